# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops: products with matrices of elements, and maps of nodes over a step."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.nodes.frame_kernels import Nodes
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Memory, unpack
from flexfem.lie import se3, so3

__all__ = [
    "add_products", "add_transposed_products", "apply_maps", "apply_transposed_maps", "step_maps",
]  # fmt: skip


@kernel
def add_products(
    rows: IntArray, columns: IntArray, values: FloatArray, width: int, vector: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Add products of dense blocks with a vector to ``out``.

    Args:
        rows: (m, j) nodes of the rows of each block.
        columns: (m, k) nodes of its columns.
        values: (m j w k w) entries, row by row, with w unknowns of a node.
        width: w.
        vector: (n, 6), of which w are used.
        out: (n, 6).
    """
    at, own = 0, np.empty(width * columns.shape[1])
    for e in range(rows.shape[0]):
        for b in range(columns.shape[1]):
            for j in range(width):
                own[width * b + j] = vector[columns[e, b], j]
        for a in range(rows.shape[1]):
            for i in range(width):
                total = 0.0
                for j in range(own.size):
                    total += values[at + j] * own[j]
                at += own.size
                out[rows[e, a], i] += total


@kernel
def add_transposed_products(
    rows: IntArray, columns: IntArray, values: FloatArray, width: int, vector: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """The same with the transposed blocks."""
    at, own = 0, np.empty(width * columns.shape[1])
    for e in range(rows.shape[0]):
        own[:] = 0.0
        for a in range(rows.shape[1]):
            for i in range(width):
                factor = vector[rows[e, a], i]
                for j in range(own.size):
                    own[j] += values[at + j] * factor
                at += own.size
        for b in range(columns.shape[1]):
            for j in range(width):
                out[columns[e, b], j] += own[width * b + j]


@inlined
def _put_turn(first: FloatArray, second: FloatArray, out: FloatArray, at: int) -> None:
    """``A^T B`` of the rotations of two frames (12,)."""
    for i in range(3):
        for j in range(3):
            out[at + 3 * i + j] = (
                first[3 + i] * second[3 + j]
                + first[6 + i] * second[6 + j]
                + first[9 + i] * second[9 + j]
            )


@inlined
def _put_blocks(T: FloatArray, out: FloatArray) -> None:
    """Write the blocks of ``[[A, U], [0, A]]`` (36,)."""
    for i in range(3):
        for j in range(3):
            out[3 * i + j] = out[18 + 3 * i + j] = T[6 * i + j]
            out[9 + 3 * i + j] = T[6 * i + 3 + j]


@kernel
def step_maps(memory: Memory, accepted: FloatArray, out: FloatArray) -> None:
    """Write the maps of the first m nodes over the step to their trial state.

    Args:
        memory: ``Nodes`` of a block.
        accepted: (m, 12) frames of the accepted state after the step.
        out: (4, m, 27) blocks A, U and D of maps ``[[A, U], [0, D]]`` of twists: from those at the
            start to those at the end, from increments, the inverse, and to the accepted axes.
    """
    nodes = unpack(Nodes, memory)
    back, H, T = np.empty(6), np.empty(12), np.empty(36)
    out[:] = 0.0
    for n in range(out.shape[1]):
        E, F, inverse, axes = out[0, n], out[1, n], out[2, n], out[3, n]
        start, end, increment = nodes.frames0[n], nodes.frames[n], nodes.increment[n]
        for k in range(6):
            back[k] = -increment[k]
        _put_turn(accepted[n], end, axes, 0)
        _put_turn(accepted[n], end, axes, 18)
        if nodes.inertial:
            _put_turn(end, start, E, 0)
            so3.exp_into(back[3:], E[18:])
            for i in range(3):
                for j in range(3):
                    F[3 * j + i] = inverse[3 * i + j] = end[3 + 3 * i + j]
            so3.tangent_into(increment[3:], F[18:])
            so3.inverse_tangent_into(increment[3:], inverse[18:])
        else:
            se3.exp_into(back, H)
            se3.adjoint_into(H, T)
            _put_blocks(T, E)
            se3.tangent_into(increment, T)
            _put_blocks(T, F)
            se3.inverse_tangent_into(increment, T)
            _put_blocks(T, inverse)


@kernel
def apply_maps(maps: FloatArray, vectors: FloatArray, out: FloatArray) -> None:
    """Write products of maps (m, 27), see :func:`step_maps`, with vectors (m, 3) or (m, 6)."""
    coupled = vectors.shape[1] > 3
    for n in range(vectors.shape[0]):
        M, x = maps[n], vectors[n]
        for i in range(3):
            k = 3 * i
            out[n, i] = M[k] * x[0] + M[k + 1] * x[1] + M[k + 2] * x[2]
            if coupled:
                out[n, i] += M[9 + k] * x[3] + M[10 + k] * x[4] + M[11 + k] * x[5]
                out[n, 3 + i] = M[18 + k] * x[3] + M[19 + k] * x[4] + M[20 + k] * x[5]


@kernel
def apply_transposed_maps(maps: FloatArray, vectors: FloatArray, out: FloatArray) -> None:
    """The same with transposed maps."""
    coupled = vectors.shape[1] > 3
    for n in range(vectors.shape[0]):
        M, x = maps[n], vectors[n]
        for i in range(3):
            out[n, i] = M[i] * x[0] + M[3 + i] * x[1] + M[6 + i] * x[2]
            if coupled:
                out[n, 3 + i] = M[9 + i] * x[0] + M[12 + i] * x[1] + M[15 + i] * x[2]
                out[n, 3 + i] += M[18 + i] * x[3] + M[21 + i] * x[4] + M[24 + i] * x[5]
