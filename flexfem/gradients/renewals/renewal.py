# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of states that are made consistent, as after a jump of loads.

Positions stay. Velocities are projected onto the constraints, ``M (v' - v) + G^T Lambda = 0`` and
``G v' + dPhi/dt = 0``, or ``-e`` times what it was with the restitution e of an impact; then
accelerations and forces of rows follow from ``M w + f + G^T L = 0`` and ``d(G v')/dt = 0``
(``integrators.start``), with the laws of forces at the state. Both are linear in what they
determine, with the symmetric matrix of masses and constraints, so that their adjoint is one more
solve with it. Derivatives by positions are those of ``gradients.equations``, with accelerations
``v' - v`` without velocities for the first equations; those of rates of rows by positions are in
``gradients.renewals.row_paths``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.constraints.elements.states import AT_REST
from flexfem.core.status import Status
from flexfem.gradients.equations.carried import Carried
from flexfem.gradients.equations.linearized import UnsolvedError
from flexfem.gradients.equations.node_maps import StepMaps
from flexfem.gradients.equations.odd_forces import AT_STATE
from flexfem.gradients.equations.step_tangent import (
    POSITIONS,
    VELOCITIES,
    BlockVectors,
    StepTangent,
    collected,
    put_steps,
)
from flexfem.gradients.equations.values import Equations, equations_at
from flexfem.gradients.renewals.row_paths import RowPaths
from flexfem.integrators.start import accelerate, drives, project_velocities, second_rates
from flexfem.solvers.linear.gmres import minimal_residual
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.system.mechanics import END_POINT
from flexfem.system.system import MASS, System

__all__ = ["SINGULAR", "Accelerations", "Projection", "Renewal"]

SINGULAR = "gradient: masses and constraints are singular where a load jumps"
#: Changes of velocities, m/s and so on, with which their effect on the equations is as large as
#: that of stiff bodies, from which it is told by a difference: it is linear in them.
_LARGE = 1e6
#: Relative accuracy of friction that follows from the forces in joints, and most iterations.
_SETTLED, _MOST = 1e-13, 60


class Renewal(ABC):
    """One of both systems of equations, linearised by :meth:`take`.

    Attributes:
        acts: True if laws, with what memories carry, act in its equations.
        maps: of all blocks at the state.
    """

    acts = False
    _paths: RowPaths
    maps: list[StepMaps]

    def __init__(
        self, system: System, solver: TangentSolver, dt: float, restitution: FloatArray
    ) -> None:
        """Store them.

        Args:
            system: the system.
            solver: of masses and constraints.
            dt: span over which drives are differentiated, s.
            restitution: (r,) factors by which rates of rows are reversed, zero but for impacts.
        """
        self._system, self._solver, self._dt = system, solver, dt
        self._restitution = restitution

    @abstractmethod
    def take(self) -> None:
        """Linearise, with the system at its accepted state and loads as they are then on."""

    @abstractmethod
    def equations(self, system: System, restitution: FloatArray | None = None) -> Equations:
        """Equations of a system at the trial state of :meth:`take` (collective).

        Args:
            system: that of the motion, or of a model like it.
            restitution: (r,) its own, None for that of the motion.
        """

    def back(
        self, carried: Sequence[Carried], targets: FloatArray, forces: FloatArray
    ) -> Equations:
        """Go back in place; returns factors of the equations (collective).

        Args:
            carried: sums for each block.
            targets: (r,) those of the targets of held rows.
            forces: (r,) those of the forces of rows behind it.
        """
        found = self._back(carried, targets, forces)
        self._to_trial()
        return found

    def ahead(
        self, carried: Sequence[Carried], targets: FloatArray, forces: FloatArray,
        changes: Equations,
    ) -> None:  # fmt: skip
        """Go ahead in place, with changes of the equations at a fixed state (collective).

        Args:
            carried: changes of each block.
            targets: (r,) those of the targets of held rows.
            forces: (r,) those of the forces of rows.
            changes: of the equations.
        """
        self._ahead(carried, targets, forces, changes)
        self._to_trial()

    @abstractmethod
    def _to_trial(self) -> None:
        """Return to the trial state of :meth:`take`."""

    @abstractmethod
    def _back(
        self, carried: Sequence[Carried], targets: FloatArray, forces: FloatArray
    ) -> Equations:
        """See :meth:`back`; the system is left at any trial state."""

    @abstractmethod
    def _ahead(
        self, carried: Sequence[Carried], targets: FloatArray, forces: FloatArray,
        changes: Equations,
    ) -> None:  # fmt: skip
        """See :meth:`ahead`; the system is left at any trial state."""

    def _factor(self) -> None:
        """Factorise masses and constraints at the trial state, whose rows are evaluated."""
        self._solver.assemble(MASS)
        self._system.counters.mass_factorizations += 1
        if not self._solver.factor():
            raise UnsolvedError(SINGULAR)

    def _solved(self, blocks: BlockVectors, rows: FloatArray) -> tuple[BlockVectors, FloatArray]:
        """Solve with them."""
        if not self._solver.solve(blocks, rows):
            raise UnsolvedError(SINGULAR)
        found = [part.block.owned_step.copy() for part in self._system.parts]
        return found, self._solver.multiplier_step.copy()

    def _undamped(self) -> BlockVectors:
        """Accelerations (n_owned, w) without damping, in local axes (collective)."""
        system = self._system
        system.constraints.multipliers[:] = 0.0
        for part in system.parts:
            part.block.acceleration[:] = 0.0
        system.interface.update()
        Renewal._factor(self)
        if not accelerate(system, self._solver, self._dt):
            raise UnsolvedError(SINGULAR)
        found = [part.block.owned_step.copy() for part in system.parts]
        self._to_state()
        return found

    def _take_maps(self) -> None:
        self.maps = [StepMaps.of(p.block, p.block.frames) for p in self._system.parts]

    def local(self, rates: Sequence[FloatArray]) -> BlockVectors:
        """Rates of increments in local axes."""
        return [by.hold(by.by_increment(x)) for by, x in zip(self.maps, rates, strict=True)]

    def _from_rates(self, sums: Sequence[FloatArray]) -> BlockVectors:
        """Sums of influences of rates of increments as those of rates in local axes."""
        return [by.hold(by.inverse.transposed(x)) for by, x in zip(self.maps, sums, strict=True)]

    def _to_rates(self, sums: Sequence[FloatArray]) -> BlockVectors:
        """The contrary."""
        return [
            by.by_increment.transposed(by.hold(x)) for by, x in zip(self.maps, sums, strict=True)
        ]

    def _to_state(self) -> None:
        """Return from any trial state to the accepted one, with its rows evaluated."""
        self._system.reset()
        self._system.constraints.elements.begin(AT_REST, exact=True)
        self._system.interface.update()
        self._system.constraints.evaluate(AT_STATE.dynamics)


class Projection(Renewal):
    """Velocities on the constraints.

    The trial state has the new velocities, their changes as accelerations, and impulses of rows as
    multipliers.
    """

    def take(self) -> None:
        """See :class:`Renewal`."""
        system, rows = self._system, self._system.constraints
        self._to_state()
        self._before = self._velocities()
        status = project_velocities(system, self._solver, self._dt, self._restitution)
        if status is not Status.OK:
            raise UnsolvedError(SINGULAR)
        self._after = self._velocities()
        self._changes = [part.block.step.copy() for part in system.parts]
        self._impulses = self._solver.multiplier_step.copy()
        self._take_maps()
        self._impact = bool(system.comm.allreduce(self._restitution.any(), op=MPI.LOR))
        if self._impact:
            self._start(self._before)
            self._paths_before = RowPaths(system, 1, rows.rates())
        self._start(self._after)
        self._paths = RowPaths(system, 1, rows.rates())
        sizes = [float(np.abs(x).max(initial=0.0)) for x in (*self._changes, self._impulses)]
        size = system.comm.allreduce(max(sizes), op=MPI.MAX)
        self._scale = _LARGE / size if size > 0.0 else 1.0
        self._still, self._moving = StepTangent(system), StepTangent(system)
        for tangent, factor in ((self._still, 0.0), (self._moving, self._scale)):
            self._set(0.0, factor)
            tangent.take(AT_STATE)
        self._to_trial()

    def _velocities(self) -> list[FloatArray]:
        return [part.block.velocity.copy() for part in self._system.parts]

    def _start(self, velocities: Sequence[FloatArray]) -> None:
        """Accept velocities, without accelerations."""
        for part, own in zip(self._system.parts, velocities, strict=True):
            part.block.velocity[:], part.block.acceleration[:] = own, 0.0
            part.block.start()
        self._to_state()

    def _set(self, speed: float, factor: float) -> None:
        """Set the trial state, with parts of the velocities and of their changes."""
        self._to_state()
        for part, own in zip(self._system.parts, self._changes, strict=True):
            part.block.velocity *= speed
            part.block.acceleration[:] = factor * own
        self._system.constraints.multipliers[:] = factor * self._impulses
        self._system.interface.update()

    def _to_trial(self) -> None:
        """See :class:`Renewal`."""
        self._set(1.0, 1.0)

    def equations(self, system: System, restitution: FloatArray | None = None) -> Equations:
        """See :class:`Renewal`."""
        rows = system.constraints
        changes = [part.block.acceleration.copy() for part in system.parts]
        system.interface.update()
        _, rates = drives(system, self._dt)
        if self._impact:
            for part, own in zip(system.parts, changes, strict=True):
                part.block.velocity -= own
            system.interface.update()
            factors = self._restitution if restitution is None else restitution
            rates += factors * drives(system, self._dt)[1]
            for part, own in zip(system.parts, changes, strict=True):
                part.block.velocity += own
            system.interface.update()
        _mass_times(system, changes)
        system.add_constraint_forces(rows.multipliers * rows.rigid)
        return collected(system), (rates - rows.relaxation * rows.multipliers) * rows.rigid

    def _back(
        self, carried: Sequence[Carried], targets: FloatArray, forces: FloatArray
    ) -> Equations:
        """See :class:`Renewal`."""
        z, mu = self._solved(
            self._from_rates([own.v for own in carried]), np.zeros(self._system.constraints.size)
        )
        turned, momenta = self._turned(mu), self._momenta(z, mu)
        with_changes, _ = self._moving.apply_transposed(z, 0.0 * mu, POSITIONS)
        without, _ = self._still.apply_transposed(z, 0.0 * mu, POSITIONS)
        for own, by, *moves, momentum in zip(
            carried, self.maps, with_changes, without, turned, momenta, strict=True
        ):
            own.q -= by.hold((moves[0] - moves[1]) / self._scale + moves[2])
            own.v = momentum
        return z, mu

    def _turned(self, mu: FloatArray) -> BlockVectors:
        """Factors of rows times derivatives of their rates by positions."""
        turned, _ = self._paths.transposed(mu)
        if self._impact:
            self._start(self._before)
            more, _ = self._paths_before.transposed(self._restitution * mu)
            turned = [a + b for a, b in zip(turned, more, strict=True)]
            self._start(self._after)
        return turned

    def _momenta(self, z: BlockVectors, mu: FloatArray) -> BlockVectors:
        """The same times derivatives by the velocities before."""
        self._to_state()
        _mass_times(self._system, z)
        self._system.add_constraint_forces(-self._restitution * mu)
        return self._to_rates([part.block.owned_residual.copy() for part in self._system.parts])

    def _ahead(
        self, carried: Sequence[Carried], targets: FloatArray, forces: FloatArray,
        changes: Equations,
    ) -> None:  # fmt: skip
        """See :class:`Renewal`."""
        q, v = [own.q for own in carried], self.local([own.v for own in carried])
        nothing, (pushes, rows) = np.zeros(self._system.constraints.size), changes
        turning = self._turning(q, v)
        with_changes, _ = self._moving.apply(q, nothing, POSITIONS)
        without, _ = self._still.apply(q, nothing, POSITIONS)
        momenta = _mass_times(self._system, v)
        total = [
            a - (b - c) / self._scale - d
            for a, b, c, d in zip(momenta, with_changes, without, pushes, strict=True)
        ]
        found, _ = self._solved(total, -(rows + turning) * self._system.constraints.rigid)
        for own, by, x in zip(carried, self.maps, found, strict=True):
            own.v = by.hold_rates(by.inverse(x))

    def _turning(self, q: BlockVectors, v: BlockVectors) -> FloatArray:
        """Changes (r,) of the rates of rows by positions, and by the velocities before."""
        nothing = [np.zeros_like(one) for one in q]
        found = self._paths.changes(q, nothing)
        if self._impact:
            self._start(self._before)
            found += self._restitution * self._paths_before.changes(q, nothing)
            self._start(self._after)
        self._to_state()
        put_steps(self._system, v)
        rows = self._system.constraints
        found += self._restitution * rows.changes(self._system.interface.steps)
        return found


class Accelerations(Renewal):
    """Accelerations and forces of rows at given velocities."""

    acts = True

    def take(self) -> None:
        """See :class:`Renewal`."""
        system, rows = self._system, self._system.constraints
        for part in system.parts:
            part.block.lead_auxiliary(part.block.accelerations, 0.0)
        self._to_state()
        self._take_maps()
        damped = bool(system.comm.allreduce(rows.damped, op=MPI.LOR))
        if damped or system.viscous():  # which may end a part of them
            put_steps(system, self._undamped())
            for part in system.parts:
                part.block.acceleration[:] = part.block.step
                part.block.start()
            self._to_state()
        rates = rows.second_rates() + _along_accelerations(system)
        self._paths = RowPaths(system, 2, rates)
        rows.elements.forget()
        self._to_trial()
        self._tangent = StepTangent(system)
        self._tangent.take(AT_STATE)
        self._couplings = rows.coupling.copy()
        self._factor()

    def _factor(self) -> None:
        """See :class:`Renewal`; friction is left to an iteration, which can be transposed."""
        self._system.constraints.coupling[:] = 0.0
        super()._factor()

    def _to_state(self) -> None:
        """See :class:`Renewal`; friction follows the forces of rows."""
        rows = self._system.constraints
        rows.multipliers[:] = rows.forces
        super()._to_state()

    def _to_trial(self) -> None:
        """See :class:`Renewal`."""
        self._to_state()

    def equations(self, system: System, restitution: FloatArray | None = None) -> Equations:
        """See :class:`Renewal`."""
        rows = system.constraints
        rows.elements.forget()
        rows.elements.begin(AT_REST, exact=True)
        blocks, laws = equations_at(system, AT_STATE)
        values, _ = drives(system, self._dt)
        rates = second_rates(system, self._dt, values) + _along_accelerations(system)
        rates -= rows.relaxation * rows.multipliers
        return blocks, np.where(rows.rigid, rates, laws)

    def _back(
        self, carried: Sequence[Carried], targets: FloatArray, forces: FloatArray
    ) -> Equations:
        """See :class:`Renewal`."""
        system, rows = self._system, self._system.constraints
        right = self._from_rates([own.a + own.w for own in carried])
        friction, normal = rows.coupled.T

        def solve(part: float, given: FloatArray) -> Equations:
            given = given + part * forces
            z, mu = self._solved([part * own for own in right], given * rows.rigid)
            put_steps(system, z)
            moves = rows.changes(system.interface.steps) - given
            laws = ~rows.rigid & (rows.compliance > 0.0)
            by_laws = np.divide(moves, rows.compliance, out=np.zeros(rows.size), where=laws)
            return z, np.where(rows.rigid, mu, by_laws)

        self._to_state()
        z, mu = self._coupled(solve, (friction, normal))
        by_laws = np.where(rows.rigid, 0.0, mu)
        mu = mu * rows.rigid
        turned, slowed = self._paths.transposed(mu)
        self._to_state()
        by_q, _ = self._tangent.apply_transposed(z, by_laws, POSITIONS)
        by_v, _ = self._tangent.apply_transposed(z, by_laws, VELOCITIES)
        for own, by, *q, v, slow in zip(
            carried, self.maps, by_q, turned, by_v, slowed, strict=True
        ):
            own.q -= by.hold(q[0] + q[1])
            own.v -= by.hold_rates(by.by_increment.transposed(v) + slow)
            own.a, own.w = np.zeros_like(own.a), np.zeros_like(own.w)
        return z, np.where(rows.rigid, mu, by_laws)

    def _ahead(
        self, carried: Sequence[Carried], targets: FloatArray, forces: FloatArray,
        changes: Equations,
    ) -> None:  # fmt: skip
        """See :class:`Renewal`."""
        q, v = [own.q for own in carried], [own.v for own in carried]
        rows, nothing = self._system.constraints, np.zeros(self._system.constraints.size)
        turning = self._paths.changes(q, v)
        self._to_state()
        by_q = self._tangent.apply(q, nothing, POSITIONS)
        by_v = self._tangent.apply(self.local(v), nothing, VELOCITIES)
        total = [-a - b - c for a, b, c in zip(changes[0], by_q[0], by_v[0], strict=True)]
        left = changes[1] + np.where(rows.rigid, turning, by_q[1] + by_v[1])
        friction, normal = rows.coupled.T

        def solve(part: float, given: FloatArray) -> Equations:
            return self._solved([part * own for own in total], given - part * left)

        found, forces[:] = self._coupled(solve, (normal, friction))
        for own, by, x in zip(carried, self.maps, found, strict=True):
            own.w = by.hold_rates(by.inverse(x))
            own.a = own.w.copy()

    def _coupled(
        self, solve: Callable[[float, FloatArray], Equations], pairs: tuple[IntArray, IntArray]
    ) -> Equations:
        """Solution of equations with right-hand sides that depend on it by friction (collective).

        Args:
            solve: solution for a part of the right-hand sides, with others of rows (r,) added.
            pairs: (k,) rows by which friction acts, and rows on which it does.
        """
        rows = self._system.constraints

        def acting(found: Equations) -> FloatArray:
            forces = np.zeros(rows.size)
            np.add.at(forces, pairs[1], self._couplings * found[1][pairs[0]])
            return forces

        def products(vectors: FloatArray, vector: FloatArray) -> FloatArray:
            found: FloatArray = vectors @ (rows.owned * vector)
            self._system.comm.Allreduce(MPI.IN_PLACE, found)
            return found

        found = solve(1.0, np.zeros(rows.size))
        first = acting(found)
        size = float(np.sqrt(products(first[np.newaxis], first)[0]))
        if size == 0.0:
            return found
        more, done = minimal_residual(
            lambda given: given - acting(solve(0.0, given)), first, size, products,
            _SETTLED * size, _MOST,
        )  # fmt: skip
        if not done:
            raise UnsolvedError(SINGULAR)
        return solve(1.0, more)


def _along_accelerations(system: System) -> FloatArray:
    """Part of the second rates (r,) of rows that the local accelerations have (collective)."""
    put_steps(
        system, [p.block.acceleration[: p.block.owned, : p.block.width] for p in system.parts]
    )
    return system.constraints.changes(system.interface.steps)


def _mass_times(system: System, steps: Sequence[FloatArray]) -> BlockVectors:
    """Masses times local twists (n_owned, w) of each block (collective)."""
    put_steps(
        system,
        [own[: p.block.owned, : p.block.width] for p, own in zip(system.parts, steps, strict=True)],
    )
    END_POINT.multiply_mass(system, 1.0)
    return collected(system)
