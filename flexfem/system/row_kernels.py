# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled evaluation of rows and their terms: values, gradients, forces.

Markers have frames ``H_a = (x_a, R_a)`` and ``H_b``; gradients are taken with respect to their
local twists ``(V_a, Omega_a, V_b, Omega_b)`` (12 numbers). The derivation uses ``dx = R V``, ``dR =
R skew(Omega)`` and nothing else.
"""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.row import RowKind
from flexfem.core.terms.dispatch import term
from flexfem.core.terms.vectors import rotate_into
from flexfem.lie._blocks import copy_entries
from flexfem.lie.compiled import inlined, kernel, subroutine
from flexfem.lie.se3 import compose_into
from flexfem.system.row_laws import RIGID, force_law

__all__ = [
    "ANGLE",
    "ON_LINES",
    "add_forces",
    "evaluate_rows",
    "marker_poses",
    "marker_wrenches",
    "sums_of_terms",
    "to_node",
    "update_angles",
]

ANGLE = int(RowKind.ANGLE)
#: Kind of a term that holds two nodes of the gradient of a row on lines, see ``line_kernels``.
ON_LINES = -1


@subroutine
def to_node(offset: FloatArray, g: FloatArray, at: int, out: FloatArray) -> None:
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
    """Poses of all markers from the frames of their nodes (-1: ground, -2: on a line, left)."""
    for m in range(marker_node.size):
        if marker_node[m] == -1:
            copy_entries(marker_offset[m], poses[m])
        elif marker_node[m] < 0:
            continue
        else:
            compose_into(frames[marker_node[m]], marker_offset[m], poses[m])


@kernel
def update_angles(
    frames: FloatArray, marker_node: IntArray, marker_offset: FloatArray, term_marker: IntArray,
    kinds: IntArray, directions: FloatArray, poses: FloatArray, memory: FloatArray,
) -> None:  # fmt: skip
    """Store the poses of all markers and the continuous angles of accepted frames."""
    marker_poses(frames, marker_node, marker_offset, poses)
    g, scratch = np.empty(12), np.empty((5, 3))
    for t in range(kinds.size):
        if kinds[t] == ANGLE:
            d = directions[t]
            memory[t] = term(
                ANGLE, poses[term_marker[t, 0]], poses[term_marker[t, 1]], d,
                memory[t], g, scratch,
            )  # fmt: skip


@kernel
def sums_of_terms(
    poses: FloatArray, term_marker: IntArray, kinds: IntArray, directions: FloatArray,
    factors: FloatArray, memory: FloatArray, row_of_term: IntArray, out: FloatArray,
) -> None:  # fmt: skip
    """Values of all rows, their targets not subtracted."""
    g, scratch = np.empty(12), np.empty((5, 3))
    out[:] = 0.0
    for t in range(kinds.size):
        if kinds[t] == ON_LINES:
            continue
        d = directions[t]
        out[row_of_term[t]] += factors[t] * term(
            kinds[t], poses[term_marker[t, 0]], poses[term_marker[t, 1]], d,
            memory[t], g, scratch,
        )  # fmt: skip


@kernel
def marker_wrenches(
    poses: FloatArray, term_marker: IntArray, kinds: IntArray, directions: FloatArray,
    factors: FloatArray, row_of_term: IntArray, forces: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add to ``out`` (m, 6) the wrenches ``-G^T forces`` on the bodies, in inertial axes.

    Moments are about the markers' origins.
    """
    g, scratch, turned = np.empty(12), np.empty((5, 3)), np.empty(3)
    for t in range(kinds.size):
        if kinds[t] == ON_LINES:
            continue
        d = directions[t]
        term(
            kinds[t], poses[term_marker[t, 0]], poses[term_marker[t, 1]], d,
            0.0, g, scratch,
        )  # fmt: skip
        size = -factors[t] * forces[row_of_term[t]]
        for part in range(4):
            m = term_marker[t, part // 2]
            rotate_into(poses[m], g[3 * part : 3 * part + 3], turned, 0)
            for i in range(3):
                out[m, 3 * (part % 2) + i] += size * turned[i]


@kernel
def add_forces(
    term_slots: IntArray, row_of_term: IntArray, force_jacobian: FloatArray,
    multipliers: FloatArray, local: IntArray, residual: FloatArray,
) -> None:  # fmt: skip
    """Add ``G^T multipliers`` to the nodes ``local[slot]`` of a block (-1: another block)."""
    for t in range(row_of_term.size):
        for side in range(2):
            slot = term_slots[t, side]
            if slot >= 0 and local[slot] >= 0:
                for i in range(6):
                    residual[local[slot], i] += (
                        multipliers[row_of_term[t]] * force_jacobian[t, side, i]
                    )


@subroutine
def _apply_law(
    r: int, law: FloatArray, function: int, data: FloatArray, value: float, rate: float,
    dynamics: FloatArray, multipliers: FloatArray, coupled: IntArray, at: int, values: FloatArray,
    compliance: FloatArray, coupling: FloatArray, slopes: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Equation ``scale (F - L/s) = 0`` of row ``r`` with its derivatives.

    The scale lies below ``s`` and below one over the slopes of the force: the equation has the
    size of a rigid row's, whether the law is stiff or its force vanishes. The row's couplings
    begin at ``at``.
    """
    squares, end = 0.0, at
    while end < coupling.size and coupled[end, 0] == r:
        squares += multipliers[coupled[end, 1]] ** 2
        end += 1
    size = np.sqrt(squares)
    force_law(
        law, function, data, value, rate, multipliers[r] / dynamics[1], size / dynamics[1], out
    )
    scale = 1.0 / (1.0 / dynamics[1] + abs(out[1]) + abs(out[2]) * dynamics[0])
    values[r] = scale * (out[0] - multipliers[r] / dynamics[1])
    compliance[r] = scale / dynamics[1]
    slopes[r, 0], slopes[r, 1] = scale * out[1], scale * out[2]
    for k in range(at, end):
        part = multipliers[coupled[k, 1]] / size if size > 0.0 else 0.0
        coupling[k] = -compliance[r] * out[3] * part


@inlined
def _to_nodes(
    t: int, g: FloatArray, factor: float, velocities: FloatArray, marker_node: IntArray,
    marker_offset: FloatArray, term_marker: IntArray, force_jacobian: FloatArray,
    step_jacobian: FloatArray,
) -> float:  # fmt: skip
    """Gradient of a term with respect to its nodes from that to its markers; its rate."""
    rate = 0.0
    for side in range(2):
        m = term_marker[t, side]
        node = marker_node[m]
        if node < 0:
            force_jacobian[t, side] = 0.0
            step_jacobian[t, side] = 0.0
            continue
        to_node(marker_offset[m], g, 6 * side, force_jacobian[t, side])
        for i in range(6):
            force_jacobian[t, side, i] *= factor
            step_jacobian[t, side, i] = force_jacobian[t, side, i]
            rate += force_jacobian[t, side, i] * velocities[node, i]
    return rate


@inlined
def _line_rate(
    t: int, slots: IntArray, velocities: FloatArray, force_jacobian: FloatArray,
    step_jacobian: FloatArray,
) -> float:  # fmt: skip
    """Rate of the gradient of a row on lines at the two nodes of a term."""
    rate = 0.0
    for side in range(2):
        for i in range(6):
            step_jacobian[t, side, i] = force_jacobian[t, side, i]
            if slots[t, side] >= 0:
                rate += force_jacobian[t, side, i] * velocities[slots[t, side], i]
    return rate


@kernel
def evaluate_rows(
    frames: FloatArray, velocities: FloatArray, marker_node: IntArray, marker_offset: FloatArray,
    term_marker: IntArray, term_slots: IntArray, line_sums: FloatArray, kinds: IntArray,
    directions: FloatArray, factors: FloatArray,
    memory: FloatArray, term_start: IntArray, targets: FloatArray, active: BoolArray,
    elastic: FloatArray, functions: IntArray, data: FloatArray, relaxation: float,
    coupled: IntArray, dynamics: FloatArray, multipliers: FloatArray, poses: FloatArray,
    force_jacobian: FloatArray, step_jacobian: FloatArray, values: FloatArray,
    compliance: FloatArray, coupling: FloatArray, slopes: FloatArray,
) -> None:  # fmt: skip
    """Evaluate every row at the trial configuration.

    Args:
        frames: (n, 12) frames of the nodes that carry markers.
        velocities: (n, 6) local twists of these nodes.
        marker_node: (m,) node of each marker, -1 for ground.
        marker_offset: (m, 12) frame of each marker relative to its node, absolute for ground.
        term_marker: (t, 2) markers a and b of each term.
        term_slots: (t, 2) their nodes.
        line_sums: (r,) sums of the rows on lines, whose gradients are known.
        kinds: (t,) values of ``RowKind``, or addresses of functions, see ``term``.
        directions: (t, 3, 3) u, v and p, see ``Term.data``.
        factors: (t,) coefficients of the terms.
        memory: (t,) continuous angles at the accepted state.
        term_start: (r + 1,) first term of each row.
        targets: (r,) values that the sums take.
        active: (r,) rows that are not released.
        elastic: (r, 5) law, stiffness, damping and two parameters, see ``Law``.
        functions: (r,) addresses of functions of the user's that laws call, 0 for none.
        data: (r, 9) time and parameters of these functions.
        relaxation: compliance of rigid rows.
        coupled: (k, 2) rows with friction, and rows whose resultant presses on them.
        dynamics: (2,) ``gamma/(beta h)`` and ``beta h^2``.
        multipliers: (r,) scaled by ``beta h^2``.
        poses: (m, 12) work.
        force_jacobian: (t, 2, 6) gradient with respect to the nodes' local twists.
        step_jacobian: (t, 2, 6) derivative of ``values`` along them; dampers: see ``add_dampers``.
        values: (r,) residual of the row.
        compliance: (r,) what couples its own multiplier.
        coupling: (k,) what couples those of ``coupled`` rows.
        slopes: (r, 2) derivatives of ``values`` with respect to the row's sum and its rate.
    """
    marker_poses(frames, marker_node, marker_offset, poses)
    g, scratch, law, at = np.empty(12), np.empty((5, 3)), np.empty(4), 0
    for r in range(targets.size):
        value, rate = line_sums[r] - targets[r], 0.0
        for t in range(term_start[r], term_start[r + 1]):
            if kinds[t] == ON_LINES:
                rate += _line_rate(t, term_slots, velocities, force_jacobian, step_jacobian)
                continue
            d = directions[t]
            value += factors[t] * term(
                kinds[t], poses[term_marker[t, 0]], poses[term_marker[t, 1]], d,
                memory[t], g, scratch,
            )  # fmt: skip
            rate += _to_nodes(
                t, g, factors[t], velocities, marker_node, marker_offset, term_marker,
                force_jacobian, step_jacobian,
            )  # fmt: skip
        if active[r] and elastic[r, 0] == RIGID:
            values[r], compliance[r] = value - relaxation * multipliers[r], relaxation
            continue
        if active[r]:
            while at < coupling.size and coupled[at, 0] < r:
                at += 1
            _apply_law(
                r, elastic[r], functions[r], data[r], value, rate, dynamics, multipliers, coupled,
                at, values, compliance, coupling, slopes, law,
            )  # fmt: skip
        else:
            values[r], compliance[r], slopes[r, 0], slopes[r, 1] = -multipliers[r], 1.0, 0.0, 0.0
        for t in range(term_start[r], term_start[r + 1]):
            for side in range(2):
                for i in range(6):
                    step_jacobian[t, side, i] *= slopes[r, 0]
