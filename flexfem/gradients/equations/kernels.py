# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops: products with matrices of elements, forwards and transposed."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.kernels.compiled import kernel

__all__ = ["add_products", "add_transposed_products"]


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
