# SPDX-License-Identifier: LGPL-3.0-or-later
"""Polygons cut into quadrilaterals, for the ends of swept surfaces."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["anticlockwise", "between", "cut"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def anticlockwise(outline: ArrayLike, who: str) -> FloatArray:
    """The vertices (k, 2) of an outline without a repeated first one, anticlockwise.

    Raises:
        ValueError: These are not finite vertices of a polygon; ``who`` names it.
    """
    p = np.array(outline, dtype=np.float64)
    if p.ndim == 2 and len(p) > 1 and np.array_equal(p[0], p[-1]):
        p = p[:-1]
    if p.ndim != 2 or p.shape[1] != 2 or len(p) < 3 or not np.isfinite(p).all():
        raise ValueError(f"{who} has shape {p.shape}, expected (k, 2), k >= 3")
    following = np.roll(p, -1, axis=0)
    return p if np.sum(_cross(p, following)) >= 0.0 else p[::-1].copy()


def cut(polygon: FloatArray) -> IntArray:
    """Faces (m, 4) that fill an anticlockwise polygon; triangles repeat a vertex.

    Convex polygons become a ladder of quadrilaterals, others triangles: one ear after the other is
    cut off (Meisters, Polygons have ears, Amer. Math. Monthly 82, 1975).
    """
    k = len(polygon)
    sides = np.roll(polygon, -1, axis=0) - polygon
    turns = _cross(sides, np.roll(sides, -1, axis=0))
    if turns.min() >= -1e-12 * np.abs(turns).max():
        i = np.arange((k - 1) // 2)
        return np.stack([i, i + 1, np.maximum(k - 2 - i, i + 1), k - 1 - i], axis=1)
    left, faces = list(range(k)), []
    while len(left) > 3:
        # an outline that crosses itself has no ear at last: any vertex goes
        at = next((i for i in range(len(left)) if _is_ear(polygon, left, i)), 0)
        a, b, c = left[at - 1], left[at], left[(at + 1) % len(left)]
        faces.append([a, b, c, c])
        del left[at]
    return np.array([*faces, [*left, left[-1]]], dtype=np.int64)


def between(k: int) -> IntArray:
    """Faces (k, 4) between vertices 0 to k - 1 of an outline and k to 2 k - 1 of its hole."""
    j = np.arange(k)
    nxt = (j + 1) % k
    return np.stack([j, nxt, k + nxt, k + j], axis=1)


def _is_ear(polygon: FloatArray, left: list[int], at: int) -> bool:
    """Return True if a corner is convex and no other vertex lies in its triangle."""
    a, b, c = (polygon[left[i % len(left)]] for i in (at - 1, at, at + 1))
    if _cross(b - a, c - b) <= 0.0:
        return False
    others = [j for i, j in enumerate(left) if i not in {(at + n) % len(left) for n in (-1, 0, 1)}]
    p = polygon[others]
    inside = [_cross(to - of, p - of) >= 0.0 for of, to in ((a, b), (b, c), (c, a))]
    return not np.all(inside, axis=0).any()


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    product: FloatArray = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product
