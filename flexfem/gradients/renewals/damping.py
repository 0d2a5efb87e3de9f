# SPDX-License-Identifier: LGPL-3.0-or-later
"""Accelerations that damping ends soon, where a state is made consistent.

With the masses M and the linear damping C, ``F = (M + dt C)^-1 M`` on the constraints,
accelerations become ``(2 F - F^2) a`` (``integrators.start``), which are ``F b`` with
``b = 2 a - F a``: two parts of a renewal, each with the equations
``M s + dt C (x + s) + G^T m = 0`` and ``G s = 0`` for the change ``s = F x - x``. C is that of
elements; stiff dampers c of joints are rows with ``G (x + s) - m / (dt c) = 0``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.core.laws import LawKind
from flexfem.gradients.equations.carried import Carried
from flexfem.gradients.equations.linearized import UnsolvedError
from flexfem.gradients.equations.odd_forces import AT_STATE, LocalRates, OddForces
from flexfem.gradients.equations.row_jumps import RowJumps
from flexfem.gradients.equations.step_tangent import (
    BlockVectors,
    collected,
    put_steps,
)
from flexfem.gradients.equations.values import Equations
from flexfem.gradients.renewals.renewal import SINGULAR, Renewal
from flexfem.integrators.stiff_dampers import StiffDampers, damping_of_rows
from flexfem.system.mechanics import VISCOUS
from flexfem.system.system import MASS, Shifts, System

__all__ = ["DAMPING"]

#: Relative difference of forces that are odd in rates from those of masses and linear damping.
_LINEAR = 1e-7


class _Damping(Renewal):
    """Accelerations ``x + factor s``.

    Attributes:
        factor: see above.
    """

    factor = 1.0

    def take(self) -> None:
        """See :class:`Renewal`."""
        self._to_state()
        self._take_maps()
        accelerations = self._undamped()
        self._dampers = StiffDampers.of(self._system, self._solver, self._dt)
        self._rows = self._system.constraints.rigid | self._dampers.chosen
        self._check_dampers()
        self._shifts = replace(MASS, velocity=self._dt)
        self._factor_damped()
        self._accelerations = self._begun(accelerations)
        self._changes, self._impulses = self._change(self._accelerations)
        self._ended = [a + s for a, s in zip(self._accelerations, self._changes, strict=True)]
        self._jumps = RowJumps(self._system, self._changes)
        self._slowed = RowJumps(self._system, self._ended)
        rates = *(self._dt * own for own in self._ended), *self._changes, self._impulses
        self._nodes = [LocalRates(part.block) for part in self._system.parts]
        self._odd = OddForces(self._system, rates, self._set)
        self._check()
        self._to_trial()
        self._factor_damped()

    def _begun(self, accelerations: BlockVectors) -> BlockVectors:
        """x, from accelerations without damping."""
        return accelerations

    def _factor_damped(self) -> None:
        """Factorise masses and damping, with the equations of stiff dampers (collective)."""
        self._dampers.use(self._system.constraints, self._dt)
        self._solver.assemble(self._shifts, mechanics=VISCOUS)
        self._system.counters.mass_factorizations += 1
        if not self._solver.factor():
            raise UnsolvedError(SINGULAR)

    def _change(self, x: BlockVectors) -> Equations:
        """The change s of accelerations x, and the forces m of rows."""
        put_steps(self._system, x)
        rows = self._system.constraints
        rates = rows.changes(self._system.interface.steps) * self._dampers.chosen
        return self._solved([-own for own in self._damping(x)], -rates)

    def _damping(self, rates: BlockVectors) -> BlockVectors:
        """``dt C`` times local vectors (collective)."""
        both = (_times(self._system, shifts, rates) for shifts in (self._shifts, MASS))
        return [a - b for a, b in zip(*both, strict=True)]

    def _set(self, factor: float) -> None:
        """Set the trial state to a multiple of the rates."""
        self._to_state()
        put_steps(self._system, self._ended)
        for part in self._system.parts:
            part.block.velocity[:] = factor * self._dt * part.block.step
        put_steps(self._system, self._changes)
        for part in self._system.parts:
            part.block.acceleration[:] = factor * part.block.step
        self._system.constraints.multipliers[:] = factor * self._impulses
        self._system.interface.update()

    def _check_dampers(self) -> None:
        """Refuse dampers whose force is not linear in the rate (collective).

        Raises:
            InputError: naming one.
        """
        rows = self._system.constraints
        odd = self._dampers.chosen & (rows.elastic[:, 0] != LawKind.SPRING)
        found = rows.joint_of_row[odd]
        names = self._system.comm.allgather(rows.joints[found[0]].joint.owner if len(found) else "")
        if name := max(names):
            raise InputError(
                f"gradient: a load jumps, or an event happens, at t = {self._system.time:.6g} s, "
                f"where the damping of {name} ends accelerations within a step; this has "
                "derivatives for linear dampers alone"
            )

    def _check(self) -> None:
        """Refuse damping that is not the linear one of the elements (collective).

        Raises:
            InputError: naming it.
        """
        system, forces = self._system, self._damping(self._ended)
        if not system.viscous():
            return
        expected, _ = self.equations(system)
        missed = [a - b for a, b in zip(self._odd.values, expected, strict=True)]
        sizes = np.array([max(np.abs(x).max(initial=0.0) for x in one) for one in (missed, forces)])
        system.comm.Allreduce(MPI.IN_PLACE, sizes, op=MPI.MAX)
        if sizes[0] > _LINEAR * sizes[1]:
            raise InputError(
                "gradient: a load jumps, or an event happens, at t = "
                f"{system.time:.6g} s, where accelerations are computed again, which has no "
                "derivatives with damping of elements besides that of another law yet"
            )

    def _to_trial(self) -> None:
        """See :class:`Renewal`."""
        self._to_state()

    def equations(self, system: System, restitution: FloatArray | None = None) -> Equations:
        """See :class:`Renewal`."""
        rows = system.constraints
        system.interface.update()
        rows.evaluate(AT_STATE.dynamics, elements=False)
        blocks = self._forces(system)
        put_steps(system, self._changes)
        rates = rows.changes(system.interface.steps) - rows.relaxation * self._impulses
        put_steps(system, self._ended)
        slowed = rows.changes(system.interface.steps)
        chosen, coefficients = self._dampers.chosen, self._dt * damping_of_rows(rows)
        slowed[chosen] -= self._impulses[chosen] / coefficients[chosen]
        put_steps(system, [np.zeros_like(own) for own in self._changes])
        system.add_constraint_forces(self._impulses * self._rows)
        values = np.where(chosen, slowed, rates * rows.rigid)
        return [a + b for a, b in zip(blocks, collected(system), strict=True)], values

    def _forces(self, system: System) -> BlockVectors:
        """``M s + dt C (x + s)`` of a system at the trial state (collective)."""
        changes, ended = self._changes, self._ended
        slowed = [s - f for s, f in zip(changes, ended, strict=True)]
        return _sum(_times(system, MASS, slowed), _times(system, self._shifts, ended))

    def _back(
        self, carried: Sequence[Carried], targets: FloatArray, forces: FloatArray
    ) -> Equations:
        """See :class:`Renewal`."""
        right = self._from_rates([self.factor * (own.a + own.w) for own in carried])
        z, mu = self._solved(right, np.zeros(self._system.constraints.size))
        self._to_state()
        stiff = self._dampers.chosen
        turned, _ = self._jumps.transposed(np.where(stiff, 0.0, mu))
        of_dampers, forces_back = self._slowed.transposed(np.where(stiff, mu, 0.0))
        turned = [a + b for a, b in zip(turned, of_dampers, strict=True)]
        moves, slowed = self._odd.transposed(z), self._damping(z)
        slowed = [a + b for a, b in zip(slowed, forces_back, strict=True)]
        for own, by, nodes, *q, x in zip(
            carried, self.maps, self._nodes, moves, turned, slowed, strict=True
        ):
            spun, v, w = nodes.transposed(-x)
            own.q += by.hold(spun - q[0] - q[1])
            own.v += by.hold_rates(v)
            own.w, own.a = own.w + own.a + by.hold_rates(w), np.zeros_like(own.a)
        return z, mu

    def _ahead(
        self, carried: Sequence[Carried], targets: FloatArray, forces: FloatArray,
        changes: Equations,
    ) -> None:  # fmt: skip
        """See :class:`Renewal`."""
        q = [own.q for own in carried]
        self._to_state()
        begun = [
            nodes.changes(own.q, own.v, own.w)
            for nodes, own in zip(self._nodes, carried, strict=True)
        ]
        total = [
            -(a + b + c)
            for a, b, c in zip(self._odd.changes(q), self._damping(begun), changes[0], strict=True)
        ]
        stiff = self._dampers.chosen
        left = np.where(stiff, self._slowed.changes(q, begun), self._jumps.changes(q)) + changes[1]
        found, _ = self._solved(total, -left * self._rows)
        for own, by, x in zip(carried, self.maps, found, strict=True):
            own.w = own.w + self.factor * by.hold_rates(by.inverse(x))
            own.a = own.w.copy()


class Doubled(_Damping):
    """Accelerations ``2 a - F a``."""

    factor = -1.0


class Damped(_Damping):
    """Accelerations ``F b`` of those."""

    def _begun(self, accelerations: BlockVectors) -> BlockVectors:
        """See :class:`_Damping`."""
        changes, _ = self._change(accelerations)
        return [a - s for a, s in zip(accelerations, changes, strict=True)]


#: One after the other.
DAMPING: Sequence[type[Renewal]] = (Doubled, Damped)


def _times(system: System, shifts: Shifts, rates: BlockVectors) -> BlockVectors:
    """Masses, with damping as ``shifts`` say, times local vectors (collective)."""
    put_steps(system, rates)
    VISCOUS.multiply_mass(system, 1.0, shifts)
    return collected(system)


def _sum(first: BlockVectors, second: BlockVectors) -> BlockVectors:
    return [a + b for a, b in zip(first, second, strict=True)]
