# SPDX-License-Identifier: LGPL-3.0-or-later
"""On which side of the triangles near it a node belongs.

A node keeps the side on which it came near, even where it has got through the surface: it is
pushed back. It loses it where it passes the rim of an open surface. Triangles of one connected part
that share nodes have the same side.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.closest import closest_candidates, mean_normal, on_rim
from flexfem.contact.regions import FACE, dot
from flexfem.lie.compiled import inlined, kernel

__all__ = ["carry_sides", "label_candidates", "settle_sides"]

#: Cosine of the angle to the surface's normal up to which a point beside an edge has a side.
_CLEAR = 0.5


@kernel
def carry_sides(
    old_starts: IntArray, old_candidates: IntArray, old_sides: IntArray, starts: IntArray,
    candidates: IntArray, sides: IntArray,
) -> None:  # fmt: skip
    """Write the sides of candidates that were there before, 0 for new ones; rows ascend."""
    for i in range(len(starts) - 1):
        o = old_starts[i]
        for c in range(starts[i], starts[i + 1]):
            while o < old_starts[i + 1] and old_candidates[o] < candidates[c]:
                o += 1
            there = o < old_starts[i + 1] and old_candidates[o] == candidates[c]
            sides[c] = old_sides[o] if there else 0


@inlined
def _settled(row: IntArray, side: IntArray, rims: IntArray) -> bool:
    """Return True if all sides are known, away from rims."""
    settled = True
    for c in range(row.size):
        settled = settled and side[c] != 0 and rims[row[c]] == 0
    return settled


@kernel
def label_candidates(
    triangles: IntArray, parts: IntArray, closed: IntArray, starts: IntArray, candidates: IntArray,
    labels: IntArray,
) -> None:  # fmt: skip
    """Number alike those candidates of each slave that share nodes, directly or through others.

    Parts (m,) number the connected parts: only triangles of one part are numbered alike, and all of
    a part that is ``closed`` (m,), not 0: the triangles on its other side are no other layer.
    """
    for i in range(len(starts) - 1):
        first, last = starts[i], starts[i + 1]
        for c in range(first, last):
            labels[c] = c - first
        changed = last > first
        while changed:
            changed = False
            for c in range(first, last):
                t = candidates[c]
                for o in range(first, c):
                    u = candidates[o]
                    if labels[c] == labels[o] or parts[t] != parts[u]:
                        continue
                    shared = closed[t] != 0
                    for k in range(3):
                        node = triangles[t, k]
                        a, b, d = triangles[u]
                        shared = shared or node in (a, b, d)
                    if shared:
                        changed = True
                        labels[c] = labels[o] = min(labels[c], labels[o])


@inlined
def _side(
    points: FloatArray, triangles: IntArray, normals: FloatArray, rims: IntArray, row: IntArray,
    near: IntArray, measures: FloatArray, label: int, labels: IntArray, known: int, n: FloatArray,
) -> int:  # fmt: skip
    """Side of the candidates with one label."""
    one, least = -1, np.inf
    for c in range(row.size):
        if labels[c] == label and measures[c, 3] < least:
            one, least = c, measures[c, 3]
    region = near[one, 1]
    if on_rim(rims[row[one]], region):
        return 0
    if known != 0:
        return known
    r = measures[one, 4:7]
    if region == FACE:
        return 1 if dot(r, normals[row[one]]) >= 0.0 else -1
    mean_normal(points, triangles, normals, row, near, row.size, one, n)
    height = dot(r, n)
    if abs(height) <= _CLEAR * np.sqrt(measures[one, 3]):
        return 0
    return 1 if height > 0.0 else -1


@kernel
def settle_sides(
    points: FloatArray, slaves: IntArray, triangles: IntArray, rims: IntArray, labels: IntArray,
    normals: FloatArray, starts: IntArray, candidates: IntArray, sides: IntArray,
    near: IntArray, measures: FloatArray,
) -> None:  # fmt: skip
    """Find sides that are not known, and forget those of nodes at a rim.

    Arguments are those of ``find.find_contacts``.
    """
    n, nothing = np.empty(3), np.zeros(len(triangles))
    unknown = np.zeros(len(near), np.int64)
    for i in range(len(slaves)):
        if starts[i] == starts[i + 1]:
            continue
        row, side = candidates[starts[i] : starts[i + 1]], sides[starts[i] : starts[i + 1]]
        if _settled(row, side, rims):
            continue
        group = labels[starts[i] : starts[i + 1]]
        closest_candidates(
            points, points[slaves[i]], triangles, normals, np.inf, nothing, row,
            unknown[: row.size], group, near, measures,
        )  # fmt: skip
        for label in range(row.size):
            if group[label] != label:
                continue
            known = 0
            for c in range(row.size):
                if group[c] == label and side[c] != 0:
                    known = side[c]
            now = _side(
                points, triangles, normals, rims, row, near, measures, label, group, known, n
            )
            for c in range(row.size):
                if group[c] == label:
                    side[c] = now
