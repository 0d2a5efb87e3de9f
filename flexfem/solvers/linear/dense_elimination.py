# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elimination of the first rows of a full matrix by LAPACK."""

import numpy as np
from scipy.linalg.lapack import dgetrf, dgetrs

from flexfem._types import FloatArray
from flexfem.la.dense import SMALLEST_PIVOT

__all__ = ["DenseElimination"]


class DenseElimination:
    """LU factors of the first rows of a full matrix, and the Schur complement of the others.

    Attributes:
        complement: (n, n) Schur complement of the other rows, after :meth:`eliminate`.
        operations: numbers of floating-point operations of a factorisation and of a solve.
    """

    def __init__(self, count: int, size: int) -> None:
        """Number of rows to eliminate, the first ones, and number of all rows."""
        self._count = count
        left = size - count
        self.complement = np.zeros((left, left))
        factor = 2.0 * count * (count**2 / 3.0 + left * (count + left))
        self.operations = factor, 2.0 * count * (count + 2.0 * left)

    def eliminate(self, matrix: FloatArray) -> bool:
        """Factorise a full (size, size) matrix; False if it is singular."""
        n = self._count
        if n == 0:
            self.complement = matrix
            return True
        # LAPACK's order of entries is the transposed one
        first = np.ascontiguousarray(matrix[:n, :n])
        largest = np.abs(first).max()
        self._factors, self._pivots, _ = dgetrf(first.T, overwrite_a=True)
        pivots = np.abs(np.diagonal(self._factors))
        if not (pivots > SMALLEST_PIVOT * largest).all():
            return False
        if len(matrix) > n:
            self._columns = dgetrs(self._factors, self._pivots, matrix[:n, n:], trans=1)[0]
            self._from_first = matrix[n:, :n]
            self.complement = matrix[n:, n:] - self._from_first @ self._columns
        return True

    def reduce(self, x: FloatArray) -> None:
        """Eliminate from a right-hand side: the other rows get that of the complement."""
        n = self._count
        if n == 0:
            return
        x[:n] = dgetrs(self._factors, self._pivots, x[:n], trans=1)[0]
        if len(x) > n:
            x[n:] -= self._from_first @ x[:n]

    def complete(self, x: FloatArray) -> None:
        """Solve for the first rows after :meth:`reduce`; the others contain their solution."""
        if 0 < self._count < len(x):
            x[: self._count] -= self._columns @ x[self._count :]
