# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops: products with matrices that are not assembled, forwards and transposed."""

from flexfem._types import FloatArray, IntArray
from flexfem.kernels.compiled import kernel

__all__ = ["add_products", "add_transposed_products"]


@kernel
def add_products(
    rows: IntArray, columns: IntArray, values: FloatArray, width: int, vector: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Add the product of entries (k,) at given rows and columns with a vector to ``out``.

    Vectors (n, 6) have ``width`` entries of each node in use.
    """
    for k in range(rows.size):
        i, j = rows[k], columns[k]
        out[i // width, i % width] += values[k] * vector[j // width, j % width]


@kernel
def add_transposed_products(
    rows: IntArray, columns: IntArray, values: FloatArray, width: int, vector: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """The same with the transposed matrix."""
    for k in range(rows.size):
        i, j = rows[k], columns[k]
        out[j // width, j % width] += values[k] * vector[i // width, i % width]
