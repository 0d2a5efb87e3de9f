# SPDX-License-Identifier: LGPL-3.0-or-later
"""Edges of triangles and polylines, and the coefficients with which primitives count.

The set of points within a distance r of a surface is the union of those of its triangles, edges and
vertices. Inclusion-exclusion with the coefficients here counts every point of it once, as long as
the surface is flat or convex on that scale: they add up to the Euler characteristic.
"""

from dataclasses import dataclass

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.obstacles.surface_data import node_areas

__all__ = ["Complex", "Primitives", "coefficients", "edges_of", "make_complex"]


@dataclass(frozen=True)
class Complex:
    """Primitives of one side of a contact that count, with their coefficients.

    Attributes:
        members: (b,) True for the bodies of the side.
        triangles: (m,) their numbers; each has the coefficient 1.
        edges, edge_coefficients: (e,) numbers of edges and their coefficients, which are not zero.
        vertices, vertex_coefficients: (v,) points and their coefficients, which are not zero.
        stations, areas: (s,) points that touch the other side, and their areas, m^2: a third of
            the triangles around, of lines the length times the diameter.
    """

    members: BoolArray
    triangles: IntArray
    edges: IntArray
    edge_coefficients: IntArray
    vertices: IntArray
    vertex_coefficients: IntArray
    stations: IntArray
    areas: FloatArray

    @property
    def characteristic(self) -> int:
        """Euler characteristic: the sum of all coefficients."""
        return len(self.triangles) + int(
            self.edge_coefficients.sum() + self.vertex_coefficients.sum()
        )


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


def edges_of(triangles: IntArray) -> tuple[IntArray, IntArray]:
    """Return the edges (e, 2) of triangles (m, 3), each once, and the first triangle at each."""
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, first = np.unique(sides, axis=0, return_index=True)
    return edges.reshape(-1, 2).astype(np.int64), first // 3


def coefficients(
    count: int, vertices: IntArray, edges: IntArray, triangles: IntArray
) -> tuple[IntArray, IntArray]:
    """Return the coefficients of edges (e,) and vertices (v,) of a complex.

    That of an edge is one less the number of triangles at it, that of a vertex one less the sum of
    the coefficients of all triangles and edges that contain it.

    Args:
        count: number of points n; its square must be below 2^63.
        vertices: (v,) points.
        edges: (e, 2) those of the triangles among them, each once.
        triangles: (m, 3).
    """
    keys = np.sort(edges, axis=1) @ np.array([count, 1])
    order = np.argsort(keys)
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    at = order[np.searchsorted(keys, sides @ np.array([count, 1]), sorter=order)]
    of_edges = 1 - np.bincount(at, minlength=len(edges))
    there = np.bincount(triangles.ravel(), minlength=count).astype(np.float64)
    there += np.bincount(edges.ravel(), np.repeat(of_edges, 2), count)
    of_vertices: FloatArray = 1.0 - there[vertices]
    return of_edges, np.rint(of_vertices).astype(np.int64)


def make_complex(primitives: Primitives, members: BoolArray) -> Complex:
    """Return the complex of some bodies.

    Args:
        primitives: of all bodies.
        members: (b,) True for these bodies.
    """
    own, count = primitives, len(primitives.body)
    taken, key = np.flatnonzero(members[own.triangle_body]), np.array([count, 1])
    chosen = own.triangles[taken]
    kept = np.isin(own.edges @ key, edges_of(chosen)[0] @ key)
    kept[: own.lines] = members[own.edge_body[: own.lines]]
    mine = np.flatnonzero(kept)
    touching = (own.body >= 0) & members[own.body]
    areas = np.where(touching, own.areas, 0.0) + node_areas(own.start, chosen)
    stations = np.flatnonzero(areas > 0.0)
    there = touching & own.vertex
    there[chosen] = there[own.edges[mine]] = True
    vertices = np.flatnonzero(there)
    of_edges, of_vertices = coefficients(count, vertices, own.edges[mine], chosen)
    return Complex(
        members, taken, mine[of_edges != 0], of_edges[of_edges != 0],
        vertices[of_vertices != 0], of_vertices[of_vertices != 0], stations, areas[stations],
    )  # fmt: skip
