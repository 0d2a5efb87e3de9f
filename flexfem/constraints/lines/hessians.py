# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled second derivatives of rows of joints on lines; conventions as in ``kernels``."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.constraints.lines.data import ON_LINE, JointsOnLines
from flexfem.constraints.lines.kernels import ALONG, ARC, coefficients, element_frames
from flexfem.constraints.rows.kernels import to_node
from flexfem.constraints.terms.dispatch import term, term_hessian
from flexfem.core.places.line_points import add_line_second, arc_length, turn_second
from flexfem.kernels.compiled import kernel, subroutine
from flexfem.kernels.records import Memory, unpack

__all__ = ["add_line_hessians"]


@subroutine
def _add_term_second(
    own: JointsOnLines, c: int, kind: int, d: FloatArray, ends: IntArray, factor: float,
    poses: FloatArray,
) -> None:  # fmt: skip
    """Add ``factor`` times gradient and second derivative of a term on the markers' twists."""
    first, a, b = own.first_marker[c], ends[0], ends[1]
    Ha, Hb = poses[own.marker[first + a]], poses[own.marker[first + b]]
    g, h, forces, hessian = own.term, own.term_second, own.forces, own.hessian
    term(kind, Ha, Hb, d, 0.0, g, own.scratch)
    term_hessian(kind, Ha, Hb, d, h)
    for i in range(12):
        row = 6 * (a if i < 6 else b) + i % 6
        forces[row] += factor * g[i]
        for j in range(12):
            hessian[row, 6 * (a if j < 6 else b) + j % 6] += factor * h[i, j]


@subroutine
def _second(
    own: JointsOnLines, c: int, weights: FloatArray, frames: FloatArray, poses: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Second derivative ``out`` (6 n, 6 n) of a weighted sum of a joint's rows.

    It is the derivative of the gradient; column j is along twist j of its nodes.
    """
    places, second, slide = own.places, own.second, own.slide[c]
    first, xi = own.first_marker[c], 6 * own.width[c]
    own.forces[:], own.hessian[:], second[:] = 0.0, 0.0, 0.0
    by_xi, by_xi_twice = 0.0, 0.0
    for r in range(own.first_row[c], own.first_row[c + 1]):
        for t in range(own.first_term[r], own.first_term[r + 1]):
            factor = weights[own.row[r]] * own.factors[t]
            if own.kinds[t] == ARC:
                m = first + own.ends[t, 0]
                _, slope, bend = arc_length(own.arc[int(places[m, 0])], places[m, 1])
                by_xi += factor * slope
                by_xi_twice += factor * bend
            elif factor != 0.0:
                _add_term_second(
                    own, c, own.kinds[t], own.directions[t], own.ends[t], factor, poses
                )
    if own.slides[first]:
        for i in range(own.forces.size):
            by_xi += own.forces[i] * own.point[c, i // 6, i % 6, xi]
        d, ends = np.zeros((3, 3)), np.zeros(2, dtype=np.int64)
        d[0, 0], ends[1] = 1.0, 1
        _add_term_second(own, c, ALONG, d, ends, -by_xi / slide[xi], poses)
    _carry_second(own, c, frames)
    second[xi, xi] += by_xi_twice
    for i in range(xi):
        for j in range(xi):
            out[i, j] = second[i, j] + slide[i] * second[xi, j]
            out[i, j] += (second[i, xi] + slide[i] * second[xi, xi]) * slide[j]


@kernel
def add_line_hessians(
    memory: Memory, first: int, last: int, weights: FloatArray, frames: FloatArray,
    poses: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add second derivatives of weighted sums of rows to the blocks of the pairs of nodes.

    The matrix (6 n, 6 n) of the last joint is left in ``JointsOnLines.space``.

    Args:
        memory: all joints on lines.
        first: first of the joints; their markers are placed.
        last: the joint after the last.
        weights: (r,) weights of all rows.
        frames: (n, 12) of all interface nodes.
        poses: (m, 12) of all markers.
        out: (p, 12, 12) blocks; that of a single node is added at its pair with the next one. With
            zero blocks nothing is added.
    """
    own = unpack(JointsOnLines, memory)
    for c in range(first, last):
        idle = True
        for r in range(own.first_row[c], own.first_row[c + 1]):
            idle = idle and weights[own.row[r]] == 0.0
        if idle:
            continue
        count, pair = own.width[c], own.first_pair[c]
        H = own.space[: 36 * count * count].reshape(6 * count, 6 * count)
        _second(own, c, weights, frames, poses, H)
        if out.shape[0] > 0:
            _add_blocks(H, count, pair, out)


@subroutine
def _add_blocks(H: FloatArray, count: int, pair: int, out: FloatArray) -> None:
    """Add a joint's matrix to the blocks of the pairs of its nodes, the first of which is given."""
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
def _carry_second(own: JointsOnLines, c: int, frames: FloatArray) -> None:
    """Write ``own.second`` by z from forces and second derivatives on the markers' twists."""
    first, count = own.first_marker[c], own.first_marker[c + 1] - own.first_marker[c]
    size, point, second = 6 * own.width[c] + 1, own.point[c], own.second
    left = np.zeros((6 * count, size))
    for i in range(6 * count):
        for k in range(6 * count):
            entry = own.hessian[i, k]
            if entry != 0.0:
                for j in range(size):
                    left[i, j] += entry * point[k // 6, k % 6, j]
    for k in range(6 * count):
        for i in range(size):
            entry = point[k // 6, k % 6, i]
            if entry != 0.0:
                for j in range(size):
                    second[i, j] += entry * left[k, j]
    for m in range(count):
        if own.interface_node[first + m] == ON_LINE:
            _add_point_second(own, first + m, m, size - 1, frames)


@subroutine
def _add_point_second(own: JointsOnLines, m: int, number: int, xi: int, frames: FloatArray) -> None:
    """Add the change of a marker's force on the nodes by the change of its directions with them."""
    line, e, g = own.line[m], int(own.places[m, 0]), np.empty(6)
    k, second = own.count[line], own.second
    to_node(own.offset[m], own.forces, 6 * number, g)
    element_frames(own, line, e, frames)
    size = 6 * k + 1
    block = own.block[: size * size].reshape(size, size)
    block[:] = 0.0
    add_line_second(
        own.element[line], own.sections[:k], coefficients(own, line, e), own.places[m, 1], g, block
    )
    if own.turned[line]:
        turn_second(own.turns[e], block)
    at = 6 * own.column[m]
    for i in range(6 * k + 1):
        row = xi if i == 6 * k else at + i
        for j in range(6 * k + 1):
            second[row, xi if j == 6 * k else at + j] += block[i, j]
