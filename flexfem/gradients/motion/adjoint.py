# SPDX-License-Identifier: LGPL-3.0-or-later
"""Discrete adjoint of a motion, and its tangent.

The adjoint is that of the equations as they are solved, step by step, so that the gradient is the
one of the computed numbers. How a step is gone back over or ahead, is that of its integrator
(``gradients.schemes``).

Where steps begin or end parts of a whole step, the acceleration-like variable ``a`` becomes ``w + c
(w - w_before)`` with the accelerations at an earlier state: ``w += (1 + c) ab``, ``wb_before -= c
ab``, ``ab = 0``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexfem._types import FloatArray
from flexfem.gradients.equations.carried import Carried
from flexfem.gradients.equations.node_maps import RateMaps, transposed
from flexfem.gradients.equations.step_tangent import BlockVectors
from flexfem.gradients.equations.values import Equations, product
from flexfem.gradients.motion.columns import Seeds
from flexfem.gradients.motion.trajectory import Motion
from flexfem.gradients.renewals.grid import Lead
from flexfem.gradients.renewals.renewal import Renewal
from flexfem.gradients.schemes.base import Recursion, SizeChange

__all__ = ["Adjoint", "Tangent"]


class Adjoint:
    """The backward recursion for one functional.

    Attributes:
        z, mu: factors of the equations of blocks and rows of the step done last.
        beside: those at the neighbours of its end.
        arrived: sums of influences of the memories' numbers after it, (n,).
        carried: by the state before it, for each block.
        remembered: those of the memories' numbers before it, (n,).
        targets: (r,) those of the targets of held rows before it.
        forces: (r,) those of the multipliers of the state, N or N m, which a step does not carry.
        time: this rank's part of that of its time, if this is the time of an event.
        by_size: this rank's part of the influence of the size of the step done last, if it changes.
    """

    z: BlockVectors
    mu: FloatArray
    beside: Sequence[Equations]
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
        self.forces = np.zeros_like(self.targets)
        self.time = self.by_size = self._lead_by_size = 0.0
        self._last: FloatArray | None = None
        # influence of the multipliers of a step on its impulses, (r,)
        self.impulsive = np.zeros(motion.system.constraints.size)
        self._arrived = motion.steps + 1
        # of accelerations at earlier states, by their numbers
        self._early: dict[int, BlockVectors] = {}

    def add(self, seeds: Seeds) -> None:
        """Add the functional's own derivatives at the accepted state at which the system is."""
        self.forces = self.forces + seeds.forces
        parts = self._motion.system.parts
        for part, own, given in zip(parts, self.carried, seeds.blocks, strict=True):
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
        self.arrived, memories = self.remembered, self._motion.memories
        follows, nothing = self._motion.follows(step), 0.0 * self.remembered
        found = memories.gather(self.remembered) if follows else None
        for k, (own, by) in enumerate(zip(self.carried, renewal.maps, strict=True)):
            if found is not None:
                own.q += by.hold(found[0][k])
                own.v += by.hold_rates(by.by_increment.transposed(found[1][k]))
        with self._motion.set_aside(self.carried):
            self.z, self.mu = renewal.back(self.carried, self.targets, self.forces)
        if follows:
            still = [0.0 * own for own in self.z], 0.0 * self.mu
            self.remembered = memories.back(self.remembered, *still)
        if renewal.acts:
            self.forces = np.zeros_like(self.forces)
            self.remembered = self.remembered + memories.back(nothing, self.z, self.mu)

    def subtract(self, other: Adjoint, factor: float) -> None:
        """Subtract a multiple of another one, which has done the same step last."""
        for own, less in zip(self.carried, other.carried, strict=True):
            own.add(less, -factor)
        self.z = [a - factor * b for a, b in zip(self.z, other.z, strict=True)]
        self.mu = self.mu - factor * other.mu
        self.targets -= factor * other.targets
        self.arrived = self.arrived - factor * other.arrived
        self.remembered = self.remembered - factor * other.remembered
        self.by_size -= factor * other.by_size

    def times(self, equations: Equations) -> float:
        """This rank's part of the factors of the last step times changes of its equations."""
        return product(self._motion.system, (self.z, self.mu), equations)

    def arrive(self, over: Recursion) -> None:
        """Go from the accepted state after a step to the trial state at its end."""
        self.to_step(over.step)
        over.arrive(self.carried, self._motion.memories.gather(self.remembered))
        self._arrived = over.step

    def step(self, over: Recursion, size: SizeChange | None = None) -> None:
        """Go back over a step, at whose end the equations are linearised (collective).

        Args:
            over: the step.
            size: what its size changes, None if that counts as given.
        """
        if self._arrived != over.step:
            self.arrive(over)
        rows = self.impulsive + self.forces / self._motion.scheme.shifts(over.step).scale
        self.impulsive, self.forces = np.zeros((2, len(rows)))
        self.by_size, self._lead_by_size = self._lead_by_size, 0.0
        if size is not None:
            self.by_size += size.along(self.carried)
        self._last = over.back(self.carried, rows, self._last, self._accuracy)
        (self.z, self.mu), *self.beside = over.factors(self._last)
        held = self._motion.system.constraints
        self.targets += self.mu * (held.held & held.rigid)
        if size is not None:
            self.by_size -= self.times(size.equations)
        self.arrived = self.remembered
        self.remembered = self._motion.memories.back(self.remembered, self.z, self.mu)


class Tangent:
    """The linearised motion along one direction of parameters.

    Attributes:
        carried: changes of the state, for each block, as those of :class:`Adjoint`.
        remembered: (n,) changes of the memories' numbers.
        recalled: those before the step done last.
        multipliers: (r,) changes of the rows' forces times ``beta h^2`` over the last step.
        forces: (r,) those of the multipliers of the state, N or N m.
        targets: (r,) those of the targets of held rows.
        time: that of the time of the state, if this is the time of an event, s.
    """

    def __init__(
        self, motion: Motion, start: list[Carried], remembered: FloatArray, forces: FloatArray
    ) -> None:
        """Begin with changes of the start."""
        self._motion = motion
        self.carried, self.remembered, self.forces = start, remembered, forces
        self.recalled = remembered
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
        memories = self._motion.memories
        own = memories.equations(self.remembered) if renewal.acts else None
        if own is not None:
            blocks = [a + b for a, b in zip(changes[0], own[0], strict=True)]
            changes = blocks, changes[1] + own[1]
        with self._motion.set_aside(self.carried):
            renewal.ahead(self.carried, self.targets, self.forces, changes)
        if self._motion.follows(step):
            moves = [one.q for one in self.carried], renewal.local([one.v for one in self.carried])
            self.remembered = memories.ahead(self.remembered, moves)
        self.lead(step)

    def like(self) -> Tangent:
        """One without changes of this state, for those of what comes."""
        nothing = [Carried.nothing(own.q.shape) for own in self.carried]
        found = Tangent(
            self._motion, nothing, np.zeros_like(self.remembered), np.zeros_like(self.forces)
        )
        found._accelerations = {
            state: [np.zeros_like(w) for w in every] for state, every in self._accelerations.items()
        }
        return found

    def add(self, other: Tangent, factor: float) -> None:
        """Add a multiple of another one at the same state."""
        for own, more in zip(self.carried, other.carried, strict=True):
            own.add(more, factor)
        self.targets += factor * other.targets
        self.remembered = self.remembered + factor * other.remembered
        self.forces = self.forces + factor * other.forces
        self._size_change += factor * other._size_change
        for state, every in other._accelerations.items():
            self._accelerations[state] = [
                a + factor * b for a, b in zip(self._accelerations[state], every, strict=True)
            ]

    def step(
        self, over: Recursion, changes: Equations, size: tuple[SizeChange, float] | None = None,
        beside: Sequence[Equations] = (),
    ) -> None:  # fmt: skip
        """Go over a step, at whose end the equations are linearised (collective).

        Args:
            over: the step.
            changes: of the equations of blocks and of rows, at a fixed state.
            size: what its size changes, and its change, s; None if that counts as given.
            beside: changes of those at the neighbours of its end.
        """
        self._accelerations = {over.step - 1: self._accelerations[over.step - 1]}
        self._size_change = 0.0 if size is None else size[1]
        forces, rows = changes
        if (own_equations := self._motion.memories.equations(self.remembered)) is not None:
            forces = [a + b for a, b in zip(forces, own_equations[0], strict=True)]
            rows = rows + own_equations[1]
        held = self._motion.system.constraints
        rows = rows - self.targets * (held.held & held.rigid)
        if size is not None:
            forces = [a + size[1] * b for a, b in zip(forces, size[0].equations[0], strict=True)]
            rows = rows + size[1] * size[0].equations[1]
        self.recalled = self.remembered
        found = over.ahead(self.carried, (forces, rows), size, beside)
        self.carried, self.multipliers = found.carried, found.multipliers
        self.forces = self.multipliers / self._motion.scheme.shifts(over.step).scale
        self.remembered = self._motion.memories.ahead(self.remembered, found.moves)
        self.lead(over.step)
