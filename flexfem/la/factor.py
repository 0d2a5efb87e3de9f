# SPDX-License-Identifier: LGPL-3.0-or-later
"""Factors of a distributed matrix that are kept over many solves."""

from petsc4py import PETSc

import numpy as np

from flexfem._types import FloatArray

__all__ = ["Factor"]


class Factor:
    """LU factors of a matrix of dense blocks.

    When no rank couples to another (bodies are whole), every rank factorises its own part with
    PETSc's blocked LU: a solve streams the factors once and sends nothing. Otherwise MUMPS
    factorises the distributed matrix.
    """

    def __init__(self, matrix: PETSc.Mat, width: int, local: bool) -> None:
        """Factorise (collective).

        Args:
            matrix: assembled AIJ matrix.
            width: rows of a block.
            local: no rank has entries in another rank's columns.
        """
        self._pc = PETSc.PC()
        self.size = matrix.getLocalSize()[0]
        if local:
            diagonal = matrix.getDiagonalBlock()
            diagonal.setBlockSize(width)
            self._matrix = diagonal.convert("baij", PETSc.Mat())
            self._pc.create(comm=PETSc.COMM_SELF)
            self._pc.setType(PETSc.PC.Type.LU)
            # the mesh numbers its nodes along the bodies already
            self._pc.setFactorOrdering("natural")
        else:
            self._matrix = matrix
            self._pc.create(comm=matrix.comm)
            self._pc.setType(PETSc.PC.Type.LU)
            self._pc.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        self._pc.setOperators(self._matrix)
        self._pc.setUp()
        self._factor = self._pc.getFactorMatrix()
        self._arrays: dict[int, tuple[PETSc.Vec, FloatArray]] = {}

    def solve(self, rhs: FloatArray, solution: FloatArray) -> None:
        """Solve for contiguous arrays of this rank's rows (collective unless local).

        Arrays are kept as long as the factors: pass the same ones again.
        """
        if self.size == 0 and self._matrix.comm.size == 1:
            return
        self._factor.solve(self._vec(rhs), self._vec(solution))

    def solve_transpose(self, rhs: FloatArray, solution: FloatArray) -> None:
        """Solve with the transposed matrix; arguments as for :meth:`solve`."""
        if self.size == 0 and self._matrix.comm.size == 1:
            return
        self._factor.solveTranspose(self._vec(rhs), self._vec(solution))

    def _vec(self, array: FloatArray) -> PETSc.Vec:
        """PETSc vector over the memory of an array."""
        key = id(array)  # its own as long as the array is kept
        if key not in self._arrays:
            flat = array.ravel()[: self.size]
            assert np.shares_memory(flat, array) or self.size == 0
            vec = PETSc.Vec().createWithArray(flat, comm=self._matrix.comm)
            self._arrays[key] = (vec, array)
        return self._arrays[key][0]
