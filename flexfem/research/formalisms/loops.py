# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over cells whose coordinates are entries of one vector.

Every cell names its entries of the vector of all coordinates; fixed entries name the one after the
last, which is zero, and sums there are dropped.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.ffcx import tabulate

__all__ = ["add_matrix", "add_vector", "evaluate"]


@inlined
def _pack(data: FloatArray, offsets: IntArray, entries: IntArray, fields: FloatArray) -> None:
    """Coefficients of one cell from the first of ``fields`` (fields, n + 1)."""
    for k in range(offsets.shape[0] - 1):
        if offsets[k] >= 0:  # the form uses it
            for i in range(entries.shape[0]):
                data[offsets[k] + i] = fields[k, entries[i]]


@kernel
def add_vector(
    address: int, offsets: IntArray, entries: IntArray, points: FloatArray, constants: FloatArray,
    fields: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add the vectors of all cells to ``out`` (n + 1).

    ``entries`` (m, k) of the cells' coordinates; ``points`` (m, 3 nodes) of their corners.
    """
    data, tensor = np.zeros(max(offsets[-1], 1)), np.empty(entries.shape[1])
    for c in range(entries.shape[0]):
        _pack(data, offsets, entries[c], fields)
        tensor[:] = 0.0
        tabulate(address, tensor, data, constants, points[c])  # type: ignore[call-arg]
        for i in range(entries.shape[1]):
            out[entries[c, i]] += tensor[i]


@kernel
def add_matrix(
    address: int, offsets: IntArray, entries: IntArray, points: FloatArray, constants: FloatArray,
    fields: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add the matrices of all cells to ``out`` (n + 1, n + 1); arguments as in `add_vector`."""
    k = entries.shape[1]
    data, tensor = np.zeros(max(offsets[-1], 1)), np.empty(k * k)
    for c in range(entries.shape[0]):
        _pack(data, offsets, entries[c], fields)
        tensor[:] = 0.0
        tabulate(address, tensor, data, constants, points[c])  # type: ignore[call-arg]
        for i in range(k):
            for j in range(k):
                out[entries[c, i], entries[c, j]] += tensor[k * i + j]


@kernel
def evaluate(
    address: int, offsets: IntArray, entries: IntArray, points: FloatArray, constants: FloatArray,
    fields: FloatArray, size: int,
) -> FloatArray:  # fmt: skip
    """Sum of the tensors (size) of all cells; arguments as in `add_vector`."""
    data, tensor = np.zeros(max(offsets[-1], 1)), np.zeros(size)
    for c in range(entries.shape[0]):
        _pack(data, offsets, entries[c], fields)
        tabulate(address, tensor, data, constants, points[c])  # type: ignore[call-arg]
    return tensor
