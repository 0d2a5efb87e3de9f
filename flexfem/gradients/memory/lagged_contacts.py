# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts by the penalty with friction or damping, which act by their state at the last step."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.contacts import Contacts
from flexfem.gradients.equations.step_tangent import BlockVectors, collected, put_steps
from flexfem.gradients.equations.values import Equations
from flexfem.gradients.memory.base import Memory, StepEnd
from flexfem.gradients.memory.lagged_laws import COUNT, Made, Remembered, numbers_of, remembered
from flexfem.gradients.unilateral.contact_moves import ContactMoves
from flexfem.simulation.motion.stepping import Simulation
from flexfem.system.system import System

__all__ = ["LaggedMemory", "lagging"]


def lagging(system: System) -> list[Contacts]:
    """Contacts of a system with friction or damping by the penalty."""
    return [one for one in system.contacts if isinstance(one, Contacts) and one.lagging]


class LaggedMemory(Memory):
    """Closed contacts of all nodes of a rank, see ``lagged_laws`` for their numbers."""

    def __init__(self, system: System) -> None:
        """Find them."""
        self._system = system
        (self._contacts,) = lagging(system)
        self._moves, self._scale = ContactMoves(self._contacts), 0.0
        self._surfaces = [surface for _, surface in _every(self._contacts)]
        sizes = [numbers_of(made, made.closed, made.lagged).size for made, _ in self._made()]
        self._ends = np.cumsum(sizes)
        self.owned = np.full(sum(sizes), True)
        self._linear: list[Remembered] = []

    def _made(self) -> Iterator[tuple[Made, int | None]]:
        return _every(self._contacts)

    def start(self, simulation: Simulation) -> FloatArray:
        """See :class:`Memory`."""
        (contacts,) = lagging(simulation.system)
        return _joined([numbers_of(made, made.closed, made.lagged) for made, _ in _every(contacts)])

    def take(self, end: StepEnd) -> None:
        """See :class:`Memory`."""
        self._scale, own = end.shifts.scale, self._contacts
        self._linear = [
            remembered(made, own.points, own.frames, surface) for made, surface in self._made()
        ]

    def equations(self, change: FloatArray) -> Equations:
        """See :class:`Memory`."""
        self._moves.clear()
        for one, surface, own in self._split(change):
            acting = one.acting
            loads = np.einsum("cms,cs->cm", acting.loads, own[acting.slots])
            self._moves.add(acting.points, surface, self._scale * loads)
        return self._collected(), np.zeros(self._system.constraints.size)

    def ahead(self, change: FloatArray, moves: Sequence[BlockVectors]) -> FloatArray:
        """See :class:`Memory`."""
        put_steps(self._system, moves[0])
        self._moves.take()
        found = []
        for one, surface, own in self._split(change):
            acting, after, out = one.acting, one.after, np.zeros_like(own)
            steps = self._moves.of(after.points, surface)
            numbers = np.einsum("csm,cm->cs", after.motion, steps)
            before = self._moves.of(acting.points, surface)[after.origins]
            pulls = np.einsum("cam,cm->ca", after.by_motion, before)
            pulls += np.einsum("cas,cs->ca", after.by_numbers, own[acting.slots[after.origins]])
            numbers[after.heirs, 4:7] += pulls
            out[after.slots] = numbers
            found.append(out)
        return _joined(found)

    def gather(self, sums: FloatArray) -> Sequence[BlockVectors]:
        """See :class:`Memory`."""
        self._moves.clear()
        for one, surface, own in self._split(sums):
            acting, after = one.acting, one.after
            factors = own[after.slots]
            self._moves.add(
                after.points, surface, np.einsum("csm,cs->cm", after.motion, factors)
            )  # fmt: skip
            pulls = np.einsum("cam,ca->cm", after.by_motion, factors[after.heirs, 4:7])
            self._moves.add(acting.points[after.origins], surface, pulls)
        found = self._collected()
        return found, [np.zeros_like(own) for own in found]

    def back(self, sums: FloatArray, z: BlockVectors, mu: FloatArray) -> FloatArray:
        """See :class:`Memory`."""
        put_steps(self._system, z)
        self._moves.take()
        found = []
        for one, surface, own in self._split(sums):
            acting, after, out = one.acting, one.after, np.zeros_like(own)
            steps = self._moves.of(acting.points, surface)
            out[acting.slots] = -self._scale * np.einsum("cms,cm->cs", acting.loads, steps)
            pulls = own[after.slots][after.heirs, 4:7]
            before = np.einsum("cas,ca->cs", after.by_numbers, pulls)
            np.add.at(out, acting.slots[after.origins], before)
            found.append(out)
        return _joined(found)

    def recall(self, simulation: Simulation, step: int) -> None:
        """See :class:`Memory`; the system has recalled the rest with the sides of its surfaces."""
        (contacts,) = lagging(simulation.system)
        contacts.accepted = self._contacts.accepted
        for (made, _), (own, _) in zip(_every(contacts), self._made(), strict=True):
            made.closed.stiffness[:] = made.slaves.stiffness[made.closed.slaves]
            made.lagged.start[:] = own.lagged.start

    def moved(self, simulation: Simulation, end: StepEnd, change: FloatArray) -> FloatArray:
        """See :class:`Memory`."""
        (contacts,) = lagging(simulation.system)
        return _joined(
            [numbers_of(made, *made.following(contacts.points)) for made, _ in _every(contacts)]
        )

    def _split(self, numbers: FloatArray) -> list[tuple[Remembered, int | None, FloatArray]]:
        """Each surface, its number if it is rigid, and numbers of its contacts (k, 13)."""
        parts = np.split(numbers, self._ends[:-1])
        own = [part.reshape(-1, COUNT) for part in parts]
        return list(zip(self._linear, self._surfaces, own, strict=True))

    def _collected(self) -> BlockVectors:
        """Forces on the blocks (collective)."""
        self._moves.gather()
        for part in self._system.parts:
            part.block.residual[:] = 0.0
        for kind in self._contacts.kinds:
            self._moves.hand_out(kind)
        return collected(self._system)


def _every(contacts: Contacts) -> Iterator[tuple[Made, int | None]]:
    """All contacts, and the numbers of rigid surfaces."""
    for made, _ in contacts.triangles():
        yield made, None
    for _, rigid, number in contacts.rigid():
        yield rigid, number


def _joined(parts: Sequence[FloatArray]) -> FloatArray:
    return np.concatenate([np.zeros(0), *(own.ravel() for own in parts)])
