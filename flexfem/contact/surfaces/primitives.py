# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points, edges and triangles of all bodies, and what of them touches in a contact."""

from dataclasses import dataclass

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.obstacles.surface_data import node_areas
from flexfem.contact.primitives.complexes import Complex

__all__ = ["Primitives", "Side", "edges_of"]


@dataclass(frozen=True)
class Primitives:
    """Points, edges and triangles of all bodies at the start.

    Attributes:
        start: (n, 3) positions of all points at the start, m.
        body: (n,) number of the body of each point, -1 for those that only carry others.
        vertex: (n,) True for the ends of edges, corners of triangles and centres of spheres.
        radius: (n,) distance from the point, m: half of a thickness.
        areas: (n,) areas without triangles, m^2: of lines the length times the diameter.
        edges: (e, 2) those of polylines first, then those of triangles.
        lines: number of the former.
        edge_body: (e,) their bodies; of triangles with common edges the first one's.
        triangles: (m, 3); triangle_body: (m,) their bodies.
    """

    start: FloatArray
    body: IntArray
    vertex: BoolArray
    radius: FloatArray
    areas: FloatArray
    edges: IntArray
    lines: int
    edge_body: IntArray
    triangles: IntArray
    triangle_body: IntArray

    def complex(self, members: BoolArray, rods: BoolArray | None = None) -> Complex:
        """The cells of the bodies that are marked in (b,).

        ``rods`` (b,) marks bodies whose polylines no others cross, see ``Complex.of``.
        """
        there = (self.body >= 0) & members[self.body]
        lines = np.flatnonzero(members[self.edge_body[: self.lines]])
        return Complex.of(
            self.triangles[members[self.triangle_body]], self.edges[lines],
            np.flatnonzero(there & self.vertex),
            np.flatnonzero(there & ~self.vertex & (self.areas > 0.0)),
            None if rods is None else rods[self.edge_body[lines]],
        )  # fmt: skip


@dataclass(frozen=True)
class Side:
    """One side of a contact.

    Attributes:
        members: (b,) True for its bodies.
        stations, areas: (s,) points that touch the other side, and their areas, m^2: a third of
            the triangles around, of lines the length times the diameter.
    """

    members: BoolArray
    stations: IntArray
    areas: FloatArray

    @classmethod
    def of(cls, own: Primitives, members: BoolArray) -> "Side":
        """Side of the bodies that are marked in (b,)."""
        touching = (own.body >= 0) & members[own.body]
        chosen = own.triangles[members[own.triangle_body]]
        areas = np.where(touching, own.areas, 0.0) + node_areas(own.start, chosen)
        stations = np.flatnonzero(areas > 0.0)
        return cls(members, stations, areas[stations])


def edges_of(triangles: IntArray) -> tuple[IntArray, IntArray]:
    """Return the edges (e, 2) of triangles (m, 3), each once, and the first triangle at each."""
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, first = np.unique(sides, axis=0, return_index=True)
    return edges.reshape(-1, 2).astype(np.int64), first // 3
