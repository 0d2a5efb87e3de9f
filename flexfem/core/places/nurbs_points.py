# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled frames at points of NURBS elements, with their derivatives.

An element of ``k`` control points with frames ``(x_I, R_I)`` and shape functions ``N_I(xi)`` has at
``xi`` the position ``x = sum N_I x_I`` and the rotation of the quaternion ``q = sum N_I q_I``, not
normalised, where ``q_I`` is that of ``R_I`` with the sign that brings it nearest to the control
point ``r = k // 2`` (sources in ``flexfem.forms.nurbs_beam``).

With ``z_I = q^-1 q_I`` and ``zeta = q^-1 q' = sum N_I' z_I``, ' for the derivative by ``xi``, the
local rotation of the point is along local rotations of the control points, ``dq_I = q_I o theta_I /
2``,

    theta = sum N_I vec(z_I o theta_I) + 2 vec(zeta) dxi.

Its derivatives follow from ``dz_I = z_I o theta_I / 2 - (sum N_J z_J o theta_J / 2 + zeta dxi) o
z_I``. The moment ``m`` at the point is ``N_I vec(a_I)`` at the control points, ``a_I = z_I^* o m``.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.kernels.compiled import inlined, on_demand, subroutine
from flexfem.lie._blocks import dot, triple
from flexfem.lie._coefficients import Triple
from flexfem.lie.quaternion import Quaternion, conjugate, from_matrix, matrix_into, product

__all__ = [
    "add_force_part",
    "add_nurbs_second",
    "apply",
    "apply_transposed",
    "nurbs_jacobian",
    "nurbs_pose",
    "put_translations",
    "shape_functions",
]


@subroutine
def shape_functions(shape: FloatArray, xi: float, N: FloatArray) -> None:
    """Rational shape functions and their first three derivatives by ``xi``.

    Args:
        shape: (k, n) coefficients of ``w_I N_I`` in powers of ``xi``, divided here by their sum.
        xi: place in the element, outside [0, 1] on the continued polynomials.
        N: (4, k) result, one row per derivative.
    """
    s0, s1, s2, s3 = 0.0, 0.0, 0.0, 0.0
    for i in range(shape.shape[0]):
        a0, a1, a2, a3 = 0.0, 0.0, 0.0, 0.0
        for j in range(shape.shape[1] - 1, -1, -1):
            a3 = a3 * xi + a2
            a2 = a2 * xi + a1
            a1 = a1 * xi + a0
            a0 = a0 * xi + shape[i, j]
        N[0, i], N[1, i], N[2, i], N[3, i] = a0, a1, 2.0 * a2, 6.0 * a3
        s0, s1, s2, s3 = s0 + a0, s1 + a1, s2 + 2.0 * a2, s3 + 6.0 * a3
    for i in range(shape.shape[0]):
        N[0, i] /= s0
        N[1, i] = (N[1, i] - N[0, i] * s1) / s0
        N[2, i] = (N[2, i] - 2.0 * N[1, i] * s1 - N[0, i] * s2) / s0
        N[3, i] = (N[3, i] - 3.0 * (N[2, i] * s1 + N[1, i] * s2) - N[0, i] * s3) / s0


@inlined
def _quaternion(values: FloatArray, row: int) -> Quaternion:
    return values[row, 0], triple(values[row], 1)


@inlined
def _put(values: FloatArray, row: int, q: Quaternion) -> None:
    w, v = q
    values[row, 0], values[row, 1], values[row, 2], values[row, 3] = w, v[0], v[1], v[2]


@inlined
def _interpolate(
    frames: FloatArray, N: FloatArray, x: FloatArray, z: FloatArray, zeta: FloatArray,
    H: FloatArray,
) -> None:  # fmt: skip
    """Frame of a point from the shape functions.

    ``x`` (3, 3) becomes the position and its first two derivatives, ``z`` (k, 4) the ``z_I``, and
    ``zeta`` (3, 4) the sums of ``z_I`` with N_I and its first two derivatives.
    """
    k = frames.shape[0]
    r = k // 2
    x[:], zeta[:] = 0.0, 0.0
    _put(z, r, from_matrix(frames[r], 3))
    for node in range(k):
        sign = 1.0
        if node != r:
            _put(z, node, from_matrix(frames[node], 3))
            near = z[node, 0] * z[r, 0] + z[node, 1] * z[r, 1]
            sign = 1.0 if near + z[node, 2] * z[r, 2] + z[node, 3] * z[r, 3] >= 0.0 else -1.0
        for i in range(4):
            z[node, i] *= sign
            zeta[0, i] += N[0, node] * z[node, i]
        for m in range(3):
            for i in range(3):
                x[m, i] += N[m, node] * frames[node, i]
    q = _quaternion(zeta, 0)
    matrix_into(q, H, 3)
    w, v = conjugate(q)
    f = 1.0 / (w * w + dot(v, v))
    inverse = f * w, (f * v[0], f * v[1], f * v[2])
    zeta[:] = 0.0
    for node in range(k):
        _put(z, node, product(inverse, _quaternion(z, node)))
        for m in range(3):
            for i in range(4):
                zeta[m, i] += N[m, node] * z[node, i]
    for i in range(3):
        H[i] = x[0, i]


@inlined
def apply(A: FloatArray, v: FloatArray, out: FloatArray) -> None:
    """Write ``A v`` of a matrix (9,)."""
    for i in range(3):
        out[i] = A[3 * i] * v[0] + A[3 * i + 1] * v[1] + A[3 * i + 2] * v[2]


@inlined
def apply_transposed(A: FloatArray, v: FloatArray, out: FloatArray) -> None:
    """Write ``A^T v``."""
    for i in range(3):
        out[i] = A[i] * v[0] + A[3 + i] * v[1] + A[6 + i] * v[2]


@inlined
def _add_cross(a: FloatArray, factor: float, out: FloatArray, row: int, column: int) -> None:
    """Add ``factor * skew(a)`` to a block of ``out``."""
    for i in range(3):
        p, q = (i + 1) % 3, (i + 2) % 3
        out[row + i, column + q] += factor * a[p]
        out[row + i, column + p] -= factor * a[q]


@inlined
def put_translations(
    frames: FloatArray, N: FloatArray, x: FloatArray, H: FloatArray, J: FloatArray
) -> None:
    """Write the first three rows of the point's local twist, those of its translation."""
    k = frames.shape[0]
    for i in range(3):
        J[i, 6 * k] = H[3 + i] * x[1, 0] + H[6 + i] * x[1, 1] + H[9 + i] * x[1, 2]
        for node in range(k):
            for j in range(3):
                J[i, 6 * node + j] = N[0, node] * (
                    H[3 + i] * frames[node, 3 + j]
                    + H[6 + i] * frames[node, 6 + j]
                    + H[9 + i] * frames[node, 9 + j]
                )


@inlined
def _jacobian(
    frames: FloatArray, N: FloatArray, x: FloatArray, z: FloatArray, zeta: FloatArray,
    H: FloatArray, J: FloatArray,
) -> None:  # fmt: skip
    """Local twist of the point."""
    k = frames.shape[0]
    J[:] = 0.0
    put_translations(frames, N, x, H, J)
    for i in range(3):
        J[3 + i, 6 * k] = 2.0 * zeta[1, 1 + i]
    for node in range(k):
        for i in range(3):
            J[3 + i, 6 * node + 3 + i] = N[0, node] * z[node, 0]
        _add_cross(z[node, 1:], N[0, node], J, 3, 6 * node + 3)


@on_demand
def nurbs_pose(frames: FloatArray, shape: FloatArray, xi: float, H: FloatArray) -> None:
    """Frame of a point; arguments as in ``line_points.line_pose``."""
    k = frames.shape[0]
    N, x, z, zeta = np.empty((4, k)), np.empty((3, 3)), np.empty((k, 4)), np.empty((3, 4))
    shape_functions(shape, xi, N)
    _interpolate(frames, N, x, z, zeta, H)


@on_demand
def nurbs_jacobian(
    frames: FloatArray, shape: FloatArray, xi: float, H: FloatArray, J: FloatArray
) -> None:
    """Frame of a point and its local twist; arguments as in ``line_points.line_jacobian``."""
    k = frames.shape[0]
    N, x, z, zeta = np.empty((4, k)), np.empty((3, 3)), np.empty((k, 4)), np.empty((3, 4))
    shape_functions(shape, xi, N)
    _interpolate(frames, N, x, z, zeta, H)
    _jacobian(frames, N, x, z, zeta, H, J)


@inlined
def add_force_part(
    frames: FloatArray, N: FloatArray, x: FloatArray, H: FloatArray, f: FloatArray, J: FloatArray,
    a: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add the changes of ``N_I R_I^T F`` and ``x' . F`` with ``F = R f``, given ``J``.

    ``a`` (4, 3) is work space.
    """
    k = frames.shape[0]
    apply(H[3:], f, a[0])
    for c in range(6 * k + 1):
        if c < 6 * k and c % 6 < 3:
            continue  # translations do not rotate F
        for i in range(3):
            p, q = (i + 1) % 3, (i + 2) % 3
            a[1, i] = J[3 + p, c] * f[q] - J[3 + q, c] * f[p]
        apply(H[3:], a[1], a[2])
        for node in range(k):
            apply_transposed(frames[node, 3:], a[2], a[3])
            for i in range(3):
                out[6 * node + i, c] += N[0, node] * a[3, i]
        for i in range(3):
            out[6 * k, c] += x[1, i] * a[2, i]
    for node in range(k):
        apply_transposed(frames[node, 3:], a[0], a[1])
        _add_cross(a[1], N[0, node], out, 6 * node, 6 * node + 3)
        for i in range(3):
            out[6 * node + i, 6 * k] += N[1, node] * a[1, i]
            out[6 * k, 6 * node + i] += N[1, node] * a[1, i]
    for i in range(3):
        out[6 * k, 6 * k] += x[2, i] * a[0, i]


@inlined
def _add_between(
    p: Quaternion, q: Quaternion, factor: float, out: FloatArray, row: int, column: int
) -> None:
    """Add ``factor * vec(p o theta o q)`` by ``theta`` to a block of ``out``."""
    (a, u), (b, v) = p, q
    along = factor * (a * b + dot(u, v))
    for i in range(3):
        m, n = (i + 1) % 3, (i + 2) % 3
        out[row + i, column + i] += along
        out[row + i, column + n] += factor * (b * u[m] - a * v[m])
        out[row + i, column + m] -= factor * (b * u[n] - a * v[n])
        for j in range(3):
            out[row + i, column + j] -= factor * (u[i] * v[j] + v[i] * u[j])


@inlined
def _add_moment_part(
    N: FloatArray, z: FloatArray, zeta: FloatArray, m: Triple, out: FloatArray
) -> None:
    """Add the changes of ``N_I vec(z_I^* o m)`` and ``2 vec(zeta) . m``."""
    k = N.shape[1]
    moment, one = (0.0, m), (1.0, (0.0, 0.0, 0.0))
    slope = conjugate(_quaternion(zeta, 1))
    turned = product(slope, moment)
    for node in range(k):
        row = 6 * node + 3
        back = conjugate(_quaternion(z, node))
        for other in range(k):
            at_other = product(conjugate(_quaternion(z, other)), moment)
            factor = 0.5 * N[0, node] * N[0, other]
            _add_between(back, at_other, factor, out, row, 6 * other + 3)
        own = product(back, moment)
        _add_between(one, own, -0.5 * N[0, node], out, row, row)
        by_xi, along = product(back, turned)[1], product(own, slope)[1]
        for i in range(3):
            out[row + i, 6 * k] += N[1, node] * own[1][i] - N[0, node] * by_xi[i]
            out[6 * k, row + i] += N[1, node] * own[1][i] - N[0, node] * along[i]
    # d zeta / d xi = q^-1 q'' - zeta o zeta
    first = _quaternion(zeta, 1)
    out[6 * k, 6 * k] += 2.0 * (dot(triple(zeta[2], 1), m) - dot(product(first, first)[1], m))


@on_demand
def add_nurbs_second(
    frames: FloatArray, shape: FloatArray, xi: float, g: FloatArray, out: FloatArray
) -> None:
    """Add the derivative of ``J^T g``; arguments as in ``line_points.add_line_second``."""
    k = frames.shape[0]
    N, x, z, zeta = np.empty((4, k)), np.empty((3, 3)), np.empty((k, 4)), np.empty((3, 4))
    H, J, a = np.empty(12), np.empty((6, 6 * k + 1)), np.empty((4, 3))
    shape_functions(shape, xi, N)
    _interpolate(frames, N, x, z, zeta, H)
    _jacobian(frames, N, x, z, zeta, H, J)
    add_force_part(frames, N, x, H, g[:3], J, a, out)
    _add_moment_part(N, z, zeta, triple(g, 3), out)
