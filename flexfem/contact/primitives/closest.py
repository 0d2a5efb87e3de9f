# SPDX-License-Identifier: LGPL-3.0-or-later
"""Closest points of two primitives.

The distance D of a pair is the smallest |r|, r = sum w_i x_i, over the points of the primitives:
w has positive weights for the first and negative ones for the second. For crossing edges with
the parameters s and t it is the smallest

    D^2 = |r|^2 + rho ((s - 1/2)^2 + (t - 1/2)^2),

which has one minimum also where edges are parallel, so that the closest points move continuously.
That is the distance of edges in five dimensions, the ends of the first at -+ sqrt(rho)/2 in the
fourth and those of the second in the fifth. Where a polyline has a vertex, t = 1. The gradient of D
by x_i is w_i r / D, since w is stationary.

Triangles and edges after Ericson, Real-Time Collision Detection (2005), sections 5.1.5 and 5.1.9.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.detection.regions import closest_on_triangle
from flexfem.contact.primitives.data import (
    CROSSING_EDGE_VERTEX,
    CROSSING_VERTICES,
    EDGE_EDGE,
    VERTEX_EDGE,
    VERTEX_TRIANGLE,
    regularisation,
)
from flexfem.kernels.compiled import inlined, kernel, subroutine

__all__ = ["apart", "closest", "closest_pairs", "place"]

#: Square of the sine of the angle at a triangle's first point, below which it is a line.
_LINE = 1e-24


@inlined
def place(
    before: FloatArray, after: FloatArray, points: IntArray, part: float, x: FloatArray
) -> None:
    """Write the positions (4, 3) of a pair's points on the way between two arrays of positions."""
    for i in range(4):
        for a in range(3):
            start = before[points[i], a]
            x[i, a] = start + part * (after[points[i], a] - start)


@inlined
def apart(before: FloatArray, after: FloatArray, kind: int, points: IntArray, reach: float) -> bool:
    """Return True if boxes around the ways of both primitives are farther apart than ``reach``."""
    middle = 2 if kind >= EDGE_EDGE else 1
    for a in range(3):
        low = high = before[points[0], a]
        other_low = other_high = before[points[3], a]
        for i in range(4):
            x, y = before[points[i], a], after[points[i], a]
            if i < middle:
                low, high = min(low, x, y), max(high, x, y)
            else:
                other_low, other_high = min(other_low, x, y), max(other_high, x, y)
        if low - other_high > reach or other_low - high > reach:
            return True
    return False


@inlined
def _along(x: FloatArray, p: int, i: int, j: int) -> float:
    """Parameter of the point of the edge i, j that is closest to the point p."""
    way = square = 0.0
    for a in range(3):
        u = x[j, a] - x[i, a]
        way += u * (x[p, a] - x[i, a])
        square += u * u
    if way <= 0.0:  # also if the edge has no length
        return 0.0
    return 1.0 if way >= square else way / square


@inlined
def _is_line(x: FloatArray) -> bool:
    """Return True if the points 1 to 3 are on a line."""
    u0, u1, u2 = x[2, 0] - x[1, 0], x[2, 1] - x[1, 1], x[2, 2] - x[1, 2]
    v0, v1, v2 = x[3, 0] - x[1, 0], x[3, 1] - x[1, 1], x[3, 2] - x[1, 2]
    area = (u1 * v2 - u2 * v1) ** 2 + (u2 * v0 - u0 * v2) ** 2 + (u0 * v1 - u1 * v0) ** 2
    squares = (u0 * u0 + u1 * u1 + u2 * u2) * (v0 * v0 + v1 * v1 + v2 * v2)
    return bool(area <= _LINE * squares)


@inlined
def _vector(x: FloatArray, w: FloatArray, r: FloatArray) -> float:
    """Write sum w_i x_i; returns its square."""
    square = 0.0
    for a in range(3):
        r[a] = w[0] * x[0, a] + w[1] * x[1, a] + w[2] * x[2, a] + w[3] * x[3, a]
        square += r[a] * r[a]
    return square


@subroutine
def _on_line(x: FloatArray, w: FloatArray, r: FloatArray) -> None:
    """Write the weights for a triangle that is a line, or a point: those of its closest edge."""
    least, at, part = np.inf, 0, 0.0
    for k in range(3):
        i, j = 1 + k, 1 + (k + 1) % 3
        t = _along(x, 0, i, j)
        w[1] = w[2] = w[3] = 0.0
        w[i], w[j] = -(1.0 - t), -t
        square = _vector(x, w, r)
        if square < least:
            least, at, part = square, k, t
    w[1] = w[2] = w[3] = 0.0
    w[1 + at], w[1 + (at + 1) % 3] = -(1.0 - part), -part


@inlined
def _best(slope: float, curvature: float) -> float:
    """Least point in [0, 1] of a parabola with this slope at 0 (negative) and curvature."""
    if slope <= 0.0:
        return 0.0
    return 1.0 if slope >= curvature else slope / curvature


@subroutine
def _crossing(kind: int, x: FloatArray, rho: float, w: FloatArray) -> None:
    """Write the weights of crossing edges."""
    if kind == CROSSING_VERTICES:
        w[0], w[1], w[2], w[3] = 0.0, 1.0, 0.0, -1.0
        return
    uu, vv, uv, ud, vd = rho, rho, 0.0, 0.5 * rho, 0.5 * rho
    cross = 0.0
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        u, v, d = x[1, a] - x[0, a], x[3, a] - x[2, a], x[2, a] - x[0, a]
        uu += u * u
        vv += v * v
        uv += u * v
        ud += u * d
        vd -= v * d
        ub, uc = x[1, b] - x[0, b], x[1, c] - x[0, c]
        cross += (ub * (x[3, c] - x[2, c]) - uc * (x[3, b] - x[2, b])) ** 2
    # least of uu s^2/2 - uv s t + vv t^2/2 - ud s - vd t
    if kind == CROSSING_EDGE_VERTEX:
        s, t = _best(ud, uu), 1.0
    else:
        # uu vv - uv^2 without the loss of digits
        whole = cross + rho * (uu + vv - rho)
        s = _best(ud * vv + uv * vd, whole)
        t = vd + uv * s
        if t <= 0.0:
            t, s = 0.0, _best(ud, uu)
        elif t >= vv:
            t, s = 1.0, _best(ud + uv, uu)
        else:
            t /= vv
    w[0], w[1], w[2], w[3] = 1.0 - s, s, -(1.0 - t), -t


@subroutine
def closest(kind: int, x: FloatArray, rho: float, w: FloatArray, r: FloatArray) -> float:
    """Closest points of a pair.

    Args:
        kind: kind of the pair.
        x: positions (4, 3) of its points, m.
        rho: square of the length that regularises crossing edges, m^2.
        w: written weights (4,) of the points.
        r: written vector (3,) from the closest point of the second primitive to that of the first.

    Returns:
        Square of the distance, m^2.
    """
    if kind >= EDGE_EDGE:
        _crossing(kind, x, rho, w)
        beside = (w[1] - 0.5) ** 2 + (w[3] + 0.5) ** 2
        return _vector(x, w, r) + rho * float(beside)
    w[0], w[1], w[2], w[3] = 1.0, -1.0, 0.0, 0.0
    if kind == VERTEX_EDGE:
        t = _along(x, 0, 1, 2)
        w[1], w[2] = -(1.0 - t), -t
    elif kind == VERTEX_TRIANGLE:
        if _is_line(x):
            _on_line(x, w, r)
        else:
            closest_on_triangle(x[0], x[1], x[2], x[3], w[1:])
            w[1], w[2], w[3] = -w[1], -w[2], -w[3]
    return _vector(x, w, r)


@kernel
def closest_pairs(
    points: FloatArray, kind: IntArray, rows: IntArray, reach: FloatArray, weights: FloatArray,
    distances: FloatArray,
) -> None:  # fmt: skip
    """Write weights (m, 4) and distances (m,) of pairs at positions (n, 3).

    ``reach`` (m,) is the sum of touch distance and dhat of each, with which crossing edges are
    regularised; 0 gives plain distances.
    """
    x, r = np.empty((4, 3)), np.empty(3)
    for p in range(len(kind)):
        place(points, points, rows[p], 0.0, x)
        rho = regularisation(kind[p], reach[p], 0.0)
        distances[p] = np.sqrt(closest(kind[p], x, rho, weights[p], r))
