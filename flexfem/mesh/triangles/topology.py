# SPDX-License-Identifier: LGPL-3.0-or-later
"""Edges and neighbours of triangles.

Triangles are rows of node indices, shape (m, 3). Edge k of a triangle lies opposite to its node k
and runs from node (k + 1) % 3 to node (k + 2) % 3. Its number 3 t + k names a side, an edge as
triangle t has it. Triangles are neighbours only within one body: where bodies share nodes, each
has an edge of its own there.
"""

from dataclasses import dataclass

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.mesh.geometry.topology import edge_keys, trace_lines

__all__ = [
    "Sides",
    "SurfaceTopology",
    "boundary_lines",
    "connected_parts",
    "match_sides",
    "node_triangles",
    "side_nodes",
    "sides_along",
    "surface_topology",
    "turned_triangles",
    "vector_areas",
]


@dataclass(frozen=True)
class Sides:
    """The sides of all triangles, sorted so that those of one edge follow one another.

    Attributes:
        order: Sides, edge by edge, shape (3 m,).
        starts: Where each edge begins in `order`, shape (e,).
        counts: Number of sides of each edge, shape (e,).
    """

    order: IntArray
    starts: IntArray
    counts: IntArray

    def twins(self) -> IntArray:
        """Return the other side of each side's edge, -1 on the boundary, shape (3 m,)."""
        twin = np.full(len(self.order), -1, dtype=np.int64)
        pairs = self.starts[self.counts == 2]
        first, second = self.order[pairs], self.order[pairs + 1]
        twin[first], twin[second] = second, first
        return twin


@dataclass(frozen=True)
class SurfaceTopology:
    """Edges and neighbours of triangles whose edges have at most two sides.

    Attributes:
        edges: Nodes of each edge as its first triangle runs along it, shape (e, 2). An edge that
            two bodies share is there once for each.
        edge_triangles: Triangles at each edge, the lower number first, the second -1 on the
            boundary, shape (e, 2).
        triangle_edges: Edge opposite to each node, shape (m, 3).
        neighbours: Triangle over each edge, -1 without, shape (m, 3).
        opposite: Node of that triangle which is not on the edge, -1 without, shape (m, 3).
    """

    edges: IntArray
    edge_triangles: IntArray
    triangle_edges: IntArray
    neighbours: IntArray
    opposite: IntArray

    @property
    def boundary_edges(self) -> IntArray:
        """Numbers of the edges with one triangle, shape (b,)."""
        return np.flatnonzero(self.edge_triangles[:, 1] < 0)


def match_sides(triangles: IntArray, body: IntArray, nodes: int) -> Sides:
    """Find the sides that lie on the same edge of the same body.

    Args:
        triangles: Node indices, shape (m, 3).
        body: Number of each triangle's body, shape (m,).
        nodes: Number of nodes; its square times the number of bodies must be below 2^63.
    """
    start, end = side_nodes(triangles)
    low, high = np.minimum(start, end), np.maximum(start, end)
    keys = (np.repeat(body, 3) * nodes + low) * nodes + high
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
    return Sides(order, starts, np.diff(np.append(starts, len(keys))))


def side_nodes(triangles: IntArray) -> tuple[IntArray, IntArray]:
    """Return the nodes where each side starts and ends, shapes (3 m,)."""
    return triangles[:, [1, 2, 0]].ravel(), triangles[:, [2, 0, 1]].ravel()


def sides_along(triangles: IntArray, pairs: IntArray, nodes: int) -> IntArray:
    """Return the first side that lies along each pair of nodes, -1 without, shape (k,).

    Args:
        triangles: Node indices, shape (m, 3), whose sides are counted.
        pairs: Nodes of edges in either direction, shape (k, 2).
        nodes: Number of nodes of the mesh.
    """
    keys = edge_keys(np.stack(side_nodes(triangles), axis=1), nodes)
    wanted = edge_keys(pairs, nodes)
    order = np.argsort(keys, kind="stable")
    at = np.minimum(np.searchsorted(keys[order], wanted), len(keys) - 1)
    found: IntArray = np.where(keys[order[at]] == wanted, order[at], -1)
    return found


def surface_topology(triangles: IntArray, sides: Sides) -> SurfaceTopology:
    """Return edges and neighbours.

    Args:
        triangles: Node indices, shape (m, 3).
        sides: Of these triangles, at most two on an edge.
    """
    twin = sides.twins()
    first = sides.order[sides.starts]
    start, end = side_nodes(triangles)
    number = np.empty(len(twin), dtype=np.int64)
    number[sides.order] = np.repeat(np.arange(len(first)), sides.counts)
    inner = twin >= 0
    return SurfaceTopology(
        edges=np.column_stack([start[first], end[first]]),
        edge_triangles=np.column_stack([first // 3, twin[first] // 3]),
        triangle_edges=number.reshape(-1, 3),
        neighbours=(twin // 3).reshape(-1, 3),
        opposite=np.where(inner, triangles.ravel()[twin], -1).reshape(-1, 3),
    )


def turned_triangles(triangles: IntArray, sides: Sides) -> tuple[BoolArray, int]:
    """Find the triangles that run the other way round than the first of their connected part.

    In the double cover of the mesh every triangle is there both ways round, and neighbours that
    fit are joined. Its connected parts are the ways to orient a part of the mesh; a part with one
    side only has one where an orientable one has two.

    Args:
        triangles: Node indices, shape (m, 3).
        sides: Of these triangles, at most two on an edge.

    Returns:
        Flags of the triangles to flip, shape (m,), and the first triangle of a part that has one
        side only, -1 if there is none.
    """
    count, twin = len(triangles), sides.twins()
    start, _ = side_nodes(triangles)
    side = np.flatnonzero(twin > np.arange(len(twin)))
    a, b = side // 3, twin[side] // 3
    # Neighbours fit when they run along their edge in opposite directions
    clash = start[side] == start[twin[side]]
    if not clash.any():
        return np.zeros(count, dtype=bool), -1
    other = np.where(clash, b + count, b)
    labels = _labels(
        2 * count,
        np.concatenate([a, a + count]),
        np.concatenate([other, (other + count) % (2 * count)]),
    )
    plain, reverse = labels[:count], labels[count:]
    if (one_sided := plain == reverse).any():
        return np.zeros(count, dtype=bool), int(np.argmax(one_sided))
    # The first triangle of a part is the lowest of both copies that carry its labels
    lowest = np.full(labels.max() + 1, count)
    np.minimum.at(lowest, plain, np.arange(count))
    np.minimum.at(lowest, reverse, np.arange(count))
    return plain[lowest[plain]] != plain, -1


def connected_parts(neighbours: IntArray) -> IntArray:
    """Return the number of each triangle's part, parts joined by edges, shape (m,)."""
    triangle, k = np.nonzero(neighbours >= 0)
    return _labels(len(neighbours), triangle, neighbours[triangle, k])


def node_triangles(triangles: IntArray, nodes: int) -> tuple[IntArray, IntArray]:
    """Return the triangles at each node, compressed by rows.

    Args:
        triangles: Node indices, shape (m, 3).
        nodes: Number of nodes n.

    Returns:
        Offsets, shape (n + 1,), and triangles in ascending order for each node, shape (3 m,).
    """
    flat = triangles.ravel()
    offsets = np.concatenate([[0], np.cumsum(np.bincount(flat, minlength=nodes))])
    return offsets, np.argsort(flat, kind="stable") // 3


def boundary_lines(topology: SurfaceTopology, triangles: IntArray) -> list[IntArray]:
    """Return the node rows along the boundary of some triangles, which stay on the left.

    Rows end where more than two boundary edges meet. A closed row repeats its first node.

    Args:
        topology: Of the whole mesh.
        triangles: Numbers of the triangles, whole bodies.
    """
    numbers = topology.boundary_edges
    chosen = np.isin(topology.edge_triangles[numbers, 0], triangles)
    return [line.nodes for line in trace_lines(topology.edges[numbers[chosen]])]


def vector_areas(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Return the normals times the areas, shape (m, 3), square metres."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


def _labels(count: int, first: IntArray, second: IntArray) -> IntArray:
    """Return the number of the connected part of each vertex of a graph."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(first), dtype=np.int8), (first, second)), (count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)
