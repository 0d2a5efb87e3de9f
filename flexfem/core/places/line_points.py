# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled frames at points of beam elements, with their first and second derivatives.

A point lies at ``xi``, 0 at an element's first end and 1 at its second, of one of two kinds of
elements: ``SE3``, the helix ``H = H_1 exp(xi d)`` with ``d = log(H_1^-1 H_2)`` between two frames,
and ``NURBS``, see ``nurbs_points``, or ``NURBS_VECTORS``, see ``nurbs_vector_points``. Frames are
those of the sections; where these are rotated against the nodes, the functions ``turn_*`` lead to
and from the nodes. Points of surfaces, see ``surface_points``, are of two more kinds, ``SIDES``
(axes of a triangle or of a patch of nodes) and ``FIXED`` (inertial axes): nothing of theirs depends
on ``xi``, and the first columns of the shape functions' coefficients hold weights. Lines that rigid
bodies and bodies in floating frames carry, see ``body_points``, are of the kind ``BODY``.

Derivatives are taken along local twists ``w_I = (u_I, theta_I)`` of the frames, ``H_I <- H_I
exp(w_I)``, and along ``xi``: the ``6 k + 1`` columns of a Jacobian are those of the frames one
after the other and that of ``xi``.

On the helix, with the right tangent map T of SE(3), ``dd = T^-1(d) w_2 - T^-1(-d) w_1``. Since
``T^-1(-d) = T^-1(d) - ad(d)`` and ``xi T(xi d) ad(d) = I - Ad(exp(-xi d))``, the local twist is

    w = (I - B) w_1 + B w_2 + d dxi,  B = xi T(xi d) T^-1(d).
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.places.body_points import add_body_second, body_jacobian, body_pose
from flexfem.core.places.nurbs_points import (
    add_nurbs_second,
    nurbs_jacobian,
    nurbs_pose,
    shape_functions,
)
from flexfem.core.places.nurbs_vector_points import (
    add_vectors_second,
    vectors_jacobian,
    vectors_pose,
)
from flexfem.core.places.surface_points import (
    add_surface_second,
    fixed_jacobian,
    fixed_pose,
    sides_jacobian,
    sides_pose,
)
from flexfem.kernels.compiled import inlined, kernel, on_demand, subroutine
from flexfem.lie.se3 import (
    adjoint_into,
    compose_into,
    exp_into,
    inverse_into,
    inverse_tangent_derivative_into,
    inverse_tangent_into,
    log_into,
    retract_into,
    tangent_derivative_into,
    tangent_into,
)

__all__ = [
    "BODY",
    "FIXED",
    "NURBS",
    "NURBS_VECTORS",
    "SE3",
    "SIDES",
    "add_line_second",
    "arc_length",
    "find_jacobian",
    "line_jacobian",
    "line_pose",
    "offset_jacobian",
    "shape_functions",
    "turn_columns",
    "turn_frames",
    "turn_second",
]

SE3, NURBS, SIDES, FIXED, BODY, NURBS_VECTORS = range(6)


@kernel
def arc_length(coefficients: FloatArray, xi: float) -> tuple[float, float, float]:
    """Polynomial of ``xi`` and its first two derivatives; ``coefficients`` (q,) of its powers."""
    s, first, half = 0.0, 0.0, 0.0
    for j in range(coefficients.size - 1, -1, -1):
        half = half * xi + first
        first = first * xi + s
        s = s * xi + coefficients[j]
    return s, first, 2.0 * half


@inlined
def _helix(frames: FloatArray, xi: float, H: FloatArray, d: FloatArray, w: FloatArray) -> None:
    """Frame of a point, ``d`` and ``w = xi d`` (6,)."""
    inverse_into(frames[0], H)
    compose_into(H, frames[1], H)
    log_into(H, d)
    for i in range(6):
        w[i] = xi * d[i]
    retract_into(frames[0], w, H)


@kernel
def line_pose(kind: int, frames: FloatArray, shape: FloatArray, xi: float, H: FloatArray) -> None:
    """Frame of the point of an element.

    Args:
        kind: ``SE3``, ``NURBS``, ``NURBS_VECTORS``, ``SIDES``, ``FIXED`` or ``BODY``.
        frames: (k, 12) frames of the sections at the nodes; k = 2 on ``SE3``, at least 3 on
            ``SIDES``.
        shape: (k, k) coefficients as in ``shape_functions``, not used on ``SE3``; on ``BODY``
            those of ``body_points``.
        xi: place in the element; outside [0, 1] the element is continued.
        H: (12,) result.
    """
    if kind == SE3:
        d, w = np.empty(6), np.empty(6)
        _helix(frames, xi, H, d, w)
    elif kind == NURBS:
        nurbs_pose(frames, shape, xi, H)
    elif kind == NURBS_VECTORS:
        vectors_pose(frames, shape, xi, H)
    elif kind == SIDES:
        sides_pose(frames, shape, H)
    elif kind == BODY:
        body_pose(frames, shape, xi, H)
    else:
        fixed_pose(frames, shape, H)


@kernel
def find_jacobian(
    kind: int, frames: FloatArray, shape: FloatArray, xi: float, H: FloatArray, J: FloatArray
) -> None:
    """:func:`line_jacobian`, for Python."""
    line_jacobian(kind, frames, shape, xi, H, J)


@subroutine
def line_jacobian(
    kind: int, frames: FloatArray, shape: FloatArray, xi: float, H: FloatArray, J: FloatArray
) -> None:
    """Frame ``H`` (12,) of the point and its local twist ``J`` (6, 6k + 1).

    The other arguments are those of ``line_pose``. The point's twist is ``J`` times the twists of
    the frames and the rate of ``xi``.
    """
    if kind == NURBS:
        nurbs_jacobian(frames, shape, xi, H, J)
        return
    if kind == NURBS_VECTORS:
        vectors_jacobian(frames, shape, xi, H, J)
        return
    if kind == SIDES:
        sides_jacobian(frames, shape, H, J)
        return
    if kind == BODY:
        body_jacobian(frames, shape, xi, H, J)
        return
    if kind == FIXED:
        fixed_jacobian(frames, shape, H, J)
        return
    _helix_jacobian(frames, xi, H, J)


@on_demand
def _helix_jacobian(frames: FloatArray, xi: float, H: FloatArray, J: FloatArray) -> None:
    d, w, T, inverse = np.empty(6), np.empty(6), np.empty(36), np.empty(36)
    _helix(frames, xi, H, d, w)
    tangent_into(w, T)
    inverse_tangent_into(d, inverse)
    for i in range(6):
        for j in range(6):
            value = 0.0
            for m in range(6):
                value += T[6 * i + m] * inverse[6 * m + j]
            J[i, j] = -xi * value
            J[i, 6 + j] = xi * value
        J[i, i] += 1.0
        J[i, 12] = d[i]


@inlined
def _apply_transposed(A: FloatArray, v: FloatArray, factor: float, out: FloatArray) -> None:
    """``factor * A^T v`` of a map of SE(3), whose lower left block is zero."""
    for j in range(6):
        value = 0.0
        for i in range(3 if j < 3 else 6):
            value += A[6 * i + j] * v[i]
        out[j] = factor * value


@inlined
def _helix_changes(
    d: FloatArray, w: FloatArray, xi: float, g: FloatArray, inverse: FloatArray, S: FloatArray,
    H: FloatArray, a: FloatArray,
) -> None:  # fmt: skip
    """Derivative ``S`` (6, 7) of ``B^T g`` by d and xi.

    ``H`` (12,) and ``a`` (5, 6) are work space.
    """
    A = np.empty(36)
    tangent_into(w, A)
    _apply_transposed(A, g, xi, a[0])
    for j in range(6):
        a[1] = 0.0
        a[1, j] = 1.0
        tangent_derivative_into(w, a[1], A)
        _apply_transposed(A, g, xi * xi, a[2])
        _apply_transposed(inverse, a[2], 1.0, a[3])
        inverse_tangent_derivative_into(d, a[1], A)
        _apply_transposed(A, a[0], 1.0, a[4])
        for i in range(6):
            S[i, j] = a[3, i] + a[4, i]
    # xi T(xi d) is the integral of Ad(exp(-xi d))
    for i in range(6):
        a[1, i] = -w[i]
    exp_into(a[1], H)
    adjoint_into(H, A)
    _apply_transposed(A, g, 1.0, a[2])
    _apply_transposed(inverse, a[2], 1.0, a[3])
    for i in range(6):
        S[i, 6] = a[3, i]


@on_demand
def _add_helix_second(frames: FloatArray, xi: float, g: FloatArray, out: FloatArray) -> None:
    d, w, H, a = np.empty(6), np.empty(6), np.empty(12), np.empty((5, 6))
    inverse, back, S = np.empty(36), np.empty(36), np.empty((6, 7))
    _helix(frames, xi, H, d, w)
    inverse_tangent_into(d, inverse)
    _helix_changes(d, w, xi, g, inverse, S, H, a)
    for i in range(6):
        a[0, i] = -d[i]
    inverse_tangent_into(a[0], back)
    for j in range(6):
        by_first, by_second = 0.0, 0.0
        for m in range(6):
            by_first -= g[m] * back[6 * m + j]
            by_second += g[m] * inverse[6 * m + j]
        out[12, j] += by_first
        out[12, 6 + j] += by_second
        for i in range(6):
            first, second = 0.0, 0.0
            for m in range(6):
                first -= S[i, m] * back[6 * m + j]
                second += S[i, m] * inverse[6 * m + j]
            out[i, j] -= first
            out[i, 6 + j] -= second
            out[6 + i, j] += first
            out[6 + i, 6 + j] += second
        out[j, 12] -= S[j, 6]
        out[6 + j, 12] += S[j, 6]


@subroutine
def add_line_second(
    kind: int, frames: FloatArray, shape: FloatArray, xi: float, g: FloatArray, out: FloatArray
) -> None:
    """Add to ``out`` (6k + 1, 6k + 1) the derivative of ``J^T g`` at a constant ``g`` (6,).

    ``out[i, j]`` is that of entry i along column j of the Jacobian J of ``line_jacobian``. It is
    not symmetric: increments of rotation do not commute. The other arguments are those of
    ``line_pose``.
    """
    if kind == SE3:
        _add_helix_second(frames, xi, g, out)
    elif kind == BODY:
        add_body_second(frames, shape, xi, g, out)
    elif kind == NURBS:
        add_nurbs_second(frames, shape, xi, g, out)
    elif kind == NURBS_VECTORS:
        add_vectors_second(frames, shape, xi, g, out)
    else:
        add_surface_second(kind == SIDES, frames, shape, g, out)


@kernel
def turn_frames(frames: FloatArray, turns: FloatArray, out: FloatArray) -> None:
    """Frames of sections (k, 12) from those of their nodes and the constant rotations (k, 9)."""
    for node in range(frames.shape[0]):
        for i in range(3):
            out[node, i] = frames[node, i]
            a, b, c = frames[node, 3 + 3 * i], frames[node, 4 + 3 * i], frames[node, 5 + 3 * i]
            for j in range(3):
                out[node, 3 + 3 * i + j] = (
                    a * turns[node, j] + b * turns[node, 3 + j] + c * turns[node, 6 + j]
                )


@kernel
def turn_columns(turns: FloatArray, A: FloatArray) -> None:
    """Convert columns of ``A`` (n, 6k + 1) from twists of sections to those of nodes, in place."""
    for node in range(turns.shape[0]):
        Q = turns[node]
        for at in (6 * node, 6 * node + 3):
            for i in range(A.shape[0]):
                a, b, c = A[i, at], A[i, at + 1], A[i, at + 2]
                for j in range(3):
                    A[i, at + j] = a * Q[3 * j] + b * Q[3 * j + 1] + c * Q[3 * j + 2]


@kernel
def turn_second(turns: FloatArray, A: FloatArray) -> None:
    """Convert rows and columns of ``A`` (6k + 1, 6k + 1) from sections to nodes, in place."""
    turn_columns(turns, A)
    for node in range(turns.shape[0]):
        Q = turns[node]
        for at in (6 * node, 6 * node + 3):
            for i in range(A.shape[1]):
                a, b, c = A[at, i], A[at + 1, i], A[at + 2, i]
                for j in range(3):
                    A[at + j, i] = a * Q[3 * j] + b * Q[3 * j + 1] + c * Q[3 * j + 2]


@kernel
def offset_jacobian(offset: FloatArray, J: FloatArray) -> None:
    """Convert ``J`` (6, n) of a frame to that of a frame at the constant ``offset`` (12,) from it.

    The twist becomes ``Ad(offset^-1) J``, in place.
    """
    o0, o1, o2 = offset[0], offset[1], offset[2]
    for c in range(J.shape[1]):
        t0, t1, t2 = J[3, c], J[4, c], J[5, c]
        v0 = J[0, c] + t1 * o2 - t2 * o1
        v1 = J[1, c] + t2 * o0 - t0 * o2
        v2 = J[2, c] + t0 * o1 - t1 * o0
        for i in range(3):
            J[i, c] = offset[3 + i] * v0 + offset[6 + i] * v1 + offset[9 + i] * v2
            J[3 + i, c] = offset[3 + i] * t0 + offset[6 + i] * t1 + offset[9 + i] * t2
