# SPDX-License-Identifier: LGPL-3.0-or-later
"""Neighbour (Verlet) lists of contact: triangles that a node may touch until it has moved far."""

from typing import Any, Self

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.detection.broad_phase import overlaps, triangle_boxes
from flexfem.contact.detection.regions import closest_on_triangle
from flexfem.contact.law.data import Slaves
from flexfem.kernels.compiled import kernel
from flexfem.kernels.records import Int1D, Memory, Record, unpack

__all__ = ["Rows", "find_candidates", "largest_move", "rings"]


class Rows(Record):
    """Lists of whole numbers, one after the other.

    Attributes:
        starts: First entry of each list, shape (n + 1,).
        values: Ascending within a list, shape (k,).
    """

    starts: Int1D
    values: Int1D

    @classmethod
    def empty(cls, count: int) -> Self:
        """Empty lists."""
        return cls(starts=np.zeros(count + 1, np.int64), values=np.zeros(0, np.int64))


def find_candidates(
    points: FloatArray, slaves: Slaves, triangles: IntArray, thickness: FloatArray, skin: float,
    excluded: Rows,
) -> tuple[IntArray, IntArray]:  # fmt: skip
    """Find the triangles that each slave may touch after both have moved by half of the skin.

    Args:
        points: Positions, shape (n, 3), metres.
        slaves: Nodes that may touch.
        triangles: Node indices, shape (m, 3).
        thickness: Half the thickness of each triangle, shape (m,), metres.
        skin: Farthest gap, metres.
        excluded: Nodes whose triangles each slave never touches.

    Returns:
        Where those of each slave begin, shape (s + 1,), and their numbers, ascending for each.
    """
    low, high = np.empty((len(triangles), 3)), np.empty((len(triangles), 3))
    margins = thickness + (float(slaves.offsets.max(initial=0.0)) + skin)
    triangle_boxes(points, triangles, margins, low, high)
    at = points[slaves.nodes]
    starts, values = overlaps(at, at, low, high)
    _choose(points, slaves.memory, triangles, thickness, skin, excluded.memory, starts, values)
    return starts, values[: starts[-1]].copy()


@kernel
def _choose(
    points: FloatArray, slaves: Memory, triangles: IntArray, thickness: FloatArray, skin: float,
    excluded: Memory, starts: IntArray, values: IntArray,
) -> None:  # fmt: skip
    """Compact the ``values`` to those within reach, and return the new starts of the rows."""
    own, never_near = unpack(Slaves, slaves), unpack(Rows, excluded)
    nodes, offsets, begins = own.nodes, own.offsets, never_near.starts
    w, kept, first = np.empty(3), 0, 0
    for i in range(len(nodes)):
        p, never = points[nodes[i]], never_near.values[begins[i] : begins[i + 1]]
        last = starts[i + 1]
        for e in range(first, last):
            t = values[e]
            allowed = True
            for k in range(3):
                place = np.searchsorted(never, triangles[t, k])
                if place < never.size and never[place] == triangles[t, k]:
                    allowed = False
            if not allowed:
                continue
            x, y, z = points[triangles[t, 0]], points[triangles[t, 1]], points[triangles[t, 2]]
            closest_on_triangle(p, x, y, z, w)
            square = 0.0
            for a in range(3):
                square += (p[a] - w[0] * x[a] - w[1] * y[a] - w[2] * z[a]) ** 2
            if square <= (offsets[i] + thickness[t] + skin) ** 2:
                values[kept] = t
                kept += 1
        starts[i + 1], first = kept, last


@kernel
def largest_move(points: FloatArray, before: FloatArray, nodes: IntArray) -> float:
    """Largest displacement of some nodes, m."""
    largest = 0.0
    for n in nodes:
        square = 0.0
        for a in range(3):
            square += (points[n, a] - before[n, a]) ** 2
        largest = max(largest, square)
    return float(np.sqrt(largest))


def rings(triangles: IntArray, nodes: IntArray, count: int, joined: IntArray) -> Rows:
    """Find the nodes up to some edges away from each of some nodes, and the nodes themselves.

    Args:
        triangles: Node indices, shape (m, 3).
        nodes: Nodes, shape (s,).
        count: Number of edges.
        joined: Pairs of nodes that joints connect, shape (k, 2): no edge is between them.
    """
    from scipy.sparse import csr_array

    size = int(max(triangles.max(initial=-1), nodes.max(initial=-1), joined.max(initial=-1))) + 1

    def both_ways(a: IntArray, b: IntArray) -> Any:
        first = np.concatenate([a, b, np.arange(size)])
        second = np.concatenate([b, a, np.arange(size)])
        return csr_array((np.ones(len(first), bool), (first, second)), (size, size))

    across = both_ways(joined[:, 0], joined[:, 1])
    step = both_ways(triangles.ravel(), np.roll(triangles, 1, axis=1).ravel()) @ across
    near = csr_array(
        (np.ones(len(nodes), bool), (np.arange(len(nodes)), nodes)), (len(nodes), size)
    )
    near = near @ across
    for _ in range(count):
        near = near @ step
    near.sort_indices()
    return Rows(starts=near.indptr.astype(np.int64), values=near.indices.astype(np.int64))
