# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled second derivatives of the terms of rows; conventions as in ``row_kernels``."""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.frame_kernels import step_rates_into
from flexfem.core.terms.dispatch import term_hessian
from flexfem.lie.compiled import kernel, subroutine
from flexfem.system.row_kernels import ON_LINES

__all__ = [
    "add_dampers",
    "add_hessians",
    "marker_map",
    "second_rates",
    "velocity_changes",
]


@subroutine
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


@subroutine
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
