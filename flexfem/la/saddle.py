# SPDX-License-Identifier: LGPL-3.0-or-later
"""Iterative solver of block matrices of bodies and multipliers, each body by its own factors.

``[[A, B], [C, -D]]`` with as many blocks in A as there are parts: GMRES, preconditioned by the
elimination of the multipliers from the diagonal blocks of A. It is exact, and GMRES ends at once,
where parts are not coupled beside the multipliers; otherwise GMRES adds what is missing.
"""

import weakref
from collections.abc import Callable
from math import inf
from typing import Protocol

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from scipy.linalg import LinAlgError, lu_factor, lu_solve

from flexfem._types import FloatArray
from flexfem.la.linear_solver import SolveCounts

__all__ = ["MOST_MULTIPLIERS", "BodyFactor", "SaddleSolver"]

#: Multipliers of a model from which they are too many: each takes a solve and a dense row.
MOST_MULTIPLIERS = 500
#: Largest number of iterations, in each of which every body is solved.
_MOST = 40
#: Iterations for each multiplier from which a new elimination is as fast: its solves take fewer
#: iterations of their own than those for residuals.
_WORTH = 0.5


class BodyFactor(Protocol):
    """Solver of a block, see :class:`flexfem.la.factor.Factor`."""

    def solver(
        self, rhs: FloatArray, solution: FloatArray, *, lasting: bool = False
    ) -> Callable[[], None]:
        """Solve from one array to another, to be called again and again."""
        ...


class SaddleSolver:
    """Solver of block matrices, with the interface of ``DirectSolver``.

    Attributes:
        counts: counters of iterative solves; a body that is not solved leaves NaN, and so fails
            the solve on all ranks, and nothing else is solved after it.
    """

    def __init__(
        self, factor: Callable[[int, PETSc.Mat], BodyFactor], parts: int, tolerance: float,
        counts: SolveCounts, *, held: bool = False, stopping: Callable[[], bool] = bool,
    ) -> None:  # fmt: skip
        """Store the arguments.

        Args:
            factor: makes the solver of a diagonal block from its number and matrix (collective).
            parts: number of blocks beside the multipliers.
            tolerance: relative accuracy.
            counts: counters of iterative solves.
            held: the solvers of the blocks hold them a little, so that the elimination is not
                exact.
            stopping: returns True if solves are to end without a solution, as after a signal
                (collective; never by default); asked before the bodies are solved.
        """
        self._held, self._stopping = held, stopping
        self._taken: float = inf  # iterations of the slowest solve since the last matrix
        self._factor, self._parts, self._tolerance = factor, parts, tolerance
        self.counts = counts

    def factor(self, matrix: PETSc.Mat) -> bool:
        """Prepare solves with a matrix (collective).

        The elimination of multipliers from the last matrix remains, which is only a preconditioner
        then, while solves take fewer iterations than half the number of multipliers.

        Returns:
            False where multipliers are dependent, or a body is not solved, which ``counts`` tell,
            or solves are to end.
        """
        self._comm: MPI.Intracomm = matrix.comm.tompi4py()
        self._matrix = matrix
        blocks = [matrix.getNestSubMatrix(i, i) for i in range(self._parts)]
        self._rights = [np.zeros(mat.getLocalSize()[0]) for mat in blocks]
        self._solutions = [np.zeros_like(right) for right in self._rights]
        pairs = list(zip(self._rights, self._solutions, strict=True))
        factors = [self._factor(i, mat) for i, mat in enumerate(blocks)]
        self._solvers = [
            f.solver(*pair, lasting=True) for f, pair in zip(factors, pairs, strict=True)
        ]
        count = matrix.getNestSize()[0]
        self._rows = count > self._parts
        rows = matrix.getNestSubMatrix(count - 1, 0).getSize()[0]
        self._old = self._rows and self._taken < _WORTH * rows
        if self._old:
            self._taken = 0
        elif self._rows and not self._eliminate():
            return False
        self._grid = [[matrix.getNestSubMatrix(i, j) for j in range(count)] for i in range(count)]
        sizes = [line[0].getLocalSize()[0] for line in self._grid]
        self._ends = np.cumsum(sizes)
        self._ksp = self._created() if count > 1 else None
        return True

    def _created(self) -> PETSc.KSP:
        """Solver of the whole matrix (collective)."""
        # its vectors are those of all blocks on this rank, one after the other
        whole = (int(self._ends[-1]), None), (int(self._ends[-1]), None)
        flat = PETSc.Mat().createPython(
            whole, context=_Product(weakref.proxy(self)), comm=self._matrix.comm
        )
        flat.setUp()
        ksp = PETSc.KSP().create(comm=self._matrix.comm)
        # a body that is hardly held amplifies what is left of its solves: no linear operator
        ksp.setType(PETSc.KSP.Type.FGMRES if self._held else PETSc.KSP.Type.GMRES)
        ksp.setGMRESRestart(_MOST)
        ksp.setTolerances(rtol=self._tolerance, atol=0.0, divtol=1e30, max_it=_MOST)
        ksp.setOperators(flat)
        pc = ksp.getPC()
        pc.setType(PETSc.PC.Type.PYTHON)
        pc.setPythonContext(_Elimination(weakref.proxy(self)))
        ksp.setUp()
        return ksp

    def _eliminate(self) -> bool:
        """Solve for the motions by each multiplier, and factorise their system (collective)."""
        self._old, self._taken = False, inf
        last, matrix = self._parts, self._matrix
        corner = matrix.getNestSubMatrix(last, last)
        unit, row = corner.createVecs()
        size, (first, end) = unit.getSize(), unit.getOwnershipRange()
        counts = np.array(self._comm.allgather(end - first))
        self._counts, self._own = counts, slice(first, end)
        self._motions = [np.empty((len(right), size)) for right in self._rights]
        own = np.empty((end - first, size))
        for column in range(size):
            unit.set(0.0)
            if first <= column < end:
                unit[column] = 1.0
            unit.assemble()
            corner.mult(unit, row)
            own[:, column] = -row.getArray(readonly=True)
            self._forces(unit)
            if not self._solve_bodies():
                return False
            for motion, solution in zip(self._motions, self._solutions, strict=True):
                motion[:, column] = solution
            own[:, column] += self._gaps()
        every = np.empty((size, size))
        self._comm.Allgatherv(own, (every, (counts * size).tolist()))
        try:
            self._schur = lu_factor(every)
        except (ValueError, LinAlgError):
            return False
        pivots = np.abs(np.diag(self._schur[0]))
        regular = bool(size == 0 or pivots.min() > 1e-13 * pivots.max())
        self._taken = 0 if regular else inf
        return regular

    def _forces(self, multipliers: PETSc.Vec) -> None:
        """Set right-hand sides to the forces of multipliers (collective)."""
        for i, right in enumerate(self._rights):
            block = self._matrix.getNestSubMatrix(i, self._parts)
            force = block.createVecLeft()
            block.mult(multipliers, force)
            right[:] = force.getArray(readonly=True)

    def _gaps(self) -> FloatArray:
        """Changes of this rank's rows by the solutions of the bodies (collective)."""
        total = np.zeros(self._own.stop - self._own.start)
        for i, solution in enumerate(self._solutions):
            block = self._matrix.getNestSubMatrix(self._parts, i)
            motion, gap = block.createVecs()
            motion.setArray(solution)
            block.mult(motion, gap)
            total += gap.getArray(readonly=True)
        return total

    def _solve_bodies(self) -> bool:
        """Solve for the bodies; False once one is not solved, or none is to be (collective)."""
        if self._stopping():
            return False
        failed = self.counts.failed  # the same on all ranks, as every body is on all of them
        for solve in self._solvers:
            solve()
            if self.counts.failed > failed:
                return False
        return True

    def multiply(self, vector: FloatArray) -> FloatArray:
        """Product of the matrix and a vector of this rank (collective)."""
        out = np.zeros(len(vector))
        pieces = zip(self._grid, np.split(out, self._ends[:-1]), strict=True)
        for line, sums in pieces:
            for block, own in zip(line, np.split(vector, self._ends[:-1]), strict=True):
                x, y = block.createVecs()
                x.setArray(own)
                block.mult(x, y)
                sums += y.getArray(readonly=True)  # noqa: PLW2901 (a view of the result)
        return out

    def eliminate(self, right: FloatArray) -> FloatArray:
        """Solve without couplings between parts beside the multipliers (collective)."""
        pieces = np.split(right, self._ends[:-1])
        for own, piece in zip(self._rights, pieces, strict=False):
            own[:] = piece
        if not self._solve_bodies():
            return np.full(len(right), np.nan)  # which ends the iteration
        if not self._rows:
            return np.concatenate(self._solutions)
        own = self._gaps() - pieces[-1]
        every = np.empty(self._counts.sum())
        self._comm.Allgatherv(own, (every, self._counts.tolist()))
        found = lu_solve(self._schur, every, check_finite=False)
        moved = [u - Z @ found for u, Z in zip(self._solutions, self._motions, strict=True)]
        return np.concatenate([*moved, found[self._own]])

    def solve(self, right: PETSc.Vec, solution: PETSc.Vec) -> bool:
        """Solve with the matrix prepared last; False without a solution (collective)."""
        nests = right.getNestSubVecs(), solution.getNestSubVecs()
        if self._ksp is None:  # one body that nothing ties
            self._rights[0][:] = nests[0][0].getArray(readonly=True)
            solved = self._solve_bodies()
            nests[1][0].setArray(self._solutions[0])
            return solved
        given, found = self._ksp.getOperators()[0].createVecs()
        given.setArray(np.concatenate([vec.getArray(readonly=True) for vec in nests[0]]))
        failed = self.counts.failed
        converged = self._converges(given, found)
        if not converged and self._old and self.counts.failed == failed:
            if not self._eliminate():
                return False
            converged = self._converges(given, found)
        pieces = np.split(found.getArray(readonly=True), self._ends[:-1])
        for vec, piece in zip(nests[1], pieces, strict=True):
            vec.setArray(piece)
        self.counts.failed += not converged
        return converged

    def _converges(self, given: PETSc.Vec, found: PETSc.Vec) -> bool:
        """Solve; the same on all ranks (collective)."""
        assert self._ksp is not None
        most = min(_MOST, int(_WORTH * self._counts.sum())) if self._old else _MOST
        self._ksp.setTolerances(max_it=most)
        self._ksp.solve(given, found)
        self._taken = max(self._taken, self._ksp.getIterationNumber())
        return bool(self._ksp.getConvergedReason() > 0)

    def reset(self) -> None:
        """Release what was prepared (collective)."""
        self._solvers, self._motions, self._taken = [], [], inf


class _Product:
    """Block matrix in the format of PETSc."""

    def __init__(self, solver: SaddleSolver) -> None:
        self._solver = solver

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Multiply by it (collective)."""
        y.setArray(self._solver.multiply(x.getArray(readonly=True)))


class _Elimination:
    """Preconditioner in the format of PETSc."""

    def __init__(self, solver: SaddleSolver) -> None:
        self._solver = solver

    def apply(self, _: PETSc.PC, right: PETSc.Vec, solution: PETSc.Vec) -> None:
        """Apply it (collective)."""
        solution.setArray(self._solver.eliminate(right.getArray(readonly=True)))
