# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells in SIMD lanes, the format of batched kernels."""

import math

import numpy as np

from flexfem._types import FloatArray

__all__ = ["LANES", "in_rows", "lanes"]

#: Cells of one call: the width of the largest vectors of today's processors.
LANES = 8


def in_rows(values: FloatArray) -> FloatArray:
    """The numbers (m, ...) of each cell in one row, (m, k), also of a rank without cells."""
    return values.reshape(len(values), math.prod(values.shape[1:]))


def lanes(values: FloatArray) -> FloatArray:
    """Rows (m, ...) in lanes (b, ..., LANES); the last row is repeated in the last batch."""
    count = len(values)
    batches = -(-count // LANES)
    rows = np.minimum(np.arange(batches * LANES), count - 1)
    split = values[rows].reshape(batches, LANES, *values.shape[1:])
    return np.ascontiguousarray(np.moveaxis(split, 1, -1))
