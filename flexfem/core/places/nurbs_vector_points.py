# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled frames at points of NURBS elements that interpolate relative rotation vectors.

As ``nurbs_points``, but the rotation is ``R_r exp(v)`` with ``v = sum N_I v_I``, ``v_I = log(R_r^T
R_I)`` and the control point ``r = k // 2`` (Crisfield, Jelenic, Proc. R. Soc. Lond. A 455 (1999)
1125-1147).

Along local rotations ``theta_I`` of the control points, with the right tangent map T and ' for the
derivative by ``xi``, the local rotation of the point is

    theta = T(v) dv + exp(-v) theta_r,    dv = sum N_I dv_I + v' dxi,
    dv_I = T^-1(v_I) theta_I - T^-1(-v_I) theta_r .

A moment m at the point is ``b = T^T m``, conjugate to v, ``N_I T^-T(v_I) b`` at the control points,
and ``exp(v) m - sum N_I T^-1(v_I) b`` at r besides, since ``T^-T(-v) = T^-1(v)``.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.places.nurbs_points import (
    add_force_part,
    apply,
    apply_transposed,
    put_translations,
    shape_functions,
)
from flexfem.kernels.compiled import on_demand, subroutine
from flexfem.lie.so3 import (
    exp_into,
    inverse_tangent_derivative_into,
    inverse_tangent_into,
    log_into,
    tangent_derivative_into,
    tangent_into,
)

__all__ = ["add_vectors_second", "vectors_jacobian", "vectors_pose"]


@subroutine
def _interpolate(
    frames: FloatArray, N: FloatArray, x: FloatArray, nodal: FloatArray, v: FloatArray,
    H: FloatArray,
) -> None:  # fmt: skip
    """Frame of a point from the shape functions.

    ``x`` (3, 3) and ``v`` (3, 3) become the position and the rotation vector with their first two
    derivatives, ``nodal`` (k, 3) the rotation vectors of the control points.
    """
    k = frames.shape[0]
    R, r = np.empty(9), k // 2
    x[:], v[:] = 0.0, 0.0
    for node in range(k):
        nodal[node] = 0.0
        if node != r:
            for i in range(3):
                for j in range(3):
                    R[3 * i + j] = (
                        frames[r, 3 + i] * frames[node, 3 + j]
                        + frames[r, 6 + i] * frames[node, 6 + j]
                        + frames[r, 9 + i] * frames[node, 9 + j]
                    )
            log_into(R, nodal[node])
        for m in range(3):
            for i in range(3):
                x[m, i] += N[m, node] * frames[node, i]
                v[m, i] += N[m, node] * nodal[node, i]
    exp_into(v[0], R)
    for i in range(3):
        H[i] = x[0, i]
        for j in range(3):
            H[3 + 3 * i + j] = (
                frames[r, 3 + 3 * i] * R[j]
                + frames[r, 4 + 3 * i] * R[3 + j]
                + frames[r, 5 + 3 * i] * R[6 + j]
            )


@subroutine
def _changes(nodal: FloatArray, N: FloatArray, v: FloatArray, D: FloatArray) -> None:
    """Changes of the rotation vectors along all columns.

    ``D`` (k + 2, 3, 6k + 1) gets those of the control points, of v and of its derivative by xi.
    """
    k = nodal.shape[0]
    A, r = np.empty(9), k // 2
    D[:] = 0.0
    for node in range(k):
        if node == r:
            continue
        inverse_tangent_into(nodal[node], A)
        for i in range(3):
            for j in range(3):
                D[node, i, 6 * node + 3 + j] = A[3 * i + j]
                D[node, i, 6 * r + 3 + j] = -A[3 * j + i]
        for m in range(2):
            for i in range(3):
                for c in range(6 * k):
                    D[k + m, i, c] += N[m, node] * D[node, i, c]
    for m in range(2):
        for i in range(3):
            D[k + m, i, 6 * k] = v[m + 1, i]


@subroutine
def _jacobian(
    frames: FloatArray, N: FloatArray, x: FloatArray, v: FloatArray, D: FloatArray, H: FloatArray,
    J: FloatArray,
) -> None:  # fmt: skip
    """Local twist of the point."""
    k = frames.shape[0]
    A, r = np.empty(9), k // 2
    J[:] = 0.0
    put_translations(frames, N, x, H, J)
    tangent_into(v[0], A)
    for i in range(3):
        for c in range(6 * k + 1):
            J[3 + i, c] = A[3 * i] * D[k, 0, c] + A[3 * i + 1] * D[k, 1, c]
            J[3 + i, c] += A[3 * i + 2] * D[k, 2, c]
    exp_into(v[0], A)
    for i in range(3):
        for j in range(3):
            J[3 + i, 6 * r + 3 + j] += A[3 * j + i]


@on_demand
def vectors_pose(frames: FloatArray, shape: FloatArray, xi: float, H: FloatArray) -> None:
    """Frame of a point; arguments as in ``line_points.line_pose``."""
    k = frames.shape[0]
    N, x, nodal, v = np.empty((4, k)), np.empty((3, 3)), np.empty((k, 3)), np.empty((3, 3))
    shape_functions(shape, xi, N)
    _interpolate(frames, N, x, nodal, v, H)


@on_demand
def vectors_jacobian(
    frames: FloatArray, shape: FloatArray, xi: float, H: FloatArray, J: FloatArray
) -> None:
    """Frame of a point and its local twist; arguments as in ``line_points.line_jacobian``."""
    k = frames.shape[0]
    N, x, nodal, v = np.empty((4, k)), np.empty((3, 3)), np.empty((k, 3)), np.empty((3, 3))
    D = np.empty((k + 2, 3, 6 * k + 1))
    shape_functions(shape, xi, N)
    _interpolate(frames, N, x, nodal, v, H)
    _changes(nodal, N, v, D)
    _jacobian(frames, N, x, v, D, H, J)


@subroutine
def _add_moment_part(
    N: FloatArray, nodal: FloatArray, v: FloatArray, D: FloatArray, m: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Add the changes of the moments at the control points and of ``v' . b``."""
    k = nodal.shape[0]
    T, E, A, dA, dT = np.empty(9), np.empty(9), np.empty(9), np.empty(9), np.empty(9)
    b, db, w, p = np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    r = k // 2
    tangent_into(v[0], T)
    exp_into(v[0], E)
    apply_transposed(T, m, b)
    for c in range(6 * k + 1):
        if c < 6 * k and c % 6 < 3:
            continue  # translations rotate nothing
        tangent_derivative_into(v[0], D[k, :, c].copy(), dT)
        apply_transposed(dT, m, db)
        for i in range(3):  # exp(v) rotates by T dv in its own axes
            w[i] = T[3 * i] * D[k, 0, c] + T[3 * i + 1] * D[k, 1, c] + T[3 * i + 2] * D[k, 2, c]
        for i in range(3):
            j, n = (i + 1) % 3, (i + 2) % 3
            p[0, i] = w[j] * m[n] - w[n] * m[j]
        apply(E, p[0], p[1])
        for i in range(3):
            out[6 * r + 3 + i, c] += p[1, i]
            out[6 * k, c] += D[k + 1, i, c] * b[i] + v[1, i] * db[i]
        for node in range(k):
            if node == r:
                continue
            inverse_tangent_into(nodal[node], A)
            inverse_tangent_derivative_into(nodal[node], D[node, :, c].copy(), dA)
            for i in range(3):
                own, other = 0.0, 0.0
                for j in range(3):
                    change = N[0, node] * db[j]
                    if c == 6 * k:
                        change += N[1, node] * b[j]
                    own += A[3 * j + i] * change + N[0, node] * dA[3 * j + i] * b[j]
                    other += A[3 * i + j] * change + N[0, node] * dA[3 * i + j] * b[j]
                out[6 * node + 3 + i, c] += own
                out[6 * r + 3 + i, c] -= other


@on_demand
def add_vectors_second(
    frames: FloatArray, shape: FloatArray, xi: float, g: FloatArray, out: FloatArray
) -> None:
    """Add the derivative of ``J^T g``; arguments as in ``line_points.add_line_second``."""
    k = frames.shape[0]
    N, x, nodal, v = np.empty((4, k)), np.empty((3, 3)), np.empty((k, 3)), np.empty((3, 3))
    D, H, J = np.empty((k + 2, 3, 6 * k + 1)), np.empty(12), np.empty((6, 6 * k + 1))
    shape_functions(shape, xi, N)
    _interpolate(frames, N, x, nodal, v, H)
    _changes(nodal, N, v, D)
    _jacobian(frames, N, x, v, D, H, J)
    add_force_part(frames, N, x, H, g[:3], J, np.empty((4, 3)), out)
    _add_moment_part(N, nodal, v, D, g[3:], out)
