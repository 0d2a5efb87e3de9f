# SPDX-License-Identifier: LGPL-3.0-or-later
"""A step of the stabilised index-2 form of generalized-alpha, linearised.

Its state, and what goes back over a step, are those of ``gradients.schemes.generalized_alpha``: the
increments o that are not integrated from rates act on the positions at the end of a step alone.
Equations of a step are two for each one there, see ``gradients.schemes.stabilized_equations``, with
the first factors z and m and the second ones y and k. With the derivatives of all of them by
velocities and accelerations in the place of ``V^T z`` and ``W^T z`` the recursion is the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from flexfem._types import FloatArray
from flexfem.gradients.equations.carried import Carried
from flexfem.gradients.equations.linearized import LinearizedStep
from flexfem.gradients.equations.node_maps import StepMaps
from flexfem.gradients.equations.step_tangent import (
    ACCELERATIONS,
    VELOCITIES,
    StepTangent,
    joined,
)
from flexfem.gradients.equations.values import Equations, SystemEquations
from flexfem.gradients.schemes.base import Ahead, SizeChange, States
from flexfem.gradients.schemes.generalized_alpha import AlphaRecursion, AlphaSteps, alpha_of
from flexfem.gradients.schemes.stabilized_equations import (
    CoupledEquations,
    Neighbour,
    RateEquations,
)
from flexfem.integrators.generalized_alpha import GeneralizedAlpha
from flexfem.integrators.stabilized_index2 import StabilizedIndex2
from flexfem.simulation.motion.stepping import Simulation

__all__ = ["StabilizedRecursion", "StabilizedSteps"]


class StabilizedRecursion(AlphaRecursion):
    """See :class:`flexfem.gradients.schemes.base.Recursion`."""

    def __init__(
        self, step: int, equations: tuple[LinearizedStep, StepTangent], maps: list[StepMaps],
        taken: tuple[GeneralizedAlpha, float],
        coupled: tuple[CoupledEquations, tuple[Neighbour, Neighbour]],
    ) -> None:  # fmt: skip
        """Store a step; see :class:`AlphaRecursion`."""
        super().__init__(step, equations, maps, taken)
        self._coupled, self._neighbours = coupled
        self._taken = False

    @property
    def coupled(self) -> CoupledEquations:
        """The equations, linearised at the neighbours as well (collective)."""
        if not self._taken:
            self._coupled.take(self._neighbours)
            self._taken = True
        return self._coupled

    def neighbours(self) -> Iterator[SystemEquations]:
        """See :class:`flexfem.gradients.schemes.base.Recursion`."""
        return self.coupled.visits()

    def factors(self, solution: FloatArray) -> list[Equations]:
        """See :class:`flexfem.gradients.schemes.base.Recursion`."""
        return self.coupled.factors(solution)

    def back(
        self, carried: Sequence[Carried], rows: FloatArray, guess: FloatArray | None,
        accuracy: float | None,
    ) -> FloatArray:  # fmt: skip
        """See :class:`flexfem.gradients.schemes.base.Recursion`."""
        coupled, first, second = self.coupled, [], []
        for own, by in zip(carried, self.maps, strict=True):
            by_rates = by.inverse.transposed(self._rates_of(own)) / self._one.square
            first.append(by.hold(own.q + by_rates))
            second.append(by.hold(-by_rates))
        right = np.concatenate([joined(first, rows), joined(second, 0.0 * rows)])
        solution, missed = coupled.solve_transposed(right, guess, accuracy)
        by_velocity = coupled.by_rates(solution, VELOCITIES)
        by_acceleration = coupled.by_rates(solution, ACCELERATIONS)
        for own, by, e, dv, dw in zip(
            carried, self.maps, missed, by_velocity, by_acceleration, strict=True
        ):
            self._back(own, by, by.hold(e), (dv, dw))
        for own, more in zip(carried, coupled.beyond(solution), strict=True):
            own.q -= more
        return solution

    def ahead(
        self, carried: Sequence[Carried], changes: Equations,
        size: tuple[SizeChange, float] | None, beside: Sequence[Equations] = (),
    ) -> Ahead:  # fmt: skip
        """See :class:`flexfem.gradients.schemes.base.Recursion`; sizes of steps are given."""
        del size
        one, coupled = self._one, self.coupled
        predicted = [self._predicted(x, by) for x, by in zip(carried, self.maps, strict=True)]
        blocks, rates = self._left(carried, predicted, changes)
        (second, laws), positions = coupled.beside(beside)
        start = [own.q for own in carried]
        by_positions = [
            by.inverse(own.q - by.before(q))
            for by, own, q in zip(self.maps, predicted, start, strict=True)
        ]
        by_velocities = [own.v / one.by_velocity for own in predicted]
        by_accelerations = [own.w / one.by_acceleration for own in predicted]
        more, more_laws = coupled.second(
            (by_positions, by_velocities, by_accelerations), np.zeros_like(rates), start
        )
        positions = positions + coupled.positions([own.q for own in predicted])
        rigid = coupled.rigid
        rows = np.where(rigid, -positions, rates)
        others = np.where(rigid, -positions - rates, -laws - more_laws)
        moved = [-(a + b) for a, b in zip(second, more, strict=True)]
        right = np.concatenate([joined(blocks, rows), joined(moved, others)])
        (found, multipliers), (shifts, _) = coupled.halves(coupled.solve(right))
        integrated = [a - b for a, b in zip(found, shifts, strict=True)]
        return self._after(predicted, (found, integrated), multipliers, None)


class StabilizedSteps(AlphaSteps):
    """See :class:`flexfem.gradients.schemes.base.Steps`."""

    def __init__(self, motion: States) -> None:
        """Store the motion."""
        super().__init__(motion)
        system = motion.system
        self._rates = RateEquations()
        self._neighbours = Neighbour(system), Neighbour(system)

    def mechanics(self, step: int) -> RateEquations:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        taken = self._motion.grid.step(step)
        scheme = taken.scheme
        assert isinstance(scheme, StabilizedIndex2)
        self._rates.rates = scheme.rates(taken.h)
        return self._rates

    def recover(self, step: int) -> None:
        """See :class:`flexfem.gradients.schemes.base.Steps`.

        Increments are divided into those that rates tell, and what is left.
        """
        super().recover(step)
        self.mechanics(step)
        motion = self._motion
        after = motion.state(step).rows
        for part in motion.system.parts:
            block, nodes = part.block, part.block.nodes
            whole = block.increment.copy()
            rates = after[block.name]["velocity"] - nodes.velocity_base
            block.increment[:] = rates / nodes.rates[0]
            block.increment[:, block.width :] = 0.0
            left = (whole - block.increment)[: block.owned, : block.width]
            block.step[:] = 0.0
            block.correct(1.0)
            maps = StepMaps.of(block, block.frames[: block.owned])
            block.owned_step[:] = maps.hold(maps.by_increment(left))
            block.shift(1.0)
        motion.system.interface.update()

    def beside(self, simulation: Simulation, step: int) -> RateEquations:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        super().beside(simulation, step)
        return self.mechanics(step)

    def tangent(self) -> StepTangent:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        self._tangent = StepTangent(self._motion.system, self._rates)
        return self._tangent

    def over(self, step: int, linear: LinearizedStep) -> StabilizedRecursion:
        """See :class:`flexfem.gradients.schemes.base.Steps`."""
        plain = super().over(step, linear)
        assert self._tangent is not None  # that of ``linear``
        taken, shifts = self._motion.grid.step(step), self.shifts(step)
        coupled = CoupledEquations(
            self._motion.system, linear, plain.maps, (self.mechanics(step), shifts)
        )
        return StabilizedRecursion(
            step, (linear, self._tangent), plain.maps, (alpha_of(taken.scheme), taken.h),
            (coupled, self._neighbours),
        )  # fmt: skip
