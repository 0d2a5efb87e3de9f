# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled second derivatives of rows of joints on lines; conventions as in ``line_kernels``."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.line_points import add_line_second, arc_length, turn_second
from flexfem.core.terms.dispatch import term, term_hessian
from flexfem.lie.compiled import kernel, subroutine
from flexfem.system.line_data import ON_LINE, LineData, PointData, RowData, Work
from flexfem.system.line_kernels import (
    ALONG,
    ARC,
    coefficients,
    element_frames,
    place_markers,
    slide_gradient,
)
from flexfem.system.row_kernels import to_node

__all__ = ["add_line_hessians", "line_hessian"]


@subroutine
def _add_term_second(
    kind: int, d: FloatArray, poses: FloatArray, first: int, a: int, b: int, marker: IntArray,
    factor: float, work: Work, g: FloatArray, h: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Add ``factor`` times gradient and second derivative of a term on the markers' twists."""
    Ha, Hb = poses[marker[first + a]], poses[marker[first + b]]
    term(kind, Ha, Hb, d, 0.0, g, scratch)
    term_hessian(kind, Ha, Hb, d, h)
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
        lines: elements.
        points: markers.
        rows: rows and terms.
        frames: (n, 12) of all slots.
        start: (m, 2) accepted places.
        work: work space.
        poses: (m, 12) of all markers.
        places: (m, 2) places at the trial state.
        out: (6 n, 6 n) derivative of the gradient; column j along twist j.
    """
    g, h, scratch, d = np.empty(12), np.empty((12, 12)), np.empty((5, 3)), np.zeros((3, 3))
    place_markers(c, lines, points, frames, start, work, poses, places)
    slide_gradient(c, points, poses, work, g, scratch)
    first, xi = points.first[c], 6 * points.width[c]
    work.forces[:], work.hessian[:], work.second[:] = 0.0, 0.0, 0.0
    by_xi, by_xi_twice = 0.0, 0.0
    for r in range(rows.first[c], rows.first[c + 1]):
        for t in range(rows.term[r], rows.term[r + 1]):
            factor = weights[rows.row[r]] * rows.factors[t]
            a, b = rows.ends[t]
            if rows.kinds[t] == ARC:
                _, slope, bend = arc_length(
                    lines.arc[int(places[first + a, 0])], places[first + a, 1]
                )
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
            out[i, j] += (work.second[i, xi] + work.slide[i] * work.second[xi, xi]) * work.slide[j]


@kernel
def add_line_hessians(
    weights: FloatArray, lines: LineData, points: PointData, rows: RowData, frames: FloatArray,
    start: FloatArray, work: Work, poses: FloatArray, places: FloatArray, first_pair: IntArray,
    space: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add second derivatives of weighted sums of rows to the blocks of the pairs of nodes.

    ``first_pair`` (n_joints,) is the first pair of each joint, which has one for any two of its
    nodes; ``space`` (at least 36 n^2,) is work space for the Hessians. To ``out`` (p, 12, 12) the
    block of a single node is added at its pair with the next one. The other arguments are those of
    ``line_hessian``.
    """
    for c in range(points.width.size):
        idle = True
        for r in range(rows.first[c], rows.first[c + 1]):
            idle = idle and weights[rows.row[r]] == 0.0
        if idle:
            continue
        count, pair = points.width[c], first_pair[c]
        H = space[: 36 * count * count].reshape(6 * count, 6 * count)
        line_hessian(c, weights, lines, points, rows, frames, start, work, poses, places, H)
        for a in range(count):
            for b in range(a + 1, count):
                for i in range(6):
                    for j in range(6):
                        out[pair, i, 6 + j] += H[6 * a + i, 6 * b + j]
                        out[pair, 6 + i, j] += H[6 * b + i, 6 * a + j]
                        if b == a + 1:
                            out[pair, i, j] += H[6 * a + i, 6 * a + j]
                        if b == a + 1 and b == count - 1:
                            out[pair, 6 + i, 6 + j] += H[6 * b + i, 6 * b + j]
                pair += 1


@subroutine
def _carry_second(
    c: int, lines: LineData, points: PointData, frames: FloatArray, places: FloatArray, work: Work
) -> None:
    """``work.second`` by z from forces and second derivatives on the markers' twists."""
    first, count = points.first[c], points.first[c + 1] - points.first[c]
    size = 6 * points.width[c] + 1
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


@subroutine
def _add_point_second(
    m: int, number: int, xi: int, lines: LineData, points: PointData, frames: FloatArray,
    places: FloatArray, work: Work,
) -> None:  # fmt: skip
    """Add that the force on a marker acts on nodes in directions that change with them."""
    line, e, g = points.line[m], int(places[m, 0]), np.empty(6)
    k = lines.width[line]
    to_node(points.offset[m], work.forces, 6 * number, g)
    element_frames(lines, line, e, frames, work)
    size = 6 * k + 1
    block = work.block[: size * size].reshape(size, size)
    block[:] = 0.0
    add_line_second(
        lines.element[line], work.frames[:k], coefficients(lines, line, e), places[m, 1], g, block
    )
    if lines.turned[line]:
        turn_second(lines.turns[e], block)
    at = 6 * points.column[m]
    for i in range(6 * k + 1):
        row = xi if i == 6 * k else at + i
        for j in range(6 * k + 1):
            work.second[row, xi if j == 6 * k else at + j] += block[i, j]
