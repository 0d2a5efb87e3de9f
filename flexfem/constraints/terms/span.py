# SPDX-License-Identifier: LGPL-3.0-or-later
"""Straight part of a cable from a sheave or point a to one b, and where it touches the sheave a.

The cable runs about the axis ``n`` of a sheave, right-handed; ``u = r_a n_a`` and ``v = r_b n_b``
are its axes times its radii, zero for points. A straight part s between two sheaves touches each at
``c(s, r n) = r (s x n) / |s x n|`` from its centre, so that

``F(s) = s + c(s, u) - c(s, v) - (x_b - x_a) = 0``.

Its projections on the planes of both sheaves are tangents there, see ``core.curves.tangent_line``.
All is a function of ``D = R_a^T (x_b - x_a)`` and ``m = R_a^T R_b v`` alone, whose derivatives
follow from those of F; ``constraints.terms.relative`` makes those along twists of them.
"""

from math import atan2, sqrt

import numpy as np

from flexfem._types import FloatArray
from flexfem.constraints.terms.angle import wrapped
from flexfem.constraints.terms.relative import gradient_of_both, hessian_of_both, relative_pose
from flexfem.constraints.terms.vectors import cross_into, dot, rotate_into
from flexfem.core.curves.tangent_line import straight_into, turn_into
from flexfem.core.row import RowKind
from flexfem.kernels.compiled import on_demand, subroutine

__all__ = ["KINDS", "evaluate", "hessian"]

SPAN, TOUCH = int(RowKind.SPAN), int(RowKind.TOUCH)
KINDS = SPAN, TOUCH


@subroutine
def _first(
    u: FloatArray, m: FloatArray, s: FloatArray, ends: FloatArray, sizes: FloatArray,
    inverse: FloatArray, ds: FloatArray, dy: FloatArray,
) -> None:  # fmt: skip
    """Derivatives of s in ``ds`` (6, 3), and of ``s x (r n)`` at both ends in ``dy`` (2, 6, 3)."""
    by_m, c = np.zeros(3), np.empty(3)
    for k in range(6):
        dy[:, k] = 0.0
        if k < 3:
            for i in range(3):
                ds[k, i] = inverse[i, k]
        else:
            by_m[:] = 0.0
            by_m[k - 3] = 1.0
            cross_into(s, by_m, dy[1, k], 0)
            turn_into(dy[1, k], ends[1], sizes[1], c)
            for i in range(3):
                ds[k, i] = dot(inverse[i], c)
        for side in range(2):
            cross_into(ds[k], u if side == 0 else m, c, 0)
            for i in range(3):
                dy[side, k, i] += c[i]


@subroutine
def _bend(
    j: int, k: int, side: int, twist: FloatArray, radius: float, size: float, e: FloatArray,
    dy: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Second change of a touching point along j and k, but for that with the second one of s."""
    turn_into(twist, e, size, out)
    if size == 0.0:
        return
    first, second = dy[side, j], dy[side, k]
    a, b, scale = dot(e, first), dot(e, second), 1.0 / (radius * size * size)
    both = dot(first, second) - a * b
    for i in range(3):
        change = a * (second[i] - b * e[i]) + b * (first[i] - a * e[i]) + both * e[i]
        out[i] -= scale * change


@subroutine
def _second(
    j: int, k: int, u: FloatArray, m: FloatArray, ends: FloatArray, sizes: FloatArray,
    inverse: FloatArray, ds: FloatArray, dy: FloatArray, dds: FloatArray, ddc: FloatArray,
) -> None:  # fmt: skip
    """Second derivatives of s and of the touching point on a along j and k."""
    twist, other, y, c = np.zeros(3), np.empty(3), np.zeros(3), np.empty(3)
    _bend(j, k, 0, twist, sqrt(dot(u, u)), sizes[0], ends[0], dy, ddc)
    if sizes[1] > 0.0:
        for one, two in ((j, k), (k, j)):
            if two >= 3:
                y[:] = 0.0
                y[two - 3] = 1.0
                cross_into(ds[one], y, c, 0)
                for i in range(3):
                    twist[i] += c[i]
    _bend(j, k, 1, twist, sqrt(dot(m, m)), sizes[1], ends[1], dy, other)
    for i in range(3):
        other[i] -= ddc[i]
    for i in range(3):
        dds[i] = dot(inverse[i], other)
    cross_into(dds, u, y, 0)
    turn_into(y, ends[0], sizes[0], c)
    for i in range(3):
        ddc[i] += c[i]


@subroutine
def _to_twists(x: FloatArray, v: FloatArray, f: FloatArray, by_b: FloatArray) -> None:
    """Gradient ``by_b`` (6) along twists of b from that by D and m (6)."""
    turned = np.empty(3)
    for k in range(3):
        by_b[k] = x[3 + k] * f[0] + x[6 + k] * f[1] + x[9 + k] * f[2]
        turned[k] = x[3 + k] * f[3] + x[6 + k] * f[4] + x[9 + k] * f[5]
    cross_into(v, turned, by_b, 3)


@subroutine
def _second_to_twists(
    x: FloatArray, v: FloatArray, f: FloatArray, ff: FloatArray, out: FloatArray
) -> None:
    """Derivatives (36) of :func:`_to_twists` along twists of b from those (6, 6) by D and m.

    The vectors R^T f turn back by the rotation of b while f changes.
    """
    by, moved, df, g, c = np.empty(6), np.zeros(6), np.empty(6), np.empty((2, 3)), np.empty(3)
    for k in range(3):
        g[0, k] = x[3 + k] * f[0] + x[6 + k] * f[1] + x[9 + k] * f[2]
        g[1, k] = x[3 + k] * f[3] + x[6 + k] * f[4] + x[9 + k] * f[5]
    unit, turn = np.empty(3), np.empty(3)
    for j in range(6):
        unit[:] = 0.0
        unit[j % 3] = 1.0
        moved[:] = 0.0
        if j < 3:
            rotate_into(x, unit, moved, 0)
        else:
            cross_into(unit, v, turn, 0)
            rotate_into(x, turn, moved, 3)
        for i in range(6):
            df[i] = 0.0
            for k in range(6):
                df[i] += ff[i, k] * moved[k]
        _to_twists(x, v, df, by)
        if j >= 3:
            cross_into(g[0], unit, c, 0)
            for i in range(3):
                by[i] += c[i]
            cross_into(g[1], unit, turn, 0)
            cross_into(v, turn, c, 0)
            for i in range(3):
                by[3 + i] += c[i]
        for i in range(6):
            out[6 * i + j] = by[i]


@on_demand
def evaluate(
    kind: int, Ha: FloatArray, Hb: FloatArray, d: FloatArray, memory: float, out: FloatArray,
    g: FloatArray,
) -> None:  # fmt: skip
    """Value in ``out[0]``, and gradient in ``g``; angles are nearest to ``memory``."""
    x, m, f, by_b = np.empty(13), np.empty(3), np.zeros(6), np.empty(6)
    s, ends, sizes, inverse = np.empty(3), np.empty((2, 3)), np.empty(2), np.empty((3, 3))
    ds, dy, c, t = np.empty((6, 3)), np.empty((2, 6, 3)), np.empty(3), np.empty(3)
    relative_pose(Ha, Hb, 1, x)
    rotate_into(x, d[1], m, 0)
    straight_into(x[:3], d[0], m, s, ends, sizes, inverse)
    _first(d[0], m, s, ends, sizes, inverse, ds, dy)
    if kind == SPAN:
        out[0] = sqrt(dot(s, s))
        for k in range(6):
            f[k] = dot(s, ds[k]) / out[0]
    else:
        radius = sqrt(dot(d[0], d[0]))
        cross_into(d[0], d[2], t, 0)
        angle = atan2(dot(t, ends[0]) / radius, dot(d[2], ends[0]))
        out[0] = wrapped(angle, memory)
        cross_into(d[0], ends[0], t, 0)
        for k in range(6):
            turn_into(dy[0, k], ends[0], sizes[0], c)
            f[k] = dot(t, c) / (radius * radius)
    _to_twists(x, d[1], f, by_b)
    gradient_of_both(x, by_b, g)


@on_demand
def hessian(kind: int, Ha: FloatArray, Hb: FloatArray, d: FloatArray, h: FloatArray) -> None:
    """Derivative (12, 12) of the gradient."""
    x, m, f, ff, by_b = np.empty(13), np.empty(3), np.zeros(6), np.zeros((6, 6)), np.empty(6)
    s, ends, sizes, inverse = np.empty(3), np.empty((2, 3)), np.empty(2), np.empty((3, 3))
    ds, dy, dds, ddc = np.empty((6, 3)), np.empty((2, 6, 3)), np.empty(3), np.empty(3)
    t, c, second = np.empty(3), np.empty(3), np.empty(36)
    relative_pose(Ha, Hb, 2, x)
    rotate_into(x, d[1], m, 0)
    straight_into(x[:3], d[0], m, s, ends, sizes, inverse)
    _first(d[0], m, s, ends, sizes, inverse, ds, dy)
    length, square = sqrt(dot(s, s)), dot(d[0], d[0])
    cross_into(d[0], ends[0], t, 0)
    for k in range(6):
        if kind == SPAN:
            f[k] = dot(s, ds[k]) / length
        else:
            turn_into(dy[0, k], ends[0], sizes[0], c)
            f[k] = dot(t, c) / square
    for j in range(6):
        for k in range(j + 1):
            _second(j, k, d[0], m, ends, sizes, inverse, ds, dy, dds, ddc)
            if kind == SPAN:
                ff[j, k] = (dot(s, dds) + dot(ds[j], ds[k]) - f[j] * f[k]) / length
            else:
                ff[j, k] = dot(t, ddc) / square
            ff[k, j] = ff[j, k]
    _to_twists(x, d[1], f, by_b)
    _second_to_twists(x, d[1], f, ff, second)
    hessian_of_both(x, by_b, second, h)
