# SPDX-License-Identifier: LGPL-3.0-or-later
"""Generalized-alpha method for independent velocities, without multipliers.

Only as many velocities are integrated as there are degrees of freedom, by the formulas of Chung and
Hulbert (1993) as in ``generalized_alpha``; all others follow from the constraints, which are
satisfied by positions, velocities and accelerations at the end of every step, and the equations of
motion are those along the independent motions (see ``flexfem.solvers.independent_motions``). An
ordinary differential equation is solved: the stability of the scheme does not depend on the
constraints, and multipliers, computed on request, are as accurate as accelerations.

Coordinate partitioning: R. A. Wehage, E. J. Haug, J. Mech. Des. 104 (1982) 247-255, here with
the null space of the constraints at the start of the step instead of chosen coordinates, as N.
K. Mani, E. J. Haug, K. E. Atkinson, J. Mech., Trans., and Automation 107 (1985) 82-87.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import ClassVar

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.state import State
from flexfem.core.status import Status
from flexfem.integrators.ended_accelerations import count_ended, ended_state, restore_ended
from flexfem.integrators.generalized_alpha import GeneralizedAlpha, predict_step, step_laws
from flexfem.integrators.integrator import Integrator, discard, predictions
from flexfem.integrators.split.step import Split
from flexfem.integrators.start import drives, second_rates
from flexfem.solvers.independent_motions import IndependentMotions
from flexfem.solvers.newton.policy import Policy
from flexfem.system.mechanics import END_POINT, EndPoint, Mechanics
from flexfem.system.moving_apart import move_apart
from flexfem.system.system import Shifts, System

__all__ = ["IndependentCoordinates"]

#: Largest number of unknowns of all bodies, since matrices are dense.
LARGEST = 2500
#: Iterations of a step; those of one with contacts, which open and close; those of the projection
#: of positions; gap that counts as zero.
_ITERATIONS, _TOUCHING, _CLOSING, _GAP = 25, 60, 10, 1e-14
#: Contraction of the iteration above which the matrix is renewed.
_SLOW = 0.2
_DIVERGENCE = 1e3


class IndependentCoordinates(Integrator):
    """The scheme for systems of up to 2500 unknowns.

    Attributes:
        scheme: its coefficients.
    """

    order: ClassVar[int] = 2

    def __init__(self, rho_inf: float = 0.9) -> None:
        """Store the spectral radius at infinite frequency.

        Raises:
            ValueError: it lies outside [0, 1].
        """
        self.scheme = self._usual = GeneralizedAlpha(rho_inf)
        self._motions: IndependentMotions | None = None

    def prepare(self, system: System) -> None:
        """See :meth:`Integrator.prepare`.

        Raises:
            InputError: the system is too large for dense matrices.
        """
        if system.unknowns > LARGEST:
            raise InputError(
                f"the integrator independent_coordinates works with dense matrices: "
                f"{system.unknowns} unknowns are more than {LARGEST}"
            )
        self._motions = IndependentMotions(system)
        self._usual.prepare(system)

    @property
    def turn_limit(self) -> float:
        """See :attr:`Integrator.turn_limit`."""
        return self._usual.turn_limit

    @property
    def mechanics(self) -> Mechanics:
        """See :attr:`Integrator.mechanics`."""
        return END_POINT

    def state(self, system: System) -> State:
        """See :meth:`Integrator.state`."""
        return ended_state(system)

    def restore(self, system: System, state: State) -> None:
        """See :meth:`Integrator.restore`."""
        restore_ended(system, state)

    def shifts(self, h: float) -> Shifts:
        """See :meth:`Integrator.shifts`."""
        return self.scheme.shifts(h)

    def solve(self, system: System, policy: Policy, h: float) -> Status:
        """See :meth:`Integrator.solve`."""
        assert self._motions is not None
        laws, start, split = step_laws(self.scheme.rho_inf, h), system.time, self.scheme.split
        if split is not None and not split.begin(h, self.scheme.weight, self.scheme.unseen):
            return Status.SINGULAR
        system.interface.update()
        system.constraints.evaluate(laws.shifts.dynamics)
        if not self._motions.begin():
            return Status.SINGULAR
        system.set_time(start + h)
        equations = END_POINT if split is None else split
        step = _Step(system, self._motions, laws.shifts, h, policy.tolerance, equations)
        status = Status.DIVERGED
        for restart in predictions(system, partial(predict_step, system, laws, split)):
            if split is None:
                status = step.solve()
            else:
                status = self._split(system, split, step, restart, h)
            if status is Status.OK:
                return status
        discard(system, start)
        return status

    def _split(
        self, system: System, split: Split, step: "_Step", restart: Callable[[], None], h: float
    ) -> Status:
        """Solve a step with impulses, see ``integrators.split.step`` (collective)."""
        scheme, rows = self.scheme, system.constraints

        def kick(block: FrameBlock) -> None:
            block.kick_rates(h, scheme.unseen, -scheme.weight / h)

        status = split.solve(self.shifts(h), step.solve, restart, kick)
        if status is Status.OK and split.kicking and scheme.unseen != 0.0:
            multipliers = rows.multipliers.copy()
            if not step.rates():
                status = Status.DIVERGED
            rows.multipliers[:] = multipliers
        return status

    def error(self, system: System, policy: Policy, h: float) -> float:
        """See :meth:`Integrator.error`; the estimate is that of the generalized-alpha method."""
        assert self._motions is not None
        scheme, motions = self.scheme, self._motions
        laws = step_laws(scheme.rho_inf, h)
        constant = 1.0 / 6.0 - scheme.beta - 0.5 * (scheme.alpha_m - scheme.alpha_f)
        for part in system.parts:
            part.block.jump_to_step(laws.accept, constant * h * h)
        END_POINT.multiply_mass(system, laws.shifts.acceleration * laws.shifts.scale)
        residual = motions.project(motions.of_nodes("residual"))
        step, _ = motions.solve(residual, np.zeros(len(motions.rigid)))
        motions.to_steps(step)
        return system.largest_step()

    def begin_parts(self, system: System) -> Integrator:
        """See :meth:`Integrator.begin_parts`."""
        self.scheme = self._usual.begin_parts(system)
        return self

    def end_parts(self, system: System, before: Sequence[FloatArray], ratio: float) -> None:
        """See :meth:`Integrator.end_parts`."""
        self.scheme = self._usual
        self.scheme.end_parts(system, before, ratio)

    def accept(self, system: System, h: float) -> None:
        """See :meth:`Integrator.accept`.

        The acceleration-like variable a is updated by ``(1 - alpha_m) a + alpha_m a0 =
        (1 - alpha_f) w + alpha_f w0`` from the accelerations w, which satisfy the constraints.
        """
        scheme, rows = self.scheme, system.constraints
        count_ended(system)
        old = [
            {name: values.copy() for name, values in part.block.state().items()}
            for part in system.parts
        ]
        if scheme.split is None:
            np.divide(rows.multipliers, self.shifts(h).scale, out=rows.forces)
        else:
            scheme.split.accept(self.shifts(h))
        system.take()
        for part, before in zip(system.parts, old, strict=True):
            now = part.block.state()
            total = (1.0 - scheme.alpha_f) * now["acceleration"]
            total += scheme.alpha_f * before["acceleration"] - scheme.alpha_m * before["auxiliary"]
            now["auxiliary"][:] = total / (1.0 - scheme.alpha_m)
        if scheme.split is not None:
            scheme.split.accepted()


class _Step:
    """One step from the predicted state."""

    def __init__(
        self, system: System, motions: IndependentMotions, shifts: Shifts, h: float,
        tolerance: float, equations: EndPoint,
    ) -> None:  # fmt: skip
        self._system, self._motions, self._equations = system, motions, equations
        self._shifts, self._h, self._tolerance = shifts, h, tolerance

    def solve(self) -> Status:
        """Iterate until steps are below the tolerance; the state then satisfies the constraints."""
        system, motions, rows = self._system, self._motions, self._system.constraints
        size, previous, renew, settled = np.inf, np.inf, True, False
        for _ in range(_TOUCHING if system.contacts else _ITERATIONS):
            if not (self._close() and self.rates()):
                return Status.DIVERGED
            residual = self._evaluate()
            if not np.isfinite(residual).all():
                return Status.DIVERGED
            if size <= self._tolerance and settled:
                return Status.OK
            system.counters.newton_iterations += 1
            if renew and not motions.factor(self._shifts):
                return Status.SINGULAR
            step, laws = motions.solve(motions.project(residual), motions.of_rows(rows.values))
            previous, size = size, float(max(np.abs(step).max(), np.abs(laws).max(initial=0.0)))
            if not np.isfinite(size) or size > _DIVERGENCE:
                return Status.DIVERGED
            renew = size > _SLOW * previous and size > self._tolerance
            part, settled = self._move(-step)
            rows.multipliers -= part * motions.to_rows(laws)
        return Status.NOT_CONVERGED

    def _move(self, motion: FloatArray) -> tuple[float, bool]:
        """Move by (n,), or a part, without contact; part, and True if it settles (collective)."""
        system = self._system
        self._motions.to_steps(motion)
        moved = move_apart(system, lambda: END_POINT.move(system, 1.0))
        return moved.part, moved.part == 1.0 and moved.unsettled <= 1.0

    def _close(self) -> bool:
        """Project positions onto the constraints along the dependent motions (collective)."""
        system, motions, rows = self._system, self._motions, self._system.constraints
        before = np.inf
        for _ in range(_CLOSING):
            system.interface.update()
            rows.evaluate(self._shifts.dynamics)
            gaps = motions.of_rows(rows.values * rows.rigid)
            gap = float(np.abs(gaps).max(initial=0.0))
            if not motions.look():
                return False
            if gap <= _GAP or gap >= 0.5 * before:
                return gap <= self._tolerance
            before = gap
            self._move(-motions.follow(gaps))
        return gap <= self._tolerance

    def rates(self) -> bool:
        """Compute dependent velocities and accelerations from the constraints (collective)."""
        system, motions, rows = self._system, self._motions, self._system.constraints
        system.interface.update()
        driven = np.array([placed.joint.driven for placed in rows.joints], dtype=np.bool_)
        moving = bool((driven[rows.joint_of_row] & rows.rigid & ~rows.held).any())
        values: list[FloatArray] = []
        if system.comm.allreduce(moving):
            values, rates = drives(system, self._h)
        else:
            rates = rows.rates()
        self._add("velocity", rates)
        system.interface.update()
        second = second_rates(system, self._h, values) if values else rows.second_rates()
        rows.evaluate(self._shifts.dynamics)
        along = motions.along_rows(motions.of_nodes("acceleration"))
        self._add("acceleration", second, along)
        return True

    def _add(self, kind: str, rates: FloatArray, more: FloatArray | float = 0.0) -> None:
        """Correct velocities or accelerations so that rates of the rigid rows vanish."""
        motions, rows = self._motions, self._system.constraints
        motions.to_steps(-motions.follow(motions.of_rows(rates * rows.rigid) + more))
        for part in self._system.parts:
            values: FloatArray = getattr(part.block, kind)
            values += part.block.step

    def _evaluate(self) -> FloatArray:
        """Residual (n,) with the forces of all rows; those of rigid rows balance it (collective).

        The rest is along the independent motions.
        """
        system, motions, rows = self._system, self._motions, self._system.constraints
        rigid = rows.rigid
        rows.multipliers[rigid] = 0.0
        self._equations.evaluate(system, self._shifts)
        residual = motions.of_nodes("residual")
        rows.multipliers[rigid] = motions.to_rows(motions.multipliers(residual))[rigid]
        return residual
