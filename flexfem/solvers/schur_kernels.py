# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled parts of the frozen solver: compliances, interface products, Schur complement entries.

A body touches the interface through columns, one for each active component of each of its interface
nodes. ``Z = A^-1 J^T`` holds the body's response to unit forces there, ``C = J Z`` its compliance.
"""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.lie.compiled import kernel

__all__ = [
    "interface_response",
    "largest_entry",
    "multiply_blocks",
    "rigid_responses",
    "row_products",
    "schur",
]


@kernel
def interface_response(
    body_nodes: IntArray, node_start: IntArray, columns: IntArray, column_start: IntArray,
    ranges: IntArray, range_start: IntArray, responses: FloatArray, start: IntArray,
    residual: FloatArray, width: int, y: FloatArray,
) -> None:  # fmt: skip
    """``y = J A^-1 r`` of every body into slots and components (n, 6) of the columns in use."""
    for b in range(node_start.size - 1):
        first, count = column_start[b], column_start[b + 1] - column_start[b]
        if count == 0:
            continue
        total = np.zeros(count)
        at = start[b]
        for n in range(node_start[b], node_start[b + 1]):
            node = body_nodes[n]
            for i in range(width):
                force = residual[node, i]
                for k in range(range_start[b], range_start[b + 1]):
                    for c in range(ranges[k, 0], ranges[k, 1]):
                        total[c] += force * responses[at + c]
                at += count
        for k in range(range_start[b], range_start[b + 1]):
            for c in range(ranges[k, 0], ranges[k, 1]):
                y[columns[first + c, 0], columns[first + c, 1]] = total[c]


@kernel
def schur(
    sides: IntArray, side_start: IntArray, slot_column: IntArray, slot_active: IntArray,
    column_start: IntArray, compliances: FloatArray, compliance_start: IntArray,
    force_jacobian: FloatArray, step_jacobian: FloatArray, values: FloatArray,
) -> None:  # fmt: skip
    """Entries of ``G~ C G^T``: for every body, all pairs of the sides of terms that act on it.

    Args:
        sides: (k, 3) term, side, slot, grouped by body, best with equal slots side by side.
        side_start: (n_bodies + 1,) first side of each body.
        slot_column: first column of each slot within its body.
        slot_active: number of columns of each slot.
        column_start: (n_bodies + 1,) first column of each body.
        compliances: all C matrices one after the other.
        compliance_start: where each of them begins.
        force_jacobian: (t, 2, 6) terms of the rows of G.
        step_jacobian: (t, 2, 6) terms of the rows of G~.
        values: pairs in the order (body, second side, first side).
    """
    at, most = 0, 0
    for b in range(side_start.size - 1):
        most = max(most, side_start[b + 1] - side_start[b])
    steps, c = np.empty((6, most)), np.empty(6)
    for b in range(side_start.size - 1):
        begin, end = side_start[b], side_start[b + 1]
        count, C = column_start[b + 1] - column_start[b], compliance_start[b]
        for i in range(begin, end):
            for k in range(6):
                steps[k, i - begin] = step_jacobian[sides[i, 0], sides[i, 1], k]
        for j in range(begin, end):
            force = force_jacobian[sides[j, 0], sides[j, 1]]
            first, active = slot_column[sides[j, 2]], slot_active[sides[j, 2]]
            i = begin
            while i < end:  # sides on one slot after the other
                slot, run = sides[i, 2], i
                while i < end and sides[i, 2] == slot:
                    i += 1
                for k in range(6):
                    c[k] = 0.0
                    if k < slot_active[slot]:
                        row = C + (slot_column[slot] + k) * count + first
                        for m in range(active):
                            c[k] += compliances[row + m] * force[m]
                x, y, z, u, v, w = c
                for n in range(run - begin, i - begin):
                    values[at] = (
                        steps[0, n] * x + steps[1, n] * y + steps[2, n] * z
                        + steps[3, n] * u + steps[4, n] * v + steps[5, n] * w
                    )  # fmt: skip
                    at += 1


@kernel
def row_products(
    term_slots: IntArray, row_of_term: IntArray, local_slot: BoolArray, step_jacobian: FloatArray,
    y: FloatArray, owned: FloatArray, row_values: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """``owned * row_values - G~ y`` of every row over the slots that this rank's bodies own."""
    for r in range(out.size):
        out[r] = owned[r] * row_values[r]
    for t in range(row_of_term.size):
        for side in range(2):
            slot = term_slots[t, side]
            if slot >= 0 and local_slot[slot]:
                total = 0.0
                for k in range(6):
                    total += step_jacobian[t, side, k] * y[slot, k]
                out[row_of_term[t]] -= total


@kernel
def multiply_blocks(inverses: FloatArray, residual: FloatArray, step: FloatArray) -> None:
    """``step[i] = inverses[i] residual[i]`` for the first nodes of a block."""
    for k in range(inverses.shape[0]):
        for i in range(6):
            total = 0.0
            for j in range(6):
                total += inverses[k, i, j] * residual[k, j]
            step[k, i] = total


@kernel
def rigid_responses(
    inverses: FloatArray, columns: IntArray, column_start: IntArray, response_start: IntArray,
    compliance_start: IntArray, responses: FloatArray, compliances: FloatArray,
) -> None:  # fmt: skip
    """Rows of ``A^-T J^T`` and matrices ``J A^-1 J^T`` of bodies with one node each."""
    for b in range(inverses.shape[0]):
        first, count = column_start[b], column_start[b + 1] - column_start[b]
        A = inverses[b]
        for c in range(count):
            component = columns[first + c, 1]
            for i in range(6):
                responses[response_start[b] + i * count + c] = A[component, i]
            for d in range(count):
                compliances[compliance_start[b] + c * count + d] = A[
                    component, columns[first + d, 1]
                ]


@kernel
def largest_entry(x: FloatArray) -> float:
    """Largest absolute value, 0 if there is none; NaN stays."""
    largest = 0.0
    for value in x:
        size = abs(value)
        if size > largest or size != size:
            largest = size
    return largest
