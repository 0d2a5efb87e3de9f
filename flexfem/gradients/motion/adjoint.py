# SPDX-License-Identifier: LGPL-3.0-or-later
"""Discrete adjoint of the Lie-group generalized-alpha method, and its tangent.

The adjoint is that of the equations as they are solved, step by step, so that the gradient is the
one of the computed numbers. With the sums ``qb, vb, ab, wb`` of all later influences of
configurations, rates, acceleration-like variables and accelerations, backwards over a step with
``b = (1 - alpha_m)/(1 - alpha_f)``, ``cv = gamma/(beta h)``, ``cw = b/(beta h^2)``, the increment n
and the maps E and F of ``gradients.equations.node_maps``:

1. ``r = qb + F^-T (h gamma vb + ab + b wb) / (beta h^2)``;
2. the transposed linearised equations give z and mu, with the residual e of their first row;
3. a gradient by parameters p loses ``z^T dF/dp + mu^T dPhi/dp``;
4. ``v' = vb - F^T V^T z / cv`` and ``w' = wb - F^T W^T z / cw`` with the matrices of
   ``gradients.equations.step_tangent``, ``nb = F^T e - (h gamma v' + ab + b w') / (beta h^2)``;
5. ``qb = E^T F^-T nb``, ``vb = h nb + v'``,
   ``ab = h^2 (1/2 - beta) nb + h (1 - gamma) v' + alpha_m/(1 - alpha_f) w'``,
   ``wb = -alpha_f/(1 - alpha_f) w'``.

Where steps begin or end parts of a whole step, ``a`` becomes ``w + c (w - w_before)`` with the
accelerations at an earlier state: ``w += (1 + c) ab``, ``wb_before -= c ab``, ``ab = 0``.

Stationarity in the acceleration-like variable takes the place of products with the stiffness in
step 5; the residual e, divided by ``beta h^2`` there, must be carried, else solutions to 1e-6 give
gradients to 1e-3 only. Compare Sonneville, Brüls, Multibody Syst. Dyn. 31 (2014) 47-67, and Lauss,
Oberpeilsteiner, Steiner, Nachbagauer, Multibody Syst. Dyn. 42 (2018) 431-464.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray
from flexfem.gradients.equations.carried import Carried
from flexfem.gradients.equations.linearized import LinearizedStep
from flexfem.gradients.equations.node_maps import RateMaps, StepMaps, transposed
from flexfem.gradients.equations.step_tangent import (
    ACCELERATIONS,
    POSITIONS,
    VELOCITIES,
    BlockVectors,
)
from flexfem.gradients.equations.unilateral import StateChange
from flexfem.gradients.equations.values import Equations, product
from flexfem.gradients.motion.columns import NodeSeeds
from flexfem.gradients.motion.trajectory import Motion
from flexfem.gradients.renewals.grid import Lead
from flexfem.gradients.renewals.renewal import Renewal

__all__ = ["Adjoint", "Scheme", "SizeChange", "Tangent", "maps_of"]


@dataclass(frozen=True)
class SizeChange:
    """What the size of a step changes at fixed increments.

    Attributes:
        rates: changes of v, a and w of each block's owned nodes, (3, n, w).
        equations: changes of the equations of blocks and rows.
    """

    rates: list[FloatArray]
    equations: Equations

    def along(self, carried: Sequence[Carried]) -> float:
        """Sums for each block times the changes of rates."""
        return sum(
            float((own.v * rates[0] + own.a * rates[1] + own.w * rates[2]).sum())
            for own, rates in zip(carried, self.rates, strict=True)
        )


@dataclass(frozen=True)
class Scheme:
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

    @classmethod
    def of(cls, motion: Motion, step: int) -> Scheme:
        """Those of a step of a motion."""
        taken = motion.grid.step(step)
        one = taken.scheme
        return cls(taken.h, one.beta, one.gamma, one.alpha_m, one.alpha_f)


def maps_of(motion: Motion, step: int) -> list[StepMaps]:
    """Maps of all blocks over a step, at whose trial state the system is."""
    return [
        StepMaps.of(part.block, motion.frames(step, part.block.name))
        for part in motion.system.parts
    ]


class Adjoint:
    """The backward recursion for one functional.

    Attributes:
        z, mu: factors of the equations of blocks and rows of the step done last.
        arrived: sums of influences of the memories' numbers after it, (n,).
        carried: by the state before it, for each block.
        remembered: those of the memories' numbers before it, (n,).
        targets: (r,) those of the targets of held rows before it.
        time: this rank's part of that of its time, if this is the time of an event.
        by_size: this rank's part of the influence of the size of the step done last, if it changes.
    """

    z: BlockVectors
    mu: FloatArray
    arrived: FloatArray

    def __init__(self, motion: Motion, accuracy: float | None = None) -> None:
        """Begin behind the end of the motion.

        Args:
            motion: the motion.
            accuracy: relative one of its equations, None for that of all others.
        """
        self._motion, self._accuracy = motion, accuracy
        shapes = [part.block.owned_step.shape for part in motion.system.parts]
        self.carried = [Carried.nothing(shape) for shape in shapes]
        self.remembered = np.zeros(len(motion.memories.owned))
        self.targets = np.zeros(motion.system.constraints.size)
        self.time = self.by_size = self._lead_by_size = 0.0
        self._last: FloatArray | None = None
        # influence of the multipliers of a step on its impulses, (r,)
        self.impulsive = np.zeros(motion.system.constraints.size)
        self._arrived = motion.steps + 1
        # of accelerations at earlier states, by their numbers
        self._early: dict[int, BlockVectors] = {}

    def add(self, seeds: list[NodeSeeds]) -> None:
        """Add the functional's own derivatives at the accepted state at which the system is."""
        for part, own, given in zip(self._motion.system.parts, self.carried, seeds, strict=True):
            if not len(given.nodes):
                continue
            maps, width = RateMaps.of(part.block), part.block.width
            at = given.nodes
            q = given.twists + transposed(maps.turning[at], given.velocities)
            q += transposed(maps.turning_again[at], given.accelerations)
            v = transposed(maps.by_rate[at], given.velocities)
            v += transposed(maps.by_rate_again[at], given.accelerations)
            w = transposed(maps.by_rate[at], given.accelerations)
            for sums, values in ((own.q, q), (own.v, v), (own.w, w)):
                np.add.at(sums, at, values[:, :width])

    def to_step(self, state: int) -> None:
        """Go from a state back to the end of the step to it, or to the start of the motion."""
        if early := self._early.pop(state, None):
            for own, more in zip(self.carried, early, strict=True):
                own.w += more
        if lead := self._motion.grid.leads.get(state):
            for own in self.carried:
                own.w += (1.0 + lead.part) * own.a
            if lead.part:
                self._early[lead.before] = [-lead.part * own.a for own in self.carried]
                self._lead_by_size = self._by_lead(lead, state)
            for own in self.carried:
                own.a = np.zeros_like(own.a)

    def _by_lead(self, lead: Lead, state: int) -> float:
        """Influence of the size of the step before a lead by this; zero if that is given."""
        grid = self._motion.grid
        if not (grid.free(lead.before) or grid.free(lead.before + 1)):
            return 0.0
        changes = self._motion.lead_by_size(state)
        pairs = zip(self.carried, changes, strict=True)
        return sum(float((own.a * change).sum()) for own, change in pairs)

    def renew(self, step: int, renewal: Renewal) -> None:
        """Go back over a part of a renewal, which is linearised (collective)."""
        self.to_step(step)
        self.z, self.mu = renewal.back(self.carried, self.targets)
        self.arrived = self.remembered

    def subtract(self, other: Adjoint, factor: float) -> None:
        """Subtract a multiple of another one, which has done the same step last."""
        for own, less in zip(self.carried, other.carried, strict=True):
            own.add(less, -factor)
        self.z = [a - factor * b for a, b in zip(self.z, other.z, strict=True)]
        self.mu = self.mu - factor * other.mu
        self.targets -= factor * other.targets
        self.by_size -= factor * other.by_size

    def times(self, equations: Equations) -> float:
        """This rank's part of the factors of the last step times changes of its equations."""
        return product(self._motion.system, (self.z, self.mu), equations)

    def arrive(self, step: int, maps: list[StepMaps]) -> None:
        """Go from the accepted state after a step to the trial state at its end."""
        self.to_step(step)
        self._gather(Scheme.of(self._motion, step), maps)
        for own, by in zip(self.carried, maps, strict=True):
            own.v, own.a, own.w = (by.hold_rates(x) for x in (own.v, own.a, own.w))
        self._arrived = step

    def step(
        self, step: int, linear: LinearizedStep, maps: list[StepMaps],
        size: SizeChange | None = None,
    ) -> None:  # fmt: skip
        """Go back over a step, at whose end the equations are linearised (collective).

        Args:
            step: its number.
            linear: the linearised equations.
            maps: those of all blocks.
            size: what its size changes, None if that counts as given.
        """
        if self._arrived != step:
            self.arrive(step, maps)
        one, right, memories = Scheme.of(self._motion, step), [], self._motion.memories
        for own, by in zip(self.carried, maps, strict=True):
            rates = one.h * one.gamma * own.v + own.a + one.share * own.w
            right.append(own.q + by.inverse.transposed(rates) / one.square)
        rows, self.impulsive = self.impulsive, np.zeros_like(self.impulsive)
        solution, missed = linear.solve(
            [by.hold(r) for by, r in zip(maps, right, strict=True)], rows, transposed=True,
            guess=self._last, accuracy=self._accuracy,
        )  # fmt: skip
        self._last = solution
        self.z, self.mu = linear.parts(solution)
        held = self._motion.system.constraints
        self.targets += self.mu * (held.held & held.rigid)
        self.by_size = self._lead_by_size
        self._lead_by_size = 0.0
        if size is not None:
            self.by_size += size.along(self.carried) - self.times(size.equations)
        by_velocity, _ = linear.tangent.apply_transposed(self.z, self.mu, VELOCITIES)
        by_acceleration, _ = linear.tangent.apply_transposed(self.z, self.mu, ACCELERATIONS)
        for own, by, e, dv, dw in zip(
            self.carried, maps, missed, by_velocity, by_acceleration, strict=True
        ):
            self._back(own, (one, by), e, (dv, dw))
        for forces in linear.tangent.forces:
            start = forces.start_transposed(self.z, self.mu)
            for own, twists, rates in zip(self.carried, start.twists, start.rates, strict=True):
                own.q -= twists
                own.v -= rates
        self.arrived = self.remembered
        self.remembered = memories.back(self.remembered, self.z, self.mu)

    def _gather(self, one: Scheme, maps: list[StepMaps]) -> None:
        """Sums in the axes of the trial state, with those of what the memories take from there."""
        found = self._motion.memories.gather(self.remembered)
        for k, (own, by) in enumerate(zip(self.carried, maps, strict=True)):
            q = by.axes.transposed(own.q)
            if found is not None:
                by_position, by_rate = (blocks[k] for blocks in found)
                q += by_position
                own.v += by.by_increment.transposed(by_rate) / one.by_velocity
            own.q = by.hold(q)

    def _back(
        self, own: Carried, scheme: tuple[Scheme, StepMaps], missed: FloatArray,
        changes: tuple[FloatArray, ...],
    ) -> None:  # fmt: skip
        """Carry the sums of one block over a step."""
        one, by = scheme
        F = by.by_increment
        v = own.v - F.transposed(changes[0]) / one.by_velocity
        w = own.w - F.transposed(changes[1]) / one.by_acceleration
        n = F.transposed(missed)
        n -= (one.h * one.gamma * v + own.a + one.share * w) / one.square
        over = 1.0 / (1.0 - one.alpha_f)
        own.q = by.before.transposed(by.inverse.transposed(n))
        own.v = one.h * n + v
        own.a = one.h**2 * (0.5 - one.beta) * n + one.h * (1.0 - one.gamma) * v
        own.a += one.alpha_m * over * w
        own.w = -one.alpha_f * over * w


class Tangent:
    """The linearised motion along one direction of parameters.

    Attributes:
        carried: changes of the state, for each block, as those of :class:`Adjoint`.
        remembered: (n,) changes of the memories' numbers.
        multipliers: (r,) changes of the rows' forces times ``beta h^2`` over the last step.
        targets: (r,) those of the targets of held rows.
        time: that of the time of the state, if this is the time of an event, s.
    """

    def __init__(self, motion: Motion, start: list[Carried], remembered: FloatArray) -> None:
        """Begin with changes of the start."""
        self._motion = motion
        self.carried, self.remembered = start, remembered
        self.multipliers = np.zeros(motion.system.constraints.size)
        self.targets, self.time = np.zeros_like(self.multipliers), 0.0
        self._size_change = 0.0
        self._accelerations: dict[int, BlockVectors] = {}
        self.lead(0)

    def lead(self, state: int) -> None:
        """Change the acceleration-like variables after a state."""
        self._accelerations[state] = [own.w for own in self.carried]
        if lead := self._motion.grid.leads.get(state):
            before = self._accelerations[lead.before]
            for own, w in zip(self.carried, before, strict=True):
                own.a = own.w + lead.part * (own.w - w)
            if lead.part and self._size_change:
                changes = self._motion.lead_by_size(state)
                for own, change in zip(self.carried, changes, strict=True):
                    own.a += self._size_change * change

    def renew(self, step: int, renewal: Renewal, changes: Equations) -> None:
        """Go over a part of a renewal, which is linearised (collective)."""
        renewal.ahead(self.carried, self.targets, changes)
        self.lead(step)

    def like(self) -> Tangent:
        """One without changes of this state, for those of what comes."""
        nothing = [Carried.nothing(own.q.shape) for own in self.carried]
        found = Tangent(self._motion, nothing, np.zeros_like(self.remembered))
        found._accelerations = {
            state: [np.zeros_like(w) for w in every] for state, every in self._accelerations.items()
        }
        return found

    def add(self, other: Tangent, factor: float) -> None:
        """Add a multiple of another one at the same state."""
        for own, more in zip(self.carried, other.carried, strict=True):
            own.add(more, factor)
        self.targets += factor * other.targets
        self._size_change += factor * other._size_change
        for state, every in other._accelerations.items():
            self._accelerations[state] = [
                a + factor * b for a, b in zip(self._accelerations[state], every, strict=True)
            ]

    def step(
        self, step: int, linear: LinearizedStep, maps: list[StepMaps], changes: Equations,
        size: tuple[SizeChange, float] | None = None,
    ) -> None:  # fmt: skip
        """Go over a step, at whose end the equations are linearised (collective).

        Args:
            step: its number.
            linear: the linearised equations.
            maps: those of all blocks.
            changes: of the equations of blocks and of rows, at a fixed state.
            size: what its size changes, and its change, s; None if that counts as given.
        """
        one = Scheme.of(self._motion, step)
        self._accelerations = {step - 1: self._accelerations[step - 1]}
        self._size_change = 0.0 if size is None else size[1]
        over, (forces, rows) = 1.0 / (1.0 - one.alpha_f), changes
        if (own_equations := self._motion.memories.equations(self.remembered)) is not None:
            forces = [a + b for a, b in zip(forces, own_equations[0], strict=True)]
            rows = rows + own_equations[1]
        held = self._motion.system.constraints
        rows = rows - self.targets * (held.held & held.rigid)
        if size is not None:
            forces = [a + size[1] * b for a, b in zip(forces, size[0].equations[0], strict=True)]
            rows = rows + size[1] * size[0].equations[1]
        predicted: list[Carried] = []
        for own, by in zip(self.carried, maps, strict=True):
            n = one.h * own.v + one.h**2 * (0.5 - one.beta) * own.a
            q = by.hold(by.before(own.q) + by.by_increment(n))
            v = own.v + one.h * (1.0 - one.gamma) * own.a
            w = over * (one.alpha_m * own.a - one.alpha_f * own.w)
            predicted.append(Carried(q, v, own.a, w))
        nothing = np.zeros_like(rows)
        start = StateChange([own.q for own in self.carried], [own.v for own in self.carried])
        by_start, rows_by_start = linear.tangent.by_start(start)
        total = [-(a + b) for a, b in zip(forces, by_start, strict=True)]
        left = -(rows + rows_by_start)
        for matrix, vectors in (
            (POSITIONS, [own.q for own in predicted]),
            (VELOCITIES, [
                by.by_increment(own.v) / one.by_velocity
                for own, by in zip(predicted, maps, strict=True)
            ]),
            (ACCELERATIONS, [
                by.by_increment(own.w) / one.by_acceleration
                for own, by in zip(predicted, maps, strict=True)
            ]),
        ):  # fmt: skip
            blocks, own_rows = linear.tangent.apply(vectors, nothing, matrix)
            total = [a - b for a, b in zip(total, blocks, strict=True)]
            left = left - own_rows
        solution, _ = linear.solve(total, left)
        found, self.multipliers = linear.parts(solution)
        self.carried, moves = [], [list[FloatArray](), list[FloatArray]()]
        for own, by, x in zip(predicted, maps, found, strict=True):
            a = by.inverse(x) / one.square
            q = own.q + x
            v, w = own.v + one.h * one.gamma * a, own.w + one.share * a
            if size is not None:
                v, a, w = (
                    x + size[1] * y
                    for x, y in zip((v, a, w), size[0].rates[len(moves[0])], strict=True)
                )
            v, a, w = (by.hold_rates(y) for y in (v, a, w))
            self.carried.append(Carried(by.axes(q), v, a, w))
            moves[0].append(q)
            moves[1].append(by.by_increment(v) / one.by_velocity)
        self.remembered = self._motion.memories.ahead(self.remembered, moves)
        self.lead(step)
