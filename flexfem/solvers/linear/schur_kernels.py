# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled parts of the frozen solver: compliances, interface products, Schur complement entries.

A body is coupled to the interface by columns, one for each active component of each of its
interface nodes. ``Z = A^-1 J^T`` is the body's response to unit forces there, ``C = J Z`` its
compliance.
"""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.constraints.rows.data import RowArrays
from flexfem.kernels.compiled import kernel
from flexfem.kernels.records import Float1D, Float2D, Int1D, Int2D, Memory, Record, unpack

__all__ = [
    "BodyColumns",
    "add_diagonal",
    "interface_response",
    "invert_blocks",
    "multiply_blocks",
    "rigid_responses",
    "row_products",
    "schur",
    "schur_of_pairs",
    "steps_beyond",
]


class BodyColumns(Record):
    """Bodies of one part with their columns, one body after the other.

    Attributes:
        width: unknowns of a node.
        nodes: local nodes of the bodies.
        node_start: (bodies + 1,) first of them of each body; likewise the other starts.
        right: (n, 6) right-hand side of the nodes of the block, with the constraint forces.
        columns: (c, 2) interface node and component of each column.
        column_start: (bodies + 1,).
        node_column: (nodes,) first column of each interface node within its body.
        node_active: (nodes,) number of columns of each interface node.
        sides: (k, 3) term, side and interface node of the forces on the bodies, equal interface
            nodes consecutively.
        side_start: (bodies + 1,).
        ranges: (j, 2) columns (first, end) on which forces act; a slider may reach the others
            later.
        range_start: (bodies + 1,).
        responses: rows of ``A^-T J^T`` of all bodies, or empty if another solve with the factors is
            cheaper.
        response_start: (bodies + 1,).
        compliances: matrices ``J A^-1 J^T``, transposed: forces of a side take consecutive entries.
        compliance_start: (bodies + 1,).
        entries: of the Schur complement, pairs in the order (body, second side, first side); of all
            pairs, or of those for which :func:`schur_of_pairs` is called.
    """

    width: int
    nodes: Int1D
    node_start: Int1D
    right: Float2D
    columns: Int2D
    column_start: Int1D
    node_column: Int1D
    node_active: Int1D
    sides: Int2D
    side_start: Int1D
    ranges: Int2D
    range_start: Int1D
    responses: Float1D
    response_start: Int1D
    compliances: Float1D
    compliance_start: Int1D
    entries: Float1D


@kernel
def interface_response(memory: Memory, y: FloatArray) -> None:
    """``y = J A^-1 r`` of every body into nodes and components (n, 6) of the columns in use."""
    own = unpack(BodyColumns, memory)
    columns, ranges, responses = own.columns, own.ranges, own.responses
    column_start, node_start = own.column_start, own.node_start
    for b in range(node_start.size - 1):
        first, count = column_start[b], column_start[b + 1] - column_start[b]
        if count == 0:
            continue
        total = np.zeros(count)
        at, begin, end = own.response_start[b], own.range_start[b], own.range_start[b + 1]
        for n in range(node_start[b], node_start[b + 1]):
            node = own.nodes[n]
            for i in range(own.width):
                force = own.right[node, i]
                for k in range(begin, end):
                    for c in range(ranges[k, 0], ranges[k, 1]):
                        total[c] += force * responses[at + c]
                at += count
        for k in range(begin, end):
            for c in range(ranges[k, 0], ranges[k, 1]):
                y[columns[first + c, 0], columns[first + c, 1]] = total[c]


@kernel
def schur(memory: Memory, rows: Memory) -> None:
    """Entries of ``G~ C G^T``: for every body, all pairs of the sides of terms that act on it.

    G are the ``force_jacobian``, G~ the ``step_jacobian`` of ``RowArrays``.
    """
    own, terms = unpack(BodyColumns, memory), unpack(RowArrays, rows)
    force_jacobian, step_jacobian = terms.force_jacobian, terms.step_jacobian
    sides, side_start, column_start = own.sides, own.side_start, own.column_start
    node_column, node_active = own.node_column, own.node_active
    at, most, widest = 0, 0, 0
    for b in range(side_start.size - 1):
        most = max(most, side_start[b + 1] - side_start[b])
        widest = max(widest, column_start[b + 1] - column_start[b])
    steps, moved = np.empty((6, most)), np.empty(widest)
    for b in range(side_start.size - 1):
        begin, end = side_start[b], side_start[b + 1]
        count, C = column_start[b + 1] - column_start[b], own.compliance_start[b]
        for i in range(begin, end):
            step = step_jacobian[sides[i, 0], sides[i, 1]]
            for k in range(6):
                steps[k, i - begin] = step[k]
        for j in range(begin, end):
            force, first = force_jacobian[sides[j, 0], sides[j, 1]], node_column[sides[j, 2]]
            # loops over all columns, and slices with indices from 0 on, become vectors
            moved[:count] = 0.0
            for m in range(node_active[sides[j, 2]]):
                row, size = own.compliances[C + (first + m) * count :], force[m]
                for k in range(count):
                    moved[k] += row[k] * size
            i = begin
            while i < end:  # sides ordered by interface nodes
                node, run = sides[i, 2], i
                while i < end and sides[i, 2] == node:
                    i += 1
                G, values = steps[:, run - begin :], own.entries[at:]
                active, y = node_active[node], moved[node_column[node] :]
                if active == 6:
                    for n in range(i - run):
                        values[n] = (
                            G[0, n] * y[0] + G[1, n] * y[1] + G[2, n] * y[2]
                            + G[3, n] * y[3] + G[4, n] * y[4] + G[5, n] * y[5]
                        )  # fmt: skip
                elif active == 3:
                    for n in range(i - run):
                        values[n] = G[0, n] * y[0] + G[1, n] * y[1] + G[2, n] * y[2]
                else:
                    for n in range(i - run):
                        values[n] = 0.0
                        for k in range(active):
                            values[n] += G[k, n] * y[k]
                at += i - run


@kernel
def schur_of_pairs(memory: Memory, rows: Memory, pairs: IndexArray, pair_start: IntArray) -> None:
    """The same entries for pairs (k, 2) of first and second sides, given the first of each body.

    Others are zero where a body does not couple their nodes, as one with lumped masses.
    """
    own, terms = unpack(BodyColumns, memory), unpack(RowArrays, rows)
    sides, compliances = own.sides, own.compliances
    for b in range(pair_start.size - 1):
        count = own.column_start[b + 1] - own.column_start[b]
        for at in range(pair_start[b], pair_start[b + 1]):
            i, j = pairs[at]
            step = terms.step_jacobian[sides[i, 0], sides[i, 1]]
            force = terms.force_jacobian[sides[j, 0], sides[j, 1]]
            node, other = sides[i, 2], sides[j, 2]
            first = own.compliance_start[b] + own.node_column[other] * count + own.node_column[node]
            total = 0.0
            for k in range(own.node_active[node]):
                moved = 0.0
                for m in range(own.node_active[other]):
                    moved += compliances[first + m * count + k] * force[m]
                total += step[k] * moved
            own.entries[at] = total


@kernel
def row_products(
    rows: Memory, local_node: BoolArray, y: FloatArray, owned: FloatArray, row_values: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """``owned * row_values - G~ y`` of ``RowArrays`` over the nodes that this rank's bodies own."""
    own = unpack(RowArrays, rows)
    nodes, row_of_term, jacobian = own.term_nodes, own.row_of_term, own.step_jacobian
    for r in range(out.size):
        out[r] = owned[r] * row_values[r]
    for t in range(row_of_term.size):
        for side in range(2):
            node = nodes[t, side]
            if node >= 0 and local_node[node]:
                total = 0.0
                for k in range(6):
                    total += jacobian[t, side, k] * y[node, k]
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
def steps_beyond(
    owned: BoolArray, steps: FloatArray, response: FloatArray, out: FloatArray
) -> None:
    """``steps`` (n, 6) of owned nodes and the response to more forces."""
    for n in range(out.shape[0]):
        for i in range(6):
            out[n, i] = response[n, i] + steps[n, i] if owned[n] else response[n, i]


@kernel
def add_diagonal(
    owned: FloatArray, compliance: FloatArray, coupled: IntArray, coupling: FloatArray,
    diagonal: FloatArray, couplings: FloatArray,
) -> None:  # fmt: skip
    """Compliances of rows (r,), and between coupled ones (k, 2), where this rank owns them."""
    for r in range(owned.size):
        diagonal[r] = owned[r] * compliance[r]
    for k in range(coupling.size):
        couplings[k] = owned[coupled[k, 0]] * coupling[k]


@kernel
def invert_blocks(matrices: FloatArray, inverses: FloatArray, smallest: float) -> bool:
    """Inverses of matrices (k, 6, 6) by Gauss and Jordan with partial pivoting.

    Returns:
        False if one is singular: the product of the largest entries of a matrix and its inverse is
        at least ``1 / smallest``, or not a number. Its inverse has no meaning then.
    """
    A, regular = np.empty((6, 12)), True
    for k in range(matrices.shape[0]):
        largest = 0.0
        for i in range(6):
            for j in range(6):
                A[i, j], A[i, 6 + j] = matrices[k, i, j], 1.0 if i == j else 0.0
                largest = max(largest, abs(A[i, j]))
        for c in range(6):
            best = c
            for i in range(c + 1, 6):
                if abs(A[i, c]) > abs(A[best, c]):
                    best = i
            if best != c:
                for j in range(12):
                    A[c, j], A[best, j] = A[best, j], A[c, j]
            over = 1.0 / A[c, c]
            for j in range(12):
                A[c, j] *= over
            for i in range(6):
                factor = A[i, c]
                if i != c and factor != 0.0:
                    for j in range(12):
                        A[i, j] -= factor * A[c, j]
        most = 0.0
        for i in range(6):
            for j in range(6):
                inverses[k, i, j] = A[i, 6 + j]
                size = abs(A[i, 6 + j])
                if size > most or size != size:
                    most = size
        regular = regular and largest * most < 1.0 / smallest
    return regular


@kernel
def rigid_responses(memory: Memory, inverses: FloatArray) -> None:
    """Responses and compliances of bodies with one node each."""
    own = unpack(BodyColumns, memory)
    columns, column_start = own.columns, own.column_start
    responses, compliances = own.responses, own.compliances
    for b in range(inverses.shape[0]):
        first, count = column_start[b], column_start[b + 1] - column_start[b]
        A, response, compliance = inverses[b], own.response_start[b], own.compliance_start[b]
        for c in range(count):
            component = columns[first + c, 1]
            for i in range(6):
                responses[response + i * count + c] = A[component, i]
            for d in range(count):
                compliances[compliance + d * count + c] = A[component, columns[first + d, 1]]
