# SPDX-License-Identifier: LGPL-3.0-or-later
"""The closest of the triangles near a point, and the point's side of it."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.detection.regions import FACE, closest_on_triangle, dot
from flexfem.contact.law.data import Candidates, Masters
from flexfem.kernels.compiled import inlined

__all__ = [
    "AT",
    "CORNERS",
    "LABEL",
    "LEAST",
    "MEASURES",
    "NEAR",
    "REGION",
    "SQUARE",
    "WAY",
    "closest_candidates",
    "is_first",
    "leave_minima",
    "mean_normal",
    "on_rim",
    "signed_distance",
]

#: Columns of ``Candidates.near``: number among all candidates, region of the closest point, mark of
#: those whose distance is a minimum.
AT, REGION, LEAST = 0, 1, 2
#: Further columns: three nodes of the triangle; two of the edge of the region, or its node twice;
#: label.
CORNERS, _SHARED, LABEL = 3, 6, 8
#: Number of these columns.
NEAR = 9
#: Columns of ``Candidates.measures`` after the area coordinates: squared distance, m^2, and the
#: vector from the closest point, m.
SQUARE, WAY = 3, 4
#: Number of these columns.
MEASURES = 7


@inlined
def closest_candidates(
    points: FloatArray, node: int, masters: Masters, candidates: Candidates, i: int, reach: float
) -> int:
    """Write the candidates of slave ``i`` that may touch its node; returns how many there are.

    Candidates are omitted whose planes, on the node's side, are beyond the contact distance.
    """
    p, triangles, thickness = points[node], masters.triangles, masters.thickness
    near, measures = candidates.near, candidates.measures
    # numba reads slices from 0 on faster than it reads parts of arrays
    first, last = candidates.starts[i], candidates.starts[i + 1]
    row, side = candidates.triangles[first:last], candidates.sides[first:last]
    count = 0
    for c in range(row.size):
        t = row[c]
        i0, i1, i2 = triangles[t]
        x, n = points[i0], candidates.normals[t]
        height = (p[0] - x[0]) * n[0] + (p[1] - x[1]) * n[1] + (p[2] - x[2]) * n[2]
        if (height * side[c] if side[c] != 0 else abs(height)) > reach + thickness[t]:
            continue
        w = measures[count, :3]
        region = closest_on_triangle(p, x, points[i1], points[i2], w)
        one = near[count]
        one[AT], one[REGION], one[LABEL] = first + c, region, candidates.labels[first + c]
        one[CORNERS], one[CORNERS + 1], one[CORNERS + 2] = i0, i1, i2
        m = region - 4 if region > 3 else region % 3
        one[_SHARED] = one[CORNERS + m]
        one[_SHARED + 1] = one[CORNERS + (m if region > 3 else (m + 1) % 3)]
        square = 0.0
        for a in range(3):
            y = w[0] * x[a] + w[1] * points[i1, a] + w[2] * points[i2, a]
            measures[count, WAY + a] = p[a] - y
            square += (p[a] - y) ** 2
        measures[count, SQUARE] = square
        count += 1
    return count


@inlined
def _has(near: IntArray, one: int, a: int, b: int) -> bool:
    """Return True if a triangle has both nodes a and b, or the one node if they are equal."""
    first, second, third = near[one, CORNERS], near[one, CORNERS + 1], near[one, CORNERS + 2]
    return a in (first, second, third) and b in (first, second, third)


@inlined
def leave_minima(candidates: Candidates, count: int) -> int:
    """Mark the candidates whose distance is a minimum; returns how many there are.

    It is a minimum in a face, and at an edge or node if no other triangle there is closer, or as
    close and earlier in the list. Comparison without a tolerance: of those that rounding makes
    equal exactly one remains, or they have the same normal.
    """
    near, measures = candidates.near, candidates.measures
    minima, closest = 0, 0
    for o in range(1, count):
        if measures[o, SQUARE] < measures[closest, SQUARE]:
            closest = o
    for one in range(count):
        least, square = 1, measures[one, SQUARE]
        a, b = near[one, _SHARED], near[one, _SHARED + 1]
        if near[one, REGION] != FACE and one != closest:
            if _has(near, closest, a, b):
                least = 0
            for o in range(count):
                d = measures[o, SQUARE]
                if least == 0:
                    break
                closer = d < square or (d == square and o < one)
                if closer and _has(near, o, a, b):
                    least = 0
        near[one, LEAST] = least
        minima += least
    return minima


@inlined
def is_first(candidates: Candidates, count: int, one: int) -> bool:
    """Return True if no other minimum with the same label is closer."""
    near, measures, first = candidates.near, candidates.measures, True
    for o in range(count):
        same = near[o, LEAST] == 1 and near[o, LABEL] == near[one, LABEL]
        first = first and not (same and measures[o, SQUARE] < measures[one, SQUARE])
    return first


@inlined
def _corner(points: FloatArray, triangle: IntArray, k: int) -> float:
    """Angle of a triangle at its node k."""
    x, y, z = points[triangle[k]], points[triangle[(k + 1) % 3]], points[triangle[(k + 2) % 3]]
    c = u = v = 0.0
    for a in range(3):
        c += (y[a] - x[a]) * (z[a] - x[a])
        u += (y[a] - x[a]) ** 2
        v += (z[a] - x[a]) ** 2
    return float(np.arccos(min(1.0, max(-1.0, c / np.sqrt(u * v)))))


@inlined
def mean_normal(
    points: FloatArray, masters: Masters, candidates: Candidates, count: int, one: int,
    n: FloatArray,
) -> None:  # fmt: skip
    """Write the normal of the edge or node closest to the point.

    It is the sum over the triangles there, weighted with their angles at a node (Baerentzen, Aanaes
    2005): it determines the side of a point reliably.
    """
    near, triangles, normals = candidates.near, masters.triangles, candidates.normals
    region, here = near[one, REGION], triangles[candidates.triangles[near[one, AT]]]
    n[0] = n[1] = n[2] = 0.0
    for o in range(count):
        t = candidates.triangles[near[o, AT]]
        if not _has(near, o, near[one, _SHARED], near[one, _SHARED + 1]):
            continue
        weight = 1.0
        if region > 3:
            for k in range(3):
                if triangles[t, k] == here[region - 4]:
                    weight = _corner(points, triangles[t], k)
        for a in range(3):
            n[a] += weight * normals[t, a]
    size = np.sqrt(dot(n, n))
    for a in range(3):
        n[a] /= max(size, 1e-300)


@inlined
def on_rim(rim: int, region: int) -> bool:
    """Return True if a triangle's region is on the boundary (bits 0 to 2 edges, 3 to 5 nodes)."""
    return region != FACE and (rim >> (region - 1)) & 1 == 1


@inlined
def signed_distance(
    points: FloatArray, masters: Masters, candidates: Candidates, count: int, one: int,
    n: FloatArray,
) -> float:  # fmt: skip
    """Write the normal (3,) on the node's side; returns the distance with its sign."""
    near, measures, normals = candidates.near, candidates.measures, candidates.normals
    c, region, r = near[one, AT], near[one, REGION], measures[one, WAY : WAY + 3]
    t, side = candidates.triangles[c], candidates.sides[c]
    if region == FACE:
        height = dot(r, normals[t])
        sign = (1.0 if height >= 0.0 else -1.0) if side == 0 else float(side)
        for a in range(3):
            n[a] = sign * normals[t, a]
        return sign * height
    size, sign = np.sqrt(measures[one, SQUARE]), 1.0
    if (side != 0 and not on_rim(masters.rims[t], region)) or size < 1e-200:
        mean_normal(points, masters, candidates, count, one, n)
        if dot(n, r) * side < 0.0:
            sign = -1.0
    if size < 1e-200:
        for a in range(3):
            n[a] *= 1.0 if side >= 0 else -1.0
        return 0.0
    for a in range(3):
        n[a] = sign * r[a] / size
    return float(sign * size)
