# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled kernels of SE(3); :mod:`flexfem.lie.se3` states the conventions and exports them."""

from flexfem._types import FloatArray
from flexfem.kernels.compiled import inlined
from flexfem.lie._blocks import (
    cross,
    dot,
    first_block,
    map_block,
    second_block,
    triple,
    zero_block,
)
from flexfem.lie._coefficients import (
    Triple,
    inverse_coefficient,
    inverse_derivatives,
    pose_coefficients,
)
from flexfem.lie.so3 import log_entries, right_coefficients

__all__ = [
    "adjoint_into",
    "coadjoint_product",
    "compose_into",
    "exp_into",
    "inverse_into",
    "inverse_tangent_apply",
    "inverse_tangent_derivative_into",
    "inverse_tangent_into",
    "log_into",
    "retract_into",
    "tangent_apply",
    "tangent_derivative_into",
    "tangent_into",
]


@inlined
def exp_into(w: FloatArray, H: FloatArray) -> None:
    """Frame of a twist."""
    u, t = triple(w, 0), triple(w, 3)
    a, b, c = pose_coefficients(dot(t, t))
    map_block(a, b, t, H, 3, 3)
    y = cross(t, u)
    z = cross(t, y)
    H[0] = u[0] + b * y[0] + c * z[0]
    H[1] = u[1] + b * y[1] + c * z[1]
    H[2] = u[2] + b * y[2] + c * z[2]


@inlined
def log_into(H: FloatArray, w: FloatArray) -> None:
    """Twist of a frame, with a rotation of at most pi."""
    x, t = triple(H, 0), log_entries(H, 3)
    e = inverse_coefficient(dot(t, t))
    y = cross(t, x)
    z = cross(t, y)
    w[0] = x[0] - 0.5 * y[0] + e * z[0]
    w[1] = x[1] - 0.5 * y[1] + e * z[1]
    w[2] = x[2] - 0.5 * y[2] + e * z[2]
    w[3], w[4], w[5] = t


@inlined
def _multiply(
    x: Triple, row_0: Triple, row_1: Triple, row_2: Triple, B: FloatArray, C: FloatArray
) -> None:
    """``C = A B`` with A in registers; column by column, so that C may be B."""
    b = triple(B, 0)
    C[0] = x[0] + dot(row_0, b)
    C[1] = x[1] + dot(row_1, b)
    C[2] = x[2] + dot(row_2, b)
    for j in range(3):
        b = (B[3 + j], B[6 + j], B[9 + j])
        C[3 + j] = dot(row_0, b)
        C[6 + j] = dot(row_1, b)
        C[9 + j] = dot(row_2, b)


@inlined
def compose_into(A: FloatArray, B: FloatArray, C: FloatArray) -> None:
    """``C = A B``; C may be A or B."""
    _multiply(triple(A, 0), triple(A, 3), triple(A, 6), triple(A, 9), B, C)


@inlined
def retract_into(H0: FloatArray, w: FloatArray, H: FloatArray) -> None:
    """``H = H0 exp(w)``; H may be H0."""
    x, row_0, row_1, row_2 = triple(H0, 0), triple(H0, 3), triple(H0, 6), triple(H0, 9)
    exp_into(w, H)
    _multiply(x, row_0, row_1, row_2, H, H)


@inlined
def inverse_into(H: FloatArray, out: FloatArray) -> None:
    """Inverse frame; ``out`` may be H."""
    x = triple(H, 0)
    columns = ((H[3], H[6], H[9]), (H[4], H[7], H[10]), (H[5], H[8], H[11]))
    for i in range(3):
        column = columns[i]
        out[i] = -dot(column, x)
        out[3 + 3 * i], out[4 + 3 * i], out[5 + 3 * i] = column


@inlined
def adjoint_into(H: FloatArray, Ad: FloatArray) -> None:
    """``[[R, skew(x) R], [0, R]]``, row by row."""
    x = triple(H, 0)
    zero_block(Ad, 18, 6)
    for j in range(3):
        column = (H[3 + j], H[6 + j], H[9 + j])
        Ad[j], Ad[6 + j], Ad[12 + j] = column
        Ad[21 + j], Ad[27 + j], Ad[33 + j] = column
        Ad[3 + j], Ad[9 + j], Ad[15 + j] = cross(x, column)


@inlined
def coadjoint_product(v: FloatArray, p: FloatArray, out: FloatArray) -> None:
    """``ad_v^T p = -(Omega x l, Omega x j + V x l)`` of ``v = (V, Omega)`` and ``p = (l, j)``."""
    velocity, omega = triple(v, 0), triple(v, 3)
    linear, angular = triple(p, 0), triple(p, 3)
    a, b = cross(angular, omega), cross(linear, velocity)
    out[0], out[1], out[2] = cross(linear, omega)
    out[3], out[4], out[5] = a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inlined
def _map_into(p: Triple, q: Triple, w: FloatArray, out: FloatArray) -> None:
    """``[[F, dF[u]], [0, F]]`` with ``F = I + p skew(theta) + q skew(theta)^2``."""
    u, t = triple(w, 0), triple(w, 3)
    map_block(p[0], q[0], t, out, 0, 6)
    first_block(p, q, t, u, out, 3, 6)
    zero_block(out, 18, 6)
    map_block(p[0], q[0], t, out, 21, 6)


@inlined
def _apply(p: Triple, q: Triple, w: FloatArray, v: FloatArray, out: FloatArray) -> None:
    """Apply ``[[F, dF[u]], [0, F]]`` to v."""
    u, t, a, o = triple(w, 0), triple(w, 3), triple(v, 0), triple(v, 3)
    y, g, h = cross(t, o), cross(t, a), cross(u, o)
    z, r = cross(t, y), (g[0] + h[0], g[1] + h[1], g[2] + h[2])
    g, h = cross(t, r), cross(u, y)
    along = dot(t, u)
    f1, f2 = p[1] * along, q[1] * along
    for i in range(3):
        out[i] = a[i] + p[0] * r[i] + f1 * y[i] + q[0] * (g[i] + h[i]) + f2 * z[i]
        out[3 + i] = o[i] + p[0] * y[i] + q[0] * z[i]


@inlined
def _derivative_into(
    p: Triple, q: Triple, w: FloatArray, direction: FloatArray, out: FloatArray
) -> None:
    """Derivative of ``[[F, dF[u]], [0, F]]`` along a change of w."""
    u, t, d, h = triple(w, 0), triple(w, 3), triple(direction, 0), triple(direction, 3)
    first_block(p, q, t, h, out, 0, 6)
    first_block(p, q, t, h, out, 21, 6)
    # the block that will be zero holds one of the two terms of the coupling block meanwhile
    first_block(p, q, t, d, out, 18, 6)
    second_block(p, q, t, u, h, out, 3, 6)
    for i in range(3):
        for j in range(3):
            out[3 + 6 * i + j] += out[18 + 6 * i + j]
    zero_block(out, 18, 6)


@inlined
def _coefficients(w: FloatArray) -> tuple[Triple, Triple]:
    t = triple(w, 3)
    return right_coefficients(dot(t, t))


@inlined
def _inverse_coefficients(w: FloatArray) -> tuple[Triple, Triple]:
    t = triple(w, 3)
    return (0.5, 0.0, 0.0), inverse_derivatives(dot(t, t))


@inlined
def tangent_into(w: FloatArray, T: FloatArray) -> None:
    """Right tangent map ``[[T(theta), dT(theta)[u]], [0, T(theta)]]``."""
    p, q = _coefficients(w)
    _map_into(p, q, w, T)


@inlined
def tangent_apply(w: FloatArray, v: FloatArray, out: FloatArray) -> None:
    """Right tangent map at w applied to v; ``out`` may be w or v."""
    p, q = _coefficients(w)
    _apply(p, q, w, v, out)


@inlined
def tangent_derivative_into(w: FloatArray, direction: FloatArray, dT: FloatArray) -> None:
    """Derivative of the right tangent map along ``direction``."""
    p, q = _coefficients(w)
    _derivative_into(p, q, w, direction, dT)


@inlined
def inverse_tangent_into(w: FloatArray, Tinv: FloatArray) -> None:
    """Inverse of the right tangent map, ``|theta| < 2 pi``."""
    p, q = _inverse_coefficients(w)
    _map_into(p, q, w, Tinv)


@inlined
def inverse_tangent_apply(w: FloatArray, v: FloatArray, out: FloatArray) -> None:
    """Inverse of the right tangent map at w applied to v; ``out`` may be w or v."""
    p, q = _inverse_coefficients(w)
    _apply(p, q, w, v, out)


@inlined
def inverse_tangent_derivative_into(
    w: FloatArray, direction: FloatArray, dTinv: FloatArray
) -> None:
    """Derivative of the inverse of the right tangent map along ``direction``."""
    p, q = _inverse_coefficients(w)
    _derivative_into(p, q, w, direction, dTinv)
