# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled evaluation of constraint rows: values, gradients, second derivatives.

Markers have frames ``H_a = (x_a, R_a)`` and ``H_b``; gradients are taken with respect to their local
twists ``(V_a, Omega_a, V_b, Omega_b)`` (12 numbers). The derivation uses ``dx = R V``,
``dR = R skew(Omega)`` and nothing else.
"""

import numpy as np

from flexfem.lie.compiled import kernel
from flexfem.lie.se3 import compose_into, inverse_tangent_into

__all__ = [
    "add_dampers",
    "add_forces",
    "add_hessians",
    "evaluate_rows",
    "marker_poses",
    "row_hessian",
    "second_rates",
    "update_angles",
]

# the values of flexfem.core.joint.RowKind
INERTIAL, ALONG, AXES, DISTANCE, ANGLE = range(5)


@kernel
def _rotate(H, v, out, at):
    """``R v`` of a frame stored as 12 numbers."""
    for i in range(3):
        k = 3 + 3 * i
        out[at + i] = H[k] * v[0] + H[k + 1] * v[1] + H[k + 2] * v[2]


@kernel
def _rotate_back(H, v, out, at):
    """``R^T v`` of a frame stored as 12 numbers."""
    for i in range(3):
        k = 3 + i
        out[at + i] = H[k] * v[0] + H[k + 3] * v[1] + H[k + 6] * v[2]


@kernel
def _cross(a, b, out, at):
    out[at] = a[1] * b[2] - a[2] * b[1]
    out[at + 1] = a[2] * b[0] - a[0] * b[2]
    out[at + 2] = a[0] * b[1] - a[1] * b[0]


@kernel
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def _row(kind, Ha, Hb, u, v, p, memory, g, s):
    """Value of one row without its target; gradient in ``g`` (12), scratch ``s`` (5, 3)."""
    g[:] = 0.0
    if kind == AXES:
        _rotate(Hb, v, s[0], 0)
        _rotate_back(Ha, s[0], s[1], 0)  # R_ab v
        _cross(u, s[1], g, 3)
        _rotate(Ha, u, s[2], 0)
        _rotate_back(Hb, s[2], s[3], 0)
        _cross(v, s[3], g, 9)
        return _dot(s[2], s[0])
    if kind == ANGLE:
        _rotate(Hb, v, s[0], 0)
        _rotate_back(Ha, s[0], s[1], 0)  # y
        _cross(u, p, s[2], 0)
        cosine, sine = _dot(p, s[1]), _dot(s[2], s[1])
        square = cosine * cosine + sine * sine
        for i in range(3):
            s[3, i] = (cosine * s[2, i] - sine * p[i]) / square
        _cross(s[3], s[1], g, 3)
        _rotate(Ha, s[3], s[4], 0)
        _rotate_back(Hb, s[4], s[0], 0)
        _cross(v, s[0], g, 9)
        angle = np.arctan2(sine, cosine)
        return memory + np.arctan2(np.sin(angle - memory), np.cos(angle - memory))
    for i in range(3):
        s[0, i] = Hb[i] - Ha[i]
    if kind == ALONG:
        _rotate_back(Ha, s[0], s[1], 0)  # p = R_a^T (x_b - x_a)
        _cross(u, s[1], g, 3)
        _rotate(Ha, u, s[2], 0)
        value = _dot(u, s[1])
    elif kind == DISTANCE:
        value = np.sqrt(_dot(s[0], s[0]))
        for i in range(3):
            s[2, i] = s[0, i] / value
    else:
        s[2, :] = u
        value = _dot(u, s[0])
    _rotate_back(Ha, s[2], g, 0)
    for i in range(3):
        g[i] = -g[i]
    _rotate_back(Hb, s[2], g, 6)
    return value


@kernel
def _to_node(offset, g, at, out):
    """Carry a marker's gradient ``g[at:at+6]`` to its node: ``Ad(H_o^-1)^T g``."""
    _rotate(offset, g[at : at + 3], out, 0)
    _rotate(offset, g[at + 3 : at + 6], out, 3)
    out[3] += offset[1] * out[2] - offset[2] * out[1]
    out[4] += offset[2] * out[0] - offset[0] * out[2]
    out[5] += offset[0] * out[1] - offset[1] * out[0]


@kernel
def marker_poses(frames, marker_node, marker_offset, poses):
    """Poses of all markers from the frames of their nodes (node -1: ground)."""
    for m in range(marker_node.size):
        if marker_node[m] < 0:
            poses[m] = marker_offset[m]
        else:
            compose_into(frames[marker_node[m]], marker_offset[m], poses[m])


@kernel
def update_angles(poses, row_marker, kinds, directions, memory):
    """Store the continuous angle of each angle row (call it when a step is accepted)."""
    g, scratch = np.empty(12), np.empty((5, 3))
    for r in range(kinds.size):
        if kinds[r] == ANGLE:
            d = directions[r]
            memory[r] = _row(
                ANGLE, poses[row_marker[r, 0]], poses[row_marker[r, 1]], d[0], d[1], d[2],
                memory[r], g, scratch,
            )  # fmt: skip


@kernel
def add_forces(row_slots, force_jacobian, multipliers, local, residual):
    """Add ``G^T multipliers`` to the nodes ``local[slot]`` of a block (-1: another block)."""
    for r in range(multipliers.size):
        for side in range(2):
            slot = row_slots[r, side]
            if slot >= 0 and local[slot] >= 0:
                for i in range(6):
                    residual[local[slot], i] += multipliers[r] * force_jacobian[r, side, i]


@kernel
def _skew_into(v, sign, out, i, j):
    """Add ``sign * skew(v)`` to the 3x3 block of ``out`` at (i, j)."""
    out[i, j + 1] -= sign * v[2]
    out[i, j + 2] += sign * v[1]
    out[i + 1, j] += sign * v[2]
    out[i + 1, j + 2] -= sign * v[0]
    out[i + 2, j] -= sign * v[1]
    out[i + 2, j + 1] += sign * v[0]


@kernel
def _skew(v):
    out = np.zeros((3, 3))
    _skew_into(v, 1.0, out, 0, 0)
    return out


@kernel
def _product(A, B):
    C = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                C[i, j] += A[i, k] * B[k, j]
    return C


@kernel
def _add(out, i, j, sign, B):
    for k in range(3):
        for m in range(3):
            out[i + k, j + m] += sign * B[k, m]


@kernel
def row_hessian(kind, Ha, Hb, u, v, p, h):
    """Derivative of a row's gradient (12) along the local twists (12) in ``h`` (12, 12).

    It is not symmetric: increments of rotation do not commute.
    """
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
            _distance_hessian(Ha, Hb, Ra, Rb, Rab, Rba, direction, h)
        _rotate_back(Ha, direction, s[1], 0)
        _rotate_back(Hb, direction, s[2], 0)
        _skew_into(s[1], -1.0, h, 0, 3)
        _skew_into(s[2], 1.0, h, 6, 9)


@kernel
def _multiply(A, v, out):
    for i in range(3):
        out[i] = A[i, 0] * v[0] + A[i, 1] * v[1] + A[i, 2] * v[2]


@kernel
def _axes_hessian(Rab, Rba, u, v, h, s):
    _multiply(Rab, v, s[0])
    _multiply(Rba, u, s[1])
    U, V = _skew(u), _skew(v)
    _add(h, 3, 9, -1.0, _product(U, _product(Rab, V)))
    _add(h, 3, 3, 1.0, _product(U, _skew(s[0])))
    _add(h, 9, 3, -1.0, _product(V, _product(Rba, U)))
    _add(h, 9, 9, 1.0, _product(V, _skew(s[1])))


@kernel
def _along_hessian(Ha, Hb, Rab, Rba, u, h, s):
    for i in range(3):
        s[0, i] = Hb[i] - Ha[i]
    _rotate_back(Ha, s[0], s[1], 0)
    _multiply(Rba, u, s[2])
    U = _skew(u)
    _add(h, 3, 6, 1.0, _product(U, Rab))
    _add(h, 3, 0, -1.0, U)
    _add(h, 3, 3, 1.0, _product(U, _skew(s[1])))
    _add(h, 6, 3, -1.0, _product(Rba, U))
    _skew_into(s[2], 1.0, h, 6, 9)


@kernel
def _distance_hessian(Ha, Hb, Ra, Rb, Rab, Rba, direction, h):
    """Part of the distance that comes from its changing direction, which it returns."""
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
def _angle_hessian(Rab, Rba, u, v, p, h, s):
    y, side, g = s[0], s[1], s[2]
    _multiply(Rab, v, y)
    _cross(u, p, side, 0)
    cosine, sine = _dot(p, y), _dot(side, y)
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
def _marker_map(offset, J):
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
    poses, marker_node, marker_offset, row_marker, kinds, directions, joint_of_row, factor, out
):
    """Add ``factor`` times every row's second derivative to its joint's block of ``out``.

    Rows and columns refer to the nodes' local twists.
    """
    h, J, left = np.empty((12, 12)), np.empty((2, 6, 6)), np.empty((12, 12))
    for r in range(kinds.size):
        if factor[r] == 0.0:
            continue
        a, b = row_marker[r, 0], row_marker[r, 1]
        d = directions[r]
        row_hessian(kinds[r], poses[a], poses[b], d[0], d[1], d[2], h)
        for side in range(2):
            m = row_marker[r, side]
            J[side] = 0.0
            if marker_node[m] >= 0:
                _marker_map(marker_offset[m], J[side])
        for i in range(12):
            for j in range(12):
                left[i, j] = 0.0
                for k in range(6):
                    left[i, j] += h[i, 6 * (j // 6) + k] * J[j // 6, k, j % 6]
        block = out[joint_of_row[r]]
        for i in range(12):
            for j in range(12):
                for k in range(6):
                    block[i, j] += factor[r] * J[i // 6, k, i % 6] * left[6 * (i // 6) + k, j]


@kernel
def second_rates(
    poses, velocities, marker_node, marker_offset, row_marker, kinds, directions, out
):
    """``v . (d gradient / dq) v`` of every row: its second time derivative at constant v."""
    h, J, v = np.empty((12, 12)), np.empty((6, 6)), np.empty(12)
    for r in range(kinds.size):
        d = directions[r]
        row_hessian(
            kinds[r], poses[row_marker[r, 0]], poses[row_marker[r, 1]], d[0], d[1], d[2], h
        )
        v[:] = 0.0
        for side in range(2):
            m = row_marker[r, side]
            if marker_node[m] >= 0:
                _marker_map(marker_offset[m], J)
                for i in range(6):
                    for j in range(6):
                        v[6 * side + i] += J[i, j] * velocities[marker_node[m], j]
        out[r] = 0.0
        for i in range(12):
            for j in range(12):
                out[r] += v[i] * h[i, j] * v[j]


@kernel
def evaluate_rows(
    frames, velocities, marker_node, marker_offset, row_marker, kinds, directions, targets, memory,
    elastic, dynamics, multipliers, poses, force_jacobian, step_jacobian, values, compliance,
):  # fmt: skip
    """Evaluate every row at the trial configuration.

    Args:
        frames: (n, 12) frames of the nodes that carry markers; velocities: (n, 6) local twists.
        marker_node: (m,) node of each marker, -1 for ground; marker_offset: (m, 12).
        row_marker: (r, 2); kinds: (r,); directions: (r, 3, 3) u, v, p; targets, memory: (r,).
        elastic: (r, 3) flag, stiffness, damping of rows with compliance.
        dynamics: (2,) ``gamma/(beta h)`` and ``beta h^2``.
        multipliers: (r,) scaled by ``beta h^2``.
        poses: (m, 12) work.
        force_jacobian: (r, 2, 6) gradient with respect to the nodes' local twists.
        step_jacobian: (r, 2, 6) derivative of ``values`` along them; dampers: see ``add_dampers``.
        values: (r,) residual of the row; compliance: (r,) what couples its own multiplier.
    """
    marker_poses(frames, marker_node, marker_offset, poses)
    g, scratch = np.empty(12), np.empty((5, 3))
    for r in range(kinds.size):
        a, b = row_marker[r, 0], row_marker[r, 1]
        u, v, p = directions[r, 0], directions[r, 1], directions[r, 2]
        value = _row(kinds[r], poses[a], poses[b], u, v, p, memory[r], g, scratch) - targets[r]
        rate = 0.0
        for side in range(2):
            m = row_marker[r, side]
            node = marker_node[m]
            if node < 0:
                force_jacobian[r, side] = 0.0
                step_jacobian[r, side] = 0.0
                continue
            _to_node(marker_offset[m], g, 6 * side, force_jacobian[r, side])
            for i in range(6):
                step_jacobian[r, side, i] = force_jacobian[r, side, i]
                rate += force_jacobian[r, side, i] * velocities[node, i]
        values[r], compliance[r] = value, 0.0
        if elastic[r, 0] != 0.0:
            # force k value + c rate: divided by k + c gamma/(beta h) the row is scaled as a rigid one
            k, c = elastic[r, 1], elastic[r, 2]
            scale = 1.0 / (k + c * dynamics[0])
            values[r] = scale * (k * value + c * rate - multipliers[r] / dynamics[1])
            compliance[r] = scale / dynamics[1]


@kernel
def add_dampers(
    poses, increments, velocities, marker_node, marker_offset, row_marker, kinds, directions,
    elastic, dynamics, step_jacobian,
):  # fmt: skip
    """Exact ``step_jacobian`` of rows with damping: their rate depends on position and increment."""
    h, J, Tinv = np.empty((12, 12)), np.empty((2, 6, 6)), np.empty(36)
    v, w, rate = np.empty(12), np.empty(6), np.empty(6)
    for r in range(kinds.size):
        k, c = elastic[r, 1], elastic[r, 2]
        if elastic[r, 0] == 0.0 or c == 0.0:
            continue
        scale = 1.0 / (k + c * dynamics[0])
        d = directions[r]
        row_hessian(
            kinds[r], poses[row_marker[r, 0]], poses[row_marker[r, 1]], d[0], d[1], d[2], h
        )
        v[:] = 0.0
        J[:] = 0.0
        for side in range(2):
            m = row_marker[r, side]
            if marker_node[m] >= 0:
                _marker_map(marker_offset[m], J[side])
                for i in range(6):
                    for j in range(6):
                        v[6 * side + i] += J[side, i, j] * velocities[marker_node[m], j]
        for side in range(2):
            m = row_marker[r, side]
            if marker_node[m] < 0:
                continue
            inverse_tangent_into(increments[marker_node[m]], Tinv)
            for j in range(6):
                w[j] = 0.0
                for i in range(12):
                    w[j] += v[i] * h[i, 6 * side + j]
            for j in range(6):
                rate[j] = 0.0
                for i in range(6):
                    rate[j] += w[i] * J[side, i, j]
                    rate[j] += dynamics[0] * step_jacobian[r, side, i] * Tinv[6 * i + j]
            for j in range(6):
                step_jacobian[r, side, j] = scale * (k * step_jacobian[r, side, j] + c * rate[j])
