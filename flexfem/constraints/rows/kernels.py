# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled evaluation of rows and their terms: values, gradients, forces.

Markers have frames ``H_a = (x_a, R_a)`` and ``H_b``; gradients are taken with respect to their
local twists ``(V_a, Omega_a, V_b, Omega_b)`` (12 numbers). The derivation uses ``dx = R V``, ``dR =
R skew(Omega)`` and nothing else.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.constraints.rows.data import InterfaceNodes, RowArrays
from flexfem.constraints.rows.laws import CAPSTAN, ELEMENT, RIGID, force_law
from flexfem.constraints.terms.dispatch import term
from flexfem.constraints.terms.vectors import put, scaled
from flexfem.core.nodes.step_kernels import add, turn
from flexfem.core.row import RowKind
from flexfem.kernels.compiled import inlined, kernel, subroutine
from flexfem.kernels.records import Memory, unpack
from flexfem.lie._blocks import copy_entries, cross, dot, triple
from flexfem.lie._coefficients import Triple
from flexfem.lie.se3 import compose_into

__all__ = [
    "ANGLE",
    "ON_LINES",
    "TWIST",
    "add_forces",
    "evaluate_rows",
    "marker_poses",
    "marker_wrenches",
    "sums_of_terms",
    "to_node",
    "update_angles",
    "update_wraps",
]

ANGLE, TOUCH = int(RowKind.ANGLE), int(RowKind.TOUCH)
#: Kind of terms with constant gradients.
TWIST = int(RowKind.TWIST)
#: Kind of a term with two nodes of the gradient of a row on lines, see
#: ``constraints.lines.kernels``.
ON_LINES = -1


@inlined
def _carried(offset: FloatArray, g: FloatArray, at: int) -> tuple[Triple, Triple]:
    """Forces and moments of :func:`to_node`."""
    force = turn(offset, triple(g, at))
    return force, add(turn(offset, triple(g, at + 3)), 1.0, cross(triple(offset, 0), force))


@subroutine
def to_node(offset: FloatArray, g: FloatArray, at: int, out: FloatArray) -> None:
    """Carry a marker's gradient ``g[at:at+6]`` to its node: ``Ad(H_o^-1)^T g``."""
    force, moment = _carried(offset, g, at)
    put(force, out, 0)
    put(moment, out, 3)


@kernel
def marker_poses(memory: Memory, frames: FloatArray, poses: FloatArray) -> None:
    """Poses of all markers from the frames of their nodes (-1: ground, -2: on a line, left)."""
    _place(unpack(RowArrays, memory), frames, poses)


@subroutine
def _place(own: RowArrays, frames: FloatArray, poses: FloatArray) -> None:
    """Poses of all markers, see :func:`marker_poses`."""
    node, offset = own.marker_node, own.marker_offset
    for m in range(node.size):
        if node[m] == -1:
            copy_entries(offset[m], poses[m])
        elif node[m] < 0:
            continue
        else:
            compose_into(frames[node[m]], offset[m], poses[m])


@inlined
def _term(own: RowArrays, t: int, before: float, g: FloatArray, scratch: FloatArray) -> float:
    """Value of a term at the markers' poses; its gradient in ``g`` (12), see ``dispatch.term``."""
    a, b = own.poses[own.term_marker[t, 0]], own.poses[own.term_marker[t, 1]]
    value: float = term(own.kinds[t], a, b, own.directions[t], before, g, scratch)
    return value


@kernel
def update_angles(memory: Memory, frames: FloatArray) -> None:
    """Store the poses of all markers and the continuous angles of accepted frames."""
    own, g, scratch = unpack(RowArrays, memory), np.empty(12), np.empty((5, 3))
    _place(own, frames, own.poses)
    for t in range(own.kinds.size):
        if own.kinds[t] == ANGLE or own.kinds[t] == TOUCH:
            own.angles[t] = _term(own, t, own.angles[t], g, scratch)


@kernel
def update_wraps(memory: Memory) -> None:
    """Exponents of the friction of cables around guides, at accepted poses and angles."""
    own, g, h, scratch = unpack(RowArrays, memory), np.empty(12), np.empty(12), np.empty((5, 3))
    for k in range(own.wrapped_rows.size):
        before, after = own.wrap_terms[k]
        coefficient, angle = own.wraps[k, 0], own.wraps[k, 1]
        if angle >= 0.0:
            angle += own.angles[before] + own.angles[after]
        else:  # an eyelet: between the directions of the straight parts
            _term(own, before, 0.0, g, scratch)
            _term(own, after, 0.0, h, scratch)
            first, last = triple(g, 6), triple(h, 0)
            across = cross(first, last)
            angle = np.arctan2(np.sqrt(dot(across, across)), -dot(first, last))
        own.elastic[own.wrapped_rows[k], 3] = coefficient * max(angle, 0.0)


@kernel
def sums_of_terms(memory: Memory, out: FloatArray) -> None:
    """Values of all rows but those on lines, their targets not subtracted."""
    own, g, scratch = unpack(RowArrays, memory), np.empty(12), np.empty((5, 3))
    out[:] = 0.0
    for t in range(own.kinds.size):
        if own.kinds[t] != ON_LINES:
            out[own.row_of_term[t]] += own.factors[t] * _term(own, t, own.angles[t], g, scratch)


@kernel
def marker_wrenches(memory: Memory, forces: FloatArray, out: FloatArray) -> None:
    """Add to ``out`` (m, 6) the wrenches ``-G^T forces`` on the bodies, in inertial axes.

    Moments are about the markers' origins.
    """
    own, g, scratch = unpack(RowArrays, memory), np.empty(12), np.empty((5, 3))
    for t in range(own.kinds.size):
        if own.kinds[t] == ON_LINES:
            continue
        _term(own, t, 0.0, g, scratch)
        size = -own.factors[t] * forces[own.row_of_term[t]]
        for part in range(4):
            m = own.term_marker[t, part // 2]
            turned = turn(own.poses[m], triple(g, 3 * part))
            for i in range(3):
                out[m, 3 * (part % 2) + i] += size * turned[i]


@kernel
def add_forces(
    memory: Memory, multipliers: FloatArray, local: IntArray, residual: FloatArray
) -> None:
    """Add ``G^T multipliers`` to the nodes ``local[node]`` of a block (-1: another block)."""
    own = unpack(RowArrays, memory)
    nodes, rows, jacobian = own.term_nodes, own.row_of_term, own.force_jacobian
    for t in range(rows.size):
        for side in range(2):
            node = nodes[t, side]
            if node >= 0 and local[node] >= 0:
                for i in range(6):
                    residual[local[node], i] += multipliers[rows[t]] * jacobian[t, side, i]


@subroutine
def _apply_law(
    own: RowArrays, r: int, at: int, value: float, rate: float, dynamics: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Equation ``scale (F - L/s) = 0`` of row ``r`` with its derivatives.

    The scale is less than ``s`` and than one over the slopes of the force: the equation has the
    magnitude of a rigid row's, both for stiff laws and for vanishing forces. The row's couplings
    begin at ``at``; ``out`` (4,) is work space.
    """
    squares, total, end, coupled, coupling = 0.0, 0.0, at, own.coupled, own.coupling
    while end < coupling.size and coupled[end, 0] == r:
        press = own.multipliers[coupled[end, 1]] - own.excess[coupled[end, 1]]
        squares += press**2
        total += press
        end += 1
    size = total if own.elastic[r, 0] == CAPSTAN else np.sqrt(squares)
    force_law(
        own.elastic[r], own.functions[r], own.function_data[r], value, rate - own.target_rates[r],
        own.multipliers[r] / dynamics[1], size / dynamics[1], out,
    )  # fmt: skip
    scale = 1.0 / (1.0 / dynamics[1] + abs(out[1]) + abs(out[2]) * dynamics[0])
    own.values[r] = scale * (out[0] - own.multipliers[r] / dynamics[1])
    own.compliance[r] = scale / dynamics[1]
    own.slopes[r, 0], own.slopes[r, 1] = scale * out[1], scale * out[2]
    for k in range(at, end):
        press = own.multipliers[coupled[k, 1]] - own.excess[coupled[k, 1]]
        part = press / size if size > 0.0 else 0.0
        if own.elastic[r, 0] == CAPSTAN:
            part = 1.0
        coupling[k] = -own.compliance[r] * out[3] * part


@inlined
def _to_nodes(own: RowArrays, t: int, g: FloatArray, velocities: FloatArray) -> float:
    """Gradient of a term by its nodes from that by its markers; its rate."""
    rate, factor = 0.0, own.factors[t]
    for side in range(2):
        m = own.term_marker[t, side]
        node, force, step = (
            own.marker_node[m],
            own.force_jacobian[t, side],
            own.step_jacobian[t, side],
        )
        if node < 0:
            force[:] = 0.0
            step[:] = 0.0
            continue
        first, last = _carried(own.marker_offset[m], g, 6 * side)
        first, last, v = scaled(factor, first), scaled(factor, last), velocities[node]
        put(first, force, 0)
        put(last, force, 3)
        put(first, step, 0)
        put(last, step, 3)
        rate += dot(first, triple(v, 0)) + dot(last, triple(v, 3))
    return rate


@inlined
def _line_rate(own: RowArrays, t: int, velocities: FloatArray) -> float:
    """Rate of the gradient of a row on lines at the two nodes of a term."""
    rate = 0.0
    for side in range(2):
        node, force, step = (
            own.term_nodes[t, side],
            own.force_jacobian[t, side],
            own.step_jacobian[t, side],
        )
        for i in range(6):
            step[i] = force[i]
            if node >= 0:
                rate += force[i] * velocities[node, i]
    return rate


@kernel
def evaluate_rows(memory: Memory, interface_nodes: Memory, dynamics: FloatArray) -> None:
    """Evaluate every row at the trial configuration.

    The dependence of rates of dampers on positions is not included, see ``hessians.add_dampers``.

    Args:
        memory: ``RowArrays``.
        interface_nodes: ``InterfaceNodes`` of the markers.
        dynamics: (2,) ``gamma/(beta h)`` and ``beta h^2``.
    """
    own, nodes = unpack(RowArrays, memory), unpack(InterfaceNodes, interface_nodes)
    velocities, term_start = nodes.velocities, own.term_start
    _place(own, nodes.frames, own.poses)
    g, scratch, law, at = np.empty(12), np.empty((5, 3)), np.empty(4), 0
    for r in range(own.targets.size):
        value, rate = own.line_sums[r] - own.targets[r], 0.0
        for t in range(term_start[r], term_start[r + 1]):
            if own.kinds[t] == ON_LINES:
                rate += _line_rate(own, t, velocities)
                continue
            value += own.factors[t] * _term(own, t, own.angles[t], g, scratch)
            rate += _to_nodes(own, t, g, velocities)
        if own.active[r] and own.elastic[r, 0] == RIGID:
            own.values[r] = value - own.relaxation * own.multipliers[r]
            own.compliance[r] = own.relaxation
            continue
        if own.active[r] and own.elastic[r, 0] == ELEMENT:
            own.slopes[r, 0], own.slopes[r, 1] = 0.0, 0.0  # see ``constraints.elements``
        elif own.active[r]:
            while at < own.coupling.size and own.coupled[at, 0] < r:
                at += 1
            _apply_law(own, r, at, value, rate, dynamics, law)
        else:
            own.values[r], own.compliance[r] = -own.multipliers[r], 1.0
            own.slopes[r, 0], own.slopes[r, 1] = 0.0, 0.0
        for t in range(term_start[r], term_start[r + 1]):
            for side in range(2):
                for i in range(6):
                    own.step_jacobian[t, side, i] *= own.slopes[r, 0]
