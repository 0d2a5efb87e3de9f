# SPDX-License-Identifier: LGPL-3.0-or-later
"""Small distributed matrices, whole on every rank.

MUMPS sends hundreds of messages for a solve on several ranks, most of them to wait for. That is
worth it for large matrices only: of small ones every rank takes a copy, one message from each rank,
and factorises it by itself.
"""

from collections.abc import Callable

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from flexfem._types import FloatArray, IntArray

__all__ = ["WholeMatrix", "taken_whole"]

#: Rows up to which every rank factorises a copy: some milliseconds at most.
LARGEST = 3000


def taken_whole(matrix: PETSc.Mat) -> bool:
    """Return True if every rank takes a copy of a matrix: it is distributed, and small."""
    return bool(matrix.comm.size > 1 and matrix.getSize()[0] <= LARGEST)


class WholeMatrix:
    """Copies of square distributed matrices of one size, AIJ or nests of AIJ.

    Rows are those of rank 0, those of rank 1 and so on, as vectors hold them.

    Attributes:
        matrix: the copy, with the numbers of the last :meth:`update`.
    """

    def __init__(self, matrix: PETSc.Mat) -> None:
        """Find the rows of every rank, before any copy (no message)."""
        self._comm: MPI.Intracomm = matrix.comm.tompi4py()
        # (blocks, ranks + 1) first row of every rank
        self._first = np.array([row[0].getOwnershipRanges() for row in _blocks(matrix)], np.int64)
        sizes = np.diff(self._first, axis=1)
        self._counts = sizes.sum(axis=0)
        start = np.cumsum(self._counts) - self._counts
        # (blocks, ranks) rows of a block on a rank begin here in the copy
        self._begin = start + np.cumsum(sizes, axis=0) - sizes
        self._own = slice(start[self._comm.rank], start[self._comm.rank] + matrix.getLocalSize()[0])
        self._pattern: list[IntArray] = []
        self.matrix: PETSc.Mat | None = None

    def update(self, matrix: PETSc.Mat) -> PETSc.Mat:
        """Take the numbers of a matrix (collective)."""
        grid = [[block.getValuesCSR() for block in row] for row in _blocks(matrix)]
        pattern = [part for row in grid for block in row for part in block[:2]]
        known = len(pattern) == len(self._pattern) and all(
            np.array_equal(new, old) for new, old in zip(pattern, self._pattern, strict=True)
        )
        if not self._comm.allreduce(known, op=MPI.LAND):
            self._create([[block[:2] for block in row] for row in grid])
            self._pattern = pattern
        assert self.matrix is not None
        values = np.concatenate([block[2] for row in grid for block in row])
        self.matrix.setValuesCOO(self._gathered(values, self._entries), PETSc.InsertMode.INSERT)
        return self.matrix

    def rows(self, own: FloatArray) -> FloatArray:
        """All rows (n, ...) from those of this rank (collective)."""
        return self._gathered(own, self._counts)

    def own(self, rows: FloatArray) -> FloatArray:
        """This rank's rows of all (n, ...)."""
        return rows[self._own]

    def solve(
        self, solve: Callable[[PETSc.Vec, PETSc.Vec], object], right: FloatArray
    ) -> FloatArray:
        """This rank's rows of a solution from those of the right-hand side (collective).

        Args:
            solve: solves with the copy.
            right: (n_own,) right-hand side.
        """
        every = PETSc.Vec().createWithArray(self.rows(right), comm=PETSc.COMM_SELF)
        found = every.duplicate()
        solve(every, found)
        return np.array(self.own(found.getArray(readonly=True)))

    def _create(self, grid: list[list[tuple[IntArray, IntArray]]]) -> None:
        """Create the copy for blocks' own rows, (starts, columns) each (collective)."""
        rows, columns = [], []
        for i, line in enumerate(grid):
            for j, (start, column) in enumerate(line):
                row = self._begin[i, self._comm.rank] + np.arange(len(start) - 1)
                rows.append(np.repeat(row, np.diff(start)))
                # ranks without rows begin where the next one does, which owns the row
                owner = np.searchsorted(self._first[j], column, side="right") - 1
                columns.append(self._begin[j, owner] + column - self._first[j, owner])
        own = np.concatenate(rows), np.concatenate(columns)
        self._entries = np.array(self._comm.allgather(len(own[0])))
        every = [self._gathered(k.astype(PETSc.IntType), self._entries) for k in own]
        size = int(self._counts.sum())
        self.matrix = PETSc.Mat().createAIJ((size, size), comm=PETSc.COMM_SELF)
        self.matrix.setPreallocationCOO(*every)

    def _gathered(self, own: np.ndarray, counts: IntArray) -> np.ndarray:
        """Arrays (count, ...) of all ranks, one after the other (collective)."""
        every = np.empty((counts.sum(), *own.shape[1:]), own.dtype)
        width = int(np.prod(own.shape[1:], dtype=np.int64))
        self._comm.Allgatherv(np.ascontiguousarray(own), (every, (counts * width).tolist()))
        return every


def _blocks(matrix: PETSc.Mat) -> list[list[PETSc.Mat]]:
    if matrix.getType() != PETSc.Mat.Type.NEST:
        return [[matrix]]
    rows, columns = matrix.getNestSize()
    return [[matrix.getNestSubMatrix(i, j) for j in range(columns)] for i in range(rows)]
