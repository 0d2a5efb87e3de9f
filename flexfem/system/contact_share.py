# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts of a system as seen from one of its blocks."""

from flexfem._types import FloatArray
from flexfem.contact.barrier.contacts import BarrierContacts
from flexfem.contact.contacts import Contacts
from flexfem.contact.tangent_entries import Triplets

__all__ = ["ContactShare"]


class ContactShare:
    """Forces and tangents of a system's contacts on one of its blocks.

    Blocks are evaluated in their order: the first one evaluates the contacts of all.

    Attributes:
        contacts: contacts of the system.
        kind: kind of the block.
        acts: False to leave forces out of residuals; pairs are not searched then.
    """

    def __init__(self, contacts: Contacts | BarrierContacts, kind: int) -> None:
        """Store the contacts and the kind of the block."""
        self.contacts, self.kind, self.acts = contacts, kind, True
        self._first = kind == contacts.kinds[0]

    def add_residual(self, scale: float) -> None:
        """Add ``scale`` times the forces at the trial state to the residual (collective)."""
        if not self.acts:
            return
        if self._first:
            self.contacts.collect(scale)
        self.contacts.hand_out(self.kind, scale)

    def add_action(self, scale: float) -> None:
        """Add ``scale`` times the tangent applied to the blocks' steps (collective)."""
        if self._first:
            self.contacts.act(scale)
        self.contacts.hand_out_action(self.kind, scale)

    def entries(self, scale: float, other: int | None = None) -> Triplets:
        """Rows, columns and values of ``scale`` times the tangent (collective).

        Args:
            scale: factor.
            other: kind of the block of the columns; None for this one.
        """
        return self.contacts.entries(scale)[self.kind, self.kind if other is None else other]

    def nearby(self) -> FloatArray:
        """Stiffness (n_owned,) of contacts that are or may soon be closed, N/m (collective)."""
        return self.contacts.nearby(self.kind)[:, 0]

    def nearby_turns(self) -> FloatArray:
        """Rotational stiffness (n_owned,) of the same contacts, N m (collective)."""
        return self.contacts.nearby(self.kind)[:, 3]
