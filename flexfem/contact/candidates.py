# SPDX-License-Identifier: LGPL-3.0-or-later
"""Neighbour (Verlet) lists of contact: triangles that a node may touch until it has moved far."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.regions import closest_on_triangle
from flexfem.contact.search import overlaps, triangle_boxes
from flexfem.lie.compiled import kernel

__all__ = ["Rows", "find_candidates", "largest_move", "rings"]


@dataclass(frozen=True)
class Rows:
    """Lists of whole numbers, one after the other.

    Attributes:
        starts: Where each begins, shape (n + 1,).
        values: Ascending within a list, shape (k,).
    """

    starts: IntArray
    values: IntArray

    @classmethod
    def empty(cls, count: int) -> Self:
        """Lists of nothing."""
        return cls(np.zeros(count + 1, np.int64), np.zeros(0, np.int64))

    @property
    def longest(self) -> int:
        """Length of the longest list."""
        return int(np.diff(self.starts).max(initial=0))


def find_candidates(
    points: FloatArray, slaves: IntArray, offsets: FloatArray, triangles: IntArray,
    thickness: FloatArray, skin: float, excluded: Rows,
) -> Rows:  # fmt: skip
    """Find the triangles that each slave may touch when both have moved by half of the skin.

    Args:
        points: Positions, shape (n, 3), metres.
        slaves: Their nodes, shape (s,).
        offsets: Distance at which each slave touches a surface of no thickness, (s,), metres.
        triangles: Node indices, shape (m, 3).
        thickness: Half the thickness of each triangle, shape (m,), metres.
        skin: Farthest gap, metres.
        excluded: Nodes whose triangles each slave never touches.
    """
    low, high = np.empty((len(triangles), 3)), np.empty((len(triangles), 3))
    margins = thickness + (float(offsets.max(initial=0.0)) + skin)
    triangle_boxes(points, triangles, margins, low, high)
    at = points[slaves]
    found, values = overlaps(at, at, low, high)
    starts = np.zeros_like(found)
    _choose(
        points, slaves, offsets, triangles, thickness, skin, excluded.starts, excluded.values,
        found, values, starts,
    )  # fmt: skip
    return Rows(starts, values[: starts[-1]].copy())


@kernel
def _choose(
    points: FloatArray, slaves: IntArray, offsets: FloatArray, triangles: IntArray,
    thickness: FloatArray, skin: float, ex_starts: IntArray, ex_nodes: IntArray, found: IntArray,
    values: IntArray, starts: IntArray,
) -> None:  # fmt: skip
    """Keep those of the ``values`` within reach, moved together, and write where rows start."""
    w, kept = np.empty(3), 0
    for i in range(len(slaves)):
        p, never = points[slaves[i]], ex_nodes[ex_starts[i] : ex_starts[i + 1]]
        for e in range(found[i], found[i + 1]):
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
        starts[i + 1] = kept


@kernel
def largest_move(points: FloatArray, before: FloatArray, nodes: IntArray) -> float:
    """Farthest that one of some nodes has moved, m."""
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
        joined: Pairs of nodes that joints hold together, shape (k, 2): no edge is between them.
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
    return Rows(near.indptr.astype(np.int64), near.indices.astype(np.int64))
