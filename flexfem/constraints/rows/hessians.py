# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled second derivatives of the terms of rows; conventions as in ``kernels``."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.constraints.rows.data import InterfaceNodes, RowArrays
from flexfem.constraints.rows.kernels import ON_LINES, TWIST, to_node
from flexfem.constraints.terms.dispatch import term_hessian
from flexfem.constraints.terms.vectors import put
from flexfem.core.nodes.frame_kernels import along_velocity_into, step_rates_into
from flexfem.core.nodes.step_kernels import add, turn_back
from flexfem.kernels.compiled import inlined, kernel, subroutine
from flexfem.kernels.records import Memory, unpack
from flexfem.lie._blocks import cross, triple

__all__ = [
    "add_dampers",
    "add_hessians",
    "marker_map",
    "second_rates",
    "velocity_changes",
]


@subroutine
def marker_map(offset: FloatArray, J: FloatArray) -> None:
    """Map ``J`` (6, 6) from node twist to marker twist, ``Ad(H_o^-1)``."""
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


@inlined
def _hessian(own: RowArrays, t: int, h: FloatArray) -> None:
    """Second derivative ``h`` (12, 12) of a term with respect to its markers' twists."""
    a, b = own.poses[own.term_marker[t, 0]], own.poses[own.term_marker[t, 1]]
    term_hessian(own.kinds[t], a, b, own.directions[t], h)


@kernel
def add_hessians(memory: Memory, factor: FloatArray, out: FloatArray) -> None:
    """Add ``factor`` times every term's second derivative to the block of its pair of markers.

    Rows and columns refer to the nodes' local twists.
    """
    own = unpack(RowArrays, memory)
    h, J, left = np.empty((12, 12)), np.empty((2, 6, 6)), np.empty((12, 12))
    for t in range(own.kinds.size):
        if factor[t] == 0.0 or own.kinds[t] == ON_LINES or own.kinds[t] == TWIST:
            continue
        _hessian(own, t, h)
        for side in range(2):
            m = own.term_marker[t, side]
            J[side] = 0.0
            if own.marker_node[m] >= 0:
                marker_map(own.marker_offset[m], J[side])
        for i in range(12):
            for j in range(12):
                left[i, j] = 0.0
                for k in range(6):
                    left[i, j] += h[i, 6 * (j // 6) + k] * J[j // 6, k, j % 6]
        block = out[own.pair_of_term[t]]
        for i in range(12):
            for j in range(12):
                for k in range(6):
                    block[i, j] += factor[t] * J[i // 6, k, i % 6] * left[6 * (i // 6) + k, j]


@subroutine
def _to_marker(offset: FloatArray, twist: FloatArray, v: FloatArray, at: int) -> None:
    """Local twist ``v[at : at + 6]`` of a marker from that of its node."""
    omega = triple(twist, 3)
    moved = add(triple(twist, 0), 1.0, cross(omega, triple(offset, 0)))
    put(turn_back(offset, moved), v, at)
    put(turn_back(offset, omega), v, at + 3)


@subroutine
def _marker_twists(own: RowArrays, t: int, velocities: FloatArray, v: FloatArray) -> None:
    """Local twists ``v`` (12) of a term's markers."""
    v[:] = 0.0
    for side in range(2):
        m = own.term_marker[t, side]
        node = own.marker_node[m]
        if node >= 0:
            _to_marker(own.marker_offset[m], velocities[node], v, 6 * side)


@kernel
def second_rates(memory: Memory, velocities: FloatArray, out: FloatArray) -> None:
    """``v . (d gradient / dq) v`` of every row: its second time derivative at constant v."""
    own = unpack(RowArrays, memory)
    h, v = np.empty((12, 12)), np.empty(12)
    out[:] = 0.0
    for t in range(own.kinds.size):
        if own.kinds[t] == ON_LINES:
            continue
        _hessian(own, t, h)
        _marker_twists(own, t, velocities, v)
        for i in range(12):
            for j in range(12):
                out[own.row_of_term[t]] += own.factors[t] * v[i] * h[i, j] * v[j]


@kernel
def add_dampers(
    memory: Memory, interface_nodes: Memory, by_increment: float, held: bool, slopes: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Add to ``out`` (t, 2, 6) the dependence of the rates of rows on position and increment.

    Args:
        memory: ``RowArrays``.
        interface_nodes: ``InterfaceNodes``.
        by_increment: dv/dn of the time integrator, 1/s.
        held: True if the nodes' velocities do not depend on steps.
        slopes: (r, 2) derivatives of the rows' values by their sums and rates.
        out: derivatives of the rows' values along steps.
    """
    own, nodes = unpack(RowArrays, memory), unpack(InterfaceNodes, interface_nodes)
    h, v, w, T = np.empty((12, 12)), np.empty(12), np.empty(12), np.empty(36)
    velocities, by_velocity, rate = nodes.velocities, np.zeros(6), np.empty(6)
    for t in range(own.kinds.size):
        slope, factor = slopes[own.row_of_term[t], 1], own.factors[t]
        if slope == 0.0 or own.kinds[t] == ON_LINES:
            continue
        _hessian(own, t, h)
        _marker_twists(own, t, velocities, v)
        w[:] = 0.0
        for i in range(12):
            for j in range(12):
                w[j] += v[i] * h[i, j]
        for side in range(2):
            m = own.term_marker[t, side]
            node = own.marker_node[m]
            if node < 0:
                continue
            if not held:
                along_velocity_into(
                    nodes.inertial[node], nodes.increments[node], velocities[node], by_increment,
                    own.force_jacobian[t, side], T, by_velocity,
                )  # fmt: skip
            to_node(own.marker_offset[m], w, 6 * side, rate)
            for j in range(6):
                out[t, side, j] += slope * (factor * rate[j] + by_velocity[j])


@kernel
def velocity_changes(interface_nodes: Memory, by_increment: float) -> FloatArray:
    """(n, 6, 6) derivatives of the local velocities of ``InterfaceNodes`` by their steps."""
    nodes = unpack(InterfaceNodes, interface_nodes)
    out, by_w = np.empty((nodes.inertial.size, 36)), np.empty(36)
    rates, nothing = np.array([by_increment, 0.0]), np.zeros(6)
    for n in range(nodes.inertial.size):
        step_rates_into(
            nodes.inertial[n], nodes.increments[n], nodes.velocities[n], nothing, rates, out[n],
            by_w,
        )  # fmt: skip
    return out.reshape(-1, 6, 6)
