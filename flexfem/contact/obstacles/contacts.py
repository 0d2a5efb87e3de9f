# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts of nodes with an obstacle of any shape at the trial state."""

from typing import NamedTuple

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.law import penalty
from flexfem.contact.law.closed_contacts import ClosedContacts
from flexfem.contact.law.data import GAP, Found, Slaves

__all__ = ["Lagged", "ObstacleContacts"]


class Lagged(NamedTuple):
    """Where contacts were at the start of a step, on which friction and damping act in it.

    Attributes:
        nodes: slave, and the three of a triangle if the obstacle has some, (c, 1 or 4).
        places: weights of these (c, 4), or places in the axes of a rigid surface (c, 3), m.
        start: positions of the slaves relative to these places, inertial axes, (c, 3), m.
    """

    nodes: IntArray
    places: FloatArray
    start: FloatArray

    @classmethod
    def none(cls, nodes: int, places: int) -> "Lagged":
        """No contacts, with so many nodes and numbers of places."""
        return cls(np.zeros((0, nodes), np.int64), np.zeros((0, places)), np.zeros((0, 3)))


class ObstacleContacts:
    """Contacts of the slave nodes with an obstacle.

    Attributes:
        slaves: Nodes that touch.
        found: Contacts at the trial state.
        closed: Closed contacts, on which friction and damping act.
        lagged: Where they were.
    """

    slaves: Slaves
    found: Found
    closed: ClosedContacts
    lagged: Lagged

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
