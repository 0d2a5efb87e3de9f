# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled discrete gradients of the terms of rows over a step, and their derivatives.

A term's value changes over a step by exactly ``g . (increments of its nodes)``: terms are made of
products of positions and directions fixed to the markers, for which averages of both ends give this
identity where nodes turn by the Cayley map (see ``core.step_kernels``). Forces ``lambda g`` do no
work then while the row is held, and the work ``-dU`` with ``lambda = (U_1 - U_0)/(value change)``;
they have neither resultant nor moment, since rigid motions about the mean positions change no term.
"""

from math import atan2, sqrt

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.step_kernels import add, turn, turn_back, unit
from flexfem.lie._blocks import cross, dot, triple
from flexfem.lie._coefficients import Triple
from flexfem.lie.compiled import inlined, kernel
from flexfem.system.row_kernels import ALONG, ANGLE, AXES, DISTANCE, INERTIAL

__all__ = ["add_step_hessians", "evaluate_step"]


@inlined
def _mean(a: Triple, b: Triple) -> Triple:
    return 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])


@inlined
def _put(v: Triple, out: FloatArray, at: int) -> None:
    out[at], out[at + 1], out[at + 2] = v


@inlined
def _sinc_inverse(x: float) -> tuple[float, float]:
    """``x / sin(x)`` and its derivative."""
    if abs(x) < 0.1:
        y = x * x
        value = 1.0 + y * (1 / 6 + y * (7 / 360 + y * (31 / 15120 + y * 127 / 604800)))
        slope = x * (1 / 3 + y * (7 / 90 + y * (31 / 2520 + y * 127 / 75600)))
        return value, slope
    s, c = np.sin(x), np.cos(x)
    return x / s, (s - x * c) / (s * s)


@inlined
def _wrapped(angle: float, near: float) -> float:
    """The angle nearest to another one."""
    return near + atan2(np.sin(angle - near), np.cos(angle - near))


@kernel
def _vectors(
    kind: int, a: FloatArray, b: FloatArray, row: FloatArray, memory: float, out: FloatArray
) -> float:
    """Value of a term at one end; the vectors it is made of in ``out`` (5, 3).

    ``out`` holds the arm between the markers, R_a u, R_a p, R_a (u x p) and R_b v.
    """
    u, v, p = triple(row[0], 0), triple(row[1], 0), triple(row[2], 0)
    arm = add(triple(b, 0), -1.0, triple(a, 0))
    _put(arm, out[0], 0)
    axis = u if kind == INERTIAL else turn(a, u)
    _put(axis, out[1], 0)
    _put(turn(a, p), out[2], 0)
    _put(turn(a, cross(u, p)), out[3], 0)
    other = turn(b, v)
    _put(other, out[4], 0)
    if kind == AXES:
        return dot(axis, other)
    if kind == DISTANCE:
        return sqrt(dot(arm, arm))
    if kind == ANGLE:
        cosine, sine = dot(triple(out[2], 0), other), dot(triple(out[3], 0), other)
        return _wrapped(atan2(sine, cosine), memory)
    return dot(axis, arm)


@inlined
def _angle_parts(
    s0: FloatArray, s1: FloatArray, change: float
) -> tuple[float, float, float, float, float, float, Triple, Triple]:
    """Cosine and sine at the end and on average, factor and slope; mean vectors."""
    c0, c1 = dot(triple(s0[2], 0), triple(s0[4], 0)), dot(triple(s1[2], 0), triple(s1[4], 0))
    d0, d1 = dot(triple(s0[3], 0), triple(s0[4], 0)), dot(triple(s1[3], 0), triple(s1[4], 0))
    size = np.sqrt((c0 * c0 + d0 * d0) * (c1 * c1 + d1 * d1))
    value, slope = _sinc_inverse(change)
    c, d = 0.5 * (c0 + c1), 0.5 * (d0 + d1)
    q, p = _mean(triple(s0[3], 0), triple(s1[3], 0)), _mean(triple(s0[2], 0), triple(s1[2], 0))
    z = (c * q[0] - d * p[0], c * q[1] - d * p[1], c * q[2] - d * p[2])
    return c1, d1, c, d, value / size, slope / size, z, q


@kernel
def _spatial(
    kind: int, s0: FloatArray, s1: FloatArray, value0: float, value1: float, out: FloatArray
) -> None:
    """Discrete gradient in inertial axes: force on b (on a: opposite), moments on a and b."""
    out[:] = 0.0
    arm = _mean(triple(s0[0], 0), triple(s1[0], 0))
    axis = _mean(triple(s0[1], 0), triple(s1[1], 0))
    other = _mean(triple(s0[4], 0), triple(s1[4], 0))
    if kind == AXES:
        _put(cross(axis, other), out, 3)
        _put(cross(other, axis), out, 6)
    elif kind == ANGLE:
        _, _, _, _, factor, _, z, _ = _angle_parts(s0, s1, value1 - value0)
        m = cross(z, other)
        _put((factor * m[0], factor * m[1], factor * m[2]), out, 3)
        _put((-factor * m[0], -factor * m[1], -factor * m[2]), out, 6)
    elif kind == DISTANCE:
        scale = 2.0 / (value0 + value1)
        _put((scale * arm[0], scale * arm[1], scale * arm[2]), out, 0)
    else:
        _put(axis, out, 0)
        if kind == ALONG:
            _put(cross(axis, arm), out, 3)


@kernel
def _angle_change(
    s0: FloatArray, s1: FloatArray, change: float, ta: Triple, tb: Triple, out: FloatArray
) -> None:
    """Derivative of the moments of an angle as both markers turn at the end."""
    c1, d1, c, d, factor, slope, z, q = _angle_parts(s0, s1, change)
    p1, q1, w1 = triple(s1[2], 0), triple(s1[3], 0), triple(s1[4], 0)
    p, w = _mean(triple(s0[2], 0), p1), _mean(triple(s0[4], 0), w1)
    dp, dq, dw = cross(ta, p1), cross(ta, q1), cross(tb, w1)
    dc, dd = dot(dp, w1) + dot(p1, dw), dot(dq, w1) + dot(q1, dw)
    square = c1 * c1 + d1 * d1
    turned, grown = (c1 * dd - d1 * dc) / square, (c1 * dc + d1 * dd) / square
    dfactor = slope * turned - factor * grown
    dz = (
        0.5 * (dc * q[0] + c * dq[0] - dd * p[0] - d * dp[0]),
        0.5 * (dc * q[1] + c * dq[1] - dd * p[1] - d * dp[1]),
        0.5 * (dc * q[2] + c * dq[2] - dd * p[2] - d * dp[2]),
    )
    m = add(cross(dz, w), 0.5, cross(z, dw))
    m = (factor * m[0], factor * m[1], factor * m[2])
    m = add(m, dfactor, cross(z, w))
    _put(m, out, 3)
    _put((-m[0], -m[1], -m[2]), out, 6)


@kernel
def _spatial_change(
    kind: int, s0: FloatArray, s1: FloatArray, value0: float, value1: float, shift: Triple,
    ta: Triple, tb: Triple, out: FloatArray,
) -> None:  # fmt: skip
    """Derivative of :func:`_spatial` as the arm shifts and the markers turn at the end."""
    out[:] = 0.0
    arm = _mean(triple(s0[0], 0), triple(s1[0], 0))
    axis = _mean(triple(s0[1], 0), triple(s1[1], 0))
    other = _mean(triple(s0[4], 0), triple(s1[4], 0))
    nothing = (0.0, 0.0, 0.0)
    if kind == AXES:
        da = add(nothing, 0.5, cross(ta, triple(s1[1], 0)))
        db = add(nothing, 0.5, cross(tb, triple(s1[4], 0)))
        m = add(cross(da, other), 1.0, cross(axis, db))
        _put(m, out, 3)
        _put((-m[0], -m[1], -m[2]), out, 6)
    elif kind == ANGLE:
        _angle_change(s0, s1, value1 - value0, ta, tb, out)
    elif kind == DISTANCE:
        total = value0 + value1
        grown = dot(triple(s1[0], 0), shift) / value1
        f = add(shift, -2.0 * grown / total, arm)
        _put((f[0] / total, f[1] / total, f[2] / total), out, 0)
    elif kind == ALONG:
        da = add(nothing, 0.5, cross(ta, triple(s1[1], 0)))
        _put(da, out, 0)
        _put(add(cross(da, arm), 0.5, cross(axis, shift)), out, 3)


@inlined
def _arm(H0: FloatArray, H1: FloatArray, offset: FloatArray) -> Triple:
    """Mean arm of a marker about its node in inertial axes."""
    o = triple(offset, 0)
    return _mean(turn(H0, o), turn(H1, o))


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
        values0[r] = _vectors(kinds[r], poses0[a], poses0[b], directions[r], memory[r], s0)
        values[r] = _vectors(kinds[r], poses[a], poses[b], directions[r], values0[r], s1)
        _spatial(kinds[r], s0, s1, values0[r], values[r], g)
        for side in range(2):
            m = term_marker[r, side]
            node = marker_node[m]
            gradient[r, side] = 0.0
            if node >= 0:
                arm = _arm(frames0[node], frames[node], marker_offset[m])
                f, moment = _node_wrench(g, side, arm)
                _put(turn_back(frames[node], f), gradient[r, side], 0)
                _put(turn_back(frames[node], moment), gradient[r, side], 3)


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
        _vectors(kinds[r], poses0[a], poses0[b], directions[r], values0[r], s0)
        _vectors(kinds[r], poses[a], poses[b], directions[r], values[r], s1)
        _spatial(kinds[r], s0, s1, values0[r], values[r], g)
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
                _spatial_change(kinds[r], s0, s1, values0[r], values[r], shift, turned, still, dg)
            else:
                _spatial_change(kinds[r], s0, s1, values0[r], values[r], shift, still, turned, dg)
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
