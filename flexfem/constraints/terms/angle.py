# SPDX-License-Identifier: LGPL-3.0-or-later
"""Angle about ``R_a u`` from ``R_a p`` to ``R_b v``, continuous over any number of revolutions."""

from math import atan2, floor, pi

import numpy as np

from flexfem._types import FloatArray
from flexfem.constraints.terms.vectors import mean, put, scaled, turned
from flexfem.core.nodes.step_kernels import add, turn, turn_back, unit
from flexfem.core.row import RowKind
from flexfem.kernels.compiled import inlined, on_demand, subroutine
from flexfem.lie._blocks import cross, dot, triple
from flexfem.lie._coefficients import Triple

__all__ = ["KIND", "hessian", "step_change", "step_gradient", "value", "wrapped"]

KIND = int(RowKind.ANGLE)
#: A revolution, rad.
_TURN = 2.0 * pi


@subroutine
def value(Ha: FloatArray, Hb: FloatArray, d: FloatArray, memory: float, g: FloatArray) -> float:
    """Value, and gradient in ``g``."""
    u, v, p = triple(d[0], 0), triple(d[1], 0), triple(d[2], 0)
    side, y = cross(u, p), turn_back(Ha, turn(Hb, v))
    cosine, sine = dot(p, y), dot(side, y)
    over = 1.0 / (cosine * cosine + sine * sine)
    slope = scaled(over, add(scaled(cosine, side), -sine, p))  # of the angle by y
    put(cross(slope, y), g, 3)
    put(cross(v, turn_back(Hb, turn(Ha, slope))), g, 9)
    return wrapped(atan2(sine, cosine), memory)


@on_demand
def hessian(Rab: FloatArray, Rba: FloatArray, d: FloatArray, h: FloatArray) -> None:
    """Derivative of the gradient ``(g x y, v x R_ba g)``: columns for axes of a, then of b."""
    u, v, p = triple(d[0], 0), triple(d[1], 0), triple(d[2], 0)
    side, y = cross(u, p), turned(Rab, v)
    cosine, sine = dot(p, y), dot(side, y)
    over = 1.0 / (cosine * cosine + sine * sine)
    g = scaled(over, add(scaled(cosine, side), -sine, p))
    other = turned(Rba, g)
    for k in range(6):
        axis = unit(k % 3)
        if k < 3:
            dy, by_turn = cross(y, axis), turned(Rba, cross(axis, g))
        else:
            dy, by_turn = turned(Rab, cross(axis, v)), cross(other, axis)
        dc, ds = dot(p, dy), dot(side, dy)
        dg = add(scaled(dc, side), -ds, p)
        dg = scaled(over, add(dg, -2.0 * (cosine * dc + sine * ds), g))
        on_a = add(cross(dg, y), 1.0, cross(g, dy))
        on_b = cross(v, add(turned(Rba, dg), 1.0, by_turn))
        column = 3 + k if k < 3 else 6 + k
        for i in range(3):
            h[3 + i, column], h[9 + i, column] = on_a[i], on_b[i]


@inlined
def _sinc_inverse(x: float) -> tuple[float, float]:
    """``x / sin(x)`` and its derivative."""
    if abs(x) < 0.1:
        y = x * x
        value = 1.0 + y * (1 / 6 + y * (7 / 360 + y * (31 / 15120 + y * 127 / 604800)))
        slope = x * (1 / 3 + y * (7 / 90 + y * (31 / 2520 + y * 127 / 75600)))
        return value, slope
    s, c = np.sin(x), np.cos(x)
    return x / s, (s - x * c) / (s * s)


@inlined
def wrapped(angle: float, near: float) -> float:
    """The angle nearest to another one."""
    return angle + _TURN * floor((near - angle) / _TURN + 0.5)


@inlined
def _angle_parts(
    s0: FloatArray, s1: FloatArray, change: float
) -> tuple[float, float, float, float, float, float, Triple, Triple]:
    """Cosine and sine at the end and on average, factor and slope; mean vectors."""
    c0, c1 = dot(triple(s0[2], 0), triple(s0[4], 0)), dot(triple(s1[2], 0), triple(s1[4], 0))
    d0, d1 = dot(triple(s0[3], 0), triple(s0[4], 0)), dot(triple(s1[3], 0), triple(s1[4], 0))
    size = np.sqrt((c0 * c0 + d0 * d0) * (c1 * c1 + d1 * d1))
    value, slope = _sinc_inverse(change)
    c, d = 0.5 * (c0 + c1), 0.5 * (d0 + d1)
    q, p = mean(triple(s0[3], 0), triple(s1[3], 0)), mean(triple(s0[2], 0), triple(s1[2], 0))
    z = (c * q[0] - d * p[0], c * q[1] - d * p[1], c * q[2] - d * p[2])
    return c1, d1, c, d, value / size, slope / size, z, q


@subroutine
def step_gradient(s0: FloatArray, s1: FloatArray, change: float, out: FloatArray) -> None:
    """Discrete gradient: opposite moments on a and b."""
    other = mean(triple(s0[4], 0), triple(s1[4], 0))
    _, _, _, _, factor, _, z, _ = _angle_parts(s0, s1, change)
    m = cross(z, other)
    put((factor * m[0], factor * m[1], factor * m[2]), out, 3)
    put((-factor * m[0], -factor * m[1], -factor * m[2]), out, 6)


@subroutine
def step_change(
    s0: FloatArray, s1: FloatArray, change: float, ta: Triple, tb: Triple, out: FloatArray
) -> None:
    """Derivative of the discrete gradient by rotations of both markers at the end."""
    c1, d1, c, d, factor, slope, z, q = _angle_parts(s0, s1, change)
    p1, q1, w1 = triple(s1[2], 0), triple(s1[3], 0), triple(s1[4], 0)
    p, w = mean(triple(s0[2], 0), p1), mean(triple(s0[4], 0), w1)
    dp, dq, dw = cross(ta, p1), cross(ta, q1), cross(tb, w1)
    dc, dd = dot(dp, w1) + dot(p1, dw), dot(dq, w1) + dot(q1, dw)
    square = c1 * c1 + d1 * d1
    turned, grown = (c1 * dd - d1 * dc) / square, (c1 * dc + d1 * dd) / square
    dfactor = slope * turned - factor * grown
    dz = (
        0.5 * (dc * q[0] + c * dq[0] - dd * p[0] - d * dp[0]),
        0.5 * (dc * q[1] + c * dq[1] - dd * p[1] - d * dp[1]),
        0.5 * (dc * q[2] + c * dq[2] - dd * p[2] - d * dp[2]),
    )
    m = add(cross(dz, w), 0.5, cross(z, dw))
    m = (factor * m[0], factor * m[1], factor * m[2])
    m = add(m, dfactor, cross(z, w))
    put(m, out, 3)
    put((-m[0], -m[1], -m[2]), out, 6)
