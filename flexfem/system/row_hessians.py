# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled second derivatives of the terms of rows; conventions as in ``row_kernels``."""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.frame_kernels import step_rates_into
from flexfem.core.terms.function import function_hessian
from flexfem.core.terms.vectors import cross_into, dot, rotate_back_into
from flexfem.lie.compiled import kernel
from flexfem.system.row_kernels import ALONG, ANGLE, AXES, DISTANCE, FUNCTION, ON_LINES

__all__ = [
    "add_dampers",
    "add_hessians",
    "marker_map",
    "second_rates",
    "term_hessian",
    "velocity_changes",
]


@kernel
def _skew_into(v: FloatArray, sign: float, out: FloatArray, i: int, j: int) -> None:
    """Add ``sign * skew(v)`` to the 3x3 block of ``out`` at (i, j)."""
    out[i, j + 1] -= sign * v[2]
    out[i, j + 2] += sign * v[1]
    out[i + 1, j] += sign * v[2]
    out[i + 1, j + 2] -= sign * v[0]
    out[i + 2, j] -= sign * v[1]
    out[i + 2, j + 1] += sign * v[0]


@kernel
def _skew(v: FloatArray) -> FloatArray:
    out = np.zeros((3, 3))
    _skew_into(v, 1.0, out, 0, 0)
    return out


@kernel
def _product(A: FloatArray, B: FloatArray) -> FloatArray:
    C = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                C[i, j] += A[i, k] * B[k, j]
    return C


@kernel
def _add(out: FloatArray, i: int, j: int, sign: float, B: FloatArray) -> None:
    for k in range(3):
        for m in range(3):
            out[i + k, j + m] += sign * B[k, m]


@kernel
def term_hessian(
    kind: int, Ha: FloatArray, Hb: FloatArray, d: FloatArray, h: FloatArray
) -> None:  # fmt: skip
    """Derivative of a term's gradient (12) along the local twists (12) in ``h`` (12, 12).

    It is not symmetric: increments of rotation do not commute.
    """
    if kind >= FUNCTION:
        function_hessian(kind, Ha, Hb, d, h)
        return
    u, v, p = d[0], d[1], d[2]
    h[:] = 0.0
    Ra, Rb = Ha[3:].copy().reshape(3, 3), Hb[3:].copy().reshape(3, 3)
    Rab = _product(Ra.T.copy(), Rb)
    Rba = Rab.T.copy()
    s = np.empty((5, 3))
    if kind == AXES:
        _axes_hessian(Rab, Rba, u, v, h, s)
    elif kind == ANGLE:
        _angle_hessian(Rab, Rba, u, v, p, h, s)
    elif kind == ALONG:
        _along_hessian(Ha, Hb, Rab, Rba, u, h, s)
    else:
        direction = s[0]
        direction[:] = u
        if kind == DISTANCE:
            _distance_hessian(Ha, Hb, Ra, Rb, direction, h)
        rotate_back_into(Ha, direction, s[1], 0)
        rotate_back_into(Hb, direction, s[2], 0)
        _skew_into(s[1], -1.0, h, 0, 3)
        _skew_into(s[2], 1.0, h, 6, 9)


@kernel
def _multiply(A: FloatArray, v: FloatArray, out: FloatArray) -> None:
    for i in range(3):
        out[i] = A[i, 0] * v[0] + A[i, 1] * v[1] + A[i, 2] * v[2]


@kernel
def _axes_hessian(
    Rab: FloatArray, Rba: FloatArray, u: FloatArray, v: FloatArray, h: FloatArray, s: FloatArray
) -> None:
    _multiply(Rab, v, s[0])
    _multiply(Rba, u, s[1])
    U, V = _skew(u), _skew(v)
    _add(h, 3, 9, -1.0, _product(U, _product(Rab, V)))
    _add(h, 3, 3, 1.0, _product(U, _skew(s[0])))
    _add(h, 9, 3, -1.0, _product(V, _product(Rba, U)))
    _add(h, 9, 9, 1.0, _product(V, _skew(s[1])))


@kernel
def _along_hessian(
    Ha: FloatArray, Hb: FloatArray, Rab: FloatArray, Rba: FloatArray, u: FloatArray, h: FloatArray,
    s: FloatArray,
) -> None:  # fmt: skip
    for i in range(3):
        s[0, i] = Hb[i] - Ha[i]
    rotate_back_into(Ha, s[0], s[1], 0)
    _multiply(Rba, u, s[2])
    U = _skew(u)
    _add(h, 3, 6, 1.0, _product(U, Rab))
    _add(h, 3, 0, -1.0, U)
    _add(h, 3, 3, 1.0, _product(U, _skew(s[1])))
    _add(h, 6, 3, -1.0, _product(Rba, U))
    _skew_into(s[2], 1.0, h, 6, 9)


@kernel
def _distance_hessian(
    Ha: FloatArray, Hb: FloatArray, Ra: FloatArray, Rb: FloatArray, direction: FloatArray,
    h: FloatArray,
) -> None:  # fmt: skip
    """Part of the distance that comes from its changing direction, left in ``direction``."""
    length = 0.0
    for i in range(3):
        direction[i] = Hb[i] - Ha[i]
        length += direction[i] * direction[i]
    length = np.sqrt(length)
    P = np.empty((3, 3))
    for i in range(3):
        direction[i] /= length
    for i in range(3):
        for j in range(3):
            P[i, j] = ((1.0 if i == j else 0.0) - direction[i] * direction[j]) / length
    PRa, PRb = _product(P, Ra), _product(P, Rb)
    RaT, RbT = Ra.T.copy(), Rb.T.copy()
    _add(h, 0, 0, 1.0, _product(RaT, PRa))
    _add(h, 0, 6, -1.0, _product(RaT, PRb))
    _add(h, 6, 0, -1.0, _product(RbT, PRa))
    _add(h, 6, 6, 1.0, _product(RbT, PRb))


@kernel
def _angle_hessian(
    Rab: FloatArray, Rba: FloatArray, u: FloatArray, v: FloatArray, p: FloatArray, h: FloatArray,
    s: FloatArray,
) -> None:  # fmt: skip
    y, side, g = s[0], s[1], s[2]
    _multiply(Rab, v, y)
    cross_into(u, p, side, 0)
    cosine, sine = dot(p, y), dot(side, y)
    square = cosine * cosine + sine * sine
    D = np.empty((3, 3))  # derivative of g with respect to y
    for i in range(3):
        g[i] = (cosine * side[i] - sine * p[i]) / square
    for i in range(3):
        for j in range(3):
            D[i, j] = (
                side[i] * p[j] - p[i] * side[j] - 2.0 * g[i] * (cosine * p[j] + sine * side[j])
            ) / square
    Y, V = _skew(y), _skew(v)
    dy_b = _product(Rab, V)  # dy = skew(y) Omega_a - R_ab skew(v) Omega_b
    G = _skew(g)
    _add(h, 3, 3, 1.0, _product(G, Y))
    _add(h, 3, 9, -1.0, _product(G, dy_b))
    DY, Db = _product(D, Y), _product(D, dy_b)
    _add(h, 3, 3, -1.0, _product(Y, DY))
    _add(h, 3, 9, 1.0, _product(Y, Db))
    _multiply(Rba, g, s[3])
    VR = _product(V, Rba)
    _add(h, 9, 3, 1.0, _product(VR, DY))
    _add(h, 9, 9, -1.0, _product(VR, Db))
    _add(h, 9, 3, -1.0, _product(VR, G))
    _add(h, 9, 9, 1.0, _product(V, _skew(s[3])))


@kernel
def marker_map(offset: FloatArray, J: FloatArray) -> None:
    """``J`` (6, 6): marker twist from node twist, ``Ad(H_o^-1)``."""
    J[:] = 0.0
    for i in range(3):
        for j in range(3):
            r = offset[3 + 3 * j + i]  # R_o^T
            J[i, j] = r
            J[3 + i, 3 + j] = r
        # R_o^T (Omega x o) = -R_o^T skew(o) Omega
        o0, o1, o2 = offset[0], offset[1], offset[2]
        r0, r1, r2 = offset[3 + i], offset[6 + i], offset[9 + i]
        J[i, 3] = -(r1 * o2 - r2 * o1)
        J[i, 4] = -(r2 * o0 - r0 * o2)
        J[i, 5] = -(r0 * o1 - r1 * o0)


@kernel
def add_hessians(
    poses: FloatArray, marker_node: IntArray, marker_offset: FloatArray, term_marker: IntArray,
    kinds: IntArray, directions: FloatArray, pair_of_term: IntArray, factor: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Add ``factor`` times every term's second derivative to the block of its pair of markers.

    Rows and columns refer to the nodes' local twists.
    """
    h, J, left = np.empty((12, 12)), np.empty((2, 6, 6)), np.empty((12, 12))
    for t in range(kinds.size):
        if factor[t] == 0.0 or kinds[t] == ON_LINES:
            continue
        a, b = term_marker[t, 0], term_marker[t, 1]
        d = directions[t]
        term_hessian(kinds[t], poses[a], poses[b], d, h)
        for side in range(2):
            m = term_marker[t, side]
            J[side] = 0.0
            if marker_node[m] >= 0:
                marker_map(marker_offset[m], J[side])
        for i in range(12):
            for j in range(12):
                left[i, j] = 0.0
                for k in range(6):
                    left[i, j] += h[i, 6 * (j // 6) + k] * J[j // 6, k, j % 6]
        block = out[pair_of_term[t]]
        for i in range(12):
            for j in range(12):
                for k in range(6):
                    block[i, j] += factor[t] * J[i // 6, k, i % 6] * left[6 * (i // 6) + k, j]


@kernel
def _marker_twists(
    velocities: FloatArray, marker_node: IntArray, marker_offset: FloatArray, markers: IntArray,
    J: FloatArray, v: FloatArray,
) -> None:  # fmt: skip
    """Maps ``J`` (2, 6, 6) from node twists to those of two markers, and these in ``v`` (12)."""
    v[:] = 0.0
    J[:] = 0.0
    for side in range(2):
        m = markers[side]
        if marker_node[m] >= 0:
            marker_map(marker_offset[m], J[side])
            for i in range(6):
                for j in range(6):
                    v[6 * side + i] += J[side, i, j] * velocities[marker_node[m], j]


@kernel
def second_rates(
    poses: FloatArray, velocities: FloatArray, marker_node: IntArray, marker_offset: FloatArray,
    term_marker: IntArray, kinds: IntArray, directions: FloatArray, factors: FloatArray,
    row_of_term: IntArray, out: FloatArray,
) -> None:  # fmt: skip
    """``v . (d gradient / dq) v`` of every row: its second time derivative at constant v."""
    h, J, v = np.empty((12, 12)), np.empty((2, 6, 6)), np.empty(12)
    out[:] = 0.0
    for t in range(kinds.size):
        if kinds[t] == ON_LINES:
            continue
        d = directions[t]
        term_hessian(kinds[t], poses[term_marker[t, 0]], poses[term_marker[t, 1]], d, h)
        _marker_twists(velocities, marker_node, marker_offset, term_marker[t], J, v)
        for i in range(12):
            for j in range(12):
                out[row_of_term[t]] += factors[t] * v[i] * h[i, j] * v[j]


@kernel
def add_dampers(
    poses: FloatArray, increments: FloatArray, velocities: FloatArray, marker_node: IntArray,
    marker_offset: FloatArray, term_marker: IntArray, kinds: IntArray, directions: FloatArray,
    factors: FloatArray, row_of_term: IntArray, slopes: FloatArray, inertial: BoolArray,
    dynamics: FloatArray, force_jacobian: FloatArray, step_jacobian: FloatArray,
) -> None:  # fmt: skip
    """Add to ``step_jacobian`` that rates of rows depend on position and increment.

    ``inertial`` (n,) tells how each node's translation is integrated.
    """
    h, J, by_v, by_w = np.empty((12, 12)), np.empty((2, 6, 6)), np.empty(36), np.empty(36)
    rates, nothing = np.array([dynamics[0], 0.0]), np.zeros(6)
    v, w = np.empty(12), np.empty(6)
    for t in range(kinds.size):
        slope = slopes[row_of_term[t], 1]
        if slope == 0.0 or kinds[t] == ON_LINES:
            continue
        d = directions[t]
        term_hessian(kinds[t], poses[term_marker[t, 0]], poses[term_marker[t, 1]], d, h)
        _marker_twists(velocities, marker_node, marker_offset, term_marker[t], J, v)
        for side in range(2):
            node = marker_node[term_marker[t, side]]
            if node < 0:
                continue
            step_rates_into(
                inertial[node], increments[node], velocities[node], nothing, rates, by_v, by_w
            )
            for j in range(6):
                w[j] = 0.0
                for i in range(12):
                    w[j] += factors[t] * v[i] * h[i, 6 * side + j]
            for j in range(6):
                rate = 0.0
                for i in range(6):
                    rate += w[i] * J[side, i, j]
                    rate += force_jacobian[t, side, i] * by_v[6 * i + j]
                step_jacobian[t, side, j] += slope * rate


@kernel
def velocity_changes(
    increments: FloatArray, velocities: FloatArray, inertial: BoolArray, by_increment: float
) -> FloatArray:
    """(n, 6, 6) derivatives of the nodes' local velocities by their steps."""
    out, by_v, by_w = np.empty((inertial.size, 6, 6)), np.empty(36), np.empty(36)
    rates, nothing = np.array([by_increment, 0.0]), np.zeros(6)
    for n in range(inertial.size):
        step_rates_into(inertial[n], increments[n], velocities[n], nothing, rates, by_v, by_w)
        out[n] = by_v.reshape(6, 6)
    return out
