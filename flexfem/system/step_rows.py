# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled discrete gradients of the terms of rows over a step, and their derivatives.

Forces ``lambda g`` with a discrete gradient g (``core.terms.dispatch``) do no work while the row is
held, and the work ``-dU`` with ``lambda = (U_1 - U_0)/(value change)``; they have neither resultant
nor moment, since rigid motions about the mean positions change no term.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.step_kernels import add, turn, turn_back, unit
from flexfem.core.terms.dispatch import step_change, step_gradient, step_vectors
from flexfem.core.terms.vectors import mean, put
from flexfem.lie._blocks import cross, triple
from flexfem.lie._coefficients import Triple
from flexfem.lie.compiled import inlined, kernel

__all__ = ["add_step_hessians", "evaluate_step"]


@inlined
def _arm(H0: FloatArray, H1: FloatArray, offset: FloatArray) -> Triple:
    """Mean arm of a marker about its node in inertial axes."""
    o = triple(offset, 0)
    return mean(turn(H0, o), turn(H1, o))


@inlined
def _node_wrench(g: FloatArray, side: int, arm: Triple) -> tuple[Triple, Triple]:
    """Force and moment on the node of one side from those on its marker."""
    f = triple(g, 0)
    if side == 0:
        f = (-f[0], -f[1], -f[2])
    return f, add(triple(g, 3 + 3 * side), 1.0, cross(arm, f))


@kernel
def evaluate_step(
    frames0: FloatArray, frames: FloatArray, poses0: FloatArray, poses: FloatArray,
    marker_node: IntArray, marker_offset: FloatArray, term_marker: IntArray, kinds: IntArray,
    directions: FloatArray, memory: FloatArray, values0: FloatArray, values: FloatArray,
    gradient: FloatArray,
) -> None:  # fmt: skip
    """Values of all terms at both ends and their discrete gradients, factors left out.

    Args:
        frames0: (n, 12) frames of the nodes that carry markers at the start of the step.
        frames: (n, 12) the same at its end.
        poses0: (m, 12) frames of the markers at the start.
        poses: (m, 12) the same at the end.
        marker_node: (m,) node of each marker, -1 for ground.
        marker_offset: (m, 12) frame of each marker relative to its node.
        term_marker: (t, 2) markers a and b of each term.
        kinds: (t,) values of ``RowKind``.
        directions: (t, 3, 3) u, v and p.
        memory: (t,) continuous angles at the accepted state.
        values0: (t,) become the values at the start.
        values: (t,) become the values at the end.
        gradient: (t, 2, 6) becomes the gradient in the axes of the nodes at the end.
    """
    s0, s1, g = np.empty((5, 3)), np.empty((5, 3)), np.empty(9)
    for r in range(kinds.size):
        a, b = term_marker[r, 0], term_marker[r, 1]
        values0[r] = step_vectors(kinds[r], poses0[a], poses0[b], directions[r], memory[r], s0)
        values[r] = step_vectors(kinds[r], poses[a], poses[b], directions[r], values0[r], s1)
        step_gradient(kinds[r], s0, s1, values0[r], values[r], g)
        for side in range(2):
            m = term_marker[r, side]
            node = marker_node[m]
            gradient[r, side] = 0.0
            if node >= 0:
                arm = _arm(frames0[node], frames[node], marker_offset[m])
                f, moment = _node_wrench(g, side, arm)
                put(turn_back(frames[node], f), gradient[r, side], 0)
                put(turn_back(frames[node], moment), gradient[r, side], 3)


@kernel
def add_step_hessians(
    frames0: FloatArray, frames: FloatArray, poses0: FloatArray, poses: FloatArray,
    marker_node: IntArray, marker_offset: FloatArray, term_marker: IntArray, kinds: IntArray,
    directions: FloatArray, values0: FloatArray, values: FloatArray, gradient: FloatArray,
    pair_of_term: IntArray, factor: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add ``factor`` times the derivative of every term's gradient to its pair's ``out`` (12, 12).

    Rows and columns refer to the nodes' local twists at the end of the step; see
    :func:`evaluate_step` for the other arguments.
    """
    s0, s1, g, dg = np.empty((5, 3)), np.empty((5, 3)), np.empty(9), np.empty(9)
    for r in range(kinds.size):
        if factor[r] == 0.0:
            continue
        a, b = term_marker[r, 0], term_marker[r, 1]
        step_vectors(kinds[r], poses0[a], poses0[b], directions[r], values0[r], s0)
        step_vectors(kinds[r], poses[a], poses[b], directions[r], values[r], s1)
        step_gradient(kinds[r], s0, s1, values0[r], values[r], g)
        for column in range(12):
            moved, k = column // 6, column % 6
            node = marker_node[term_marker[r, moved]]
            if node < 0:
                continue
            u, t = unit(k), unit(k - 3)
            turned = turn(frames[node], t)
            swing = turn(frames[node], cross(t, triple(marker_offset[term_marker[r, moved]], 0)))
            shift = add(turn(frames[node], u), 1.0, swing)
            still = (0.0, 0.0, 0.0)
            if moved == 0:
                shift = add(still, -1.0, shift)
                step_change(kinds[r], s0, s1, values0[r], values[r], shift, turned, still, dg)
            else:
                step_change(kinds[r], s0, s1, values0[r], values[r], shift, still, turned, dg)
            for side in range(2):
                m = term_marker[r, side]
                other = marker_node[m]
                if other < 0:
                    continue
                arm = _arm(frames0[other], frames[other], marker_offset[m])
                df, dm = _node_wrench(dg, side, arm)
                if side == moved:
                    f, _ = _node_wrench(g, side, arm)
                    dm = add(dm, 0.5, cross(swing, f))
                df, dm = turn_back(frames[other], df), turn_back(frames[other], dm)
                if side == moved:
                    df = add(df, -1.0, cross(t, triple(gradient[r, side], 0)))
                    dm = add(dm, -1.0, cross(t, triple(gradient[r, side], 3)))
                for i in range(3):
                    out[pair_of_term[r], 6 * side + i, column] += factor[r] * df[i]
                    out[pair_of_term[r], 6 * side + 3 + i, column] += factor[r] * dm[i]
