# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled evaluation of joints with markers that lie on lines between nodes, or slide on them.

Such a marker's frame H(q, xi) depends on the frames q of all nodes of an element. Where it slides,
the coordinate xi is the one at which the section's plane contains the other marker b,

``G(q, xi) = R e1 . (x_b - x) = 0``,

so that it is a function of the nodes. For the sum F(q, xi) of a row, this gives the gradient ``F_q
+ F_xi xi_q`` with ``xi_q = -G_q / G_xi`` and, with ``mu = -F_xi / G_xi``, the second derivative
``P^T (F + mu G)_zz P`` with ``z = (q, xi)`` and ``P = (1; xi_q)``. A constraint along the other two
axes of the section thus exerts a force at right angles to the section's normal, for any shear.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.constraints.lines.data import ON_LINE, JointsOnLines
from flexfem.constraints.rows.hessians import marker_map
from flexfem.constraints.terms.dispatch import term
from flexfem.constraints.terms.vectors import rotate_back_into, rotate_into
from flexfem.core.places.line_points import (
    arc_length,
    line_jacobian,
    offset_jacobian,
    turn_columns,
    turn_frames,
)
from flexfem.core.row import RowKind
from flexfem.kernels.compiled import inlined, kernel, subroutine
from flexfem.kernels.records import Memory, unpack
from flexfem.lie._blocks import copy_entries
from flexfem.lie.se3 import compose_into

__all__ = [
    "ALONG",
    "ARC",
    "add_line_wrenches",
    "coefficients",
    "element_frames",
    "evaluate_lines",
    "place_lines",
    "put_interface_nodes",
    "slider_motions",
    "update_line_angles",
]

ARC, ALONG = int(RowKind.ARC), int(RowKind.ALONG)
ANGLE, TOUCH = int(RowKind.ANGLE), int(RowKind.TOUCH)

#: Newton steps for the place of a slider, and the step size at convergence.
_STEPS, _SMALL = 50, 1e-13


@kernel
def place_lines(
    memory: Memory, first: int, last: int, frames: FloatArray, poses: FloatArray,
    places: FloatArray,
) -> None:  # fmt: skip
    """Place the markers of joints and find their motion along twists of the nodes.

    The derivatives by z are left in ``JointsOnLines.point`` and ``slide``, for all other loops.

    Args:
        memory: all joints on lines.
        first: first of the joints.
        last: the joint after the last.
        frames: (n, 12) of all interface nodes.
        poses: (m, 12) of all markers; those of the joints are set.
        places: (m, 2) element and xi of these markers; those that slide are set.
    """
    own = unpack(JointsOnLines, memory)
    for c in range(first, last):
        _place_markers(own, c, frames, poses, places)
        _slide_gradient(own, c, poses)


@subroutine
def element_frames(own: JointsOnLines, line: int, e: int, frames: FloatArray) -> None:
    """Frames of the sections at the nodes of an element in ``own.sections``."""
    k, sections = own.count[line], own.sections
    for i in range(k):
        copy_entries(frames[own.nodes[e, i]], sections[i])
    if own.turned[line]:
        turn_frames(sections[:k], own.turns[e], sections[:k])


@subroutine
def coefficients(own: JointsOnLines, line: int, e: int) -> FloatArray:
    """Coefficients of the shape functions of an element."""
    rows, columns = own.size[line]
    shape: FloatArray = own.shape[e][: rows * columns].reshape(rows, columns)
    return shape


@inlined
def section_jacobian(own: JointsOnLines, line: int) -> FloatArray:
    """``own.section`` as the matrix (6, 6 k + 1) of an element of a line.

    Contiguous, like all matrices for ``core.places.line_points``: for another layout numba would
    compile these once more.
    """
    columns = 6 * own.count[line] + 1
    J: FloatArray = own.section[: 6 * columns].reshape(6, columns)
    return J


@subroutine
def _section(
    own: JointsOnLines, line: int, e: int, xi: float, frames: FloatArray, H: FloatArray
) -> None:
    """Frame ``H`` of a section and its derivatives in ``own.section``."""
    k = own.count[line]
    element_frames(own, line, e, frames)
    J = section_jacobian(own, line)
    line_jacobian(own.element[line], own.sections[:k], coefficients(own, line, e), xi, H, J)
    if own.turned[line]:
        turn_columns(own.turns[e], J)


@subroutine
def _slide_to(
    own: JointsOnLines, line: int, x: FloatArray, frames: FloatArray, place: FloatArray
) -> None:
    """Move ``place`` (element, xi) along the line until the section's plane contains the point x.

    Beyond the ends the last elements are continued. Elements are left in the direction of the first
    crossing only: where the sections of two of them differ at their common node, the search would
    alternate between them.
    """
    H, p, gap = np.empty(12), np.empty(3), np.empty(3)
    first, last = own.first_element[line], own.first_element[line + 1] - 1
    e, xi, direction, k = int(place[0]), place[1], 0, 6 * own.count[line]
    for _ in range(_STEPS):
        _section(own, line, e, xi, frames, H)
        for i in range(3):
            gap[i] = x[i] - H[i]
        rotate_back_into(H, gap, p, 0)
        J = section_jacobian(own, line)
        step = p[0] / (J[0, k] + J[4, k] * p[2] - J[5, k] * p[1])
        xi += min(max(step, -1.0), 1.0)
        if abs(step) < _SMALL:
            break
        if xi > 1.0 and e < last and direction >= 0:
            xi = (xi - 1.0) * _speed(own, e, 1.0) / _speed(own, e + 1, 0.0)
            e, direction = e + 1, 1
        elif xi < 0.0 and e > first and direction <= 0:
            xi = 1.0 + xi * _speed(own, e, 0.0) / _speed(own, e - 1, 1.0)
            e, direction = e - 1, -1
    place[0], place[1] = e, xi


@subroutine
def _speed(own: JointsOnLines, e: int, xi: float) -> float:
    """Arc length per coordinate."""
    speed: float = arc_length(own.arc[e], xi)[1]
    return speed


@subroutine
def _put_marker(offset: FloatArray, section: FloatArray, at: int, xi: int, J: FloatArray) -> None:
    """Derivatives J of a marker from those of the section that carries it.

    The nodes' columns begin at ``at``, that of the coordinate is ``xi``, -1 if it is fixed.
    """
    offset_jacobian(offset, section)
    last = section.shape[1] - 1
    for i in range(6):
        for j in range(last):
            J[i, at + j] = section[i, j]
        if xi >= 0:
            J[i, xi] = section[i, last]


@subroutine
def _place_markers(
    own: JointsOnLines, c: int, frames: FloatArray, poses: FloatArray, places: FloatArray
) -> None:
    """Poses of a joint's markers and their derivatives by z."""
    H, first, last, xi = (
        np.empty(12), own.first_marker[c], own.first_marker[c + 1], 6 * own.width[c]
    )  # fmt: skip
    point = own.point[c]
    point[:] = 0.0
    for m in range(last - 1, first - 1, -1):  # a sliding marker depends on a later one
        pose, J, at = poses[own.marker[m]], point[m - first], 6 * own.column[m]
        offset = own.offset[m]
        if own.interface_node[m] == -1:
            copy_entries(offset, pose)
        elif own.interface_node[m] >= 0:
            compose_into(frames[own.interface_node[m]], offset, pose)
            marker_map(offset, J[:, at : at + 6])
        else:
            line = own.line[m]
            if own.slides[m]:
                copy_entries(own.accepted[m], places[m])
                other = poses[own.marker[first + 1]]
                _slide_to(own, line, other[:3], frames, places[m])
            _section(own, line, int(places[m, 0]), places[m, 1], frames, H)
            compose_into(H, offset, pose)
            section = section_jacobian(own, line)
            _put_marker(offset, section, at, xi if own.slides[m] else -1, J)


@subroutine
def _along_first(own: JointsOnLines, c: int, poses: FloatArray) -> None:
    """Gradient ``own.term`` of a slider's equation with respect to both markers' twists."""
    d, first = np.zeros((3, 3)), own.first_marker[c]
    d[0, 0] = 1.0
    a, b = own.marker[first], own.marker[first + 1]
    term(ALONG, poses[a], poses[b], d, 0.0, own.term, own.scratch)


@subroutine
def _slide_gradient(own: JointsOnLines, c: int, poses: FloatArray) -> None:
    """Derivatives of the coordinate of a joint's slider by the twists of nodes."""
    xi, slide = 6 * own.width[c], own.slide[c]
    slide[: xi + 1] = 0.0
    if not own.slides[own.first_marker[c]]:
        return
    _along_first(own, c, poses)
    _add_to_nodes(own, c, 0, 1, 1.0, slide[: xi + 1])
    for j in range(xi):
        slide[j] = -slide[j] / slide[xi]


@subroutine
def _add_to_nodes(
    own: JointsOnLines, c: int, a: int, b: int, factor: float, out: FloatArray
) -> None:
    """Add a gradient ``own.term`` with respect to the twists of markers a and b, carried to z."""
    g, point = own.term, own.point[c]
    for j in range(out.size):
        total = 0.0
        for i in range(6):
            total += g[i] * point[a, i, j] + g[6 + i] * point[b, i, j]
        out[j] += factor * total


@subroutine
def _row_value(own: JointsOnLines, c: int, r: int, poses: FloatArray) -> float:
    """Sum of a row's terms; its gradient by z in ``own.gradient``."""
    at, value, gradient = own.first_marker[c], 0.0, own.gradient[: 6 * own.width[c] + 1]
    gradient[:] = 0.0
    for t in range(own.first_term[r], own.first_term[r + 1]):
        a, b = own.ends[t]
        factor = own.factors[t]
        if own.kinds[t] == ARC:
            e, xi = int(own.places[at + a, 0]), own.places[at + a, 1]
            s, slope, _ = arc_length(own.arc[e], xi)
            value += factor * (own.start[e] + s)
            gradient[gradient.size - 1] += factor * slope
            continue
        value += factor * term(
            own.kinds[t], poses[own.marker[at + a]], poses[own.marker[at + b]], own.directions[t],
            own.angles[t], own.term, own.scratch,
        )  # fmt: skip
        _add_to_nodes(own, c, a, b, factor, gradient)
    return value


@kernel
def evaluate_lines(memory: Memory, poses: FloatArray, gradients: FloatArray) -> None:
    """Sums and gradients of all rows of ``JointsOnLines`` after its markers are placed.

    Args:
        memory: the joints.
        poses: (m, 12) of all markers.
        gradients: (t, 2, 6) gradients of all terms, two nodes a term; those of the joints are set.
    """
    own = unpack(JointsOnLines, memory)
    gradient = own.gradient
    for c in range(own.width.size):
        xi, slide = 6 * own.width[c], own.slide[c]
        for r in range(own.first_row[c], own.first_row[c + 1]):
            own.sums[own.row[r]] = _row_value(own, c, r, poses)
            for n in range(own.width[c]):
                out = gradients[own.entry[r] + n // 2, n % 2]
                for i in range(6):
                    j = 6 * n + i
                    out[i] = gradient[j] + gradient[xi] * slide[j]


@kernel
def put_interface_nodes(memory: Memory, term_nodes: IntArray, pair_nodes: IntArray) -> None:
    """Write the interface nodes of the joints to their terms (t, 2) and pairs (p, 2) of nodes."""
    own = unpack(JointsOnLines, memory)
    most = 0
    for c in range(own.width.size):
        most = max(most, own.width[c])
    nodes = np.empty(most, dtype=np.int64)
    for c in range(own.width.size):
        for m in range(own.first_marker[c], own.first_marker[c + 1]):
            if own.interface_node[m] >= 0:
                nodes[own.column[m]] = own.interface_node[m]
            elif own.interface_node[m] == ON_LINE:
                e = int(own.places[m, 0])
                for i in range(own.count[own.line[m]]):
                    nodes[own.column[m] + i] = own.nodes[e, i]
        count, pair = own.width[c], own.first_pair[c]
        for r in range(own.first_row[c], own.first_row[c + 1]):
            for n in range(count + count % 2):
                node = nodes[n] if n < count else -1
                term_nodes[own.entry[r] + n // 2, n % 2] = node
        for a in range(count):
            for b in range(a + 1, count):
                pair_nodes[pair, 0], pair_nodes[pair, 1] = nodes[a], nodes[b]
                pair += 1


@kernel
def update_line_angles(memory: Memory, poses: FloatArray) -> None:
    """Store the continuous angles at accepted poses of the markers."""
    own = unpack(JointsOnLines, memory)
    for c in range(own.width.size):
        marker = own.marker[own.first_marker[c] :]
        for t in range(own.first_term[own.first_row[c]], own.first_term[own.first_row[c + 1]]):
            if own.kinds[t] == ANGLE or own.kinds[t] == TOUCH:
                a, b = poses[marker[own.ends[t, 0]]], poses[marker[own.ends[t, 1]]]
                d, before = own.directions[t], own.angles[t]
                own.angles[t] = term(own.kinds[t], a, b, d, before, own.term, own.scratch)


@kernel
def add_line_wrenches(
    memory: Memory, forces: FloatArray, poses: FloatArray, out: FloatArray
) -> None:
    """Add to ``out`` (m, 6) the wrenches of the joints on the bodies, in inertial axes.

    Forces that fix or drive a slider along its line act on both bodies as well. ``forces`` (r,) are
    those of all rows; markers are placed, with ``poses`` (m, 12).
    """
    own, turned = unpack(JointsOnLines, memory), np.empty(3)
    total = own.forces
    for c in range(own.width.size):
        first, xi = own.first_marker[c], 6 * own.width[c]
        by_xi = 0.0
        total[:] = 0.0
        for r in range(own.first_row[c], own.first_row[c + 1]):
            force = forces[own.row[r]]
            _row_value(own, c, r, poses)
            by_xi += force * own.gradient[xi]
            _add_forces(own, c, r, force, poses)
        if own.slides[first]:
            _along_first(own, c, poses)
            for i in range(12):
                total[i] -= by_xi / own.slide[c, xi] * own.term[i]
        for m in range(first, own.first_marker[c + 1]):
            to = own.marker[m]
            for half in range(2):
                at = 6 * (m - first) + 3 * half
                rotate_into(poses[to], total[at : at + 3], turned, 0)
                for i in range(3):
                    out[to, 3 * half + i] -= turned[i]


@subroutine
def _add_forces(own: JointsOnLines, c: int, r: int, force: float, poses: FloatArray) -> None:
    """Add the gradient of a row with respect to its markers' twists times its force."""
    first, total, g = own.first_marker[c], own.forces, own.term
    for t in range(own.first_term[r], own.first_term[r + 1]):
        if own.kinds[t] == ARC:
            continue
        a, b = own.ends[t]
        Ha, Hb = poses[own.marker[first + a]], poses[own.marker[first + b]]
        term(own.kinds[t], Ha, Hb, own.directions[t], own.angles[t], g, own.scratch)
        for i in range(6):
            total[6 * a + i] += force * own.factors[t] * g[i]
            total[6 * b + i] += force * own.factors[t] * g[6 + i]


@kernel
def slider_motions(
    memory: Memory, joints: IntArray, velocities: FloatArray, poses: FloatArray,
    places: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Frames and local twists of the sections at sliders, their arc lengths and rates.

    Args:
        memory: all joints on lines.
        joints: (n,) numbers of the joints, whose markers are placed.
        velocities: (n, 6) local twists of all interface nodes.
        poses: (m, 12) of all markers.
        places: (m, 2) element and xi of these markers.
        out: (n, 20).
    """
    own = unpack(JointsOnLines, memory)
    for k in range(joints.size):
        first = own.first_marker[joints[k]]
        e = int(places[first, 0])
        copy_entries(poses[own.marker[first]], out[k])
        rate = _section_twist(own, joints[k], velocities, places, out[k])
        s, slope, _ = arc_length(own.arc[e], places[first, 1])
        out[k, 18], out[k, 19] = own.start[e] + s, slope * rate


@subroutine
def _section_twist(
    own: JointsOnLines, c: int, velocities: FloatArray, places: FloatArray, out: FloatArray
) -> float:
    """Local twist of the section in ``out[12:18]``; rate of the slider's coordinate."""
    rate, point, slide = 0.0, own.point[c], own.slide[c]
    out[12:18] = 0.0
    for m in range(own.first_marker[c], own.first_marker[c + 1]):
        on_line = own.interface_node[m] == ON_LINE
        count = own.count[own.line[m]] if on_line else int(own.interface_node[m] >= 0)
        for n in range(count):
            node = own.nodes[int(places[m, 0]), n] if on_line else own.interface_node[m]
            for i in range(6):
                j, v = 6 * (own.column[m] + n) + i, velocities[node, i]
                rate += slide[j] * v
                for k in range(6):
                    out[12 + k] += point[0, k, j] * v
    return rate
