# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled frames at points of NURBS elements, with their derivatives.

An element of ``k`` control points with frames ``(x_I, R_I)`` and shape functions ``N_I(xi)`` has at
``xi`` the frame ``x = sum N_I x_I``, ``R = R_r exp(Theta)``, ``Theta = sum N_I Theta_I``, where
``Theta_I = log(R_r^T R_I)`` are the rotations relative to the control point ``r = k // 2``.

With the right tangent map T of SO(3) ``dTheta_I = T^-1(Theta_I) theta_I - T^-1(Theta_I)^T theta_r``
holds along local rotations of the control points. Since ``T^-1(Theta)^T = T^-1(Theta) -
skew(Theta)`` and ``T(Theta) skew(Theta) = I - exp(-Theta)``, the local rotation of the point is

    theta = theta_r + T(Theta) (sum N_I T^-1(Theta_I) (theta_I - theta_r) + Theta' dxi).
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.lie import so3
from flexfem.lie.compiled import inlined, kernel

__all__ = ["add_nurbs_second", "nurbs_jacobian", "nurbs_pose", "shape_functions"]


@kernel
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
def _interpolate(
    frames: FloatArray, N: FloatArray, angles: FloatArray, x: FloatArray, theta: FloatArray,
    H: FloatArray, turn: FloatArray,
) -> None:  # fmt: skip
    """Frame of a point from the shape functions.

    ``angles`` (k, 3) becomes Theta_I; ``x`` and ``theta`` (3, 3) position and Theta with their
    first two derivatives; ``turn`` (9,) is work space.
    """
    k = frames.shape[0]
    r = k // 2
    x[:] = 0.0
    theta[:] = 0.0
    for node in range(k):
        for i in range(3):
            for j in range(3):
                turn[3 * i + j] = (
                    frames[r, 3 + i] * frames[node, 3 + j]
                    + frames[r, 6 + i] * frames[node, 6 + j]
                    + frames[r, 9 + i] * frames[node, 9 + j]
                )
        so3.log_into(turn, angles[node])
        if node == r:
            angles[r] = 0.0  # not the rounding of R_r^T R_r
        for m in range(3):
            for i in range(3):
                x[m, i] += N[m, node] * frames[node, i]
                theta[m, i] += N[m, node] * angles[node, i]
    so3.exp_into(theta[0], turn)
    for i in range(3):
        H[i] = x[0, i]
        for j in range(3):
            H[3 + 3 * i + j] = (
                frames[r, 3 + 3 * i] * turn[j]
                + frames[r, 4 + 3 * i] * turn[3 + j]
                + frames[r, 5 + 3 * i] * turn[6 + j]
            )


@inlined
def _apply(A: FloatArray, v: FloatArray, out: FloatArray) -> None:
    for i in range(3):
        out[i] = A[3 * i] * v[0] + A[3 * i + 1] * v[1] + A[3 * i + 2] * v[2]


@inlined
def _apply_transposed(A: FloatArray, v: FloatArray, out: FloatArray) -> None:
    for i in range(3):
        out[i] = A[i] * v[0] + A[3 + i] * v[1] + A[6 + i] * v[2]


@inlined
def _jacobian(
    frames: FloatArray, N: FloatArray, angles: FloatArray, x: FloatArray, theta: FloatArray,
    H: FloatArray, T: FloatArray, inverse: FloatArray, J: FloatArray,
) -> None:  # fmt: skip
    """Local twist of the point; ``T`` (9,) becomes T(Theta), ``inverse`` (k, 9) T^-1(Theta_I)."""
    k = frames.shape[0]
    r = k // 2
    so3.tangent_into(theta[0], T)
    J[:] = 0.0
    for i in range(3):
        J[3 + i, 6 * r + 3 + i] = 1.0
        J[i, 6 * k] = H[3 + i] * x[1, 0] + H[6 + i] * x[1, 1] + H[9 + i] * x[1, 2]
        J[3 + i, 6 * k] = (
            T[3 * i] * theta[1, 0] + T[3 * i + 1] * theta[1, 1] + T[3 * i + 2] * theta[1, 2]
        )
    for node in range(k):
        so3.inverse_tangent_into(angles[node], inverse[node])
        for i in range(3):
            for j in range(3):
                J[i, 6 * node + j] = N[0, node] * (
                    H[3 + i] * frames[node, 3 + j]
                    + H[6 + i] * frames[node, 6 + j]
                    + H[9 + i] * frames[node, 9 + j]
                )
                if node != r:
                    turned = N[0, node] * (
                        T[3 * i] * inverse[node, j]
                        + T[3 * i + 1] * inverse[node, 3 + j]
                        + T[3 * i + 2] * inverse[node, 6 + j]
                    )
                    J[3 + i, 6 * node + 3 + j] = turned
                    J[3 + i, 6 * r + 3 + j] -= turned


@kernel
def nurbs_pose(frames: FloatArray, shape: FloatArray, xi: float, H: FloatArray) -> None:
    """Frame of a point; arguments as in ``line_points.line_pose``."""
    k = frames.shape[0]
    N, angles, turn = np.empty((4, k)), np.empty((k, 3)), np.empty(9)
    x, theta = np.empty((3, 3)), np.empty((3, 3))
    shape_functions(shape, xi, N)
    _interpolate(frames, N, angles, x, theta, H, turn)


@kernel
def nurbs_jacobian(
    frames: FloatArray, shape: FloatArray, xi: float, H: FloatArray, J: FloatArray
) -> None:
    """Frame of a point and its local twist; arguments as in ``line_points.line_jacobian``."""
    k = frames.shape[0]
    N, angles, T = np.empty((4, k)), np.empty((k, 3)), np.empty(9)
    x, theta, inverse = np.empty((3, 3)), np.empty((3, 3)), np.empty((k, 9))
    shape_functions(shape, xi, N)
    _interpolate(frames, N, angles, x, theta, H, T)
    _jacobian(frames, N, angles, x, theta, H, T, inverse, J)


@inlined
def _add_cross(a: FloatArray, factor: float, out: FloatArray, row: int, column: int) -> None:
    """Add ``factor * skew(a)`` to a block of ``out``."""
    for i in range(3):
        p, q = (i + 1) % 3, (i + 2) % 3
        out[row + i, column + q] += factor * a[p]
        out[row + i, column + p] -= factor * a[q]


@inlined
def _add_force_part(
    frames: FloatArray, N: FloatArray, x: FloatArray, H: FloatArray, f: FloatArray, J: FloatArray,
    a: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add the changes of ``N_I R_I^T F`` and ``x' . F`` with ``F = R f``.

    ``a`` (4, 3) is work space.
    """
    k = frames.shape[0]
    _apply(H[3:], f, a[0])
    for c in range(6 * k + 1):
        if c < 6 * k and c % 6 < 3:
            continue  # translations do not turn F
        for i in range(3):
            p, q = (i + 1) % 3, (i + 2) % 3
            a[1, i] = J[3 + p, c] * f[q] - J[3 + q, c] * f[p]
        _apply(H[3:], a[1], a[2])
        for node in range(k):
            _apply_transposed(frames[node, 3:], a[2], a[3])
            for i in range(3):
                out[6 * node + i, c] += N[0, node] * a[3, i]
        for i in range(3):
            out[6 * k, c] += x[1, i] * a[2, i]
    for node in range(k):
        _apply_transposed(frames[node, 3:], a[0], a[1])
        _add_cross(a[1], N[0, node], out, 6 * node, 6 * node + 3)
        for i in range(3):
            out[6 * node + i, 6 * k] += N[1, node] * a[1, i]
            out[6 * k, 6 * node + i] += N[1, node] * a[1, i]
    for i in range(3):
        out[6 * k, 6 * k] += x[2, i] * a[0, i]


@inlined
def _angle_changes(
    N: FloatArray, theta: FloatArray, inverse: FloatArray, change: FloatArray
) -> None:
    """``change`` (6, 6k + 1) becomes that of Theta and of Theta'."""
    k = N.shape[1]
    r = k // 2
    change[:] = 0.0
    for node in range(k):
        if node == r:
            continue
        for m in range(2):
            for i in range(3):
                for j in range(3):
                    row = 3 * m + i
                    change[row, 6 * node + 3 + j] = N[m, node] * inverse[node, 3 * i + j]
                    change[row, 6 * r + 3 + j] -= N[m, node] * inverse[node, 3 * j + i]
    for i in range(3):
        change[i, 6 * k] = theta[1, i]
        change[3 + i, 6 * k] = theta[2, i]


@inlined
def _add_moment_part(
    N: FloatArray, theta: FloatArray, T: FloatArray, inverse: FloatArray, m: FloatArray,
    change: FloatArray, D: FloatArray, a: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add the changes by Theta of ``N_I T^-1(Theta_I)^T M`` and ``Theta' . M``, ``M = T^T m``.

    ``D`` (9,) and ``a`` (4, 3) are work space, ``a[0]`` becomes M.
    """
    k = N.shape[1]
    r = k // 2
    _apply_transposed(T, m, a[0])
    so3.tangent_product_into(theta[0], m, D)
    for c in range(6 * k + 1):
        if c < 6 * k and c % 6 < 3:
            continue  # translations do not change Theta
        for i in range(3):
            a[1, i] = change[i, c]
        _apply(D, a[1], a[2])
        for node in range(k):
            if node == r:
                continue
            _apply_transposed(inverse[node], a[2], a[3])
            for i in range(3):
                out[6 * node + 3 + i, c] += N[0, node] * a[3, i]
                out[6 * r + 3 + i, c] -= N[0, node] * a[3, i]
        for i in range(3):
            out[6 * k, c] += theta[1, i] * a[2, i] + a[0, i] * change[3 + i, c]


@inlined
def _add_map_part(
    N: FloatArray, angles: FloatArray, inverse: FloatArray, M: FloatArray, D: FloatArray,
    a: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add the change of ``N_I T^-1(Theta_I)^T M`` at a constant M."""
    k = N.shape[1]
    r = k // 2
    for node in range(k):
        if node == r:
            continue
        so3.inverse_tangent_product_into(angles[node], M, D)
        _apply_transposed(inverse[node], M, a)
        for i in range(3):
            row, opposite = 6 * node + 3 + i, 6 * r + 3 + i
            for j in range(3):
                own, other = 0.0, 0.0
                for n in range(3):
                    own += N[0, node] * D[3 * i + n] * inverse[node, 3 * n + j]
                    other += N[0, node] * D[3 * i + n] * inverse[node, 3 * j + n]
                out[row, 6 * node + 3 + j] += own
                out[row, 6 * r + 3 + j] -= other
                out[opposite, 6 * node + 3 + j] -= own
                out[opposite, 6 * r + 3 + j] += other
            out[row, 6 * k] += N[1, node] * a[i]
            out[opposite, 6 * k] -= N[1, node] * a[i]


@kernel
def add_nurbs_second(
    frames: FloatArray, shape: FloatArray, xi: float, g: FloatArray, out: FloatArray
) -> None:
    """Add the derivative of ``J^T g``; arguments as in ``line_points.add_line_second``."""
    k = frames.shape[0]
    N, angles, T, H = np.empty((4, k)), np.empty((k, 3)), np.empty(9), np.empty(12)
    x, theta, inverse = np.empty((3, 3)), np.empty((3, 3)), np.empty((k, 9))
    J, change, a = np.empty((6, 6 * k + 1)), np.empty((6, 6 * k + 1)), np.empty((4, 3))
    shape_functions(shape, xi, N)
    _interpolate(frames, N, angles, x, theta, H, T)
    _jacobian(frames, N, angles, x, theta, H, T, inverse, J)
    _add_force_part(frames, N, x, H, g[:3], J, a, out)
    _angle_changes(N, theta, inverse, change)
    D = np.empty(9)
    _add_moment_part(N, theta, T, inverse, g[3:], change, D, a, out)
    _add_map_part(N, angles, inverse, a[0], D, a[1], out)
