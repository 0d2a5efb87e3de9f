# SPDX-License-Identifier: LGPL-3.0-or-later
"""A step of the Lie-group generalized-alpha method, linearised.

With the sums ``qb, vb, ab, wb`` of all later influences of configurations, rates, acceleration-like
variables and accelerations, backwards over a step with ``b = (1 - alpha_m)/(1 - alpha_f)``, ``cv =
gamma/(beta h)``, ``cw = b/(beta h^2)``, the increment n and the maps E and F of
``gradients.equations.node_maps``:

1. ``r = qb + F^-T (h gamma vb + ab + b wb) / (beta h^2)``;
2. the transposed linearised equations give z and mu, with the residual e of their first row;
3. a gradient by parameters p loses ``z^T dF/dp + mu^T dPhi/dp``;
4. ``v' = vb - F^T V^T z / cv`` and ``w' = wb - F^T W^T z / cw`` with the matrices of
   ``gradients.equations.step_tangent``, ``nb = F^T e - (h gamma v' + ab + b w') / (beta h^2)``;
5. ``qb = E^T F^-T nb``, ``vb = h nb + v'``,
   ``ab = h^2 (1/2 - beta) nb + h (1 - gamma) v' + alpha_m/(1 - alpha_f) w'``,
   ``wb = -alpha_f/(1 - alpha_f) w'``.

Stationarity in the acceleration-like variable takes the place of products with the stiffness in
step 5; the residual e, divided by ``beta h^2`` there, must be carried, else solutions to 1e-6 give
gradients to 1e-3 only. Compare Sonneville, Brüls, Multibody Syst. Dyn. 31 (2014) 47-67, and Lauss,
Oberpeilsteiner, Steiner, Nachbagauer, Multibody Syst. Dyn. 42 (2018) 431-464.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.core.differences import STENCIL
from flexfem.core.nodes.prediction import Prediction
from flexfem.gradients.equations.carried import Carried
from flexfem.gradients.equations.linearized import LinearizedStep
from flexfem.gradients.equations.node_maps import StepMaps, increments_between
from flexfem.gradients.equations.step_tangent import (
    ACCELERATIONS,
    POSITIONS,
    STEP,
    VELOCITIES,
    BlockVectors,
    StepTangent,
)
from flexfem.gradients.equations.unilateral import StateChange
from flexfem.gradients.equations.values import (
    Equations,
    copy_state,
    equations_at,
)
from flexfem.gradients.memory.base import StepEnd
from flexfem.gradients.schemes.base import SIZE, Ahead, Recursion, SizeChange, States, StoppedError
from flexfem.gradients.unilateral.forces import unilateral_forces
from flexfem.integrators.generalized_alpha import GeneralizedAlpha, StepLaws, step_laws
from flexfem.integrators.integrator import Integrator
from flexfem.simulation.motion.stepping import Simulation
from flexfem.system.mechanics import END_POINT, EndPoint
from flexfem.system.system import Shifts

__all__ = ["AlphaRecursion", "AlphaSteps", "alpha_of"]


@dataclass(frozen=True)
class _Coefficients:
    """Coefficients of a step of size ``h``, see ``integrators.generalized_alpha``."""

    h: float
    beta: float
    gamma: float
    alpha_m: float
    alpha_f: float

    @property
    def square(self) -> float:
        """``beta h^2``, s^2."""
        return self.beta * self.h**2

    @property
    def share(self) -> float:
        """``(1 - alpha_m)/(1 - alpha_f)``."""
        return (1.0 - self.alpha_m) / (1.0 - self.alpha_f)

    @property
    def by_velocity(self) -> float:
        """``gamma/(beta h)``, 1/s."""
        return self.gamma / (self.beta * self.h)

    @property
    def by_acceleration(self) -> float:
        """Derivative of accelerations by increments, 1/s^2."""
        return self.share / self.square


class AlphaRecursion(Recursion):
    """See :class:`flexfem.gradients.schemes.base.Recursion`."""

    def __init__(
        self, step: int, equations: tuple[LinearizedStep, StepTangent], maps: list[StepMaps],
        taken: tuple[GeneralizedAlpha, float],
    ) -> None:  # fmt: skip
        """Store a step, with its equations, maps of all blocks, its scheme and its size, s."""
        self.step, self.maps = step, maps
        self.linear, self._tangent = equations
        one, h = taken
        self._one = _Coefficients(h, one.beta, one.gamma, one.alpha_m, one.alpha_f)

    # -- Back -----------------------------------------------------------------------------------

    def arrive(self, carried: Sequence[Carried], memories: Sequence[BlockVectors] | None) -> None:
        """See :class:`flexfem.gradients.schemes.base.Recursion`."""
        for k, (own, by) in enumerate(zip(carried, self.maps, strict=True)):
            q = by.axes.transposed(own.q)
            if memories is not None:
                by_position, by_rate = (blocks[k] for blocks in memories)
                q += by_position
                own.v += by.by_increment.transposed(by_rate) / self._one.by_velocity
            own.q = by.hold(q)
            own.v, own.a, own.w = (by.hold_rates(x) for x in (own.v, own.a, own.w))

    def back(
        self, carried: Sequence[Carried], rows: FloatArray, guess: FloatArray | None,
        accuracy: float | None,
    ) -> FloatArray:  # fmt: skip
        """See :class:`flexfem.gradients.schemes.base.Recursion`."""
        right, linear = [], self.linear
        for own, by in zip(carried, self.maps, strict=True):
            rates = by.inverse.transposed(self._rates_of(own)) / self._one.square
            right.append(by.hold(own.q + rates))
        solution, missed = linear.solve(
            right, rows, transposed=True, guess=guess, accuracy=accuracy
        )
        z, mu = linear.parts(solution)
        by_velocity, _ = self._tangent.apply_transposed(z, mu, VELOCITIES)
        by_acceleration, _ = self._tangent.apply_transposed(z, mu, ACCELERATIONS)
        for own, by, e, dv, dw in zip(
            carried, self.maps, missed, by_velocity, by_acceleration, strict=True
        ):
            self._back(own, by, by.hold(e), (dv, dw))
        for forces in self._tangent.forces:
            start = forces.start_transposed(z, mu)
            for own, twists, rates in zip(carried, start.twists, start.rates, strict=True):
                own.q -= twists
                own.v -= rates
        return solution

    def _rates_of(self, own: Carried) -> FloatArray:
        """Influences by rates of the acceleration-like variable times ``beta h^2``."""
        one = self._one
        found: FloatArray = one.h * one.gamma * own.v + own.a + one.share * own.w
        return found

    def _back(
        self, own: Carried, by: StepMaps, missed: FloatArray, changes: tuple[FloatArray, ...]
    ) -> None:
        """Carry the sums of one block over the step."""
        one, F = self._one, by.by_increment
        v = own.v - F.transposed(changes[0]) / one.by_velocity
        w = own.w - F.transposed(changes[1]) / one.by_acceleration
        n = F.transposed(missed)
        n -= self._rates_of(Carried(own.q, v, own.a, w)) / one.square
        over = 1.0 / (1.0 - one.alpha_f)
        own.q = by.before.transposed(by.inverse.transposed(n))
        own.v = one.h * n + v
        own.a = one.h**2 * (0.5 - one.beta) * n + one.h * (1.0 - one.gamma) * v
        own.a += one.alpha_m * over * w
        own.w = -one.alpha_f * over * w

    # -- Ahead ----------------------------------------------------------------------------------

    def ahead(
        self, carried: Sequence[Carried], changes: Equations,
        size: tuple[SizeChange, float] | None, beside: Sequence[Equations] = (),
    ) -> Ahead:  # fmt: skip
        """See :class:`flexfem.gradients.schemes.base.Recursion`."""
        linear = self.linear
        predicted = [self._predicted(x, by) for x, by in zip(carried, self.maps, strict=True)]
        solution, _ = linear.solve(*self._left(carried, predicted, changes))
        found, multipliers = linear.parts(solution)
        return self._after(predicted, (found, found), multipliers, size)

    def _after(
        self, predicted: Sequence[Carried], moved: tuple[BlockVectors, BlockVectors],
        multipliers: FloatArray, size: tuple[SizeChange, float] | None,
    ) -> Ahead:  # fmt: skip
        """Changes at the end of the step.

        Args:
            predicted: see :meth:`_predicted`.
            moved: by how much more positions change, and the part of it that is integrated from
                rates.
            multipliers: (r,) changes of those of the rows.
            size: see :meth:`ahead`.
        """
        one, after = self._one, list[Carried]()
        moves: tuple[BlockVectors, BlockVectors] = [], []
        for own, by, x, y in zip(predicted, self.maps, *moved, strict=True):
            a = by.inverse(y) / one.square
            q = own.q + x
            v, w = own.v + one.h * one.gamma * a, own.w + one.share * a
            if size is not None:
                v, a, w = (
                    x + size[1] * y
                    for x, y in zip((v, a, w), size[0].rates[len(after)], strict=True)
                )
            v, a, w = (by.hold_rates(y) for y in (v, a, w))
            after.append(Carried(by.axes(q), v, a, w))
            moves[0].append(q)
            moves[1].append(by.by_increment(v) / one.by_velocity)
        return Ahead(after, multipliers, moves)

    def _predicted(self, own: Carried, by: StepMaps) -> Carried:
        """Changes of one block at a fixed acceleration-like variable."""
        one, over = self._one, 1.0 / (1.0 - self._one.alpha_f)
        n = one.h * own.v + one.h**2 * (0.5 - one.beta) * own.a
        q = by.hold(by.before(own.q) + by.by_increment(n))
        v = own.v + one.h * (1.0 - one.gamma) * own.a
        w = over * (one.alpha_m * own.a - one.alpha_f * own.w)
        return Carried(q, v, own.a, w)

    def _left(
        self, carried: Sequence[Carried], predicted: Sequence[Carried], changes: Equations
    ) -> Equations:
        """Right-hand sides of the equations (collective)."""
        one, tangent = self._one, self._tangent
        nothing = np.zeros_like(changes[1])
        start = StateChange([own.q for own in carried], [own.v for own in carried])
        by_start, rows_by_start = tangent.by_start(start)
        total = [-(a + b) for a, b in zip(changes[0], by_start, strict=True)]
        left = -(changes[1] + rows_by_start)
        for matrix, vectors in (
            (POSITIONS, [own.q for own in predicted]),
            (VELOCITIES, [
                by.by_increment(own.v) / one.by_velocity
                for own, by in zip(predicted, self.maps, strict=True)
            ]),
            (ACCELERATIONS, [
                by.by_increment(own.w) / one.by_acceleration
                for own, by in zip(predicted, self.maps, strict=True)
            ]),
        ):  # fmt: skip
            blocks, own_rows = tangent.apply(vectors, nothing, matrix)
            total = [a - b for a, b in zip(total, blocks, strict=True)]
            left = left - own_rows
        return total, left


class AlphaSteps:
    """See :class:`flexfem.gradients.schemes.base.Steps`."""

    matrices: ClassVar[Sequence[int]] = (POSITIONS, STEP)

    def __init__(self, motion: States) -> None:
        """Store the motion."""
        self._motion, self.stored = motion, motion.system
        self._tangent: StepTangent | None = None

    @property
    def from_start(self) -> bool:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        system = self._motion.system
        acting = bool(system.contacts) or system.constraints.split
        return bool(self._motion.memories.parts) or acting

    def begin(self, simulation: Simulation) -> None:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        one = alpha_of(simulation.integrator)
        _begin(one, one, simulation.options.dt)
        if one.split is not None and one.split.lacking:
            raise InputError(
                "gradient: bodies touch at the start, which has no derivatives with damping of "
                "elements yet; move them apart"
            )

    def laws(self, step: int) -> StepLaws:
        """Coefficients of a step."""
        taken = self._motion.grid.step(step)
        return step_laws(alpha_of(taken.scheme).rho_inf, taken.h)

    def shifts(self, step: int) -> Shifts:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        return self.laws(step).shifts

    def mechanics(self, step: int) -> EndPoint:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        return alpha_of(self._motion.grid.step(step).scheme).split or END_POINT

    def end(self, step: int) -> StepEnd:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        laws = self.laws(step)
        return StepEnd(step, laws.shifts, laws.states, self.mechanics(step))

    def size_change(self, over: Recursion) -> SizeChange:
        """See :class:`flexfem.gradients.schemes.base.Steps`.

        Equations depend on the size at fixed increments n by the rates ``v(n; h)``, ``w(n; h)``,
        linearly.
        """
        motion = self._motion
        taken, shifts = motion.grid.step(over.step), self.shifts(over.step)
        laws = np.zeros(10)
        for place, weight in STENCIL:
            h = taken.h * (1.0 + place * SIZE)
            own = step_laws(alpha_of(taken.scheme).rho_inf, h)
            plain = own.predict[0]  # whose increments are zero
            values = np.concatenate([plain[2:], own.rates, own.accept])
            laws += weight / (SIZE * taken.h) * values
        found, velocities, accelerations = [], list[FloatArray](), list[FloatArray]()
        for part, by in zip(motion.system.parts, over.maps, strict=True):
            block = part.block
            state = motion.state(over.step - 1).rows[block.name]
            own_nodes = np.s_[: block.owned, : block.width]
            names = "velocity", "auxiliary", "acceleration"
            v0, a0, w0 = (state[name][own_nodes] for name in names)
            n = block.increment[own_nodes]
            v = laws[0] * v0 + laws[1] * a0 + laws[5] * n
            w = laws[2] * v0 + laws[3] * a0 + laws[4] * w0 + laws[6] * n
            a = laws[7] * n + laws[8] * v0 + laws[9] * a0
            found.append(np.array([by.hold_rates(x) for x in (v, a, w)]))
            velocities.append(by.by_increment(found[-1][0]) / shifts.velocity)
            accelerations.append(by.by_increment(found[-1][2]) / shifts.acceleration)
        nothing = np.zeros(motion.system.constraints.size)
        tangent = over.linear.tangent
        by_v = tangent.apply(velocities, nothing, VELOCITIES)
        by_w = tangent.apply(accelerations, nothing, ACCELERATIONS)
        # redundant constraints yield to forces, which are those of the step over its scale
        rows = motion.system.constraints
        yielding = 2.0 / taken.h * rows.relaxation * rows.multipliers * rows.rigid
        return SizeChange(found, (_sum(by_v[0], by_w[0]), by_v[1] + by_w[1] - yielding))

    def at_time(self, step: int, later: float) -> Equations:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        self._motion.system.set_time(float(self._motion.times[step]) + later)
        return equations_at(self._motion.system, self.shifts(step))

    def recall(self, step: int) -> None:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        self._recall(alpha_of(self._motion.grid.step(step).scheme), step)

    def _recall(self, scheme: GeneralizedAlpha, step: int) -> None:
        if scheme.split is not None:
            size = self._motion.lacking(step)
            scheme.split.recall_damping(size, lacking=size > 0.0)

    def _begin(self, simulation: Simulation, step: int) -> EndPoint:
        """Begin a step at the accepted state of a model; its equations (collective)."""
        taken, scheme = self._motion.grid.step(step), alpha_of(simulation.integrator)
        self._recall(scheme, step)
        _begin(scheme, alpha_of(taken.scheme), taken.h)
        return scheme.split or END_POINT

    def recover(self, step: int) -> None:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        motion, laws = self._motion, self.laws(step)
        system, rows = motion.system, motion.system.constraints
        self._begin(motion.simulation, step)
        system.set_time(motion.times[step])
        system.predict(laws.predict[Prediction.REST], laws.rates)
        rows.elements.forget()
        rows.elements.begin(laws.states, exact=True)
        state = motion.state(step).rows
        for part in system.parts:
            block = part.block
            ends = state[block.name]["frames"]
            block.increment[:] = increments_between(block.frames0, ends, inertial=block.inertial)
            block.increment[:, block.width :] = 0.0  # axes are rotated between steps only
            block.step[:] = 0.0
            block.correct(1.0)
        rows.multipliers[:] = laws.shifts.scale * state["rows"]["forces"]
        if rows.split:
            impulses = laws.shifts.scale * state["rows"]["impulses"]
            rows.multipliers[:] += alpha_of(motion.grid.step(step).scheme).weight * impulses
        system.interface.update()

    def beside(self, simulation: Simulation, step: int) -> EndPoint:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        motion, system, laws = self._motion, simulation.system, self.laws(step)
        mechanics = self._begin(simulation, step)
        motion.memories.recall(simulation, step)
        system.set_time(motion.times[step])
        system.constraints.elements.begin(laws.states, exact=True)
        copy_state(motion.system, system)
        return mechanics

    def tangent(self) -> StepTangent:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        system, split = self._motion.system, alpha_of(self._motion.simulation.integrator).split
        found = StepTangent(system, split or END_POINT, unilateral_forces(system, split))
        self._tangent = found
        return found

    def over(self, step: int, linear: LinearizedStep) -> AlphaRecursion:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        assert self._tangent is not None  # that of ``linear``
        taken, after = self._motion.grid.step(step), self._motion.state(step).rows
        blocks = [part.block for part in self._motion.system.parts]
        maps = [StepMaps.of(block, after[block.name]["frames"]) for block in blocks]
        scheme = alpha_of(taken.scheme), taken.h
        return AlphaRecursion(step, (linear, self._tangent), maps, scheme)

    def product(
        self, step: int, linear: LinearizedStep, matrix: int, direction: BlockVectors
    ) -> Equations:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        nothing = np.zeros(self._motion.system.constraints.size)
        moved = linear.tangent.turned([own.copy() for own in direction])
        return linear.tangent.apply(moved, nothing, matrix)

    def move(self, step: int, matrix: int, direction: BlockVectors) -> None:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        for part, own in zip(self._motion.system.parts, direction, strict=True):
            part.block.owned_step[:] = own
            if matrix == STEP:
                part.block.correct(1.0)
            else:
                part.block.shift(1.0)


def alpha_of(integrator: Integrator) -> GeneralizedAlpha:
    """The scheme of a motion, which is one of these."""
    assert isinstance(integrator, GeneralizedAlpha)
    return integrator


def _begin(scheme: GeneralizedAlpha, coefficients: GeneralizedAlpha, h: float) -> None:
    """Begin a step of a size, s, with forces over it, at the accepted state (collective).

    At the start of a motion accelerations lose those forces.

    Raises:
        StoppedError: masses are singular.
    """
    split, one = scheme.split, coefficients
    if split is not None and not split.begin(h, one.weight, one.unseen):
        raise StoppedError("gradient: the masses are singular where an impulse acts")


def _sum(first: BlockVectors, second: BlockVectors) -> BlockVectors:
    return [a + b for a, b in zip(first, second, strict=True)]
