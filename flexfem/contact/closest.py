# SPDX-License-Identifier: LGPL-3.0-or-later
"""The triangles near a point: which is closest, and on which side of them the point is."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.regions import FACE, closest_on_triangle, dot
from flexfem.lie.compiled import inlined

__all__ = [
    "closest_candidates",
    "is_first",
    "leave_minima",
    "mean_normal",
    "on_rim",
    "signed_distance",
]


@inlined
def closest_candidates(
    points: FloatArray, p: FloatArray, triangles: IntArray, normals: FloatArray, reach: float,
    thickness: FloatArray, candidates: IntArray, sides: IntArray,
    labels: IntArray, near: IntArray, measures: FloatArray,
) -> int:  # fmt: skip
    """Write the candidates that may touch; returns how many there are.

    Of each the place in the list, the region, a mark, its nodes, those of the edge or node of the
    region, and the label; area coordinates, squared distance, way to the point. Left out are
    those whose planes are farther away, on the node's side, than contact reaches.
    """
    count = 0
    for c in range(candidates.size):
        t = candidates[c]
        i, j, k = triangles[t]
        x, n = points[i], normals[t]
        height = (p[0] - x[0]) * n[0] + (p[1] - x[1]) * n[1] + (p[2] - x[2]) * n[2]
        if (height * sides[c] if sides[c] != 0 else abs(height)) > reach + thickness[t]:
            continue
        w = measures[count, :3]
        region = closest_on_triangle(p, x, points[j], points[k], w)
        near[count, 0], near[count, 1] = c, region
        near[count, 3], near[count, 4], near[count, 5], near[count, 8] = i, j, k, labels[c]
        m = region - 4 if region > 3 else region % 3
        near[count, 6] = near[count, 3 + m]
        near[count, 7] = near[count, 3 + (m if region > 3 else (m + 1) % 3)]
        square = 0.0
        for a in range(3):
            y = w[0] * x[a] + w[1] * points[j, a] + w[2] * points[k, a]
            measures[count, 4 + a] = p[a] - y
            square += (p[a] - y) ** 2
        measures[count, 3] = square
        count += 1
    return count


@inlined
def _has(first: int, second: int, third: int, a: int, b: int) -> bool:
    """Return True if a triangle has both nodes a and b, or the one node if they are equal."""
    return a in (first, second, third) and b in (first, second, third)


@inlined
def leave_minima(near: IntArray, measures: FloatArray, count: int) -> int:
    """Mark the candidates whose distance is a minimum; returns how many there are.

    It is one in a face, and at an edge or node where no triangle there is closer, or as close
    before this one. Comparison without a tolerance: of those that rounding makes equal exactly one
    remains, or they have the same normal.
    """
    minima, closest = 0, 0
    for o in range(1, count):
        if measures[o, 3] < measures[closest, 3]:
            closest = o
    for one in range(count):
        least, square, a, b = 1, measures[one, 3], near[one, 6], near[one, 7]
        if near[one, 1] != FACE and one != closest:
            if _has(near[closest, 3], near[closest, 4], near[closest, 5], a, b):
                least = 0
            for o in range(count):
                d = measures[o, 3]
                if least == 0:
                    break
                closer = d < square or (d == square and o < one)
                if closer and _has(near[o, 3], near[o, 4], near[o, 5], a, b):
                    least = 0
        near[one, 2] = least
        minima += least
    return minima


@inlined
def is_first(near: IntArray, measures: FloatArray, count: int, one: int) -> bool:
    """Return True if no other minimum with the same label is closer."""
    first = True
    for o in range(count):
        same = near[o, 2] == 1 and near[o, 8] == near[one, 8]
        first = first and not (same and measures[o, 3] < measures[one, 3])
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
    points: FloatArray, triangles: IntArray, normals: FloatArray, candidates: IntArray,
    near: IntArray, count: int, one: int, n: FloatArray,
) -> None:  # fmt: skip
    """Write the normal of the edge or node closest to the point.

    It is the sum over the triangles there, weighted with their angles at a node (Baerentzen, Aanaes
    2005): which side a point is on follows from it for sure.
    """
    region, here = near[one, 1], triangles[candidates[near[one, 0]]]
    n[0] = n[1] = n[2] = 0.0
    for o in range(count):
        t = candidates[near[o, 0]]
        if not _has(near[o, 3], near[o, 4], near[o, 5], near[one, 6], near[one, 7]):
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
    """Return True if a triangle's region is on the rim (bits 0 to 2 edges, 3 to 5 nodes)."""
    return region != FACE and (rim >> (region - 1)) & 1 == 1


@inlined
def signed_distance(
    points: FloatArray, triangles: IntArray, normals: FloatArray, rims: IntArray,
    candidates: IntArray, side: int, near: IntArray, measures: FloatArray, count: int, one: int,
    n: FloatArray,
) -> float:  # fmt: skip
    """Write the normal (3,) on the node's side; returns the distance with its sign."""
    t, region, r = candidates[near[one, 0]], near[one, 1], measures[one, 4:7]
    if region == FACE:
        height = dot(r, normals[t])
        sign = (1.0 if height >= 0.0 else -1.0) if side == 0 else float(side)
        for a in range(3):
            n[a] = sign * normals[t, a]
        return sign * height
    size, sign = np.sqrt(measures[one, 3]), 1.0
    if (side != 0 and not on_rim(rims[t], region)) or size < 1e-200:
        mean_normal(points, triangles, normals, candidates, near, count, one, n)
        if dot(n, r) * side < 0.0:
            sign = -1.0
    if size < 1e-200:
        for a in range(3):
            n[a] *= 1.0 if side >= 0 else -1.0
        return 0.0
    for a in range(3):
        n[a] = sign * r[a] / size
    return float(sign * size)
