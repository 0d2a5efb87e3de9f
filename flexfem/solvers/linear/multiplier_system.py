# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interface system: the dual Schur complement of the multipliers, distributed over the ranks.

Every rank has the entries between the rows that it evaluates. It eliminates its unshared rows; the
complement on the rows shared with other ranks is summed by one reduction and solved everywhere.
"""

from typing import Protocol

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from scipy.linalg.lapack import dgetrf, dgetrs

from flexfem._types import FloatArray, IntArray
from flexfem.kernels.compiled import kernel
from flexfem.kernels.sequence import Call
from flexfem.la.dense import SMALLEST_PIVOT
from flexfem.solvers.linear.banded import band_factor, band_solve
from flexfem.solvers.linear.multifrontal import Fronts

__all__ = ["InterfaceSystem"]

#: Part of all entries from which LAPACK's dense factors are faster than any sparse ones.
_FULL = 0.4
#: Half bandwidth up to which a banded factorisation is faster than a multifrontal one.
_WIDEST = 64


class _Elimination(Protocol):
    """Elimination of the first rows of a matrix.

    Attributes:
        complement: (n, n) Schur complement of the other rows, after :meth:`factor`.
    """

    complement: FloatArray

    def factor(self, values: FloatArray) -> bool:
        """Factorise the matrix of the given entries; False if it is singular."""
        ...

    def reduce(self, x: FloatArray) -> None:
        """Eliminate from a right-hand side: the other rows get that of the complement."""
        ...

    def complete(self, x: FloatArray) -> None:
        """Solve for the first rows after :meth:`reduce`; the others contain their solution."""
        ...


@kernel
def _scatter_add(index: IntArray, select: IntArray, values: FloatArray, out: FloatArray) -> None:
    """``out[index[k]] += values[select[k]]``."""
    for k in range(index.size):
        out[index[k]] += values[select[k]]


class Band:
    """Elimination in the order of reverse Cuthill and McKee: narrow bands for chains and trees."""

    def __init__(self, i: IntArray, j: IntArray, order: IntArray, half: int, size: int) -> None:
        """Entries (i, j), order of the first rows, their half bandwidth then, number of rows."""
        count = len(order)
        left = size - count
        rank = np.empty(size, dtype=np.int64)
        rank[order], rank[count:] = np.arange(count), np.arange(left)
        first, last = i < count, j < count
        inner = first & last
        self._inner = None if inner.all() else np.flatnonzero(inner)
        self._order, self._work, self._left = order, np.empty(count), left
        self._band = np.zeros((count, 2 * half + 1))
        self._index = (rank[i] * (2 * half + 1) + rank[j] - rank[i] + half)[inner]
        self._blocks = []
        for rows, columns, shape in (
            (first, ~last, (count, left)), (~first, last, (left, count)),
            (~first, ~last, (left, left)),
        ):  # fmt: skip
            select = np.flatnonzero(rows & columns)
            index = np.where(first, i, i - count) * shape[1] + np.where(last, j, j - count)
            self._blocks.append((index[select], select, np.zeros(shape)))
        self._to_left, self._from_first, self.complement = (b[2] for b in self._blocks)

    def factor_call(self, values: FloatArray) -> Call:
        """Call of the loop of :meth:`factor`, if all rows are eliminated."""
        return Call(band_factor, self._index, values, self._band)

    def solve_call(self, x: FloatArray) -> Call:
        """Call of the loop of :meth:`reduce`, if all rows are eliminated."""
        return Call(band_solve, self._band, self._order, self._work, x)

    @property
    def whole(self) -> bool:
        """True if all rows are eliminated."""
        return self._left == 0 and self._inner is None

    def factor(self, values: FloatArray) -> bool:
        """See :class:`_Elimination`."""
        inner = values if self._inner is None else values[self._inner]
        regular: bool = band_factor(self._index, inner, self._band)
        if regular and self._left:
            for index, select, out in self._blocks:
                out[:] = 0.0
                _scatter_add(index, select, values, out.reshape(-1))
            self._columns = np.ascontiguousarray(self._to_left.T)
            for column in self._columns:
                band_solve(self._band, self._order, self._work, column)
            self.complement -= self._from_first @ self._columns.T
        return regular

    def reduce(self, x: FloatArray) -> None:
        """See :class:`_Elimination`."""
        band_solve(self._band, self._order, self._work, x)
        if self._left:
            x[len(self._order) :] -= self._from_first @ x[: len(self._order)]

    def complete(self, x: FloatArray) -> None:
        """See :class:`_Elimination`."""
        if self._left:
            x[: len(self._order)] -= self._columns.T @ x[len(self._order) :]


def _factors(matrix: FloatArray) -> tuple[FloatArray, IntArray, bool]:
    """LAPACK's factors of the transposed matrix, with their pivots; False if it is singular.

    Its order of entries is the transposed one: a contiguous matrix is overwritten by its factors.
    """
    largest = np.abs(matrix).max(initial=0.0)
    factors, pivots, _ = dgetrf(matrix.T, overwrite_a=True)
    return factors, pivots, bool((np.abs(np.diagonal(factors)) > SMALLEST_PIVOT * largest).all())


class _Dense:
    """Elimination by LAPACK: bodies that are bonded by many nodes couple all of their rows."""

    def __init__(self, i: IntArray, j: IntArray, count: int, size: int) -> None:
        """Entries (i, j), number of the first rows, number of rows."""
        self._index, self._count, self._size = i * size + j, count, size
        self.complement = np.zeros((size - count, size - count))

    def factor(self, values: FloatArray) -> bool:
        """See :class:`_Elimination`."""
        n, size = self._count, self._size
        matrix = np.bincount(self._index, values, size * size).reshape(size, size)
        self._factors, self._pivots, regular = _factors(matrix[:n, :n])
        if regular and size > n:
            self._columns = dgetrs(self._factors, self._pivots, matrix[:n, n:], trans=1)[0]
            self._from_first = matrix[n:, :n]
            self.complement = matrix[n:, n:] - self._from_first @ self._columns
        return regular

    def reduce(self, x: FloatArray) -> None:
        """See :class:`_Elimination`."""
        n = self._count
        x[:n] = dgetrs(self._factors, self._pivots, x[:n], trans=1)[0]
        if len(x) > n:
            x[n:] -= self._from_first @ x[:n]

    def complete(self, x: FloatArray) -> None:
        """See :class:`_Elimination`."""
        if len(x) > self._count:
            x[: self._count] -= self._columns @ x[self._count :]


def _is_full(first: IntArray, second: IntArray, count: int) -> bool:
    """True if the entries fill most of a matrix that is not small."""
    if count <= _WIDEST or len(first) < _FULL * count**2:
        return False
    filled = np.zeros((count, count), dtype=np.bool_)
    filled[first, second] = True
    return bool(filled.mean() >= _FULL)


def _elimination(i: IntArray, j: IntArray, count: int, size: int) -> _Elimination:
    """Elimination of the first rows: dense, banded if their order allows it, or by fronts."""
    inner = (i < count) & (j < count)
    first, second = i[inner], j[inner]
    if _is_full(first, second, count):
        return _Dense(i, j, count, size)
    order = _ordering("rcm", first, second, count)
    rank = np.empty(count, dtype=np.int64)
    rank[order] = np.arange(count)
    half = int(np.abs(rank[first] - rank[second]).max(initial=0))
    if half <= _WIDEST:
        return Band(i, j, order, half, size)
    # minimum degree: for some thousand rows of trees, lattices and grids less fill than dissection;
    # the other rows form a full matrix, so that rows coupled to them come late
    others = np.arange(count, size)
    full = np.repeat(others, len(others)), np.tile(others, len(others))
    order = _ordering("qmd", np.concatenate([i, full[0]]), np.concatenate([j, full[1]]), size)
    return Fronts(i, j, order[order < count], size)


def _ordering(kind: str, i: IntArray, j: IntArray, size: int) -> IntArray:
    """Sequence of elimination of the rows of a matrix with the given entries."""
    matrix = PETSc.Mat().createAIJ((size, size), comm=PETSc.COMM_SELF)
    matrix.setPreallocationCOO(i.astype(PETSc.IntType), j.astype(PETSc.IntType))
    matrix.setValuesCOO(np.ones(len(i)), PETSc.InsertMode.INSERT)
    return np.array(matrix.getOrdering(kind)[0].getIndices(), dtype=np.int64)


class InterfaceSystem:
    """Solver of the multipliers' system."""

    def __init__(
        self, comm: MPI.Intracomm, i: IntArray, j: IntArray, interior: int,
        shared: IntArray, shared_size: int,
    ) -> None:  # fmt: skip
        """Set up the pattern.

        Args:
            comm: communicator.
            i: row of every entry, numbered on this rank.
            j: its column.
            interior: number of rows of this rank alone, the first ones.
            shared: number of each other row among the shared rows of all ranks.
            shared_size: number of shared rows of all ranks.
        """
        self._comm, self._count = comm, interior
        self._sharing = shared_size > 0
        self._own = _elimination(i, j, interior, interior + len(shared))
        self._shared, self._grid = shared, np.ix_(shared, shared)
        # the complement on the shared rows and a flag of failure, for one reduction
        self._buffer = np.zeros(shared_size**2 + 1)
        self._matrix = self._buffer[:-1].reshape(shared_size, shared_size)
        self._vector = np.zeros(shared_size)

    @property
    def band(self) -> Band | None:
        """The factors if this rank alone has the rows, in a narrow band."""
        own = self._own
        alone = self._comm.size == 1 and not self._sharing
        return own if alone and isinstance(own, Band) and own.whole else None

    def factor(self, values: FloatArray, regular: bool = True) -> bool:
        """Factorise (collective); False on all ranks when the system is singular on one.

        Args:
            values: one number per entry of the pattern.
            regular: False if this rank's part is singular.
        """
        regular = self._own.factor(values) and regular
        if self._comm.size == 1 and not self._sharing:
            return regular
        self._buffer[:] = 0.0
        self._matrix[self._grid] = self._own.complement
        self._buffer[-1] = 0.0 if regular else 1.0
        self._comm.Allreduce(MPI.IN_PLACE, self._buffer, op=MPI.SUM)
        if not self._sharing or self._buffer[-1] > 0.0:
            return bool(self._buffer[-1] == 0.0)
        self._factors, self._pivots, regular = _factors(self._matrix)
        return regular

    def solve(self, right: FloatArray) -> None:
        """Solve in place for this rank's part of the right-hand side (collective if shared)."""
        self._own.reduce(right)
        if self._sharing:
            self._vector[:] = 0.0
            self._vector[self._shared] = right[self._count :]
            self._comm.Allreduce(MPI.IN_PLACE, self._vector, op=MPI.SUM)
            dgetrs(self._factors, self._pivots, self._vector, trans=1, overwrite_b=True)
            right[self._count :] = self._vector[self._shared]
        self._own.complete(right)
