# SPDX-License-Identifier: LGPL-3.0-or-later
"""The small linear system of the multipliers, distributed over the ranks.

Every rank holds entries between the rows that it evaluates. It eliminates the rows of its own; the
complement on the rows shared with other ranks is summed by one reduction and solved everywhere.
"""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.lie.compiled import kernel
from flexfem.solvers.banded import band_factor, band_solve
from flexfem.solvers.schur_kernels import lu_factor, lu_solve

__all__ = ["InterfaceSystem"]

#: Up to this half bandwidth a banded factorisation beats a sparse one.
_WIDEST = 64


@kernel
def _scatter_add(index: IntArray, select: IntArray, values: FloatArray, out: FloatArray) -> None:
    """``out[index[k]] += values[select[k]]``."""
    for k in range(index.size):
        out[index[k]] += values[select[k]]


class _BandedInterior:
    """Rows in the order of reverse Cuthill and McKee, which makes chains and trees narrow."""

    def __init__(self, i: IntArray, j: IntArray, order: IntArray, half: int) -> None:
        """Entries (i, j) in the new order, the old rows in this order, half bandwidth."""
        self._order = order
        self._band = np.zeros((len(order), 2 * half + 1))
        self._index = i * (2 * half + 1) + j - i + half
        self._work = np.empty(len(order))

    def factor(self, values: FloatArray) -> bool:
        regular: bool = band_factor(self._index, values, self._band)
        return regular

    def solve(self, x: FloatArray) -> None:
        band_solve(self._band, self._order, self._work, x)


class _SparseInterior:
    def __init__(self, i: IntArray, j: IntArray, size: int) -> None:
        self._matrix = _matrix(i, j, size)
        self._pc = PETSc.PC().create(comm=PETSc.COMM_SELF)
        self._pc.setType(PETSc.PC.Type.LU)
        # up to some thousand rows of trees, lattices and grids faster than nested dissection
        self._pc.setFactorOrdering("qmd")
        self._pc.setOperators(self._matrix)
        self._rhs, self._solution = self._matrix.createVecs()

    def factor(self, values: FloatArray) -> bool:
        self._matrix.setValuesCOO(values, PETSc.InsertMode.INSERT)
        self._pc.setOperators(self._matrix)
        self._pc.setUp()
        return bool(self._pc.getFailedReason() == 0)

    def solve(self, x: FloatArray) -> None:
        self._rhs.setArray(x)
        self._pc.apply(self._rhs, self._solution)
        x[:] = self._solution.getArray(readonly=True)


def _matrix(i: IntArray, j: IntArray, size: int) -> PETSc.Mat:
    matrix = PETSc.Mat().createAIJ((size, size), comm=PETSc.COMM_SELF)
    kind = PETSc.IntType
    matrix.setPreallocationCOO(i.astype(kind), j.astype(kind))
    return matrix


def _interior(i: IntArray, j: IntArray, size: int) -> _BandedInterior | _SparseInterior:
    """Solver for the rows of this rank alone."""
    matrix = _matrix(i, j, size)
    matrix.setValuesCOO(np.ones(len(i)), PETSc.InsertMode.INSERT)
    order = np.array(matrix.getOrdering("rcm")[0].getIndices(), dtype=np.int64)
    rank = np.empty(size, dtype=np.int64)
    rank[order] = np.arange(size)
    half = int(np.abs(rank[i] - rank[j]).max(initial=0))
    if half <= _WIDEST:
        return _BandedInterior(rank[i], rank[j], order, half)
    return _SparseInterior(i, j, size)


class InterfaceSystem:
    """Solver of the multipliers' system.

    Attributes:
        sparse: the rows of this rank alone are no narrow band, which makes factors costly.
    """

    def __init__(
        self, comm: MPI.Intracomm, i: IntArray, j: IntArray, interior: int,
        shared: IntArray, shared_size: int,
    ) -> None:  # fmt: skip
        """Set up the pattern.

        Args:
            comm: communicator.
            i: row of every entry, numbered on this rank.
            j: its column.
            interior: number of rows of this rank alone; they come first.
            shared: number of each other row among the shared rows of all ranks.
            shared_size: number of shared rows of all ranks.
        """
        self._comm, self._count = comm, interior
        inner = (i < interior) & (j < interior)
        self._inner = np.flatnonzero(inner)
        if interior:
            self._interior = _interior(i[inner], j[inner], interior)
        self.sparse = interior > 0 and isinstance(self._interior, _SparseInterior)
        self._whole = bool(inner.all())
        self._shared, self._shared_size = shared, shared_size
        outer = len(shared)
        self._blocks = []
        for rows, columns, shape in (
            (i < interior, j >= interior, (interior, outer)),
            (i >= interior, j < interior, (outer, interior)),
            (i >= interior, j >= interior, (outer, outer)),
        ):
            select = np.flatnonzero(rows & columns)
            at = np.where(i[select] >= interior, i[select] - interior, i[select])
            to = np.where(j[select] >= interior, j[select] - interior, j[select])
            self._blocks.append((at * shape[1] + to, select, np.zeros(shape)))
        # the complement on the shared rows and a flag of failure, for one reduction
        self._buffer = np.zeros(shared_size**2 + 1)
        self._matrix = self._buffer[:-1].reshape(shared_size, shared_size)
        self._vector = np.zeros(shared_size)
        self._pivots = np.zeros(shared_size, dtype=np.int64)

    def factor(self, values: FloatArray, regular: bool = True) -> bool:
        """Factorise (collective); False on all ranks when the system is singular on one.

        Args:
            values: one number per entry of the pattern.
            regular: what this rank knows already.
        """
        inner = values if self._whole else values[self._inner]
        if self._count:
            regular = self._interior.factor(inner) and regular
        if self._comm.size == 1 and self._shared_size == 0:
            return regular
        self._buffer[:] = 0.0
        if self._shared_size:
            self._gather_shared(values, regular)
        self._buffer[-1] = 0.0 if regular else 1.0
        self._comm.Allreduce(MPI.IN_PLACE, self._buffer, op=MPI.SUM)
        return bool(lu_factor(self._matrix, self._pivots)) and self._buffer[-1] == 0.0

    def _gather_shared(self, values: FloatArray, regular: bool) -> None:
        """This rank's part of the complement on the shared rows."""
        for index, select, out in self._blocks:
            out[:] = 0.0
            _scatter_add(index, select, values, out.reshape(-1))
        to_outer, self._from_inner, outer = (b[2] for b in self._blocks)
        self._columns = np.ascontiguousarray(to_outer.T)
        if self._count and regular:
            for column in self._columns:
                self._interior.solve(column)
            outer -= self._from_inner @ self._columns.T
        self._matrix[np.ix_(self._shared, self._shared)] = outer

    def solve(self, right: FloatArray) -> None:
        """Solve in place for this rank's part of the right-hand side (collective if shared)."""
        if self._shared_size == 0:
            if self._count:
                self._interior.solve(right)
            return
        own, other = right[: self._count], right[self._count :]
        if self._count:
            self._interior.solve(own)
            other -= self._from_inner @ own
        self._vector[:] = 0.0
        self._vector[self._shared] = other
        self._comm.Allreduce(MPI.IN_PLACE, self._vector, op=MPI.SUM)
        lu_solve(self._matrix, self._pivots, self._vector)
        other[:] = self._vector[self._shared]
        own -= self._columns.T @ other
