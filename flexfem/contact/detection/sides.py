# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sides of nearby triangles to which nodes belong.

A node keeps the side from which it approached, also after it has passed through the surface, so
that the force returns it. The side is reset beyond the boundary of an open surface. Triangles of
one connected part that share nodes have the same side.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.detection.closest import (
    AT,
    REGION,
    SQUARE,
    WAY,
    closest_candidates,
    mean_normal,
    on_rim,
)
from flexfem.contact.detection.regions import FACE, dot
from flexfem.contact.law.data import Candidates, Masters, Slaves
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Memory, unpack

__all__ = ["carry_sides", "label_candidates", "settle_sides"]

#: Cosine of the angle to the surface's normal up to which a point beside an edge has a side.
_CLEAR = 0.5


@kernel
def carry_sides(candidates: Memory, starts: IntArray, triangles: IntArray, sides: IntArray) -> None:
    """Write the sides of new lists of candidates: those of the old lists, or 0."""
    old = unpack(Candidates, candidates)
    old_starts, old_triangles, old_sides = old.starts, old.triangles, old.sides
    for i in range(len(starts) - 1):
        o = old_starts[i]
        for c in range(starts[i], starts[i + 1]):
            while o < old_starts[i + 1] and old_triangles[o] < triangles[c]:
                o += 1
            there = o < old_starts[i + 1] and old_triangles[o] == triangles[c]
            sides[c] = old_sides[o] if there else 0


@inlined
def _settled(masters: Masters, candidates: Candidates, i: int) -> bool:
    """Return True if all sides of a slave are known, away from boundaries."""
    first, last = candidates.starts[i], candidates.starts[i + 1]
    row, side = candidates.triangles[first:last], candidates.sides[first:last]
    rims, settled = masters.rims, True
    for c in range(row.size):
        settled = settled and side[c] != 0 and rims[row[c]] == 0
    return settled


@kernel
def label_candidates(masters: Memory, candidates: Memory) -> None:
    """Assign one number to those candidates of each slave that are connected by nodes.

    Only triangles of one connected part share a number, and all triangles of a one-sided part do:
    those on its other side are not another layer.
    """
    touched, own = unpack(Masters, masters), unpack(Candidates, candidates)
    triangles, parts, starts, labels = touched.triangles, touched.parts, own.starts, own.labels
    for i in range(len(starts) - 1):
        first, last = starts[i], starts[i + 1]
        for c in range(first, last):
            labels[c] = c - first
        changed = last > first
        while changed:
            changed = False
            for c in range(first, last):
                t = own.triangles[c]
                for o in range(first, c):
                    u = own.triangles[o]
                    if labels[c] == labels[o] or parts[t] != parts[u]:
                        continue
                    shared = touched.sides[t] != 0
                    for k in range(3):
                        node = triangles[t, k]
                        a, b, d = triangles[u]
                        shared = shared or node in (a, b, d)
                    if shared:
                        changed = True
                        labels[c] = labels[o] = min(labels[c], labels[o])


@inlined
def _side(
    points: FloatArray, masters: Masters, candidates: Candidates, count: int, label: int,
    known: int, n: FloatArray,
) -> int:  # fmt: skip
    """Side of the candidates with one label, all of which are near; ``n`` (3,) is work space."""
    near, measures = candidates.near, candidates.measures
    first = near[0, AT]
    labels = candidates.labels[first : first + count]
    one, least = -1, np.inf
    for c in range(count):
        if labels[c] == label and measures[c, SQUARE] < least:
            one, least = c, measures[c, SQUARE]
    t, region = candidates.triangles[first + one], near[one, REGION]
    if on_rim(masters.rims[t], region):
        return 0
    if known != 0:
        return known
    r = measures[one, WAY : WAY + 3]
    if region == FACE:
        return 1 if dot(r, candidates.normals[t]) >= 0.0 else -1
    mean_normal(points, masters, candidates, count, one, n)
    height = dot(r, n)
    if abs(height) <= _CLEAR * np.sqrt(measures[one, SQUARE]):
        return 0
    return 1 if height > 0.0 else -1


@kernel
def settle_sides(points: FloatArray, slaves: Memory, masters: Memory, candidates: Memory) -> None:
    """Find unknown sides, and reset those of nodes at a boundary.

    ``points`` (n, 3) are positions, m; normals are up to date.
    """
    nodes, touched = unpack(Slaves, slaves).nodes, unpack(Masters, masters)
    own = unpack(Candidates, candidates)
    starts, n = own.starts, np.empty(3)
    for i in range(len(nodes)):
        first, last = starts[i], starts[i + 1]
        if first == last or _settled(touched, own, i):
            continue
        count = closest_candidates(points, nodes[i], touched, own, i, np.inf)
        side, group = own.sides[first:last], own.labels[first:last]
        for label in range(count):
            if group[label] != label:
                continue
            known = 0
            for c in range(count):
                if group[c] == label and side[c] != 0:
                    known = side[c]
            now = _side(points, touched, own, count, label, known, n)
            for c in range(count):
                if group[c] == label:
                    side[c] = now
