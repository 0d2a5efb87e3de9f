# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled evaluation of constraint rows: values and gradients.

Markers have frames ``H_a = (x_a, R_a)`` and ``H_b``; gradients are taken with respect to their
local twists ``(V_a, Omega_a, V_b, Omega_b)`` (12 numbers). The derivation uses ``dx = R V``, ``dR =
R skew(Omega)`` and nothing else.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.joint import RowKind
from flexfem.lie.compiled import kernel
from flexfem.lie.se3 import compose_into

__all__ = [
    "ALONG",
    "ANGLE",
    "AXES",
    "DISTANCE",
    "INERTIAL",
    "add_forces",
    "cross_into",
    "dot",
    "evaluate_rows",
    "marker_poses",
    "rotate_back_into",
    "rotate_into",
    "update_angles",
]

INERTIAL, ALONG, AXES, DISTANCE, ANGLE = (int(kind) for kind in RowKind)


@kernel
def rotate_into(H: FloatArray, v: FloatArray, out: FloatArray, at: int) -> None:
    """``R v`` of a frame stored as 12 numbers."""
    for i in range(3):
        k = 3 + 3 * i
        out[at + i] = H[k] * v[0] + H[k + 1] * v[1] + H[k + 2] * v[2]


@kernel
def rotate_back_into(H: FloatArray, v: FloatArray, out: FloatArray, at: int) -> None:
    """``R^T v`` of a frame stored as 12 numbers."""
    for i in range(3):
        k = 3 + i
        out[at + i] = H[k] * v[0] + H[k + 3] * v[1] + H[k + 6] * v[2]


@kernel
def cross_into(a: FloatArray, b: FloatArray, out: FloatArray, at: int) -> None:
    """``a x b``."""
    out[at] = a[1] * b[2] - a[2] * b[1]
    out[at + 1] = a[2] * b[0] - a[0] * b[2]
    out[at + 2] = a[0] * b[1] - a[1] * b[0]


@kernel
def dot(a: FloatArray, b: FloatArray) -> float:
    """``a . b``."""
    product: float = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    return product


@kernel
def _row(
    kind: int, Ha: FloatArray, Hb: FloatArray, u: FloatArray, v: FloatArray, p: FloatArray,
    memory: float, g: FloatArray, s: FloatArray,
) -> float:  # fmt: skip
    """Value of one row without its target; gradient in ``g`` (12), scratch ``s`` (5, 3)."""
    g[:] = 0.0
    if kind == AXES:
        rotate_into(Hb, v, s[0], 0)
        rotate_back_into(Ha, s[0], s[1], 0)  # R_ab v
        cross_into(u, s[1], g, 3)
        rotate_into(Ha, u, s[2], 0)
        rotate_back_into(Hb, s[2], s[3], 0)
        cross_into(v, s[3], g, 9)
        return dot(s[2], s[0])
    if kind == ANGLE:
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
    for i in range(3):
        s[0, i] = Hb[i] - Ha[i]
    if kind == ALONG:
        rotate_back_into(Ha, s[0], s[1], 0)  # p = R_a^T (x_b - x_a)
        cross_into(u, s[1], g, 3)
        rotate_into(Ha, u, s[2], 0)
        value = dot(u, s[1])
    elif kind == DISTANCE:
        value = np.sqrt(dot(s[0], s[0]))
        for i in range(3):
            s[2, i] = s[0, i] / value
    else:
        s[2, :] = u
        value = dot(u, s[0])
    rotate_back_into(Ha, s[2], g, 0)
    for i in range(3):
        g[i] = -g[i]
    rotate_back_into(Hb, s[2], g, 6)
    return value


@kernel
def _to_node(offset: FloatArray, g: FloatArray, at: int, out: FloatArray) -> None:
    """Carry a marker's gradient ``g[at:at+6]`` to its node: ``Ad(H_o^-1)^T g``."""
    rotate_into(offset, g[at : at + 3], out, 0)
    rotate_into(offset, g[at + 3 : at + 6], out, 3)
    out[3] += offset[1] * out[2] - offset[2] * out[1]
    out[4] += offset[2] * out[0] - offset[0] * out[2]
    out[5] += offset[0] * out[1] - offset[1] * out[0]


@kernel
def marker_poses(
    frames: FloatArray, marker_node: IntArray, marker_offset: FloatArray, poses: FloatArray
) -> None:
    """Poses of all markers from the frames of their nodes (node -1: ground)."""
    for m in range(marker_node.size):
        if marker_node[m] < 0:
            poses[m] = marker_offset[m]
        else:
            compose_into(frames[marker_node[m]], marker_offset[m], poses[m])


@kernel
def update_angles(
    poses: FloatArray, row_marker: IntArray, kinds: IntArray, directions: FloatArray,
    memory: FloatArray,
) -> None:  # fmt: skip
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
def add_forces(
    row_slots: IntArray, force_jacobian: FloatArray, multipliers: FloatArray, local: IntArray,
    residual: FloatArray,
) -> None:  # fmt: skip
    """Add ``G^T multipliers`` to the nodes ``local[slot]`` of a block (-1: another block)."""
    for r in range(multipliers.size):
        for side in range(2):
            slot = row_slots[r, side]
            if slot >= 0 and local[slot] >= 0:
                for i in range(6):
                    residual[local[slot], i] += multipliers[r] * force_jacobian[r, side, i]


@kernel
def evaluate_rows(
    frames: FloatArray, velocities: FloatArray, marker_node: IntArray, marker_offset: FloatArray,
    row_marker: IntArray, kinds: IntArray, directions: FloatArray, targets: FloatArray,
    memory: FloatArray, elastic: FloatArray, dynamics: FloatArray, multipliers: FloatArray,
    poses: FloatArray, force_jacobian: FloatArray, step_jacobian: FloatArray, values: FloatArray,
    compliance: FloatArray,
) -> None:  # fmt: skip
    """Evaluate every row at the trial configuration.

    Args:
        frames: (n, 12) frames of the nodes that carry markers.
        velocities: (n, 6) local twists of these nodes.
        marker_node: (m,) node of each marker, -1 for ground.
        marker_offset: (m, 12) frame of each marker relative to its node, absolute for ground.
        row_marker: (r, 2) markers a and b of each row.
        kinds: (r,) values of ``RowKind``.
        directions: (r, 3, 3) u, v and p.
        targets: (r,) values that the constraint functions take.
        memory: (r,) continuous angles at the accepted state.
        elastic: (r, 3) flag, stiffness, damping of rows with compliance.
        dynamics: (2,) ``gamma/(beta h)`` and ``beta h^2``.
        multipliers: (r,) scaled by ``beta h^2``.
        poses: (m, 12) work.
        force_jacobian: (r, 2, 6) gradient with respect to the nodes' local twists.
        step_jacobian: (r, 2, 6) derivative of ``values`` along them; dampers: see ``add_dampers``.
        values: (r,) residual of the row.
        compliance: (r,) what couples its own multiplier.
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
            # divided by k + c gamma/(beta h) the force k value + c rate is scaled as a rigid row
            k, c = elastic[r, 1], elastic[r, 2]
            scale = 1.0 / (k + c * dynamics[0])
            values[r] = scale * (k * value + c * rate - multipliers[r] / dynamics[1])
            compliance[r] = scale / dynamics[1]
