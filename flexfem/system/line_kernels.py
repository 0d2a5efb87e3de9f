# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled evaluation of joints with markers that lie on lines between nodes, or slide on them.

Such a marker's frame H(q, xi) depends on the frames q of all nodes of an element. Where it slides,
the coordinate xi is the one at which the section's plane holds the other marker b,

``G(q, xi) = R e1 . (x_b - x) = 0``,

so that it is a function of the nodes. For what rows measure, F(q, xi) in total, this gives the
gradient ``F_q + F_xi xi_q`` with ``xi_q = -G_q / G_xi`` and, with ``mu = -F_xi / G_xi``, the second
derivative ``P^T (F + mu G)_zz P`` with ``z = (q, xi)`` and ``P = (1; xi_q)``. A constraint along the
other two axes of the section thus pulls at right angles to the line, whatever the section's shear.
"""

from typing import NamedTuple

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.line_points import (
    add_line_second,
    arc_length,
    line_jacobian,
    offset_jacobian,
    turn_columns,
    turn_frames,
    turn_second,
)
from flexfem.core.row import RowKind
from flexfem.lie.compiled import kernel
from flexfem.lie.se3 import compose_into
from flexfem.system.row_hessians import marker_map, term_hessian
from flexfem.system.row_kernels import ANGLE, rotate_back_into, rotate_into, term, to_node

__all__ = [
    "LineData",
    "PointData",
    "RowData",
    "Work",
    "add_line_wrenches",
    "evaluate_lines",
    "line_hessian",
    "node_slots",
    "update_line_angles",
]

ARC, ALONG = int(RowKind.ARC), int(RowKind.ALONG)

#: Slot of a marker that no single node carries.
ON_LINE = -2

#: Newton steps for the place of a slider, and their size at which it is found.
_STEPS, _SMALL = 50, 1e-13


class LineData(NamedTuple):
    """Elements of all lines, one line after the other; k is the largest number of nodes.

    Attributes:
        element: (n_lines,) how frames are interpolated; width: (n_lines,) nodes of an element.
        first: (n_lines + 1,) first element of each line.
        nodes: (e, k) slots of the nodes.
        shape: (e, k, k), turns: (e, 2, 9), start: (e,), arc: (e, q), see ``line_cells``.
        turned: (n_lines,) whether any section is turned against its node.
    """

    element: IntArray
    width: IntArray
    first: IntArray
    nodes: IntArray
    shape: FloatArray
    turns: FloatArray
    start: FloatArray
    arc: FloatArray
    turned: BoolArray


class PointData(NamedTuple):
    """Markers of these joints.

    Attributes:
        first: (n_joints + 1,) first marker of each joint.
        marker: (m,) its number among all markers.
        slot: (m,) slot of the node that carries it, -1 on the ground, -2 on a line.
        offset: (m, 12) relative to its node or section.
        line: (m,) number of its line; slides: (m,) whether it slides.
        column: (m,) where its nodes begin among those of the joint.
        count: (n_joints,) nodes of each joint, a node of two markers counted twice.
    """

    first: IntArray
    marker: IntArray
    slot: IntArray
    offset: FloatArray
    line: IntArray
    slides: BoolArray
    column: IntArray
    count: IntArray


class RowData(NamedTuple):
    """Rows of these joints and their terms.

    Attributes:
        first: (n_joints + 1,) first row of each joint here.
        row: (r,) number among all rows.
        entry: (r,) first term among all terms, which holds the gradient, two nodes a term.
        term: (r + 1,) first term here.
        kinds, directions, factors, memory: (t,), (t, 3, 3), (t,) and (t,) of the terms.
        ends: (t, 2) markers within the joint.
    """

    first: IntArray
    row: IntArray
    entry: IntArray
    term: IntArray
    kinds: IntArray
    directions: FloatArray
    factors: FloatArray
    memory: FloatArray
    ends: IntArray


class Work(NamedTuple):
    """Work space; n is the largest number of nodes of a joint, m that of its markers.

    Attributes:
        frames: (k, 12) frames of an element's nodes.
        section: (6, 6 k + 1) derivatives of a section's frame; block: (6 k + 1, 6 k + 1).
        point: (m, 6, 6 n + 1) derivatives of the markers along z = (twists of nodes, xi).
        forces: (6 m,) gradient with respect to the markers' twists, hessian: (6 m, 6 m).
        slide: (6 n + 1,) derivative of the slider's equation G by z.
        gradient: (6 n + 1,) derivative of a row by z.
        second: (6 n + 1, 6 n + 1) second derivatives.
    """

    frames: FloatArray
    section: FloatArray
    block: FloatArray
    point: FloatArray
    forces: FloatArray
    hessian: FloatArray
    slide: FloatArray
    gradient: FloatArray
    second: FloatArray


@kernel
def _section(
    lines: LineData, line: int, e: int, xi: float, frames: FloatArray, work: Work, H: FloatArray
) -> None:
    """Frame ``H`` of a section and its derivatives in ``work.section``."""
    k = lines.width[line]
    for i in range(k):
        work.frames[i] = frames[lines.nodes[e, i]]
    if lines.turned[line]:
        turn_frames(work.frames[:k], lines.turns[e], work.frames[:k])
    J = work.section[:, : 6 * k + 1]
    line_jacobian(lines.element[line], work.frames[:k], lines.shape[e, :k, :k], xi, H, J)
    if lines.turned[line]:
        turn_columns(lines.turns[e], J)


@kernel
def _slide_to(
    lines: LineData, line: int, x: FloatArray, frames: FloatArray, work: Work, place: FloatArray
) -> None:
    """Move ``place`` (element, xi) along the line until the section's plane holds the point x.

    Beyond the ends the last elements are continued. Elements are left in the direction of the
    first crossing only: where the sections of two of them differ at their common node, either may
    send the point to the other.
    """
    H, p, gap = np.empty(12), np.empty(3), np.empty(3)
    first, last = lines.first[line], lines.first[line + 1] - 1
    e, xi, direction, k = int(place[0]), place[1], 0, 6 * lines.width[line]
    for _ in range(_STEPS):
        _section(lines, line, e, xi, frames, work, H)
        for i in range(3):
            gap[i] = x[i] - H[i]
        rotate_back_into(H, gap, p, 0)
        J = work.section
        step = p[0] / (J[0, k] + J[4, k] * p[2] - J[5, k] * p[1])
        xi += min(max(step, -1.0), 1.0)
        if abs(step) < _SMALL:
            break
        if xi > 1.0 and e < last and direction >= 0:
            xi = (xi - 1.0) * _speed(lines, e, 1.0) / _speed(lines, e + 1, 0.0)
            e, direction = e + 1, 1
        elif xi < 0.0 and e > first and direction <= 0:
            xi = 1.0 + xi * _speed(lines, e, 0.0) / _speed(lines, e - 1, 1.0)
            e, direction = e - 1, -1
    place[0], place[1] = e, xi


@kernel
def _speed(lines: LineData, e: int, xi: float) -> float:
    """Arc length per coordinate."""
    speed: float = arc_length(lines.arc[e], xi)[1]
    return speed


@kernel
def _put_marker(offset: FloatArray, section: FloatArray, at: int, xi: int, J: FloatArray) -> None:
    """Derivatives J of a marker from those of the section that carries it.

    The nodes' columns begin at ``at``, that of the coordinate is ``xi``, -1 where it is held.
    """
    offset_jacobian(offset, section)
    last = section.shape[1] - 1
    for i in range(6):
        for j in range(last):
            J[i, at + j] = section[i, j]
        if xi >= 0:
            J[i, xi] = section[i, last]


@kernel
def _place_markers(
    c: int, lines: LineData, points: PointData, frames: FloatArray, start: FloatArray,
    work: Work, poses: FloatArray, places: FloatArray,
) -> None:  # fmt: skip
    """Poses of a joint's markers and their derivatives by z in ``work.point``.

    Args:
        c: number of the joint.
        lines: elements.
        points: markers.
        frames: (n, 12) of all slots.
        start: (m, 2) accepted places, from which sliders are followed.
        work: work space.
        poses: (m, 12) of all markers.
        places: (m, 2) element and xi of these markers; those that slide are set.
    """
    H, first, last, xi = np.empty(12), points.first[c], points.first[c + 1], 6 * points.count[c]
    work.point[:] = 0.0
    for m in range(last - 1, first - 1, -1):  # what slides follows a later marker
        pose, J, at = poses[points.marker[m]], work.point[m - first], 6 * points.column[m]
        if points.slot[m] == -1:
            pose[:] = points.offset[m]
        elif points.slot[m] >= 0:
            compose_into(frames[points.slot[m]], points.offset[m], pose)
            marker_map(points.offset[m], J[:, at : at + 6])
        else:
            line = points.line[m]
            if points.slides[m]:
                places[m] = start[m]
                other = poses[points.marker[first + 1]]
                _slide_to(lines, line, other[:3], frames, work, places[m])
            _section(lines, line, int(places[m, 0]), places[m, 1], frames, work, H)
            compose_into(H, points.offset[m], pose)
            section = work.section[:, : 6 * lines.width[line] + 1]
            _put_marker(points.offset[m], section, at, xi if points.slides[m] else -1, J)


@kernel
def _along_first(poses: FloatArray, a: int, b: int, g: FloatArray, scratch: FloatArray) -> None:
    """Gradient ``g`` (12) of the slider's equation with respect to both markers' twists."""
    u = np.zeros(3)
    u[0] = 1.0
    term(ALONG, poses[a], poses[b], u, u, u, 0.0, g, scratch)


@kernel
def _slide_gradient(
    c: int, points: PointData, poses: FloatArray, work: Work, g: FloatArray, scratch: FloatArray
) -> None:
    """Derivatives of the coordinate of a joint's slider by the twists of nodes in ``work.slide``.

    Its last entry is that of G by the coordinate; zero where nothing slides.
    """
    first, xi = points.first[c], 6 * points.count[c]
    work.slide[: xi + 1] = 0.0
    if not points.slides[first]:
        return
    _along_first(poses, points.marker[first], points.marker[first + 1], g, scratch)
    _add_to_nodes(g, 0, 1, 1.0, work, xi + 1, work.slide)
    for j in range(xi):
        work.slide[j] = -work.slide[j] / work.slide[xi]


@kernel
def _add_to_nodes(
    g: FloatArray, a: int, b: int, factor: float, work: Work, size: int, out: FloatArray
) -> None:
    """Add a gradient (12) with respect to the twists of markers a and b, carried to z."""
    for j in range(size):
        total = 0.0
        for i in range(6):
            total += g[i] * work.point[a, i, j] + g[6 + i] * work.point[b, i, j]
        out[j] += factor * total


@kernel
def _row_value(
    r: int, c: int, lines: LineData, points: PointData, rows: RowData, poses: FloatArray,
    places: FloatArray, work: Work, g: FloatArray, scratch: FloatArray,
) -> float:  # fmt: skip
    """Sum of a row's terms; its gradient by z in ``work.gradient``."""
    size, value = 6 * points.count[c] + 1, 0.0
    work.gradient[:size] = 0.0
    for t in range(rows.term[r], rows.term[r + 1]):
        a, b = rows.ends[t]
        if rows.kinds[t] == ARC:
            m = points.first[c] + a
            e = int(places[m, 0])
            s, slope, _ = arc_length(lines.arc[e], places[m, 1])
            value += rows.factors[t] * (lines.start[e] + s)
            work.gradient[size - 1] += rows.factors[t] * slope
            continue
        d, at = rows.directions[t], points.first[c]
        value += rows.factors[t] * term(
            rows.kinds[t], poses[points.marker[at + a]], poses[points.marker[at + b]], d[0], d[1],
            d[2], rows.memory[t], g, scratch,
        )  # fmt: skip
        _add_to_nodes(g, a, b, rows.factors[t], work, size, work.gradient)
    return value


@kernel
def evaluate_lines(
    lines: LineData, points: PointData, rows: RowData, frames: FloatArray, start: FloatArray,
    work: Work, poses: FloatArray, places: FloatArray, values: FloatArray, gradients: FloatArray,
) -> None:  # fmt: skip
    """Evaluate all rows of joints on lines.

    Args:
        lines, points, rows: data.
        frames: (n, 12) of all slots.
        start: (m, 2) accepted places of the markers on lines.
        work: work space.
        poses: (m, 12) of all markers.
        places: (m, 2) places at the trial state.
        values: (r,) sums of the terms of all rows; those of joints on lines are set.
        gradients: (t, 2, 6) gradients of all terms, two nodes a term, in the same way.
    """
    g, scratch = np.empty(12), np.empty((5, 3))
    for c in range(points.count.size):
        _place_markers(c, lines, points, frames, start, work, poses, places)
        _slide_gradient(c, points, poses, work, g, scratch)
        xi = 6 * points.count[c]
        for r in range(rows.first[c], rows.first[c + 1]):
            values[rows.row[r]] = _row_value(
                r, c, lines, points, rows, poses, places, work, g, scratch
            )
            for n in range(points.count[c]):
                out = gradients[rows.entry[r] + n // 2, n % 2]
                for i in range(6):
                    j = 6 * n + i
                    out[i] = work.gradient[j] + work.gradient[xi] * work.slide[j]


@kernel
def _add_term_second(
    kind: int, d: FloatArray, poses: FloatArray, first: int, a: int, b: int, marker: IntArray,
    factor: float, work: Work, g: FloatArray, h: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Add ``factor`` times gradient and second derivative of a term on the markers' twists."""
    Ha, Hb = poses[marker[first + a]], poses[marker[first + b]]
    term(kind, Ha, Hb, d[0], d[1], d[2], 0.0, g, scratch)
    term_hessian(kind, Ha, Hb, d[0], d[1], d[2], h)
    for i in range(12):
        row = 6 * (a if i < 6 else b) + i % 6
        work.forces[row] += factor * g[i]
        for j in range(12):
            work.hessian[row, 6 * (a if j < 6 else b) + j % 6] += factor * h[i, j]


@kernel
def line_hessian(
    c: int, weights: FloatArray, lines: LineData, points: PointData, rows: RowData,
    frames: FloatArray, start: FloatArray, work: Work, poses: FloatArray, places: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Second derivative of a weighted sum of a joint's rows along the twists of its nodes.

    Args:
        c: number of the joint.
        weights: (r,) weights of all rows.
        lines, points, rows, frames, start, work, poses, places: see :func:`evaluate_lines`.
        out: (6 n, 6 n) derivative of the gradient; column j along twist j.
    """
    g, h, scratch, d = np.empty(12), np.empty((12, 12)), np.empty((5, 3)), np.zeros((3, 3))
    _place_markers(c, lines, points, frames, start, work, poses, places)
    _slide_gradient(c, points, poses, work, g, scratch)
    first, xi = points.first[c], 6 * points.count[c]
    size = xi + 1
    work.forces[:], work.hessian[:], work.second[:] = 0.0, 0.0, 0.0
    by_xi, by_xi_twice = 0.0, 0.0
    for r in range(rows.first[c], rows.first[c + 1]):
        for t in range(rows.term[r], rows.term[r + 1]):
            factor = weights[rows.row[r]] * rows.factors[t]
            a, b = rows.ends[t]
            if rows.kinds[t] == ARC:
                _, slope, bend = arc_length(lines.arc[int(places[first + a, 0])], places[first + a, 1])
                by_xi += factor * slope
                by_xi_twice += factor * bend
            elif factor != 0.0:
                _add_term_second(
                    rows.kinds[t], rows.directions[t], poses, first, a, b, points.marker, factor,
                    work, g, h, scratch,
                )  # fmt: skip
    if points.slides[first]:
        for i in range(work.forces.size):
            by_xi += work.forces[i] * work.point[i // 6, i % 6, xi]
        d[0, 0] = 1.0
        _add_term_second(
            ALONG, d, poses, first, 0, 1, points.marker, -by_xi / work.slide[xi], work, g, h,
            scratch,
        )  # fmt: skip
    _carry_second(c, lines, points, frames, places, work)
    work.second[xi, xi] += by_xi_twice
    for i in range(xi):
        for j in range(xi):
            out[i, j] = work.second[i, j] + work.slide[i] * work.second[xi, j]
            out[i, j] += (
                work.second[i, xi] + work.slide[i] * work.second[xi, xi]
            ) * work.slide[j]


@kernel
def _carry_second(
    c: int, lines: LineData, points: PointData, frames: FloatArray, places: FloatArray, work: Work
) -> None:
    """``work.second`` by z from forces and second derivatives on the markers' twists."""
    first, count = points.first[c], points.first[c + 1] - points.first[c]
    size = 6 * points.count[c] + 1
    left = np.zeros((6 * count, size))
    for i in range(6 * count):
        for k in range(6 * count):
            entry = work.hessian[i, k]
            if entry != 0.0:
                for j in range(size):
                    left[i, j] += entry * work.point[k // 6, k % 6, j]
    for k in range(6 * count):
        for i in range(size):
            entry = work.point[k // 6, k % 6, i]
            if entry != 0.0:
                for j in range(size):
                    work.second[i, j] += entry * left[k, j]
    for m in range(count):
        if points.slot[first + m] == ON_LINE:
            _add_point_second(first + m, m, size - 1, lines, points, frames, places, work)


@kernel
def _add_point_second(
    m: int, number: int, xi: int, lines: LineData, points: PointData, frames: FloatArray,
    places: FloatArray, work: Work,
) -> None:  # fmt: skip
    """Add that the force on a marker acts on nodes in directions that change with them."""
    line, e, g = points.line[m], int(places[m, 0]), np.empty(6)
    k = lines.width[line]
    to_node(points.offset[m], work.forces, 6 * number, g)
    for i in range(k):
        work.frames[i] = frames[lines.nodes[e, i]]
    block = work.block[: 6 * k + 1, : 6 * k + 1]
    block[:] = 0.0
    if lines.turned[line]:
        turn_frames(work.frames[:k], lines.turns[e], work.frames[:k])
    add_line_second(
        lines.element[line], work.frames[:k], lines.shape[e, :k, :k], places[m, 1], g, block
    )
    if lines.turned[line]:
        turn_second(lines.turns[e], block)
    at = 6 * points.column[m]
    for i in range(6 * k + 1):
        row = xi if i == 6 * k else at + i
        for j in range(6 * k + 1):
            work.second[row, xi if j == 6 * k else at + j] += block[i, j]


@kernel
def node_slots(
    lines: LineData, points: PointData, rows: RowData, places: FloatArray, first_pair: IntArray,
    term_slots: IntArray, pair_slots: IntArray,
) -> None:  # fmt: skip
    """Write the slots of the joints' nodes to the terms (t, 2) and pairs (p, 2) that hold them."""
    slots = np.empty(points.count.max(), dtype=np.int64)
    for c in range(points.count.size):
        for m in range(points.first[c], points.first[c + 1]):
            if points.slot[m] >= 0:
                slots[points.column[m]] = points.slot[m]
            elif points.slot[m] == ON_LINE:
                e = int(places[m, 0])
                for i in range(lines.width[points.line[m]]):
                    slots[points.column[m] + i] = lines.nodes[e, i]
        count, pair = points.count[c], first_pair[c]
        for r in range(rows.first[c], rows.first[c + 1]):
            for n in range(count + count % 2):
                slot = slots[n] if n < count else -1
                term_slots[rows.entry[r] + n // 2, n % 2] = slot
        for a in range(count):
            for b in range(a + 1, count):
                pair_slots[pair, 0], pair_slots[pair, 1] = slots[a], slots[b]
                pair += 1


@kernel
def update_line_angles(points: PointData, rows: RowData, poses: FloatArray) -> None:
    """Store the continuous angles at accepted poses of the markers."""
    g, scratch = np.empty(12), np.empty((5, 3))
    for c in range(points.count.size):
        marker = points.marker[points.first[c] :]
        for t in range(rows.term[rows.first[c]], rows.term[rows.first[c + 1]]):
            if rows.kinds[t] == ANGLE:
                a, b, d = poses[marker[rows.ends[t, 0]]], poses[marker[rows.ends[t, 1]]], rows.directions[t]
                rows.memory[t] = term(ANGLE, a, b, d[0], d[1], d[2], rows.memory[t], g, scratch)


@kernel
def add_line_wrenches(
    forces: FloatArray, lines: LineData, points: PointData, rows: RowData, frames: FloatArray,
    start: FloatArray, work: Work, poses: FloatArray, places: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add to ``out`` (m, 6) the wrenches of the joints on the bodies, in inertial axes.

    What keeps or drives a slider along its line acts on both bodies, too.
    """
    g, scratch, turned = np.empty(12), np.empty((5, 3)), np.empty(3)
    for c in range(points.count.size):
        _place_markers(c, lines, points, frames, start, work, poses, places)
        _slide_gradient(c, points, poses, work, g, scratch)
        first, xi = points.first[c], 6 * points.count[c]
        by_xi = 0.0
        work.forces[:] = 0.0
        for r in range(rows.first[c], rows.first[c + 1]):
            force = forces[rows.row[r]]
            _row_value(r, c, lines, points, rows, poses, places, work, g, scratch)
            by_xi += force * work.gradient[xi]
            _add_forces(r, first, points, rows, poses, force, work, g, scratch)
        if points.slides[first]:
            _along_first(poses, points.marker[first], points.marker[first + 1], g, scratch)
            for i in range(12):
                work.forces[i] -= by_xi / work.slide[xi] * g[i]
        for m in range(first, points.first[c + 1]):
            to = points.marker[m]
            for half in range(2):
                at = 6 * (m - first) + 3 * half
                rotate_into(poses[to], work.forces[at : at + 3], turned, 0)
                for i in range(3):
                    out[to, 3 * half + i] -= turned[i]


@kernel
def _add_forces(
    r: int, first: int, points: PointData, rows: RowData, poses: FloatArray, force: float,
    work: Work, g: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Add the gradient of a row with respect to its markers' twists times its force."""
    for t in range(rows.term[r], rows.term[r + 1]):
        if rows.kinds[t] == ARC:
            continue
        a, b = rows.ends[t]
        d = rows.directions[t]
        Ha, Hb = poses[points.marker[first + a]], poses[points.marker[first + b]]
        term(rows.kinds[t], Ha, Hb, d[0], d[1], d[2], rows.memory[t], g, scratch)
        for i in range(6):
            work.forces[6 * a + i] += force * rows.factors[t] * g[i]
            work.forces[6 * b + i] += force * rows.factors[t] * g[6 + i]
