# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static equilibrium: loads as functions of one parameter, and Newton's iteration at given loads.

The equations are those of dynamics without inertia, ``s (f_internal - f_external) + G^T L = 0`` and
``Phi = 0`` with ``L = s lambda``; s is the inverse of the model's largest stiffness, so that scaled
multipliers are lengths. The trial state becomes the base of the next increment after every
iteration, so that a load step may rotate nodes by any angle.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import inf, isfinite

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.core.laws import LawKind
from flexfem.core.status import Status
from flexfem.kernels.sequence import largest_entry
from flexfem.lie import so3
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.solvers.statics.stability import Inertia
from flexfem.system.mechanics import END_POINT
from flexfem.system.moving_apart import Moved, move_apart
from flexfem.system.system import Shifts, System

__all__ = ["Equilibrium", "Limits", "Loading", "Snapshot", "settle"]

#: Laws of a node at rest: no increment is predicted, no velocity remains.
_REST, _NO_RATES, _NO_LAW = np.zeros(7), np.zeros(2), np.zeros(3)
#: Contraction above which steps below _NOISE tolerances are round-off.
_STAGNATION, _NOISE = 0.7, 1e3
#: Target rotation of the first iteration of a load step that was cut, relative to the limit.
_CUT = 0.8
#: Stiffness of a damper, which resists no displacement, relative to the largest in the model.
_DAMPER = 1e-20
#: Fraction of the loads by which they are grown at t = 0, and how often it is halved.
_SETTLING, _HALVINGS = 0.25, 12

#: Solves for the blocks' steps (stored there, to be subtracted): success, the multipliers' step
#: (to be subtracted) and the change of the load parameter (to be added).
LinearStep = Callable[[], tuple[bool, FloatArray, float]]


@dataclass(frozen=True)
class Limits:
    """Stopping criteria of a static iteration.

    Attributes:
        tolerance: largest entry of the last step: displacements and scaled multipliers relative to
            the size of the model, rotations in rad.
        max_iterations: iterations after which a load step counts as failed.
        turn: largest rotation (rad) of one iteration, above which the load step is cut.
    """

    tolerance: float = 1e-8
    max_iterations: int = 30
    turn: float = 1.0


@dataclass(frozen=True)
class Snapshot:
    """A state to be restored: frames of each block, multipliers and load parameter."""

    frames: list[FloatArray]
    multipliers: FloatArray
    t: float


class Loading:
    """Loads, drives and gravity as functions of the load parameter t.

    Loads that grow are multiplied by t; the others follow their amplitudes at time t, as drives do.

    Attributes:
        t: the present parameter.
        fraction: fraction of all loads and initial strains that acts, without drives.
        span: its end, by which steps of differences are measured.
    """

    def __init__(
        self, system: System, growing: BoolArray, gravity_grows: bool, span: float
    ) -> None:
        """Store full gravity.

        Args:
            system: system whose loads are set.
            growing: (n_loads,) loads in proportion to t.
            gravity_grows: True if gravity is in proportion to t, too.
            span: end of the parameter.
        """
        self._system, self._growing, self._gravity_grows = system, growing, gravity_grows
        self._gravity = system.gravity.copy()
        self.t, self.span, self.fraction = 0.0, span, 1.0

    def set(self, t: float, fraction: float = 1.0) -> None:
        """Set loads and drives to parameter ``t``; all but drives to a fraction of theirs."""
        system, self.fraction = self._system, fraction
        system.set_time(t)
        system.set_initial_strains(fraction)
        system.factors[self._growing] = t
        system.factors[:] *= self.fraction
        system.gravity[:] = self._gravity * (self.fraction * (t if self._gravity_grows else 1.0))
        self.t = t

    def derivative(self, shifts: Shifts) -> tuple[list[FloatArray], FloatArray]:
        """Derivative of the blocks' residuals (n_owned, width) and of the rows (r,) along t.

        Loads and gravity enter the residual linearly; their factors, the drives and initial strains
        are differentiated by differences over 1e-4 of the span, exact for proportional ones. The
        residuals of the blocks are overwritten.
        """
        system, rows, t = self._system, self._system.constraints, self.t
        step = 1e-4 * self.span
        low, high = (0.0, step) if t == 0.0 else (t - step, t + step)  # none before the start
        values, inner = [], []
        for at in (low, high):
            self.set(at, self.fraction)
            rows.evaluate(shifts.dynamics)
            values.append((system.factors.copy(), system.gravity.copy(), rows.values.copy()))
            inner.append(self.inner_forces(shifts.scale) if system.timed else [])
        self.set(t, self.fraction)
        rows.evaluate(shifts.dynamics)
        factors, gravity, by_t = (
            (after - before) / (high - low)
            for before, after in zip(values[0], values[1], strict=True)
        )
        blocks = []
        for part in system.parts:
            part.add_residual(gravity, factors, shifts.scale)
            loaded = part.block.owned_residual.copy()
            part.add_residual(np.zeros(3), np.zeros_like(factors), shifts.scale)
            blocks.append(loaded - part.block.owned_residual)
        if not system.timed:
            return blocks, by_t
        moved = zip(blocks, *inner, strict=True)
        return [block + (b - a) / (high - low) for block, a, b in moved], by_t

    def inner_forces(self, scale: float) -> list[FloatArray]:
        """Residuals (n_owned, width) of the blocks without loads."""
        found, none = [], np.zeros_like(self._system.factors)
        for part in self._system.parts:
            part.add_residual(np.zeros(3), none, scale)
            found.append(part.block.owned_residual.copy())
        return found


class Equilibrium:
    """Newton's iteration for the equilibrium of a system at rest.

    Attributes:
        system, tangent, loading: the equations to solve.
        size: of the model, m, by which displacements are measured.
        shifts: stiffness alone, with the scale of the residual.
        weights: (n_owned, width) of each block, scaled stiffness of its nodes at the start, the
            same for three directions.
        iterations: number of iterations of the last solution.
        stuck: True if the last solution failed at its first matrix, which an iterative solver could
            not solve with: that of the state before it, so that smaller steps do not help.
        cut: factor by which a failed load step is best shortened.
        room: factor by which the last load step could have been longer, by its rotations.
        inertia: counter of unstable directions.
        limits: stopping criteria.
        strains: those of each part whose stresses the next matrix uses: continued along the last
            step of an iteration, or those of the trial state.
    """

    def __init__(
        self, system: System, tangent: TangentSolver, loading: Loading, size: float,
        limits: Limits, *, conservative: bool,
    ) -> None:  # fmt: skip
        """Set all velocities to zero and choose the scale (collective).

        Args:
            system: the system, at its start.
            tangent: its exact matrix.
            loading: its loads.
            size: of the model, m.
            limits: when iterations stop.
            conservative: True if all loads have a potential, so that the matrix is symmetric.
        """
        self.system, self.tangent, self.loading = system, tangent, loading
        self.size, self.limits = size, limits
        self.iterations, self.cut, self.room, self.stuck = 0, 0.5, 1.0, False
        self.strains = system.present
        rows = system.constraints
        self._elastic = rows.elastic.copy()
        system.predict(_REST, _NO_RATES)
        self.shifts = Shifts(velocity=0.0, acceleration=0.0, scale=1.0)
        self._choose_scale()
        tangent.weights = self.weights
        self.inertia = Inertia(tangent, conservative)

    def _choose_scale(self) -> None:
        """Scale of the residual and weights; dampers and friction become very soft springs."""
        system, rows = self.system, self.system.constraints
        law, stiffness_of_row = rows.elastic[:, 0], rows.elastic[:, 1]
        rubbing = rows.frictional
        damper = rubbing | ((law == LawKind.SPRING) & (stiffness_of_row == 0.0))
        rows.elastic[rubbing, 3] = 0.0
        law[damper], stiffness_of_row[damper] = LawKind.SPRING, 1.0  # until the scale is known
        rows.elastic[:, 2] = 0.0
        loads = []
        for t in (0.0, self.loading.span):
            self.loading.set(t)
            END_POINT.evaluate(system, self.shifts)
            loads.append(max(largest_entry(p.block.residual[:, :3].ravel()) for p in system.parts))
        self.loading.set(0.0)
        # forces of laws resist motions across them, such as those of a taut cable
        pulls = rows.active & ~rows.rigid & ~damper & ~rows.of_elements
        rows.multipliers[pulls] = rows.static_forces()[pulls, 0]
        END_POINT.evaluate(system, self.shifts)
        self.assemble()
        # the stiffness of fixed unknowns has no meaning
        diagonals = [
            p.block.hold(abs(d))
            for p, d in zip(system.parts, self.tangent.diagonals(), strict=True)
        ]
        springs = stiffness_of_row[~damper & (law != LawKind.RIGID)]
        largest = np.array([
            max((float(d[:, :3].max(initial=0.0)) for d in diagonals), default=0.0),
            float(springs.max(initial=0.0)),
            np.nan_to_num(max(loads)) / self.size,
        ])  # fmt: skip
        system.comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
        stiffness = next((float(k) for k in largest if k > 0.0), 1.0)
        stiffness_of_row[damper] = _DAMPER * stiffness
        self.shifts = Shifts(velocity=0.0, acceleration=0.0, scale=1.0 / stiffness)
        rows.multipliers /= stiffness
        self.weights = [_isotropic(d / stiffness, self.size) for d in diagonals]

    @property
    def memory(self) -> FloatArray:
        """Data of earlier iterations besides the state, empty for most classes."""
        return np.empty(0)

    @memory.setter
    def memory(self, values: FloatArray) -> None:
        assert not len(values)

    def release(self) -> None:
        """Restore the dampers and springs, and the matrix's solver, for dynamics."""
        self.tangent.leave_rest()
        self.system.constraints.elastic[:] = self._elastic

    def keep(self) -> Snapshot:
        """The present state."""
        frames = [part.block.frames.copy() for part in self.system.parts]
        return Snapshot(frames, self.system.constraints.multipliers.copy(), self.loading.t)

    def restore(self, state: Snapshot) -> None:
        """Restore a state (collective)."""
        self.put_back(state)
        self.react()
        self.loading.set(state.t)
        for contacts in self.system.contacts:
            contacts.update()

    def put_back(self, state: Snapshot) -> None:
        """Set the blocks and the multipliers to those of a state."""
        self.strains = self.system.present
        for part, frames in zip(self.system.parts, state.frames, strict=True):
            part.block.frames0[:] = frames
            part.block.reset()
        self.system.constraints.multipliers[:] = state.multipliers

    def react(self) -> None:
        """Set the joints' forces to those of the trial state."""
        rows = self.system.constraints
        rows.forces[:] = rows.multipliers / self.shifts.scale

    def accept(self) -> None:
        """End a load step (collective)."""
        self.react()
        self.system.advance_histories()
        self.system.interface.update()
        self.system.constraints.accept()
        self.system.constraints.elements.settle(self.system.constraints, still=True)

    def solve(self, t: float, fraction: float = 1.0) -> Status:
        """Find the equilibrium at load parameter ``t`` from the present state (collective).

        Args:
            t: load parameter.
            fraction: fraction of all loads that acts, without drives.
        """
        self.loading.set(t, fraction)
        return self.iterate(self._newton_step)

    def iterate(self, linear_step: LinearStep) -> Status:
        """Iterate until steps are below the tolerance or round-off (collective)."""
        failed = self.system.linear.counts.failed
        status = self._iterate(linear_step)
        self.strains = self.system.present
        if status is Status.SINGULAR:
            status = self.unsolved(failed)
        self.stuck = status is Status.UNSOLVED and self.iterations == 1
        return status

    def unsolved(self, failed: int) -> Status:
        """Status of a step without a solution, by the failed iterative solves before it."""
        counts = self.system.linear.counts
        return Status.UNSOLVED if counts.failed > failed else Status.SINGULAR

    def _iterate(self, linear_step: LinearStep) -> Status:
        system, limits, previous = self.system, self.limits, inf
        self.cut = 0.5
        for self.iterations in range(1, limits.max_iterations + 1):
            END_POINT.evaluate(system, self.shifts)
            system.counters.newton_iterations += 1
            success, change, load = linear_step()
            size, turn, failed = self.measure(change, success)
            if failed:
                return Status.SINGULAR
            if self.iterations == 1:
                self.room = _CUT * limits.turn / turn if turn > 0.0 else inf
            if not (isfinite(size) and turn <= limits.turn):
                # cut the load at once: shortened steps leave stresses that fit no load
                self.cut = max(self.room, 0.1) if self.iterations == 1 else 0.5
                return Status.DIVERGED
            noise = size > _STAGNATION * previous and size <= _NOISE * limits.tolerance
            done = (size <= limits.tolerance or noise) and self._balanced()
            moved = self._advance(change, load)
            if done and moved.part == 1.0 and moved.unsettled <= 1.0:
                return Status.OK
            previous = size
        return Status.NOT_CONVERGED

    def _balanced(self) -> bool:
        """Return True if the system alone carries the loads in the last step (collective)."""
        return True

    def _advance(self, change: FloatArray, load: float) -> Moved:
        """Move by the blocks' steps, the multipliers' step and that of the load (collective)."""
        return self.move(-1.0, change, load)

    def measure(self, change: FloatArray, success: bool = True) -> tuple[float, float, bool]:
        """Size of the step in the blocks, its largest rotation (rad), True after a failure."""
        steps = [part.block.owned_step for part in self.system.parts]
        local = np.array([
            max((largest_entry(s[:, :3].ravel()) for s in steps), default=0.0),
            max((largest_entry(s[:, 3:].ravel()) for s in steps), default=0.0),
            largest_entry(change),
            0.0 if success else 1.0,
        ])  # fmt: skip
        local = np.nan_to_num(local, nan=np.inf)  # MPI's maximum does not order NaN
        self.system.comm.Allreduce(MPI.IN_PLACE, local, op=MPI.MAX)
        shift, turn, multiplier, failed = (float(x) for x in local)
        return max(shift / self.size, turn, multiplier / self.size), turn, failed > 0.0

    def largest(self, value: float) -> float:
        """Largest value on any rank (collective)."""
        return float(self.system.comm.allreduce(value, op=MPI.MAX))

    def move(self, factor: float, change: FloatArray, load: float) -> Moved:
        """Move by a multiple of the blocks' steps and the multipliers' step (collective).

        The load parameter moves by the same multiple of ``-load``. Less is taken where surfaces
        would pass through each other.
        """
        system = self.system
        self.strains = system.continued_strains(factor, thin=False)
        moved = move_apart(system, lambda: END_POINT.move(system, factor))
        for part in system.parts:
            part.block.accept(_NO_LAW, 0.0)
        system.constraints.multipliers += moved.part * factor * change
        if load:
            self.loading.set(self.loading.t - moved.part * factor * load)
        return moved

    def _newton_step(self) -> tuple[bool, FloatArray, float]:
        success, change = self.tangent.step(self.shifts, self.strains)
        return success, change, 0.0

    def assemble(self) -> None:
        """Set the tangent matrix at the trial state and :attr:`strains` (collective)."""
        self.tangent.assemble(self.shifts, self.strains)

    def turning(self) -> list[FloatArray]:
        """Blocks (n_owned, width, width): derivative of inertial force components (collective).

        Away from equilibrium only that is the symmetric second derivative of an energy; forces and
        matrix are those of the stresses of :attr:`strains`.
        """
        out = []
        END_POINT.evaluate(self.system, self.shifts, self.strains)
        for part in self.system.parts:
            residual, width = part.block.owned_residual, part.block.width
            out.append(np.zeros((len(residual), width, width)))
            out[-1][:, :3, 3:] = -so3.skew(residual[:, :3])[:, :, : width - 3]
        END_POINT.evaluate(self.system, self.shifts)
        return out


def settle(equilibrium: Equilibrium) -> Status:
    """Bring a system from its start to equilibrium under the loads at t = 0 (collective).

    The loads are applied at once if that converges, else grown from zero in adaptive steps.
    """
    start = equilibrium.keep()
    status = equilibrium.solve(0.0)
    if status is Status.OK:
        equilibrium.accept()
        return status
    reached, h = 0.0, _SETTLING
    while reached < 1.0 and not equilibrium.stuck:
        equilibrium.restore(start)
        fraction = min(reached + h, 1.0)
        status = equilibrium.solve(0.0, fraction)
        if status is Status.OK:
            equilibrium.accept()
            start, reached, h = equilibrium.keep(), fraction, min(2.0 * h, _SETTLING)
        else:
            h *= equilibrium.cut
        if h < _SETTLING * 0.5**_HALVINGS:
            break
    return status


def _isotropic(diagonal: FloatArray, size: float) -> FloatArray:
    """Weights (n, 6) of nodes from their scaled stiffness; nodes without any count as others."""
    out = np.empty_like(diagonal)
    for first, default in ((0, 1.0), (3, size * size)):
        largest = diagonal[:, first : first + 3].max(axis=1, initial=0.0)
        out[:, first : first + 3] = np.where(largest > 0.0, largest, default)[:, np.newaxis]
    return out
