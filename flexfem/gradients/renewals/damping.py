# SPDX-License-Identifier: LGPL-3.0-or-later
"""Accelerations that damping of elements ends soon, where a state is made consistent.

With the masses M and the linear damping C, ``F = (M + dt C)^-1 M`` on the constraints,
accelerations become ``(2 F - F^2) a`` (``integrators.start``), which are ``F b`` with
``b = 2 a - F a``: two parts of a renewal, each with the equations
``M s + dt C (x + s) + G^T m = 0`` and ``G s = 0`` for the change ``s = F x - x``. Forces of M and C
are odd in rates, those of stiffness and gyroscopic ones even: derivatives by positions are half the
difference between those at opposite rates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.gradients.equations.carried import Carried
from flexfem.gradients.equations.linearized import UnsolvedError
from flexfem.gradients.equations.row_jumps import RowJumps
from flexfem.gradients.equations.step_tangent import (
    POSITIONS,
    BlockVectors,
    StepTangent,
    collected,
    put_steps,
)
from flexfem.gradients.equations.values import Equations
from flexfem.gradients.renewals.renewal import AT_STATE, SINGULAR, Renewal
from flexfem.integrators.start import zero_velocities
from flexfem.system.mechanics import VISCOUS
from flexfem.system.system import MASS, Shifts, System

__all__ = ["DAMPING"]

#: Largest rates, m/s and so on, with which forces are differentiated: they are linear in them.
_LARGE = 1e3
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
        self._shifts = replace(MASS, velocity=self._dt)
        self._factor_damped()
        self._accelerations = self._begun(accelerations)
        self._changes, self._impulses = self._change(self._accelerations)
        self._ended = [a + s for a, s in zip(self._accelerations, self._changes, strict=True)]
        self._jumps = RowJumps(self._system, self._changes)
        sizes = [
            float(np.abs(x).max(initial=0.0))
            for x in (*(self._dt * own for own in self._ended), *self._changes, self._impulses)
        ]
        size = self._system.comm.allreduce(max(sizes), op=MPI.MAX)
        self._scale = _LARGE / size if size > 0.0 else 1.0
        self._sides = StepTangent(self._system), StepTangent(self._system)
        found = []
        for tangent, sign in zip(self._sides, (1.0, -1.0), strict=True):
            self._set(sign * self._scale)
            tangent.take(AT_STATE)
            found.append(collected(self._system))
        self._check([(a - b) / (2.0 * self._scale) for a, b in zip(*found, strict=True)])
        self._to_trial()
        self._factor_damped()

    def _begun(self, accelerations: BlockVectors) -> BlockVectors:
        """x, from accelerations without damping."""
        return accelerations

    def _factor_damped(self) -> None:
        """Factorise masses and damping (collective)."""
        with zero_velocities(self._system):
            self._solver.assemble(self._shifts, mechanics=VISCOUS)
        self._system.counters.mass_factorizations += 1
        if not self._solver.factor():
            raise UnsolvedError(SINGULAR)

    def _change(self, x: BlockVectors) -> Equations:
        """The change s of accelerations x, and the forces m of rows."""
        nothing = np.zeros(self._system.constraints.size)
        return self._solved([-own for own in self._damping(x)], nothing)

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

    def _check(self, found: BlockVectors) -> None:
        """Refuse damping that is not the linear one of the elements (collective).

        Raises:
            InputError: naming it.
        """
        system, forces = self._system, self._damping(self._ended)
        expected, _ = self.equations(system)
        missed = [a - b for a, b in zip(found, expected, strict=True)]
        sizes = np.array([max(np.abs(x).max(initial=0.0) for x in one) for one in (missed, forces)])
        system.comm.Allreduce(MPI.IN_PLACE, sizes, op=MPI.MAX)
        if sizes[0] > _LINEAR * sizes[1]:
            raise InputError(
                "gradient: a load jumps, or an event happens, at t = "
                f"{system.time:.6g} s, where accelerations are computed again, which has no "
                "derivatives with damping of elements besides damping of modes or of another law "
                "yet"
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
        put_steps(system, [np.zeros_like(own) for own in self._changes])
        system.add_constraint_forces(self._impulses * rows.rigid)
        return [a + b for a, b in zip(blocks, collected(system), strict=True)], rates * rows.rigid

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
        turned, _ = self._jumps.transposed(mu)
        first, second = (side.apply_transposed(z, 0.0 * mu, POSITIONS)[0] for side in self._sides)
        slowed = self._damping(z)
        for part, own, by, *moves, x in zip(
            self._system.parts, carried, self.maps, first, second, turned, slowed, strict=True
        ):
            own.q -= by.hold((moves[0] - moves[1]) / (2.0 * self._scale) + moves[2])
            own.w = own.w + own.a - by.by_increment.transposed(by.hold(x))
            own.a = np.zeros_like(own.a)
            by_q, by_v = _spun_transposed(part.block, -x)
            own.q += by.hold(by_q)
            own.v += by.hold_rates(by.by_increment.transposed(by_v))
        return z, mu

    def _ahead(
        self, carried: Sequence[Carried], targets: FloatArray, forces: FloatArray,
        changes: Equations,
    ) -> None:  # fmt: skip
        """See :class:`Renewal`."""
        q, v = [own.q for own in carried], self.local([own.v for own in carried])
        rows, nothing = self._system.constraints, np.zeros(self._system.constraints.size)
        self._to_state()
        begun = [
            own + _spun(part.block, move, rate)
            for part, own, move, rate in zip(
                self._system.parts, self.local([own.w for own in carried]), q, v, strict=True
            )
        ]
        first, second = (side.apply(q, nothing, POSITIONS)[0] for side in self._sides)
        total = [
            -(a - b) / (2.0 * self._scale) - c - d
            for a, b, c, d in zip(first, second, self._damping(begun), changes[0], strict=True)
        ]
        left = self._jumps.changes(q) + changes[1]
        found, _ = self._solved(total, -left * rows.rigid)
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
    with zero_velocities(system):
        VISCOUS.multiply_mass(system, 1.0, shifts)
    return collected(system)


def _sum(first: BlockVectors, second: BlockVectors) -> BlockVectors:
    return [a + b for a, b in zip(first, second, strict=True)]


def _spun(block: FrameBlock, twists: FloatArray, rates: FloatArray) -> FloatArray:
    """Changes (n, w) of local accelerations ``R^T w - omega x v`` by twists and local velocities.

    Without what turns with the nodes.
    """
    found = np.zeros_like(twists)
    if block.inertial and block.width == 6:
        v, omega = np.split(block.velocity[: block.owned], 2, axis=1)
        found[:, :3] = np.cross(np.cross(omega, twists[:, 3:]), v)
        found[:, :3] -= np.cross(rates[:, 3:], v) + np.cross(omega, rates[:, :3])
    return found


def _spun_transposed(block: FrameBlock, factors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Factors of twists and of local velocities in factors times :func:`_spun`."""
    by_twists, by_rates = np.zeros_like(factors), np.zeros_like(factors)
    if block.inertial and block.width == 6:
        v, omega = np.split(block.velocity[: block.owned], 2, axis=1)
        turned = np.cross(v, factors[:, :3])
        by_twists[:, 3:] = np.cross(turned, omega)
        by_rates[:, 3:] = -turned
        by_rates[:, :3] = -np.cross(factors[:, :3], omega)
    return by_twists, by_rates
