# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled evaluation of joints with markers that lie on lines between nodes, or slide on them.

Such a marker's frame H(q, xi) depends on the frames q of all nodes of an element. Where it slides,
the coordinate xi is the one at which the section's plane holds the other marker b,

``G(q, xi) = R e1 . (x_b - x) = 0``,

so that it is a function of the nodes. For what rows measure, F(q, xi) in total, this gives the
gradient ``F_q + F_xi xi_q`` with ``xi_q = -G_q / G_xi`` and, with ``mu = -F_xi / G_xi``, the second
derivative ``P^T (F + mu G)_zz P`` with ``z = (q, xi)`` and ``P = (1; xi_q)``. A constraint along
the other two axes of the section thus pulls at right angles to the line, whatever its shear.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.line_points import (
    arc_length,
    line_jacobian,
    offset_jacobian,
    turn_columns,
    turn_frames,
)
from flexfem.core.row import RowKind
from flexfem.core.terms.dispatch import term
from flexfem.core.terms.vectors import rotate_back_into, rotate_into
from flexfem.lie._blocks import copy_entries
from flexfem.lie.compiled import inlined, kernel, subroutine
from flexfem.lie.se3 import compose_into
from flexfem.system.line_data import ON_LINE, LineData, PointData, RowData, Work
from flexfem.system.row_hessians import marker_map

__all__ = [
    "ALONG",
    "ARC",
    "add_line_wrenches",
    "coefficients",
    "element_frames",
    "evaluate_lines",
    "node_slots",
    "place_markers",
    "slide_gradient",
    "slider_motions",
    "update_line_angles",
]

ARC, ALONG, ANGLE = int(RowKind.ARC), int(RowKind.ALONG), int(RowKind.ANGLE)

#: Newton steps for the place of a slider, and their size at which it is found.
_STEPS, _SMALL = 50, 1e-13


@subroutine
def element_frames(lines: LineData, line: int, e: int, frames: FloatArray, work: Work) -> None:
    """Frames of the sections at the nodes of an element in ``work.frames``."""
    k = lines.width[line]
    for i in range(k):
        copy_entries(frames[lines.nodes[e, i]], work.frames[i])
    if lines.turned[line]:
        turn_frames(work.frames[:k], lines.turns[e], work.frames[:k])


@subroutine
def coefficients(lines: LineData, line: int, e: int) -> FloatArray:
    """Those of the shape functions of an element."""
    rows, columns = lines.size[line]
    own: FloatArray = lines.shape[e][: rows * columns].reshape(rows, columns)
    return own


@inlined
def section_jacobian(lines: LineData, line: int, work: Work) -> FloatArray:
    """``work.section`` as the matrix (6, 6 k + 1) of an element of a line.

    Contiguous, as all matrices for ``line_points``: another layout would be compiled once more.
    """
    columns = 6 * lines.width[line] + 1
    own: FloatArray = work.section[: 6 * columns].reshape(6, columns)
    return own


@subroutine
def _section(
    lines: LineData, line: int, e: int, xi: float, frames: FloatArray, work: Work, H: FloatArray
) -> None:
    """Frame ``H`` of a section and its derivatives in ``work.section``."""
    k = lines.width[line]
    element_frames(lines, line, e, frames, work)
    J = section_jacobian(lines, line, work)
    line_jacobian(lines.element[line], work.frames[:k], coefficients(lines, line, e), xi, H, J)
    if lines.turned[line]:
        turn_columns(lines.turns[e], J)


@subroutine
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
        J = section_jacobian(lines, line, work)
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


@subroutine
def _speed(lines: LineData, e: int, xi: float) -> float:
    """Arc length per coordinate."""
    speed: float = arc_length(lines.arc[e], xi)[1]
    return speed


@subroutine
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


@subroutine
def place_markers(
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
    H, first, last, xi = np.empty(12), points.first[c], points.first[c + 1], 6 * points.width[c]
    work.point[:] = 0.0
    for m in range(last - 1, first - 1, -1):  # what slides follows a later marker
        pose, J, at = poses[points.marker[m]], work.point[m - first], 6 * points.column[m]
        if points.slot[m] == -1:
            copy_entries(points.offset[m], pose)
        elif points.slot[m] >= 0:
            compose_into(frames[points.slot[m]], points.offset[m], pose)
            marker_map(points.offset[m], J[:, at : at + 6])
        else:
            line = points.line[m]
            if points.slides[m]:
                copy_entries(start[m], places[m])
                other = poses[points.marker[first + 1]]
                _slide_to(lines, line, other[:3], frames, work, places[m])
            _section(lines, line, int(places[m, 0]), places[m, 1], frames, work, H)
            compose_into(H, points.offset[m], pose)
            section = section_jacobian(lines, line, work)
            _put_marker(points.offset[m], section, at, xi if points.slides[m] else -1, J)


@subroutine
def _along_first(poses: FloatArray, a: int, b: int, g: FloatArray, scratch: FloatArray) -> None:
    """Gradient ``g`` (12) of the slider's equation with respect to both markers' twists."""
    d = np.zeros((3, 3))
    d[0, 0] = 1.0
    term(ALONG, poses[a], poses[b], d, 0.0, g, scratch)


@subroutine
def slide_gradient(
    c: int, points: PointData, poses: FloatArray, work: Work, g: FloatArray, scratch: FloatArray
) -> None:
    """Derivatives of the coordinate of a joint's slider by the twists of nodes in ``work.slide``.

    Its last entry is that of G by the coordinate; zero where nothing slides.
    """
    first, xi = points.first[c], 6 * points.width[c]
    work.slide[: xi + 1] = 0.0
    if not points.slides[first]:
        return
    _along_first(poses, points.marker[first], points.marker[first + 1], g, scratch)
    _add_to_nodes(g, 0, 1, 1.0, work, xi + 1, work.slide)
    for j in range(xi):
        work.slide[j] = -work.slide[j] / work.slide[xi]


@subroutine
def _add_to_nodes(
    g: FloatArray, a: int, b: int, factor: float, work: Work, size: int, out: FloatArray
) -> None:
    """Add a gradient (12) with respect to the twists of markers a and b, carried to z."""
    for j in range(size):
        total = 0.0
        for i in range(6):
            total += g[i] * work.point[a, i, j] + g[6 + i] * work.point[b, i, j]
        out[j] += factor * total


@subroutine
def _row_value(
    r: int, c: int, lines: LineData, points: PointData, rows: RowData, poses: FloatArray,
    places: FloatArray, work: Work, g: FloatArray, scratch: FloatArray,
) -> float:  # fmt: skip
    """Sum of a row's terms; its gradient by z in ``work.gradient``."""
    size, value = 6 * points.width[c] + 1, 0.0
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
            rows.kinds[t], poses[points.marker[at + a]], poses[points.marker[at + b]], d,
            rows.memory[t], g, scratch,
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
        lines: elements.
        points: markers.
        rows: rows and terms.
        frames: (n, 12) of all slots.
        start: (m, 2) accepted places of the markers on lines.
        work: work space.
        poses: (m, 12) of all markers.
        places: (m, 2) places at the trial state.
        values: (r,) sums of the terms of all rows; those of joints on lines are set.
        gradients: (t, 2, 6) gradients of all terms, two nodes a term, in the same way.
    """
    g, scratch = np.empty(12), np.empty((5, 3))
    for c in range(points.width.size):
        place_markers(c, lines, points, frames, start, work, poses, places)
        slide_gradient(c, points, poses, work, g, scratch)
        xi = 6 * points.width[c]
        for r in range(rows.first[c], rows.first[c + 1]):
            values[rows.row[r]] = _row_value(
                r, c, lines, points, rows, poses, places, work, g, scratch
            )
            for n in range(points.width[c]):
                out = gradients[rows.entry[r] + n // 2, n % 2]
                for i in range(6):
                    j = 6 * n + i
                    out[i] = work.gradient[j] + work.gradient[xi] * work.slide[j]


@kernel
def node_slots(
    lines: LineData, points: PointData, rows: RowData, places: FloatArray, first_pair: IntArray,
    term_slots: IntArray, pair_slots: IntArray,
) -> None:  # fmt: skip
    """Write the slots of the joints' nodes to the terms (t, 2) and pairs (p, 2) that hold them."""
    slots = np.empty(points.width.max(), dtype=np.int64)
    for c in range(points.width.size):
        for m in range(points.first[c], points.first[c + 1]):
            if points.slot[m] >= 0:
                slots[points.column[m]] = points.slot[m]
            elif points.slot[m] == ON_LINE:
                e = int(places[m, 0])
                for i in range(lines.width[points.line[m]]):
                    slots[points.column[m] + i] = lines.nodes[e, i]
        count, pair = points.width[c], first_pair[c]
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
    for c in range(points.width.size):
        marker = points.marker[points.first[c] :]
        for t in range(rows.term[rows.first[c]], rows.term[rows.first[c + 1]]):
            if rows.kinds[t] == ANGLE:
                a, b, d = (
                    poses[marker[rows.ends[t, 0]]],
                    poses[marker[rows.ends[t, 1]]],
                    rows.directions[t],
                )
                rows.memory[t] = term(ANGLE, a, b, d, rows.memory[t], g, scratch)


@kernel
def add_line_wrenches(
    forces: FloatArray, lines: LineData, points: PointData, rows: RowData, frames: FloatArray,
    start: FloatArray, work: Work, poses: FloatArray, places: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add to ``out`` (m, 6) the wrenches of the joints on the bodies, in inertial axes.

    What keeps or drives a slider along its line acts on both bodies, too.
    """
    g, scratch, turned = np.empty(12), np.empty((5, 3)), np.empty(3)
    for c in range(points.width.size):
        place_markers(c, lines, points, frames, start, work, poses, places)
        slide_gradient(c, points, poses, work, g, scratch)
        first, xi = points.first[c], 6 * points.width[c]
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


@subroutine
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
        term(rows.kinds[t], Ha, Hb, d, rows.memory[t], g, scratch)
        for i in range(6):
            work.forces[6 * a + i] += force * rows.factors[t] * g[i]
            work.forces[6 * b + i] += force * rows.factors[t] * g[6 + i]


@kernel
def slider_motions(
    joints: IntArray, lines: LineData, points: PointData, frames: FloatArray,
    velocities: FloatArray, start: FloatArray, work: Work, poses: FloatArray, places: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Frames and local twists of the sections at sliders, their arc lengths and rates.

    Args:
        joints: (n,) numbers of the joints.
        lines: elements.
        points: markers.
        frames: (n, 12) of all slots.
        velocities: (n, 6) their local twists.
        start: (m, 2) accepted places of the markers on lines.
        work: work space.
        poses: (m, 12) of all markers; set for the joints.
        places: (m, 2) places; set for the joints.
        out: (n, 20).
    """
    g, scratch = np.empty(12), np.empty((5, 3))
    for k in range(joints.size):
        c = joints[k]
        place_markers(c, lines, points, frames, start, work, poses, places)
        slide_gradient(c, points, poses, work, g, scratch)
        first = points.first[c]
        e = int(places[first, 0])
        copy_entries(poses[points.marker[first]], out[k])
        rate = _section_twist(c, lines, points, velocities, work, places, out[k])
        s, slope, _ = arc_length(lines.arc[e], places[first, 1])
        out[k, 18], out[k, 19] = lines.start[e] + s, slope * rate


@subroutine
def _section_twist(
    c: int, lines: LineData, points: PointData, velocities: FloatArray, work: Work,
    places: FloatArray, out: FloatArray,
) -> float:  # fmt: skip
    """Local twist of the section in ``out[12:18]``; rate of the slider's coordinate."""
    rate = 0.0
    out[12:18] = 0.0
    for m in range(points.first[c], points.first[c + 1]):
        on_line = points.slot[m] == ON_LINE
        count = lines.width[points.line[m]] if on_line else int(points.slot[m] >= 0)
        for n in range(count):
            node = lines.nodes[int(places[m, 0]), n] if on_line else points.slot[m]
            for i in range(6):
                j, v = 6 * (points.column[m] + n) + i, velocities[node, i]
                rate += work.slide[j] * v
                for k in range(6):
                    out[12 + k] += work.point[0, k, j] * v
    return rate
