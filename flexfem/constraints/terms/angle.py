# SPDX-License-Identifier: LGPL-3.0-or-later
"""Angle about ``R_a u`` from ``R_a p`` to ``R_b v``, continuous over any number of revolutions."""

from math import atan2

import numpy as np

from flexfem._types import FloatArray
from flexfem.constraints.terms.vectors import (
    add_block,
    cross_into,
    dot,
    mean,
    multiply,
    product_into,
    put,
    rotate_back_into,
    rotate_into,
    skew_into,
)
from flexfem.core.nodes.step_kernels import add
from flexfem.core.row import RowKind
from flexfem.kernels.compiled import inlined, on_demand, subroutine
from flexfem.lie._blocks import cross, triple
from flexfem.lie._blocks import dot as dot_of
from flexfem.lie._coefficients import Triple

__all__ = ["KIND", "hessian", "step_change", "step_gradient", "value", "wrapped"]

KIND = int(RowKind.ANGLE)


@subroutine
def value(
    Ha: FloatArray, Hb: FloatArray, d: FloatArray, memory: float, g: FloatArray, s: FloatArray
) -> float:
    """Value, and gradient in ``g``."""
    u, v, p = d[0], d[1], d[2]
    rotate_into(Hb, v, s[0], 0)
    rotate_back_into(Ha, s[0], s[1], 0)  # y
    cross_into(u, p, s[2], 0)
    cosine, sine = dot(p, s[1]), dot(s[2], s[1])
    square = cosine * cosine + sine * sine
    for i in range(3):
        s[3, i] = (cosine * s[2, i] - sine * p[i]) / square
    cross_into(s[3], s[1], g, 3)
    rotate_into(Ha, s[3], s[4], 0)
    rotate_back_into(Hb, s[4], s[0], 0)
    cross_into(v, s[0], g, 9)
    angle = np.arctan2(sine, cosine)
    turned: float = memory + np.arctan2(np.sin(angle - memory), np.cos(angle - memory))
    return turned


@subroutine
def _add_product(
    h: FloatArray, i: int, j: int, sign: float, A: FloatArray, B: FloatArray, work: FloatArray
) -> None:
    """Add ``sign A B`` to the block of ``h`` at (i, j); ``work`` (3, 3)."""
    product_into(A, B, work)
    add_block(h, i, j, sign, work)


@on_demand
def hessian(Rab: FloatArray, Rba: FloatArray, d: FloatArray, h: FloatArray, s: FloatArray) -> None:
    """Derivative of the gradient."""
    u, v, p = d[0], d[1], d[2]
    y, side, g = s[0], s[1], s[2]
    multiply(Rab, v, y)
    cross_into(u, p, side, 0)
    cosine, sine = dot(p, y), dot(side, y)
    square = cosine * cosine + sine * sine
    work = np.zeros((9, 3, 3))
    D, Y, V, G, dy_b, DY, Db, VR, one = work  # D: derivative of g with respect to y
    for i in range(3):
        g[i] = (cosine * side[i] - sine * p[i]) / square
    for i in range(3):
        for j in range(3):
            D[i, j] = (
                side[i] * p[j] - p[i] * side[j] - 2.0 * g[i] * (cosine * p[j] + sine * side[j])
            ) / square
    skew_into(y, 1.0, Y, 0, 0)
    skew_into(v, 1.0, V, 0, 0)
    skew_into(g, 1.0, G, 0, 0)
    product_into(Rab, V, dy_b)  # dy = skew(y) Omega_a - R_ab skew(v) Omega_b
    _add_product(h, 3, 3, 1.0, G, Y, one)
    _add_product(h, 3, 9, -1.0, G, dy_b, one)
    product_into(D, Y, DY)
    product_into(D, dy_b, Db)
    _add_product(h, 3, 3, -1.0, Y, DY, one)
    _add_product(h, 3, 9, 1.0, Y, Db, one)
    product_into(V, Rba, VR)
    _add_product(h, 9, 3, 1.0, VR, DY, one)
    _add_product(h, 9, 9, -1.0, VR, Db, one)
    _add_product(h, 9, 3, -1.0, VR, G, one)
    multiply(Rba, g, s[3])
    Y[:] = 0.0
    skew_into(s[3], 1.0, Y, 0, 0)
    _add_product(h, 9, 9, 1.0, V, Y, one)


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
    return near + atan2(np.sin(angle - near), np.cos(angle - near))


@inlined
def _angle_parts(
    s0: FloatArray, s1: FloatArray, change: float
) -> tuple[float, float, float, float, float, float, Triple, Triple]:
    """Cosine and sine at the end and on average, factor and slope; mean vectors."""
    c0, c1 = dot_of(triple(s0[2], 0), triple(s0[4], 0)), dot_of(triple(s1[2], 0), triple(s1[4], 0))
    d0, d1 = dot_of(triple(s0[3], 0), triple(s0[4], 0)), dot_of(triple(s1[3], 0), triple(s1[4], 0))
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
    dc, dd = dot_of(dp, w1) + dot_of(p1, dw), dot_of(dq, w1) + dot_of(q1, dw)
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
