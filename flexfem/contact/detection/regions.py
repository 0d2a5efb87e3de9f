# SPDX-License-Identifier: LGPL-3.0-or-later
"""The point of a triangle closest to a given point.

Regions: 0 the face, 1 + k the edge opposite to node k, 4 + k the node k. After Ericson, Real-Time
Collision Detection (2005), section 5.1.5.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.kernels.compiled import inlined

__all__ = ["FACE", "closest_on_triangle", "dot", "unit_normal"]

FACE = 0


@inlined
def dot(a: FloatArray, b: FloatArray) -> float:
    """Inner product of two vectors (3,)."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@inlined
def unit_normal(x0: FloatArray, x1: FloatArray, x2: FloatArray, n: FloatArray) -> None:
    """Write the unit normal (3,) of a triangle."""
    a0, a1, a2 = x1[0] - x0[0], x1[1] - x0[1], x1[2] - x0[2]
    b0, b1, b2 = x2[0] - x0[0], x2[1] - x0[1], x2[2] - x0[2]
    n[0], n[1], n[2] = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    size = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
    for a in range(3):
        n[a] /= size


@inlined
def closest_on_triangle(
    p: FloatArray, x0: FloatArray, x1: FloatArray, x2: FloatArray, w: FloatArray
) -> int:
    """Write the area coordinates (3,) of the closest point; returns its region."""
    d1 = d2 = d3 = d4 = d5 = d6 = 0.0
    for a in range(3):
        u, v, q = x1[a] - x0[a], x2[a] - x0[a], p[a]
        d1 += u * (q - x0[a])
        d2 += v * (q - x0[a])
        d3 += u * (q - x1[a])
        d4 += v * (q - x1[a])
        d5 += u * (q - x2[a])
        d6 += v * (q - x2[a])
    w[0], w[1], w[2] = 0.0, 0.0, 0.0
    if d1 <= 0.0 and d2 <= 0.0:
        w[0] = 1.0
        return 4
    if d3 >= 0.0 and d4 <= d3:
        w[1] = 1.0
        return 5
    if d6 >= 0.0 and d5 <= d6:
        w[2] = 1.0
        return 6
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        w[1] = d1 / (d1 - d3)
        w[0] = 1.0 - w[1]
        return 3
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        w[2] = d2 / (d2 - d6)
        w[0] = 1.0 - w[2]
        return 2
    if va <= 0.0 and d4 >= d3 and d5 >= d6:
        w[2] = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        w[1] = 1.0 - w[2]
        return 1
    total = va + vb + vc
    w[1], w[2] = vb / total, vc / total
    w[0] = 1.0 - w[1] - w[2]
    return 0
