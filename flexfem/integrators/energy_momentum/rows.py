# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled discrete gradients of the terms of rows over a step, and their derivatives.

Forces ``lambda g`` with a discrete gradient g (``constraints.terms.dispatch``) do no work on a
rigid row, and the work ``-dU`` with ``lambda = (U_1 - U_0)/(value change)``; they have neither
resultant nor moment, since rigid motions about the mean positions change no term.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.constraints.rows.data import RowArrays
from flexfem.constraints.terms.dispatch import step_change, step_gradient, step_vectors
from flexfem.constraints.terms.vectors import mean, put
from flexfem.core.nodes.step_kernels import add, turn, turn_back, unit
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Float1D, Float2D, Float3D, Memory, Record, unpack
from flexfem.lie._blocks import cross, triple
from flexfem.lie._coefficients import Triple

__all__ = ["StepTerms", "add_step_hessians", "at_start", "evaluate_step", "exchanged"]


class StepTerms(Record):
    """Terms of rows over a step, factors left out.

    Attributes:
        frames0, frames: (n, 12) nodes that carry markers at both ends of the step.
        poses0, poses: (m, 12) frames of the markers at both ends.
        values0, values: (t,) values at both ends.
        gradient: (t, 2, 6) discrete gradients in the axes of the nodes at the end.
    """

    frames0: Float2D
    frames: Float2D
    poses0: Float2D
    poses: Float2D
    values0: Float1D
    values: Float1D
    gradient: Float3D


def exchanged(step: StepTerms) -> StepTerms:
    """The same terms from the end of a step to its start.

    Their gradients are those of the step, in the axes of the nodes at its start.
    """
    return _between(step.frames, step.poses, step)


def at_start(step: StepTerms) -> StepTerms:
    """The same terms over a step of size zero at the start of a step."""
    return _between(step.frames0, step.poses0, step)


def _between(frames: FloatArray, poses: FloatArray, step: StepTerms) -> StepTerms:
    """Terms from some frames and poses to the start of a step."""
    terms = len(step.values)
    return StepTerms(
        frames0=frames, frames=step.frames0, poses0=poses, poses=step.poses0,
        values0=np.zeros(terms), values=np.zeros(terms), gradient=np.zeros((terms, 2, 6)),
    )  # fmt: skip


@inlined
def _arm(step: StepTerms, node: int, offset: FloatArray) -> Triple:
    """Mean arm of a marker about its node in inertial axes."""
    o = triple(offset, 0)
    return mean(turn(step.frames0[node], o), turn(step.frames[node], o))


@inlined
def _node_wrench(g: FloatArray, side: int, arm: Triple) -> tuple[Triple, Triple]:
    """Force and moment on the node of one side from those on its marker."""
    f = triple(g, 0)
    if side == 0:
        f = (-f[0], -f[1], -f[2])
    return f, add(triple(g, 3 + 3 * side), 1.0, cross(arm, f))


@kernel
def evaluate_step(rows: Memory, step: Memory) -> None:
    """Write the values of all terms at both ends and their discrete gradients.

    Args:
        rows: ``RowArrays``.
        step: :class:`StepTerms` with the frames and poses at both ends.
    """
    own, over = unpack(RowArrays, rows), unpack(StepTerms, step)
    kinds, term_marker, directions = own.kinds, own.term_marker, own.directions
    frames, poses0, poses = over.frames, over.poses0, over.poses
    values0, values, gradient = over.values0, over.values, over.gradient
    s0, s1, g = np.empty((5, 3)), np.empty((5, 3)), np.empty(9)
    for r in range(kinds.size):
        a, b, d = term_marker[r, 0], term_marker[r, 1], directions[r]
        values0[r] = step_vectors(kinds[r], poses0[a], poses0[b], d, own.angles[r], s0)
        values[r] = step_vectors(kinds[r], poses[a], poses[b], d, values0[r], s1)
        step_gradient(kinds[r], s0, s1, values0[r], values[r], g)
        for side in range(2):
            m = term_marker[r, side]
            node = own.marker_node[m]
            gradient[r, side] = 0.0
            if node >= 0:
                f, moment = _node_wrench(g, side, _arm(over, node, own.marker_offset[m]))
                put(turn_back(frames[node], f), gradient[r, side], 0)
                put(turn_back(frames[node], moment), gradient[r, side], 3)


@kernel
def add_step_hessians(rows: Memory, step: Memory, factor: FloatArray, out: FloatArray) -> None:
    """Add the derivatives of all terms' gradients to the blocks of their pairs of nodes.

    Args:
        rows: ``RowArrays``.
        step: :class:`StepTerms`, evaluated.
        factor: (t,) of each term.
        out: (pairs, 12, 12); rows and columns refer to the nodes' local twists at the end.
    """
    own, over = unpack(RowArrays, rows), unpack(StepTerms, step)
    kinds, term_marker, directions = own.kinds, own.term_marker, own.directions
    marker_node, marker_offset = own.marker_node, own.marker_offset
    frames, poses0, poses = over.frames, over.poses0, over.poses
    values0, values, gradient = over.values0, over.values, over.gradient
    s0, s1, g, dg = np.empty((5, 3)), np.empty((5, 3)), np.empty(9), np.empty(9)
    for r in range(kinds.size):
        if factor[r] == 0.0:
            continue
        a, b, d = term_marker[r, 0], term_marker[r, 1], directions[r]
        step_vectors(kinds[r], poses0[a], poses0[b], d, values0[r], s0)
        step_vectors(kinds[r], poses[a], poses[b], d, values[r], s1)
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
            turns = (still, turned)
            if moved == 0:
                shift, turns = add(still, -1.0, shift), (turned, still)
            step_change(kinds[r], s0, s1, values0[r], values[r], shift, turns, dg)
            for side in range(2):
                m = term_marker[r, side]
                other = marker_node[m]
                if other < 0:
                    continue
                arm = _arm(over, other, marker_offset[m])
                df, dm = _node_wrench(dg, side, arm)
                if side == moved:
                    f, _ = _node_wrench(g, side, arm)
                    dm = add(dm, 0.5, cross(swing, f))
                df, dm = turn_back(frames[other], df), turn_back(frames[other], dm)
                if side == moved:
                    df = add(df, -1.0, cross(t, triple(gradient[r, side], 0)))
                    dm = add(dm, -1.0, cross(t, triple(gradient[r, side], 3)))
                for i in range(3):
                    out[own.pair_of_term[r], 6 * side + i, column] += factor[r] * df[i]
                    out[own.pair_of_term[r], 6 * side + 3 + i, column] += factor[r] * dm[i]
