# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of penalties of contacts at the end of a step.

What friction and damping remember of its start is a memory, see ``memory.lagged_contacts``.
"""

from __future__ import annotations

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.carriers import CarriedPoints
from flexfem.contact.contacts import Contacts
from flexfem.gradients.equations.unilateral import StateChange, StateFactors
from flexfem.gradients.unilateral.contact_moves import ContactMoves
from flexfem.system.system import Shifts, System

__all__ = ["Penalties"]


class Penalties:
    """Derivatives of the forces of penalties; see ``equations.unilateral.Unilateral``."""

    def __init__(self, system: System, contacts: Contacts) -> None:
        """Store the contacts of a system."""
        self._contacts, self._scale = contacts, 0.0
        self._rows, self._moves = system.constraints.size, ContactMoves(contacts)
        self._blocks: list[tuple[IntArray, FloatArray, int | None]] = []

    def take(self, shifts: Shifts) -> None:
        """See ``Unilateral``."""
        self._scale, contacts = shifts.scale, self._contacts
        self._blocks = [(*made.blocks(shifts.scale), None) for made, _ in contacts.triangles()]
        for _, made, number in contacts.rigid():
            nodes, blocks = made.blocks(shifts.scale)
            self._blocks.append((nodes[:, np.newaxis], blocks, number))

    def add(self) -> None:
        """See ``Unilateral``."""
        self._multiply(transposed=False)

    def add_transposed(self) -> None:
        """See ``Unilateral``."""
        self._multiply(transposed=True)

    def add_start(self, change: StateChange) -> FloatArray:
        """See ``Unilateral``: none."""
        return np.zeros(self._rows)

    def start_transposed(self, z: list[FloatArray], mu: FloatArray) -> StateFactors:
        """See ``Unilateral``: none."""
        return StateFactors([np.zeros_like(own) for own in z], [np.zeros_like(own) for own in z])

    def _multiply(self, *, transposed: bool) -> None:
        """Add products with the blocks' steps to their residuals."""
        moves, subscripts = self._moves, "cba,cb->ca" if transposed else "cab,cb->ca"
        moves.take()
        moves.clear()
        for nodes, blocks, surface in self._blocks:
            moves.add(nodes, surface, np.einsum(subscripts, blocks, moves.of(nodes, surface)))
        moves.gather()
        for kind in self._contacts.kinds:
            moves.hand_out(kind)
            if kind in self._contacts.carriers.by_kind:
                self._turn(self._contacts.carriers.by_kind[kind], transposed=transposed)

    def _turn(self, own: CarriedPoints, *, transposed: bool) -> None:
        """Add the change of the loads as their nodes turn."""
        if not own.turns:
            return
        at, loads, step = own.local, self._scale * own.loads, own.block.step[own.local]
        if transposed:
            factors = step[:, :3] + np.cross(step[:, 3:], own.arms)
            np.add.at(own.block.residual[:, 3:], at, np.cross(factors, loads))
            return
        change = np.cross(loads, step[:, 3:])
        moments = np.cross(own.arms, change)
        np.add.at(own.block.residual, at, np.concatenate([change, moments], axis=1))
