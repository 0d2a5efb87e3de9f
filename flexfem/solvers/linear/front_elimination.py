# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elimination of the first rows of a dense matrix, a front, without pivoting.

Symmetric fronts are eliminated by their entries from the diagonal on, half of the products.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.kernels.compiled import inlined, subroutine

__all__ = ["copy", "eliminate", "eliminate_pivots", "subtract_products"]

#: Pivot relative to the largest entry of its row before elimination that counts as zero.
_ZERO = 1e-14
#: Pivots that are eliminated from one another one by one, before products of matrices do so, and
#: rows of a symmetric front from which all pivots before are eliminated by one product.
_BLOCK, _WIDE = 32, 128
#: Rows of a symmetric front that are updated together, from the diagonal on.
_ROWS = 96
#: Difference of entries of a symmetric front, relative to the diagonals of the whole matrix: fronts
#: have those of their other rows in part.
_ALIKE = 1e-13


@inlined
def copy(source: FloatArray, out: FloatArray) -> None:
    """Copy a matrix."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            out[i, j] = source[i, j]


@subroutine
def eliminate(
    F: FloatArray, scales: FloatArray, upper: FloatArray, lower: FloatArray
) -> bool:  # fmt: skip
    """Eliminate the first rows of a front; False if a pivot vanishes.

    Args:
        F: (n, n) the front; the pivot rows are eliminated from its other rows.
        scales: (n,) square roots of the diagonal of the whole matrix.
        upper: (m, n) becomes the factors in the first rows.
        lower: (m, n - m) becomes those in the other rows, transposed: long loops.
    """
    m, n = upper.shape
    copy(F[:m], upper)
    least = np.zeros(m)
    for i in range(m):
        for j in range(n):
            least[i] = max(least[i], _ZERO * abs(upper[i, j]))
    if _is_symmetric(F, scales):
        return _eliminate_symmetric(F, upper, lower, least)
    copy(F[m:, :m].T, lower)
    for first in range(0, m, _BLOCK):
        end = min(first + _BLOCK, m)
        for i in range(first, end):
            for p in range(first, i):
                upper[i, p] /= upper[p, p]
                factor = upper[i, p]
                for j in range(p + 1, n):
                    upper[i, j] -= factor * upper[p, j]
            if not abs(upper[i, i]) > least[i]:
                return False
        for i in range(end, m):
            for p in range(first, end):
                upper[i, p] /= upper[p, p]
                for j in range(p + 1, end):
                    upper[i, j] -= upper[i, p] * upper[p, j]
        if end < m:
            rows = np.ascontiguousarray(upper[first:end, end:])
            upper[end:, end:] -= np.ascontiguousarray(upper[end:, first:end]) @ rows
        for p in range(first, end):
            for q in range(first, p):
                factor = upper[q, p]
                for i in range(n - m):
                    lower[p, i] -= factor * lower[q, i]
            factor = 1.0 / upper[p, p]
            for i in range(n - m):
                lower[p, i] *= factor
        if end < m:
            columns = np.ascontiguousarray(upper[first:end, end:m].T)
            lower[end:] -= columns @ lower[first:end]
    if m:
        F[m:, m:] -= np.ascontiguousarray(lower.T) @ np.ascontiguousarray(upper[:, m:])
    return True


@subroutine
def _eliminate_symmetric(
    F: FloatArray, upper: FloatArray, lower: FloatArray, least: FloatArray
) -> bool:
    """Eliminate the first rows of a symmetric front by its entries from the diagonal on.

    Args:
        F: see :func:`eliminate`.
        upper: the first rows of F.
        lower: see :func:`eliminate`.
        least: (m,) sizes at which pivots vanish.
    """
    m, n = upper.shape
    over = np.empty(m)
    if not eliminate_pivots(upper, over, least):
        return False
    for p in range(m):
        for i in range(p + 1, m):
            upper[i, p] = over[p] * upper[p, i]
        for i in range(n - m):
            lower[p, i] = over[p] * upper[p, m + i]
    if m:
        subtract_products(upper[:, m:], over, F[m:, m:])
        for first in range(m, n, _ROWS):
            end = min(first + _ROWS, n)
            copy(F[first:end, end:].T, F[end:, first:end])
    return True


@subroutine
def eliminate_pivots(upper: FloatArray, over: FloatArray, least: FloatArray) -> bool:
    """Eliminate the first rows of a symmetric matrix from one another; False if a pivot vanishes.

    Args:
        upper: (m, n) these rows, of which the entries from the diagonal on are read and become the
            pivots times the factors; those before it lose their meaning.
        over: (m,) becomes one over the pivots.
        least: (m,) sizes at which pivots vanish.
    """
    m = over.size
    for begin in range(0, m, _WIDE):
        stop = min(begin + _WIDE, m)
        _subtract_from_rows(upper[:begin, begin:], over[:begin], upper[begin:stop, begin:])
        for first in range(begin, stop, _BLOCK):
            end = min(first + _BLOCK, stop)
            before = over[begin:first]
            _subtract_from_rows(upper[begin:first, first:], before, upper[first:end, first:])
            for i in range(first, end):
                _subtract_rows(upper, over, first, i)
                if not abs(upper[i, i]) > least[i]:
                    return False
                over[i] = 1.0 / upper[i, i]
    return True


@subroutine
def _subtract_rows(upper: FloatArray, over: FloatArray, first: int, i: int) -> None:
    """Eliminate the pivots from ``first`` to that before ``i`` from row ``i``, four at a time."""
    row, four = upper[i, i:], i - (i - first) % 4
    for p in range(first, four, 4):
        a, b, c, d = upper[p, i:], upper[p + 1, i:], upper[p + 2, i:], upper[p + 3, i:]
        by_a, by_b = over[p] * a[0], over[p + 1] * b[0]
        by_c, by_d = over[p + 2] * c[0], over[p + 3] * d[0]
        for j in range(row.size):
            row[j] -= by_a * a[j] + by_b * b[j] + by_c * c[j] + by_d * d[j]
    for p in range(four, i):
        a, by_a = upper[p, i:], over[p] * upper[p, i]
        for j in range(row.size):
            row[j] -= by_a * a[j]


@subroutine
def _subtract_from_rows(rows: FloatArray, over: FloatArray, out: FloatArray) -> None:
    """Subtract the first rows of ``rows^T diag(over) rows``, as many as ``out`` has."""
    if not over.size:
        return
    left = np.empty((over.size, out.shape[0]))
    for p in range(over.size):
        for i in range(out.shape[0]):
            left[p, i] = over[p] * rows[p, i]
    out -= left.T @ np.ascontiguousarray(rows)


@subroutine
def subtract_products(rows: FloatArray, over: FloatArray, out: FloatArray) -> None:
    """Subtract ``rows^T diag(over) rows``, from the diagonal on, and some more."""
    for first in range(0, out.shape[0], _ROWS):
        end = min(first + _ROWS, out.shape[0])
        _subtract_from_rows(rows[:, first:], over, out[first:end, first:])


@subroutine
def _is_symmetric(F: FloatArray, scales: FloatArray) -> bool:
    """True if a matrix is symmetric up to round-off of entries of these sizes."""
    for i in range(F.shape[0]):
        for j in range(i):
            if abs(F[i, j] - F[j, i]) > _ALIKE * scales[i] * scales[j]:
                return False
    return True
