# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts of nodes with an obstacle of any shape at the trial state."""

from flexfem._types import FloatArray, IntArray
from flexfem.contact.law import penalty
from flexfem.contact.law.data import GAP, Found, Slaves

__all__ = ["ObstacleContacts"]


class ObstacleContacts:
    """Contacts of the slave nodes with an obstacle.

    Attributes:
        slaves: Nodes that touch.
        found: Contacts at the trial state.
    """

    slaves: Slaves
    found: Found

    @property
    def count(self) -> int:
        """Number of contacts at the trial state."""
        return int(self.found.closed[0])

    @property
    def ends(self) -> IntArray:
        """Slave of each contact, and its triangle if the obstacle has some, (count, 1 or 2)."""
        return self.found.ends[: self.count]

    @property
    def contacts(self) -> FloatArray:
        """Numbers of each contact, see ``law.data``, (count, FIELDS or RIGID_FIELDS)."""
        return self.found.numbers[: self.count]

    @property
    def energy(self) -> float:
        """Energy stored, J."""
        value: float = penalty.energy(self.slaves.memory, self.found.memory)
        return value

    @property
    def deepest(self) -> float:
        """Largest penetration, m."""
        return float(-self.contacts[:, GAP].min(initial=0.0))
