# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled LU factorisation of a banded matrix, without pivoting.

Entry (i, j) of the matrix is stored at ``[i, j - i + b]`` of an array (n, 2 b + 1).

Bands of chains are narrow: with b = 5 a factorisation takes 0.62, 1.7 and 6.3 us for 12, 48 and 192
rows, LAPACK's dgbtrf 1.9, 4.2 and 12.9 us. For 192 rows and b = 20 it is 23 against 36 us, for 768
rows and b = 60 it is 0.55 against 0.62 ms (``tests/benchmarks/banded_against_lapack.py``).
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.kernels.compiled import kernel, subroutine

__all__ = ["band_backward", "band_eliminate", "band_factor", "band_forward", "band_solve"]

#: Pivot relative to the largest entry of its row before elimination that counts as zero.
_ZERO = 1e-14


@kernel
def band_factor(index: IntArray, values: FloatArray, band: FloatArray) -> bool:
    """Factorise the matrix with ``values`` at ``index`` of the flattened storage.

    Duplicate entries are summed; those with the index -1 are left out. Returns False if a pivot
    vanishes.
    """
    flat = band.reshape(-1)
    flat[:] = 0.0
    for k in range(index.size):
        if index[k] >= 0:
            flat[index[k]] += values[k]
    n, width = band.shape
    b = width // 2
    sizes = np.empty(n)
    for i in range(n):
        sizes[i] = 0.0
        for k in range(width):
            sizes[i] = max(sizes[i], abs(band[i, k]))
    for k in range(n):
        upper = band[k, b:]
        pivot = upper[0]
        if not abs(pivot) > _ZERO * sizes[k]:
            return False
        for i in range(k + 1, min(k + b + 1, n)):
            # slices with indices from 0 on, which the compiler turns into vectors
            row = band[i, k - i + b : k - i + 2 * b + 1]
            factor = row[0] / pivot
            if factor != 0.0:
                row[0] = factor
                for m in range(1, b + 1):
                    row[m] -= factor * upper[m]
    return True


@kernel
def band_solve(band: FloatArray, order: IntArray, work: FloatArray, x: FloatArray) -> None:
    """Solve in place with the factors; row i of the band is entry ``order[i]`` of ``x``."""
    _forward(band, order, work, x)
    _backward(band, order, work, x)


@kernel
def band_forward(
    band: FloatArray, order: IntArray, work: FloatArray, begin: int, below: FloatArray,
    x: FloatArray,
) -> None:  # fmt: skip
    """The first half of :func:`band_solve`, and elimination from rows beyond the band, the last.

    ``begin`` and ``below`` are those after :func:`band_eliminate`.
    """
    _forward(band, order, work, x)
    n = order.size
    for i in range(n):
        x[order[i]] = work[i]
    for i in range(begin, n):
        for c in range(below.shape[1]):
            x[n + c] -= below[i - begin, c] * work[i]


@kernel
def band_backward(
    band: FloatArray, order: IntArray, work: FloatArray, begin: int, right: FloatArray,
    x: FloatArray,
) -> None:  # fmt: skip
    """The second half, with the solution of the rows beyond the band."""
    n = order.size
    for i in range(n):
        work[i] = x[order[i]]
    for i in range(begin, n):
        for c in range(right.shape[1]):
            work[i] -= right[i - begin, c] * x[n + c]
    _backward(band, order, work, x)


@subroutine
def _forward(band: FloatArray, order: IntArray, work: FloatArray, x: FloatArray) -> None:
    n, width = band.shape
    b = width // 2
    for i in range(n):
        total = x[order[i]]
        for k in range(max(0, i - b), i):
            total -= band[i, k - i + b] * work[k]
        work[i] = total


@subroutine
def _backward(band: FloatArray, order: IntArray, work: FloatArray, x: FloatArray) -> None:
    n, width = band.shape
    b = width // 2
    for i in range(n - 1, -1, -1):
        total = work[i]
        for k in range(i + 1, min(i + b + 1, n)):
            total -= band[i, k - i + b] * work[k]
        work[i] = total / band[i, b]
        x[order[i]] = work[i]


@kernel
def band_eliminate(
    band: FloatArray, begin: int, right: FloatArray, below: FloatArray, complement: FloatArray
) -> None:
    """Eliminate the rows of the band from rows beyond it.

    Args:
        band: factors ``L U``.
        begin: first row that is coupled.
        right: (n - begin, k) columns of the rows beyond from there on; L^-1 of them afterwards.
        below: transposed rows likewise; U^-T of them afterwards.
        complement: (k, k) entries of the rows beyond; the Schur complement afterwards.
    """
    n, width = band.shape
    b = width // 2
    for i in range(begin, n):
        for k in range(max(begin, i - b), i):
            lower, upper = band[i, k - i + b], band[k, i - k + b]
            for c in range(right.shape[1]):
                right[i - begin, c] -= lower * right[k - begin, c]
                below[i - begin, c] -= upper * below[k - begin, c]
        for c in range(right.shape[1]):
            below[i - begin, c] /= band[i, b]
        for c in range(right.shape[1]):
            factor = below[i - begin, c]
            for d in range(right.shape[1]):
                complement[c, d] -= factor * right[i - begin, d]
