# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled frames at points of lines that bodies carry, with their derivatives.

The first node of such an element is the body's frame; then come, for an elastic body in a floating
frame, its interfaces and the nodes of its amplitudes, three each. The point at ``xi`` has, in the
frame's axes, the position ``p(xi) + sum_j p_j(xi) y_j`` and the rotation of the quaternion ``q(xi)
+ sum_j q_j(xi) y_j``, not normalised, with the coordinates y: of every interface its position in
the frame and its rotation vector (see ``floating_frames``), then the amplitudes. All functions of
``xi`` are cubic: row j of ``shape`` (1 + n, 28) has the four coefficients, in powers of ``xi``, of
three components of the position, then of four of the quaternion; row 0 are p and q.

A nonlinear body has six more coordinates of every interface, and its rotation is in other ones (see
``floating_frames``, the twelve of a nonlinear body): those of the rotations' products follow the
amplitudes, and one that is zero marks the body.

With ``X = (p, R)`` in the frame, the local twist of the point is ``Ad(X^-1) w_F + (R^T dp, 2
vec(q^-1 dq))``, ``w_F`` that of the frame's node.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.places.floating_frames import (
    linear_into,
    relative_frame,
    rotation_into,
    row_of,
    write_columns,
    write_linear_columns,
    write_linear_second,
    write_second,
)
from flexfem.kernels.compiled import inlined, on_demand, subroutine
from flexfem.lie._blocks import triple
from flexfem.lie.quaternion import Quaternion, conjugate, matrix_into, product
from flexfem.lie.se3 import compose_into

__all__ = ["POWERS", "add_body_second", "body_jacobian", "body_pose"]

#: Coefficients of each of the seven components.
POWERS = 4


@inlined
def _nonlinear(n: int) -> bool:
    """True if these are the coordinates of a nonlinear body."""
    return n % 3 == 1


@inlined
def _interfaces(k: int, n: int) -> int:
    """Interfaces of an element of k nodes with n coordinates."""
    return (n - 3 * (k - 1)) // (9 if _nonlinear(n) else 3)


@subroutine
def _coordinates(frames: FloatArray, n: int, X: FloatArray, g: FloatArray, y: FloatArray) -> None:
    """Coordinates ``y`` (n,), relative frames ``X`` (c, 12) and factors ``g`` (c, 4)."""
    count, values = _interfaces(frames.shape[0], n), np.empty(12)
    if _nonlinear(n):
        y[n - 1] = 0.0
    for c in range(count):
        relative_frame(frames[0], frames[1 + c], X[c])
        if _nonlinear(n):
            linear_into(X[c], 1.0, values)
            for i in range(12):
                y[row_of(c, i, count, n - 1)] = values[i]
            continue
        rotation_into(X[c], g[c], y[6 * c + 3 : 6 * c + 6])
        for i in range(3):
            y[6 * c + i] = X[c, i]
    for j in range(3 * (frames.shape[0] - 1 - count)):
        y[6 * count + j] = frames[1 + count + j // 3, j % 3]


@subroutine
def _evaluate(shape: FloatArray, xi: float, y: FloatArray, V: FloatArray, B: FloatArray) -> None:
    """Position and quaternion ``V`` (3, 7) with two derivatives by ``xi``, and ``B`` (2, n, 7).

    The latter are their derivatives by the coordinates, and the derivatives of these by ``xi``.
    """
    V[:] = 0.0
    for j in range(shape.shape[0]):
        for i in range(7):
            a, slope, half = 0.0, 0.0, 0.0
            for m in range(POWERS - 1, -1, -1):
                half = half * xi + slope
                slope = slope * xi + a
                a = a * xi + shape[j, POWERS * i + m]
            factor = 1.0 if j == 0 else y[j - 1]
            V[0, i] += factor * a
            V[1, i] += factor * slope
            V[2, i] += factor * 2.0 * half
            if j > 0:
                B[0, j - 1, i], B[1, j - 1, i] = a, slope


@inlined
def _quaternion(values: FloatArray) -> Quaternion:
    return values[3], triple(values, 4)


@inlined
def _inverse(q: Quaternion) -> Quaternion:
    w, v = conjugate(q)
    f = 1.0 / (w * w + v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    return f * w, (f * v[0], f * v[1], f * v[2])


@inlined
def _frame(V: FloatArray, P: FloatArray) -> None:
    """The point in the body's frame, (12,)."""
    for i in range(3):
        P[i] = V[0, i]
    matrix_into(_quaternion(V[0]), P, 3)


@inlined
def _twists(V: FloatArray, B: FloatArray, P: FloatArray, M: FloatArray) -> None:
    """Local twists ``M`` (6, n + 1) of the point in the frame by the coordinates and ``xi``."""
    inverse, n = _inverse(_quaternion(V[0])), B.shape[1]
    for j in range(n + 1):
        change = B[0, j] if j < n else V[1]
        turned = product(inverse, _quaternion(change))[1]
        for i in range(3):
            M[i, j] = P[3 + i] * change[0] + P[6 + i] * change[1] + P[9 + i] * change[2]
            M[3 + i, j] = 2.0 * turned[i]


@subroutine
def _derivatives(
    frames: FloatArray, shape: FloatArray, X: FloatArray, g: FloatArray, units: FloatArray,
    Y: FloatArray,
) -> None:  # fmt: skip
    """Derivatives ``Y`` (n + 1, 6k + 1) of the coordinates and of ``xi`` along the twists.

    ``units`` (c, 12, 12) become those of the relative frames.
    """
    k, n = frames.shape[0], shape.shape[0] - 1
    count, width = _interfaces(k, n), 12 if _nonlinear(n) else 6
    columns = np.empty((width, 12))
    Y[:] = 0.0
    Y[n, 6 * k] = 1.0
    for c in range(count):
        if width == 12:
            write_linear_columns(X[c], units[c], columns)
        else:
            write_columns(X[c], g[c], units[c], columns)
        for i in range(width):
            row = row_of(c, i, count, n - 1)
            for j in range(6):
                Y[row, j] = columns[i, j]
                Y[row, 6 * (1 + c) + j] = columns[i, 6 + j]
    for j in range(3 * (k - 1 - count)):
        Y[6 * count + j, 6 * (1 + count + j // 3) + j % 3] = 1.0


@on_demand
def body_pose(frames: FloatArray, shape: FloatArray, xi: float, H: FloatArray) -> None:
    """Frame of a point; arguments as in ``line_points.line_pose``."""
    n = shape.shape[0] - 1
    X, g, y = np.empty((frames.shape[0], 12)), np.empty((frames.shape[0], 4)), np.empty(n)
    V, B, P = np.empty((3, 7)), np.empty((2, n, 7)), np.empty(12)
    _coordinates(frames, n, X, g, y)
    _evaluate(shape, xi, y, V, B)
    _frame(V, P)
    compose_into(frames[0], P, H)


@on_demand
def body_jacobian(
    frames: FloatArray, shape: FloatArray, xi: float, H: FloatArray, J: FloatArray
) -> None:
    """Frame of a point and its local twist; arguments as in ``line_points.line_jacobian``."""
    k, n = frames.shape[0], shape.shape[0] - 1
    X, g, y = np.empty((k, 12)), np.empty((k, 4)), np.empty(n)
    V, B, P, M = np.empty((3, 7)), np.empty((2, n, 7)), np.empty(12), np.empty((6, n + 1))
    units, Y = np.empty((k, 12, 12)), np.empty((n + 1, 6 * k + 1))
    _coordinates(frames, n, X, g, y)
    _evaluate(shape, xi, y, V, B)
    _frame(V, P)
    compose_into(frames[0], P, H)
    _twists(V, B, P, M)
    _derivatives(frames, shape, X, g, units, Y)
    for i in range(6):
        for j in range(6 * k + 1):
            J[i, j] = 0.0
            for m in range(n + 1):
                J[i, j] += M[i, m] * Y[m, j]
    for i in range(3):
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            J[i, j] += P[3 + 3 * j + i]
            J[3 + i, 3 + j] += P[3 + 3 * j + i]
            # e_j x p
            J[i, 3 + j] += P[3 + 3 * b + i] * P[a] - P[3 + 3 * a + i] * P[b]


@inlined
def _cross(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    for i in range(3):
        p, q = (i + 1) % 3, (i + 2) % 3
        out[i] = a[p] * b[q] - a[q] * b[p]


@inlined
def _rotate(P: FloatArray, v: FloatArray, out: FloatArray) -> None:
    for i in range(3):
        out[i] = P[3 + 3 * i] * v[0] + P[4 + 3 * i] * v[1] + P[5 + 3 * i] * v[2]


@subroutine
def _by_coordinates(
    V: FloatArray, B: FloatArray, P: FloatArray, M: FloatArray, w: FloatArray, A: FloatArray,
    D: FloatArray,
) -> None:  # fmt: skip
    """Derivatives by coordinates and ``xi`` of the virtual work of a constant wrench ``w`` (6,).

    ``A`` (6, n + 1) is that of ``Ad(X^-1)^T w``, ``D`` (n + 1, n + 1) that of ``M^T w``.
    """
    n = B.shape[1]
    F, dF, u, v = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    inverse = _inverse(_quaternion(V[0]))
    _rotate(P, w[:3], F)
    for j in range(n + 1):
        change = B[0, j] if j < n else V[1]
        _cross(M[3:, j], w[:3], u)
        _rotate(P, u, dF)
        _cross(change[:3], F, u)
        _cross(P[:3], dF, v)
        for i in range(3):
            A[i, j] = dF[i]
            A[3 + i, j] = u[i] + v[i]
        _cross(M[3:, j], w[3:], u)
        _rotate(P, u, v)
        by_j = product(inverse, _quaternion(change))
        for i in range(3):
            A[3 + i, j] += v[i]
        for i in range(n + 1):
            own = B[0, i] if i < n else V[1]
            turned = product(by_j, product(inverse, _quaternion(own)))[1]
            D[i, j] = 0.0
            for m in range(3):
                D[i, j] += own[m] * dF[m] - 2.0 * turned[m] * w[3 + m]
            if i < n and j < n:
                continue
            mixed = V[2] if i == j else B[1, min(i, j)]
            bent = product(inverse, _quaternion(mixed))[1]
            for m in range(3):
                D[i, j] += mixed[m] * F[m] + 2.0 * bent[m] * w[3 + m]


@on_demand
def add_body_second(
    frames: FloatArray, shape: FloatArray, xi: float, w: FloatArray, out: FloatArray
) -> None:
    """Add the derivative of ``J^T w``; arguments as in ``line_points.add_line_second``."""
    k, n = frames.shape[0], shape.shape[0] - 1
    X, g, y = np.empty((k, 12)), np.empty((k, 4)), np.empty(n)
    V, B, P, M = np.empty((3, 7)), np.empty((2, n, 7)), np.empty(12), np.empty((6, n + 1))
    units, Y = np.empty((k, 12, 12)), np.empty((n + 1, 6 * k + 1))
    A, D, change = np.empty((6, n + 1)), np.empty((n + 1, n + 1)), np.empty((12, 12))
    _coordinates(frames, n, X, g, y)
    _evaluate(shape, xi, y, V, B)
    _frame(V, P)
    _twists(V, B, P, M)
    _derivatives(frames, shape, X, g, units, Y)
    _by_coordinates(V, B, P, M, w, A, D)
    first, second = A @ Y, Y.T @ (D @ Y)
    for i in range(6 * k + 1):
        for j in range(6 * k + 1):
            out[i, j] += second[i, j] + (first[i, j] if i < 6 else 0.0)
    count, width = _interfaces(k, n), 12 if _nonlinear(n) else 6
    for c in range(count):
        force = np.zeros(width)
        for i in range(width):
            for m in range(6):
                force[i] += M[m, row_of(c, i, count, n - 1)] * w[m]
        if width == 12:
            write_linear_second(units[c], force, change)
        else:
            write_second(X[c], g[c], units[c], force, change)
        for i in range(12):
            row = i if i < 6 else 6 * c + i
            for j in range(12):
                out[row, j if j < 6 else 6 * c + j] += change[i, j]
