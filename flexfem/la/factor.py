# SPDX-License-Identifier: LGPL-3.0-or-later
"""Factors of a distributed matrix that are kept over many solves."""

import ctypes
from collections.abc import Callable
from functools import cache, partial

from petsc4py import PETSc

import numpy as np

from flexfem._types import FloatArray
from flexfem.la.whole import WholeMatrix, taken_whole

__all__ = ["Factor", "is_symmetric"]


#: Right-hand sides that MUMPS solves for together, which reads its factors once for all of them.
_TOGETHER = 32
#: Right-hand sides of so many numbers for each that is not zero are given to MUMPS without zeros:
#: unit forces on 50,000 unknowns take 1.9 ms instead of 4.3 ms each.
_SPARSE = 100
#: MUMPS solves with the transposed matrix where this parameter is not 1.
_TRANSPOSED = 9
#: Rows of a body from which MUMPS factorises faster (with equal times of a solve): a plate of
#: 4000 rows takes 11 ms by either, one of 30,000 rows 0.4 s instead of 1.8 s.
_LARGE = 6000
#: Root of the difference of two entries ``i, j`` and ``j, i`` by rounding, relative to the roots of
#: the diagonal entries.
_ROUNDING = 1e-6


class Factor:
    """LU factors of a matrix of dense blocks.

    When no rank couples to another (bodies are whole), every rank factorises its own part. With
    PETSc's blocked LU a solve of small bodies streams the factors once and sends nothing; MUMPS
    factorises large ones, and those that are distributed; small ones of these on every rank. Of a
    large symmetric matrix there are half as many factors, ``L D L^T``.
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
        # the caller's is overwritten by the next one
        self._product = matrix.copy() if chained and not local else None
        self._pc.create(comm=self._matrix.comm)
        small = local and (chained or largest <= _LARGE)
        self._symmetric = local and not small and is_symmetric(self._matrix)
        self._pc.setType(PETSc.PC.Type.CHOLESKY if self._symmetric else PETSc.PC.Type.LU)
        if small:
            self._matrix.setBlockSize(width)
            self._matrix = self._product = self._matrix.convert("baij", PETSc.Mat())
            # minimum degree fills surfaces less than any order of their nodes
            self._pc.setFactorOrdering("natural" if chained else "qmd")
        else:
            self._pc.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        self._pc.setOperators(self._matrix)
        self._pc.setUp()
        self._factor = self._pc.getFactorMatrix()
        if local and not small:
            self._pc.destroy()  # and with it the matrix, which MUMPS does not read again
            del self._matrix

    @property
    def kept(self) -> bool:
        """True if the matrix is kept beside its factors, see :meth:`multiplier`."""
        return self._product is not None

    @property
    def entries(self) -> int:
        """Numbers that a solve reads on this rank, twice if symmetric; on rank 0 with MUMPS."""
        if self._factor.getType() == "mumps":
            stored = int(self._factor.getMumpsInfog(29)) if self._comm.rank == 0 else 0
            if stored < 0:  # in millions, of very many
                stored *= -1_000_000
            return 2 * stored if self._symmetric else stored
        return int(self._factor.getInfo()["nz_used"])

    @property
    def together(self) -> int:
        """Number of right-hand sides that are quickly solved for together."""
        mumps = self._whole is None and self._factor.getType() == "mumps"
        return _TOGETHER if mumps else 1

    def solver(
        self, rhs: FloatArray, solution: FloatArray, *, transposed: bool = False,
        lasting: bool = False,
    ) -> Callable[[], None]:  # fmt: skip
        """Solve from one array to another, to be called again and again.

        A call is collective unless the factors are local.

        Args:
            rhs: contiguous, of this rank's rows; read in every call.
            solution: likewise, written in every call.
            transposed: solve with the transposed matrix.
            lasting: the solutions are kept, and are not corrected by later ones: no difference
                here, but to iterative solvers.
        """
        solve = self._factor.solveTranspose if transposed else self._factor.solve
        if self._whole is not None:
            return partial(_solve_whole, self._whole, solve, self._rows(rhs), self._rows(solution))
        if self.size == 0 and self._comm.size == 1:
            return _nothing
        vectors = (
            PETSc.Vec().createWithArray(self._rows(x), comm=self._comm) for x in (rhs, solution)
        )
        # PETSc's own call, without a frame between: it is one of the most frequent of a run
        return partial(solve, *vectors)

    def foreign_solver(
        self, rhs: FloatArray, solution: FloatArray
    ) -> tuple[int, list[int], Callable[[], None]] | None:
        """Address of PETSc's function, the pointers it takes, and the same solve from Python.

        None where a solve is more than one call.
        """
        solve = self.solver(rhs, solution)
        if not isinstance(solve, partial) or self._whole is not None:
            return None
        return _mat_solve(), [one.handle for one in (self._factor, *solve.args)], solve

    def solve_columns(
        self, right: FloatArray, solution: FloatArray, *, transposed: bool = False
    ) -> None:
        """Solve for several right-hand sides, whose solutions are kept (collective as a solve).

        Args:
            right: (k, ...) contiguous, this rank's rows each, k at most ``together``.
            solution: likewise, written.
            transposed: solve with the transposed matrix.
        """
        if self.together == 1:
            for one, found in zip(right, solution, strict=True):
                self.solver(one, found, transposed=transposed, lasting=True)()
            return
        given, found = (
            PETSc.Mat().createDense(
                ((self.size, None), (None, len(right))), array=x.T, comm=self._comm
            )
            for x in (right, solution)
        )
        if self._comm.size == 1 and _SPARSE * np.count_nonzero(right) < right.size:
            given = _sparse(right.reshape(len(right), -1))
        self._factor.setMumpsIcntl(_TRANSPOSED, 0 if transposed else 1)
        self._factor.matSolve(given, found)
        self._factor.setMumpsIcntl(_TRANSPOSED, 1)
        for matrix in (given, found):
            matrix.destroy()

    def multiplier(self, vector: FloatArray, product: FloatArray) -> Callable[[], None]:
        """Multiply with the matrix that was factorised, from one array to another, as solutions.

        Only where it is ``kept``; collective unless the factors are local.
        """
        assert self._product is not None
        vectors = (
            PETSc.Vec().createWithArray(self._rows(x), comm=self._product.comm)
            for x in (vector, product)
        )
        return partial(self._product.mult, *vectors)

    def _rows(self, array: FloatArray) -> FloatArray:
        """The numbers of an array in one row, in its own memory."""
        flat = array.reshape(-1)[: self.size]
        assert np.shares_memory(flat, array) or self.size == 0
        return flat


def _solve_whole(
    whole: WholeMatrix, solve: Callable[[PETSc.Vec, PETSc.Vec], None], rhs: FloatArray,
    solution: FloatArray,
) -> None:  # fmt: skip
    solution[:] = whole.solve(solve, rhs)


def _sparse(rows: FloatArray) -> PETSc.Mat:
    """Sequential matrix of columns (k, n), of which MUMPS reads what is not zero."""
    (count, size), (row, column) = rows.shape, np.nonzero(rows)
    start = np.searchsorted(row, np.arange(count + 1))
    csr = start.astype(PETSc.IntType), column.astype(PETSc.IntType), rows[row, column]
    return PETSc.Mat().createTranspose(
        PETSc.Mat().createAIJ((count, size), csr=csr, comm=PETSc.COMM_SELF)
    )


def is_symmetric(matrix: PETSc.Mat) -> bool:
    """True if a sequential AIJ matrix is symmetric to rounding, row by row."""
    start, column, values = matrix.getValuesCSR()
    first, second, mirrored = matrix.transpose(PETSc.Mat()).getValuesCSR()
    if not (np.array_equal(start, first) and np.array_equal(column, second)):
        return False
    size = np.sqrt(np.abs(matrix.getDiagonal().getArray(readonly=True)))
    size *= _ROUNDING
    allowed = np.repeat(size, np.diff(start))
    allowed *= size[column]
    mirrored -= values
    return bool((np.abs(mirrored, out=mirrored) <= allowed).all())


@cache
def _mat_solve() -> int:
    """Address of PETSc's MatSolve, in the library that petsc4py is linked to."""
    function = ctypes.CDLL(PETSc.__file__).MatSolve
    return ctypes.cast(function, ctypes.c_void_p).value or 0


def _nothing() -> None:
    """Solve without rows."""
