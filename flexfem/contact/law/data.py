# SPDX-License-Identifier: LGPL-3.0-or-later
"""Records of slaves, triangles, candidates and contacts for compiled loops.

A contact is a row of numbers. Those with triangles and those with rigid surfaces have the same
first columns.
"""

from typing import Self

import numpy as np

from flexfem._types import BoolArray
from flexfem.kernels.records import Float1D, Float2D, Int1D, Int2D, Record

__all__ = [
    "AREAS",
    "BEND",
    "DISTANCE",
    "FIELDS",
    "FIRST",
    "FORCE",
    "GAP",
    "NORMAL",
    "PLACE",
    "POTENTIAL",
    "REACH",
    "RIGID_FIELDS",
    "SECOND",
    "SLOPE",
    "TURN",
    "Candidates",
    "Found",
    "Masters",
    "Slaves",
]

#: Gap, m, negative in contact.
GAP = 0
#: Force (negative like the gap), its slope by the gap and potential (positive), all over the
#: stiffness; see ``stiffening``.
FORCE, SLOPE, POTENTIAL = 1, 2, 3
#: Unit normal from the surface to the slave, and two tangential directions, 3 numbers each.
NORMAL, FIRST, SECOND = 4, 7, 10
#: Curvatures of the distance in both directions, 1/m.
BEND = 13
#: Distance of the slave from the mid-surface at which it touches, m.
REACH = 15

#: With triangles: distance with its sign, m.
DISTANCE = 16
#: With triangles: three area coordinates of the closest point.
AREAS = 17
#: With triangles: rotation of the normal about the first direction with each node, then about the
#: second, 1/m.
TURN = 20
#: Numbers of a contact with a triangle.
FIELDS = 26

#: With rigid surfaces: position of the slave in the axes of the surface, m.
PLACE = 16
#: Numbers of a contact with a rigid surface.
RIGID_FIELDS = 19


class Slaves(Record):
    """Nodes that touch.

    Attributes:
        nodes: Rows of the positions, shape (s,).
        offsets: Contact distance from a surface of zero thickness, shape (s,), metres.
        stiffness: Force per penetration, shape (s,), N/m.
    """

    nodes: Int1D
    offsets: Float1D
    stiffness: Float1D

    def restricted(self, kept: BoolArray) -> Self:
        """Those that are marked in (s,)."""
        return type(self)(
            nodes=self.nodes[kept], offsets=self.offsets[kept], stiffness=self.stiffness[kept]
        )


class Masters(Record):
    """Triangles that are touched.

    Attributes:
        triangles: Rows of the positions, shape (m, 3).
        thickness: Half of the thickness, shape (m,), metres.
        rims: Flags of edges (bits 0 to 2, opposite to the nodes) and nodes (bits 3 to 5) on the
            boundary of the surface, shape (m,).
        parts: Number of the connected part, in which all normals point to one side, shape (m,).
        sides: The only side that acts, 1 or -1, of closed surfaces; 0 where both do, shape (m,).
    """

    triangles: Int2D
    thickness: Float1D
    rims: Int1D
    parts: Int1D
    sides: Int1D


class Candidates(Record):
    """Triangles that each slave may touch, and work space of those of one slave.

    Attributes:
        starts: First candidate of each slave, shape (s + 1,).
        triangles: Their numbers, ascending for each slave, shape (k,).
        sides: Side of each to which the slave belongs: 1, -1, or 0 for none, shape (k,).
        labels: Numbers of the connected groups of a slave's candidates, shape (k,).
        chosen: Numbers of the triangles that were searched, ascending.
        normals: Unit normals of all triangles, those of the chosen ones up to date, shape (m, 3).
        near, measures: Data of the candidates in reach, see ``closest``, at least as many rows as a
            slave has candidates, with ``NEAR`` and ``MEASURES`` columns.
    """

    starts: Int1D
    triangles: Int1D
    sides: Int1D
    labels: Int1D
    chosen: Int1D
    normals: Float2D
    near: Int2D
    measures: Float2D

    @property
    def longest(self) -> int:
        """Largest number of candidates of a slave."""
        return int(np.diff(self.starts).max(initial=0))


class Found(Record):
    """Contacts at the trial state.

    Attributes:
        closed: Number of closed contacts, shape (1,); they are the first rows of the arrays below.
        ends: Slave, and the triangle if there is one, shape (c, 2) or (c, 1).
        numbers: Data of each contact, shape (c, FIELDS) or (c, RIGID_FIELDS).
    """

    closed: Int1D
    ends: Int2D
    numbers: Float2D
