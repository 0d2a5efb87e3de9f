# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compliance between rows of motion through the points that they share."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.dissipation.data import ACROSS, ALONG, NORMAL, Groups
from flexfem.kernels.compiled import kernel
from flexfem.kernels.records import Memory, unpack

__all__ = ["couple", "couple_next", "vectors_of_rows"]


@kernel
def vectors_of_rows(
    groups: Memory, width: int, points: IntArray, rows: IntArray, vectors: FloatArray
) -> None:
    """Write where rows of motion act, and along which vectors; spins are left out.

    Args:
        groups: of ``Groups``.
        width: rows of a group, 1 or 3.
        points: points (k,), k the number of points of all groups times ``width``.
        rows: rows (k,) there.
        vectors: their directions times weights, shape (k, 3).
    """
    own, at = unpack(Groups, groups), 0
    for g in range(own.count[0]):
        for r in range(width):
            axis = NORMAL if r == 0 else ALONG + (r - 1) * (ACROSS - ALONG)
            for e in range(own.starts[g], own.starts[g + 1]):
                points[at], rows[at] = own.points[e], width * g + r
                for a in range(3):
                    vectors[at, a] = own.weights[e] * own.numbers[g, axis + a]
                at += 1


@kernel
def couple(
    points: IntArray, rows: IntArray, vectors: FloatArray, compliances: FloatArray,
    out: tuple[IntArray, IntArray, FloatArray],
) -> int:  # fmt: skip
    """Write rows, columns and values of the compliance between rows; returns their number.

    Args:
        points: points (k,), ascending.
        rows: rows (k,) that act there.
        vectors: along which, shape (k, 3).
        compliances: of all points, 3 x 3 numbers each, shape (n, 9), m/N.
        out: arrays that are written, of size 0 to count only.
    """
    first, count, moved = 0, 0, np.empty(3)
    while first < len(points):
        last = first
        while last < len(points) and points[last] == points[first]:
            last += 1
        if len(out[0]) == 0:
            count += (last - first) ** 2
            first = last
            continue
        C = compliances[points[first]]
        for i in range(first, last):
            for a in range(3):
                moved[a] = 0.0
                for b in range(3):
                    moved[a] += C[3 * a + b] * vectors[i, b]
            for j in range(first, last):
                out[0][count], out[1][count] = rows[j], rows[i]
                out[2][count] = (
                    vectors[j, 0] * moved[0] + vectors[j, 1] * moved[1] + vectors[j, 2] * moved[2]
                )
                count += 1
        first = last
    return count


@kernel
def couple_next(
    nodes: IntArray, rows: IntArray, loads: FloatArray, compliances: FloatArray,
    out: tuple[IntArray, IntArray, FloatArray],
) -> int:  # fmt: skip
    """Write the compliance between rows that act on nodes near each other; returns their number.

    Args:
        nodes: nodes (k,) of one block, ascending.
        rows: rows (k,) that act there.
        loads: by which loads on the nodes, shape (k, w).
        compliances: (n, 1 + b, w, w) motions of each node and of the b next ones by its loads.
        out: arrays that are written, of size 0 to count only.
    """
    beside, width, count = compliances.shape[1] - 1, loads.shape[1], 0
    moved = np.empty(width)
    for i in range(len(nodes)):
        last = 0
        for j in range(i + 1, len(nodes)):
            away = nodes[j] - nodes[i]
            if away > beside:
                break
            if away == 0:
                continue
            if len(out[0]) == 0:
                count += 2
                continue
            if away != last:
                last = away
                for a in range(width):
                    moved[a] = 0.0
                    for b in range(width):
                        moved[a] += compliances[nodes[i], away, a, b] * loads[i, b]
            value = 0.0
            for a in range(width):
                value += loads[j, a] * moved[a]
            out[0][count], out[1][count], out[2][count] = rows[i], rows[j], value
            out[0][count + 1], out[1][count + 1], out[2][count + 1] = rows[j], rows[i], value
            count += 2
    return count
