# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions of the nodes and surfaces of contacts by the penalty, and forces on them."""

from __future__ import annotations

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.contacts import Contacts

__all__ = ["ContactMoves"]


class ContactMoves:
    """Motions (c, m) of contacts by the blocks' steps, and forces of these sizes on the blocks.

    They are those of the points (c, p) of each contact, three numbers each in inertial axes, and
    of the rigid surface, if there is one, six in its axes.
    """

    def __init__(self, contacts: Contacts) -> None:
        """Store the contacts."""
        self._contacts = contacts
        self._steps, self._forces = np.zeros((2, len(contacts.carriers.home), 3))
        self._twists = np.zeros((0, 6))

    def take(self) -> None:
        """Take the blocks' steps (collective)."""
        self._contacts.carriers.move(self._steps)
        self._twists = self._contacts.frames.twists()

    def of(self, points: IntArray, surface: int | None) -> FloatArray:
        """Motions of contacts, with the number of a rigid surface."""
        own = self._steps[points].reshape(len(points), 3 * points.shape[1])
        if surface is None:
            return own
        return np.concatenate([own, np.tile(self._twists[surface], (len(points), 1))], axis=1)

    def clear(self) -> None:
        """Begin with no forces."""
        self._forces[:] = self._contacts.frames.wrenches[:] = 0.0

    def add(self, points: IntArray, surface: int | None, forces: FloatArray) -> None:
        """Add forces (c, m)."""
        count = 3 * points.shape[1]
        np.add.at(self._forces, points, forces[:, :count].reshape(*points.shape, 3))
        if surface is not None:
            self._contacts.frames.wrenches[surface] += forces[:, count:].sum(axis=0)

    def gather(self) -> None:
        """Bring forces to the ranks of nodes and surfaces (collective)."""
        self._contacts.carriers.gather(self._forces)
        self._contacts.frames.gather()

    def hand_out(self, kind: int) -> None:
        """Add gathered forces to the residual of a block."""
        if kind in self._contacts.carriers.by_kind:
            self._contacts.carriers.add_forces(kind, self._forces)
        self._contacts.frames.add_wrenches(kind)
