# SPDX-License-Identifier: LGPL-3.0-or-later
"""Factors of a distributed matrix that are kept over many solves."""

from collections.abc import Callable

from petsc4py import PETSc

import numpy as np

from flexfem._types import FloatArray
from flexfem.la.whole import WholeMatrix, taken_whole

__all__ = ["Factor"]


#: Rows of a body from which MUMPS factorises faster (with equal times of a solve): a plate of
#: 4000 rows takes 11 ms by either, one of 30,000 rows 0.4 s instead of 1.8 s.
_LARGE = 6000


class Factor:
    """LU factors of a matrix of dense blocks.

    When no rank couples to another (bodies are whole), every rank factorises its own part. With
    PETSc's blocked LU a solve of small bodies streams the factors once and sends nothing; MUMPS
    factorises large ones, and those that are distributed; small ones of these on every rank.
    """

    def __init__(
        self, matrix: PETSc.Mat, width: int, local: bool, *, chained: bool = True, largest: int = 0
    ) -> None:
        """Factorise (collective).

        Args:
            matrix: assembled AIJ matrix.
            width: rows of a block.
            local: no rank has entries in another rank's columns.
            chained: the rows follow one another along lines, which is a good order of elimination.
            largest: rows of the largest body on this rank, where they do not.
        """
        self._pc = PETSc.PC()
        self.size = matrix.getLocalSize()[0]
        self._matrix = matrix.getDiagonalBlock() if local else matrix
        self._comm = self._matrix.comm
        self._whole: WholeMatrix | None = None
        if taken_whole(self._matrix):
            self._whole = WholeMatrix(self._matrix)
            self._matrix = self._whole.update(self._matrix)
        self._pc.create(comm=self._matrix.comm)
        self._pc.setType(PETSc.PC.Type.LU)
        if local and (chained or largest <= _LARGE):
            self._matrix.setBlockSize(width)
            self._matrix = self._matrix.convert("baij", PETSc.Mat())
            # minimum degree fills surfaces less than any order of their nodes
            self._pc.setFactorOrdering("natural" if chained else "qmd")
        else:
            self._pc.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        self._pc.setOperators(self._matrix)
        self._pc.setUp()
        self._factor = self._pc.getFactorMatrix()
        self._arrays: dict[int, tuple[PETSc.Vec, FloatArray]] = {}

    @property
    def entries(self) -> int:
        """Numbers stored on this rank, which a solve reads; all of them on rank 0 with MUMPS."""
        if self._factor.getType() == "mumps":
            return int(self._factor.getMumpsInfog(29)) if self._comm.rank == 0 else 0
        return int(self._factor.getInfo()["nz_used"])

    def solve(self, rhs: FloatArray, solution: FloatArray) -> None:
        """Solve for contiguous arrays of this rank's rows (collective unless local).

        Arrays are kept as long as the factors: pass the same ones again.
        """
        self._apply(self._factor.solve, rhs, solution)

    def solve_transpose(self, rhs: FloatArray, solution: FloatArray) -> None:
        """Solve with the transposed matrix; arguments as for :meth:`solve`."""
        self._apply(self._factor.solveTranspose, rhs, solution)

    def _apply(
        self, solve: Callable[[PETSc.Vec, PETSc.Vec], None], rhs: FloatArray, solution: FloatArray
    ) -> None:
        if self._whole is not None:
            solution.ravel()[: self.size] = self._whole.solve(solve, rhs.ravel()[: self.size])
        elif self.size or self._comm.size > 1:
            solve(self._vec(rhs), self._vec(solution))

    def _vec(self, array: FloatArray) -> PETSc.Vec:
        """PETSc vector over the memory of an array."""
        key = id(array)  # its own as long as the array is kept
        if key not in self._arrays:
            flat = array.ravel()[: self.size]
            assert np.shares_memory(flat, array) or self.size == 0
            vec = PETSc.Vec().createWithArray(flat, comm=self._comm)
            self._arrays[key] = (vec, array)
        return self._arrays[key][0]
