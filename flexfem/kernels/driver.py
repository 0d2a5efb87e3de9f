# SPDX-License-Identifier: LGPL-3.0-or-later
"""Driver of cell kernels: the loops that gather the data of cells, call a kernel and scatter.

A kernel is called by address with FFCx's signature: it adds its results to a tensor, from the
packed coefficients of one cell, or of ``LANES`` cells at once. :class:`CellKernel` has the
positions of each nodal array, the data of the cell and the data of its section among the
coefficients, and :class:`Cells` these data. :func:`add_forces` adds the results to nodes
(residuals, actions of a tangent), :func:`add_entries` to a vector or a matrix of nodes with one
number each, :func:`add_blocks` adds matrices to those of pairs of nodes, :func:`evaluate` stores
results by cell, and :func:`evaluate_tangents` combines derivatives by configuration, velocity and
acceleration to one matrix a cell. :func:`add_products` multiplies stored matrices by nodal values.
"""

import math
from collections.abc import Iterable, Mapping
from enum import IntEnum

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.kernels.compiled import inlined, kernel, subroutine
from flexfem.kernels.ffcx import Kernel, tabulate
from flexfem.kernels.records import (
    Bool1D,
    Float2D,
    Float3D,
    Index2D,
    Int1D,
    Int2D,
    Memory,
    Record,
    array_at,
    unpack,
)

__all__ = [
    "ALL_COLUMNS",
    "LINE",
    "NO_NODES",
    "CellKernel",
    "Cells",
    "Nodal",
    "add_blocks",
    "add_entries",
    "add_forces",
    "add_products",
    "cell_kernel",
    "evaluate",
    "evaluate_tangents",
    "plain_cells",
    "put_rotation",
    "put_twist",
    "turn_matrix",
]

#: Corners of the reference interval, for forms that do not depend on the size of the cell.
LINE = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0]])
#: Unknowns in the order of all columns, node by node, see :class:`CellKernel`.
ALL_COLUMNS = np.empty((0, 2), dtype=np.int64)
#: Record of the nodes for kernels without nodal data.
NO_NODES: Memory = np.empty(0, dtype=np.int64)


class Nodal(IntEnum):
    """Kinds of nodal data, by their transformation to the cell's own axes at the node."""

    #: Three components of a frame in inertial axes: its position.
    POSITION = 0
    #: The rotation of a frame, row by row, times that of the cell's axes.
    ROTATION = 1
    #: Translation and rotation of a twist, or of its change, in the axes of the node.
    TWIST = 2
    #: Numbers that are not transformed, as many as their array has columns.
    NUMBERS = 3


_POSITION, _ROTATION, _NUMBERS = int(Nodal.POSITION), int(Nodal.ROTATION), int(Nodal.NUMBERS)


class CellKernel(Record):
    """A kernel, and the positions of data among its coefficients.

    Attributes:
        address: of the function.
        lanes: number of cells that one call evaluates.
        coefficients: number of coefficients of a cell.
        size: number of results of a cell.
        unknowns: (t, 2) node of the cell, and first of the three columns there, of each three
            results; empty if they are in the order of all columns, node by node.
        nodal: (g, 3) kind of nodal data, word of their array in the record of the nodes, and first
            coefficient.
        own: (o, 3) first column in ``Cells.own``, number of columns, first coefficient.
        section: (s, 3) likewise of ``Cells.sections``.
    """

    address: int
    lanes: int
    coefficients: int
    size: int
    unknowns: Int2D
    nodal: Int2D
    own: Int2D
    section: Int2D


class Cells(Record):
    """Constant data of cells.

    Attributes:
        nodes: (m, k) nodes, -1 for a missing node: a kernel gets the data of the first node
            instead, and its results there are not used.
        turned: (m,) True for cells whose own axes at nodes differ from the axes of the nodes.
        turns: (m, k, 9) rotations from the cells' axes to those of the nodes; one row if none is
            rotated.
        own: (m, p) data of each cell.
        section: (m,) number of its section.
        sections: (s, q) data of each section.
        corners: coordinates for the kernels, or the data that hand-written ones take in their
            place: a row for each call, or one row for all.
    """

    nodes: Index2D
    turned: Bool1D
    turns: Float3D
    own: Float2D
    section: Int1D
    sections: Float2D
    corners: Float2D


def plain_cells(
    own: Float2D,
    nodes: Index2D | None = None,
    corners: Float2D = LINE,
    section: Int1D | None = None,
    sections: Float2D | None = None,
) -> Cells:
    """Cells whose axes are those of their nodes; without nodes and sections unless given.

    ``own`` may have no rows if no kernel takes data of cells.
    """
    nodes = np.empty((len(own), 0), dtype=np.int32) if nodes is None else nodes
    count = len(nodes)
    return Cells(
        nodes=nodes, turned=np.zeros(count, dtype=np.bool_),
        turns=np.zeros((1, nodes.shape[1], 9)), own=own, corners=corners,
        section=np.zeros(count, dtype=np.int64) if section is None else section,
        sections=np.empty((1, 0)) if sections is None else sections,
    )  # fmt: skip


def cell_kernel(
    kernel: Kernel,
    size: int,
    names: Iterable[str],
    nodal: Mapping[str, tuple[Nodal, int]],
    own: Mapping[str, tuple[int, int]],
    section: Mapping[str, tuple[int, int]] | None = None,
    unknowns: Int2D = ALL_COLUMNS,
) -> CellKernel:
    """The kernel with the positions of its data, without those that it does not use.

    Args:
        kernel: compiled kernel.
        size: number of results of a cell.
        names: names of its coefficients in the order of its offsets.
        nodal: kind of the coefficients with nodal values, and word of their array in the record of
            the nodes, ``Kind.word(name)``.
        own: first column in ``Cells.own`` and number of columns of those of cells.
        section: the same in ``Cells.sections``.
        unknowns: see :class:`CellKernel`.
    """
    offset = dict(zip(names, kernel.offsets.tolist(), strict=False))

    def table(rows: list[tuple[int, int, int]]) -> Int2D:
        return np.array([row for row in rows if row[2] >= 0], dtype=np.int64).reshape(-1, 3)

    return CellKernel(
        address=kernel.address, lanes=kernel.lanes, coefficients=max(int(kernel.offsets[-1]), 1),
        size=size, unknowns=unknowns,
        nodal=table([(kind, word, offset[name]) for name, (kind, word) in nodal.items()]),
        own=table([(*columns, offset[name]) for name, columns in own.items()]),
        section=table([(*columns, offset[name]) for name, columns in (section or {}).items()]),
    )  # fmt: skip


@inlined
def _put_numbers(
    data: FloatArray, at: int, lane: int, values: FloatArray, row: int, count: int
) -> None:
    """Write numbers of a row as they are."""
    # numba tests signed indices for negative ones, which takes half as long as the rest
    to, of = np.uintp(lane), np.uintp(row)
    for i in range(count):
        data[np.uintp(at + i), to] = values[of, np.uintp(i)]


@inlined
def put_rotation(
    data: FloatArray, at: int, lane: int, frame: FloatArray, turned: bool, Q: FloatArray
) -> None:
    """Write the rotation of a frame, times ``Q`` (9,) if the cell is rotated."""
    for i in range(3):
        k = 3 + 3 * i
        for j in range(3):
            if turned:
                data[at + 3 * i + j, lane] = (
                    frame[k] * Q[j] + frame[k + 1] * Q[3 + j] + frame[k + 2] * Q[6 + j]
                )
            else:
                data[at + 3 * i + j, lane] = frame[k + j]


@inlined
def put_twist(
    data: FloatArray, at: int, lane: int, twist: FloatArray, turned: bool, Q: FloatArray
) -> None:
    """Write a nodal twist in the axes of the cell."""
    for half in range(0, 6, 3):
        for i in range(3):
            if turned:
                data[at + half + i, lane] = (
                    Q[i] * twist[half] + Q[i + 3] * twist[half + 1] + Q[i + 6] * twist[half + 2]
                )
            else:
                data[at + half + i, lane] = twist[half + i]


@inlined
def _gather(
    kernel: CellKernel, cells: Cells, nodes: Memory, c: int, lane: int, data: FloatArray
) -> None:
    """Write the nodal data and the own data of a cell."""
    turned, turn = cells.turned[c], c * cells.turned[c]
    for g in range(kernel.nodal.shape[0]):
        kind, at = kernel.nodal[g, 0], kernel.nodal[g, 2]
        values = array_at(nodes, kernel.nodal[g, 1])
        for j in range(cells.nodes.shape[1]):
            node = cells.nodes[np.uintp(c), np.uintp(j)]
            if node < 0:
                node = cells.nodes[c, 0]
            if kind == _POSITION:
                _put_numbers(data, at + 3 * j, lane, values, node, 3)
            elif kind == _ROTATION:
                put_rotation(data, at + 9 * j, lane, values[node], turned, cells.turns[turn, j])
            elif kind == _NUMBERS:
                _put_numbers(data, at + values.shape[1] * j, lane, values, node, values.shape[1])
            else:
                put_twist(data, at + 6 * j, lane, values[node], turned, cells.turns[turn, j])
    for o in range(kernel.own.shape[0]):
        first, count, at = kernel.own[o, 0], kernel.own[o, 1], kernel.own[o, 2]
        for i in range(count):
            data[at + i, lane] = cells.own[c, first + i]


@inlined
def _put_section(
    kernel: CellKernel, cells: Cells, section: int, lane: int, data: FloatArray
) -> None:
    """Write the data of a section, which is needed only when the section changes."""
    for s in range(kernel.section.shape[0]):
        first, count, at = kernel.section[s, 0], kernel.section[s, 1], kernel.section[s, 2]
        for i in range(count):
            data[at + i, lane] = cells.sections[section, first + i]


@inlined
def _corners(cells: Cells, call: int) -> FloatArray:
    """Coordinates for one of the calls."""
    corners: FloatArray = cells.corners[call if cells.corners.shape[0] > 1 else 0]
    return corners


@inlined
def _evaluate_batch(
    kernel: CellKernel, cells: Cells, nodes: Memory, first: int, held: IntArray,
    data: FloatArray, constants: FloatArray, results: FloatArray,
) -> None:  # fmt: skip
    """Write the results of the cells of one call; ``held``: the sections with data in ``data``."""
    last = cells.nodes.shape[0] - 1
    for lane in range(kernel.lanes):
        c = min(first + lane, last)  # the last cell is repeated in the last batch
        _gather(kernel, cells, nodes, c, lane, data)
        if cells.section[c] != held[lane]:
            held[lane] = cells.section[c]
            _put_section(kernel, cells, held[lane], lane, data)
    results[:] = 0.0
    corners = _corners(cells, first // kernel.lanes)
    tabulate(kernel.address, results, data, constants, corners)  # type: ignore[call-arg]


@inlined
def _unknown(unknowns: IntArray, columns: int, t: int) -> tuple[int, int]:
    """Node of the cell and first column there of three results, see ``CellKernel.unknowns``."""
    if unknowns.shape[0] > 0:
        return unknowns[t, 0], unknowns[t, 1]
    return (t, 0) if columns == 3 else (t // 2, 3 * (t % 2))  # without a division by a variable


@inlined
def _add_to_nodes(
    unknowns: IntArray, cells: Cells, c: int, turned: bool, results: FloatArray, lane: int,
    scale: float, target: FloatArray,
) -> None:  # fmt: skip
    """Add the results of a cell to its nodes; those of twists in the axes of the nodes."""
    turn = c * turned
    for t in range(results.shape[0] // 3):
        at = 3 * t
        j, column = _unknown(unknowns, target.shape[1], t)
        node = cells.nodes[c, j]
        if node < 0:
            continue
        for i in range(3):
            value = results[np.uintp(at + i), np.uintp(lane)]
            if turned:
                Q = cells.turns[turn, j]
                value = (
                    Q[3 * i] * results[at, lane]
                    + Q[3 * i + 1] * results[at + 1, lane]
                    + Q[3 * i + 2] * results[at + 2, lane]
                )
            target[np.uintp(node), np.uintp(column + i)] += scale * value


@kernel
def add_forces(
    kernel: Memory, cells: Memory, nodes: Memory, constants: FloatArray, scale: float,
    target: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times the results of all cells to their nodes.

    Args:
        kernel: a :class:`CellKernel` with 3 or 6 results a node.
        cells: :class:`Cells`.
        nodes: record of the nodes.
        constants: constants of the kernel.
        scale: factor of the results.
        target: (n, 3) or (n, 6); columns of the latter are those of twists.
    """
    call, own = unpack(CellKernel, kernel), unpack(Cells, cells)
    width, count = call.lanes, own.nodes.shape[0]
    data, results = np.empty((call.coefficients, width)), np.empty((call.size, width))
    held = np.full(width, -1)
    for first in range(0, count, width):
        _evaluate_batch(call, own, nodes, first, held, data, constants, results)
        for lane in range(min(width, count - first)):
            c = first + lane
            _add_to_nodes(call.unknowns, own, c, own.turned[c], results, lane, scale, target)


@kernel
def add_entries(
    kernel: Memory, cells: Memory, nodes: Memory, constants: FloatArray, target: FloatArray
) -> None:
    """Add the results of all cells to the entries of their nodes, which have one number each.

    Args:
        kernel: a :class:`CellKernel` with one result for each of k nodes, or each pair of them.
        cells: :class:`Cells`.
        nodes: record of the nodes.
        constants: constants of the kernel.
        target: a vector (n, 1), or a matrix (n, n) for pairs.
    """
    call, own = unpack(CellKernel, kernel), unpack(Cells, cells)
    width, (count, k), paired = call.lanes, own.nodes.shape, target.shape[1] > 1
    data, results = np.empty((call.coefficients, width)), np.empty((call.size, width))
    held, columns = np.full(width, -1), call.size // k
    for first in range(0, count, width):
        _evaluate_batch(call, own, nodes, first, held, data, constants, results)
        for lane in range(min(width, count - first)):
            ends = own.nodes[first + lane]
            for i in range(k):
                for j in range(columns):
                    to = ends[j] if paired else 0
                    target[ends[i], to] += results[columns * i + j, lane]


@kernel
def evaluate(
    kernel: Memory, cells: Memory, nodes: Memory, constants: FloatArray, values: FloatArray
) -> None:
    """Write the results of all cells.

    Args:
        kernel: a :class:`CellKernel`.
        cells: :class:`Cells`.
        nodes: record of the nodes.
        constants: constants of the kernel.
        values: (m, s) results.
    """
    call, own = unpack(CellKernel, kernel), unpack(Cells, cells)
    width, count = call.lanes, own.nodes.shape[0]
    data, results = np.empty((call.coefficients, width)), np.empty((call.size, width))
    held = np.full(width, -1)
    for first in range(0, count, width):
        _evaluate_batch(call, own, nodes, first, held, data, constants, results)
        for lane in range(min(width, count - first)):
            for i in range(call.size):
                values[first + lane, i] = results[i, lane]


@kernel
def add_blocks(
    kernel: Memory, cells: Memory, nodes: Memory, constants: FloatArray, index: IndexArray,
    blocks: FloatArray,
) -> None:  # fmt: skip
    """Add the matrices of all cells, whose axes are those of their nodes, to pairs of nodes.

    Args:
        kernel: a :class:`CellKernel` of matrices.
        cells: :class:`Cells`.
        nodes: record of the nodes.
        constants: constants of the kernel.
        index: (m, k, k) numbers of the pairs, -1 where a node is missing.
        blocks: (b, 3, 3) or (b, 6, 6) matrices of the pairs.
    """
    call, own = unpack(CellKernel, kernel), unpack(Cells, cells)
    width, count, columns = call.lanes, own.nodes.shape[0], blocks.shape[1]
    data, results = np.empty((call.coefficients, width)), np.empty((call.size, width))
    held, rows = np.full(width, -1), int(math.sqrt(call.size))
    for first in range(0, count, width):
        _evaluate_batch(call, own, nodes, first, held, data, constants, results)
        for s in range(rows // 3):
            i, row = _unknown(call.unknowns, columns, s)
            for t in range(rows // 3):
                j, column = _unknown(call.unknowns, columns, t)
                for lane in range(min(width, count - first)):  # which are contiguous in memory
                    to = index[first + lane, i, j]
                    if to >= 0:
                        for a in range(3):
                            at = (3 * s + a) * rows + 3 * t
                            for b in range(3):
                                blocks[to, row + a, column + b] += results[at + b, lane]


@kernel
def add_products(
    unknowns: IntArray, cells: Memory, matrices: FloatArray, steps: FloatArray, scale: float,
    transposed: bool, target: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times the matrices of all cells, or their transposes, times nodal values.

    Args:
        unknowns: as of a :class:`CellKernel`.
        cells: :class:`Cells`.
        matrices: (m, s^2) in the axes of the nodes, as :func:`evaluate_tangents` leaves them, and
            :func:`evaluate` where these are also the axes of the cells.
        steps: (n, 3) or (n, 6) values.
        scale: factor of the products.
        transposed: True for transposed matrices.
        target: array of the shape of the values.
    """
    own, size = unpack(Cells, cells), int(math.sqrt(matrices.shape[1]))
    x, y = np.empty(size), np.empty((size, 1))
    for c in range(own.nodes.shape[0]):
        for t in range(size // 3):
            j, column = _unknown(unknowns, target.shape[1], t)
            node = own.nodes[c, j]
            for i in range(3):
                x[3 * t + i] = steps[node, column + i] if node >= 0 else 0.0
        y[:] = 0.0
        for i in range(size):
            for j in range(size):
                if transposed:
                    y[j, 0] += matrices[c, i * size + j] * x[i]
                else:
                    y[i, 0] += matrices[c, i * size + j] * x[j]
        _add_to_nodes(unknowns, own, c, False, y, 0, scale, target)


@subroutine
def turn_matrix(cells: Cells, c: int, K: FloatArray, work: FloatArray) -> None:
    """``K <- P K P^T`` with the block diagonal P of the rotations, twice for each node."""
    width = 6 * cells.nodes.shape[1]
    for block in range(width // 3):
        Q = cells.turns[c, block // 2]
        for j in range(width):
            for i in range(3):
                work[i] = 0.0
                for k in range(3):
                    work[i] += Q[3 * i + k] * K[(3 * block + k) * width + j]
            for i in range(3):
                K[(3 * block + i) * width + j] = work[i]
    for block in range(width // 3):
        Q = cells.turns[c, block // 2]
        for i in range(width):
            for j in range(3):
                work[j] = 0.0
                for k in range(3):
                    work[j] += K[i * width + 3 * block + k] * Q[3 * j + k]
            for j in range(3):
                K[i * width + 3 * block + j] = work[j]


@kernel
def evaluate_tangents(
    stiffness: Memory, inertia: Memory, cells: Memory, nodes: Memory, constants: FloatArray,
    rates: FloatArray, factors: FloatArray, values: FloatArray,
) -> None:  # fmt: skip
    """Write some ``s (k K + C dv + M dw)`` of all cells, whose nodes have twists.

    Args:
        stiffness: a :class:`CellKernel` of the matrices K.
        inertia: one that takes two constants, the factors of C and M, whose sum it is.
        cells: :class:`Cells`.
        nodes: record of the nodes.
        constants: constants of the stiffness.
        rates: (r, n, 2, 36) changes dv and dw of each node along its local twist, row by row.
        factors: (r, 2) k and s.
        values: (r, m, (6 k)^2).
    """
    for_K, for_CM = unpack(CellKernel, stiffness), unpack(CellKernel, inertia)
    own = unpack(Cells, cells)
    k_data, m_data = np.empty((for_K.coefficients, 1)), np.empty((for_CM.coefficients, 1))
    size, count = for_K.size, own.nodes.shape[1]
    K, C, M, work = np.empty(size), np.empty(size), np.empty(size), np.empty(3)
    only_v, only_w, held = np.array([1.0, 0.0]), np.array([0.0, 1.0]), -1
    for c in range(own.nodes.shape[0]):
        _gather(for_K, own, nodes, c, 0, k_data)
        _gather(for_CM, own, nodes, c, 0, m_data)
        if own.section[c] != held:
            held = own.section[c]
            _put_section(for_K, own, held, 0, k_data)
            _put_section(for_CM, own, held, 0, m_data)
        K[:], C[:], M[:] = 0.0, 0.0, 0.0
        corners = _corners(own, c)
        tabulate(for_K.address, K, k_data, constants, corners)  # type: ignore[call-arg]
        tabulate(for_CM.address, C, m_data, only_v, corners)
        tabulate(for_CM.address, M, m_data, only_w, corners)
        if own.turned[c]:
            turn_matrix(own, c, K, work)
            turn_matrix(own, c, C, work)
            turn_matrix(own, c, M, work)
        for r in range(rates.shape[0]):
            for i in range(6 * count):
                for node in range(count):
                    at, by = 6 * (i * count + node), rates[r, own.nodes[c, node]]
                    for j in range(6):
                        total = factors[r, 0] * K[at + j]
                        for k in range(6):
                            total += C[at + k] * by[0, 6 * k + j]
                            total += M[at + k] * by[1, 6 * k + j]
                        values[r, c, at + j] = factors[r, 1] * total
