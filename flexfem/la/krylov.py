# SPDX-License-Identifier: LGPL-3.0-or-later
"""Krylov methods with a multigrid hierarchy that is kept over many solves, as factors are.

The preconditioner of stiffnesses is PETSc's smoothed aggregation (GAMG; Vanek, Mandel, Brezina,
Computing 56 (1996) 179-196), whose coarse spaces hold the rigid motions of the bodies; that of
masses is the diagonal (Wathen, IMA J. Numer. Anal. 7 (1987) 449-457).
"""

from collections.abc import Callable
from functools import partial
from math import isfinite

from petsc4py import PETSc

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.la.linear_solver import SolveCounts

__all__ = ["KrylovFactor", "rigid_motions"]

#: Relative accuracy of solves with masses, which no iteration repeats, and of those whose results
#: are kept.
_MASSES, _LASTING = 1e-13, 1e-10
#: Largest number of iterations of a solve, and vectors that GMRES orthogonalises.
_MOST, _RESTART = 1000, 60
#: Iterations, relative to those with a hierarchy's own matrix, from which it is made again.
_SLOW = 2
#: Relative asymmetry that is round-off.
_SYMMETRIC = 1e-11
#: Length of a motion, relative to what it was, of which fixed unknowns have left nothing.
_NOTHING = 1e-10
#: Numbers of the matrix that a solve reads, about, that may be stored instead: as responses.
_STORED = 2
#: Entries of a row of the masses of quadratic tetrahedra, about, if they are not stored.
_UNSTORED = 80
#: Behind this prefix options of PETSc change the solver; these are set unless they are given.
_PREFIX = "flexfem_iterative_"
_OPTIONS = {"pc_gamg_threshold": 0.05, "mg_levels_ksp_max_it": 2}


def rigid_motions(points: FloatArray, axes: FloatArray, held: BoolArray | None) -> FloatArray:
    """Increments (6, n, 3) of nodes that move together as a rigid body.

    Args:
        points: (n, 3) places of the nodes.
        axes: (n, 3, 3) axes in whose directions the increments are counted, columns.
        held: (n, 3) fixed unknowns, which do not move; None if there are none.
    """
    lines = np.eye(3)[:, np.newaxis] + np.zeros((1, len(points), 3))
    turns = np.cross(np.eye(3)[:, np.newaxis], points[np.newaxis])
    found: FloatArray = np.einsum("nij,kni->knj", axes, np.concatenate([lines, turns]))
    if held is not None:
        found[:, held] = 0.0
    return found


class KrylovFactor:
    """Krylov method for a matrix, with the interface of :class:`flexfem.la.factor.Factor`.

    Symmetric matrices are solved by conjugate gradients, and by GMRES if these find that a matrix
    is not positive definite; others by GMRES. A solve that does not converge leaves NaN as its
    solution, and counts: no caller can take it for one. So does every solve with a matrix that is
    not finite, as that of a trial state with cells turned inside out is. The hierarchy of one
    matrix serves the next ones, see :meth:`take`.

    Attributes:
        size: rows of this rank.
        kept: see ``Factor``: the matrix is not multiplied by; likewise ``together``.
    """

    kept, together = False, 1

    def __init__(
        self, matrix: PETSc.Mat, motions: FloatArray | None, held: BoolArray | None,
        tolerance: float, counts: SolveCounts,
    ) -> None:  # fmt: skip
        """Make the preconditioner (collective).

        Args:
            matrix: assembled AIJ matrix, which this object takes over.
            motions: (k, rows) of this rank, near null space of the multigrid; None for masses.
            held: (rows,) fixed unknowns, whose rows and columns have nothing but their diagonal;
                right-hand sides are zero there. None if there are none on any rank.
            tolerance: relative accuracy.
            counts: counters.
        """
        self.size = matrix.getLocalSize()[0]
        self._tolerance = tolerance if motions is not None else min(tolerance, _MASSES)
        self._counts = counts
        self._expected = self._taken = 0
        self._ksp: PETSc.KSP | None = None
        self._symmetric = False
        self._read(matrix, motions, held)
        if self._finite:
            self._renew()

    def _read(self, matrix: PETSc.Mat, motions: FloatArray | None, held: BoolArray | None) -> None:
        """Take a matrix (collective)."""
        self._matrix, self._motions, self._held = matrix, motions, held
        if held is not None:
            _level(matrix, held)
        self._transposed: KrylovFactor | None = None
        self._finite, symmetric = _properties(matrix)
        if self._finite:
            self._symmetric = symmetric

    def take(self, matrix: PETSc.Mat, motions: FloatArray | None, held: BoolArray | None) -> None:
        """Solve with another matrix like the last one, arguments as at the start (collective).

        The hierarchy remains as long as solves converge, and none takes more than twice the
        iterations of the slowest with its own matrix.
        """
        symmetric = self._symmetric
        self._read(matrix, motions, held)
        if not self._finite:
            return
        slow = self._taken > _SLOW * self._expected
        if self._ksp is None or slow or self._symmetric != symmetric:
            self._renew()
            return
        self._old, self._taken = True, 0
        self._ksp.setOperators(matrix)
        self._ksp.getPC().setReusePreconditioner(True)

    def _renew(self) -> None:
        """Make the hierarchy of the matrix (collective)."""
        self._ksp = self._created()
        self._old, self._expected, self._taken = False, 0, 0
        self._counts.setups += 1

    def _created(self) -> PETSc.KSP:
        """Solver with its preconditioner (collective)."""
        ksp = PETSc.KSP().create(comm=self._matrix.comm)
        ksp.setType(PETSc.KSP.Type.CG if self._symmetric else PETSc.KSP.Type.GMRES)
        ksp.setGMRESRestart(_RESTART)  # without effect on conjugate gradients
        ksp.setTolerances(rtol=self._tolerance, atol=0.0, divtol=1e30, max_it=_MOST)
        ksp.setNormType(PETSc.KSP.NormType.PRECONDITIONED)
        ksp.setErrorIfNotConverged(False)
        ksp.setOperators(self._matrix)
        pc = ksp.getPC()
        motions = [] if self._motions is None else _orthonormal(self._matrix, self._motions)
        if not motions:  # masses, or nothing that moves
            pc.setType(PETSc.PC.Type.JACOBI)
        else:
            self._matrix.setBlockSize(3)
            near = PETSc.NullSpace().create(vectors=motions, comm=self._matrix.comm)
            self._matrix.setNearNullSpace(near)
            pc.setType(PETSc.PC.Type.GAMG)
            _set_options()
            ksp.setOptionsPrefix(_PREFIX)
            ksp.setFromOptions()
        ksp.setUp()
        return ksp

    @property
    def entries(self) -> int:
        """Numbers on this rank that storing responses must not exceed; see ``Factor``."""
        if self._matrix.getType() == PETSc.Mat.Type.PYTHON:  # multiplied without being stored
            return int(_STORED * _UNSTORED * self.size)
        stored = float(self._matrix.getInfo()["nz_used"])
        return int(_STORED * stored)

    def solver(
        self, rhs: FloatArray, solution: FloatArray, *, transposed: bool = False,
        lasting: bool = False,
    ) -> Callable[[], None]:  # fmt: skip
        """Solve from one array to another, to be called again and again; see ``Factor``."""
        if transposed and not self._symmetric:
            return self._of_transposed().solver(rhs, solution, lasting=lasting)
        vectors = [
            PETSc.Vec().createWithArray(x.reshape(-1)[: self.size], comm=self._matrix.comm)
            for x in (rhs, solution)
        ]
        accuracy = min(self._tolerance, _LASTING) if lasting else self._tolerance
        return partial(self._solve, accuracy, *vectors)

    def foreign_solver(self, rhs: FloatArray, solution: FloatArray) -> None:
        """See ``Factor``: an iteration is no single call."""

    def solve_columns(
        self, right: FloatArray, solution: FloatArray, *, transposed: bool = False
    ) -> None:
        """Solve for several right-hand sides, one by one; see ``Factor``."""
        for one, found in zip(right, solution, strict=True):
            self.solver(one, found, transposed=transposed, lasting=True)()

    def _of_transposed(self) -> "KrylovFactor":
        if self._transposed is None:
            other = self._matrix.transpose(PETSc.Mat())
            self._transposed = KrylovFactor(
                other, self._motions, None, self._tolerance, self._counts
            )
        return self._transposed

    def _solve(self, accuracy: float, rhs: PETSc.Vec, solution: PETSc.Vec) -> None:
        """Solve (collective unless the matrix is this rank's alone)."""
        self._counts.solves += 1
        self._iterated = 0
        while not (self._finite and self._converges(accuracy, rhs, solution)):
            if not (self._finite and self._improved()):
                self._counts.failed += 1
                solution.set(np.nan)
                return

    def _improved(self) -> bool:
        """Change what may help a solve to converge; False if nothing does (collective)."""
        if self._old:
            self._renew()
            self._iterated = 0
            return True
        ksp, reasons = self._ksp, PETSc.KSP.ConvergedReason
        assert ksp is not None
        reason = ksp.getConvergedReason()
        if ksp.getType() != PETSc.KSP.Type.CG:
            # PETSc's GMRES ends at a restart if rounding has moved its residual by a tenth of what
            # it was at the last one, and may be anywhere then: it goes on from its solution
            gave_up = reason == reasons.DIVERGED_BREAKDOWN and ksp.getIterationNumber() > 0
            goes_on = bool(gave_up and self._iterated < _MOST)
            ksp.setInitialGuessNonzero(goes_on)
            return goes_on
        if reason == reasons.DIVERGED_MAX_IT:
            return False
        ksp.setType(PETSc.KSP.Type.GMRES)  # the matrix is not positive definite
        ksp.setGMRESRestart(_RESTART)
        self._iterated = 0
        return True

    def _converges(self, accuracy: float, rhs: PETSc.Vec, solution: PETSc.Vec) -> bool:
        ksp = self._ksp
        assert ksp is not None
        ksp.setTolerances(rtol=accuracy, max_it=_MOST - self._iterated)
        ksp.solve(rhs, solution)
        ksp.setInitialGuessNonzero(False)
        taken = ksp.getIterationNumber()
        self._counts.iterations += taken
        self._iterated += taken
        self._taken = max(self._taken, self._iterated)
        if not self._old:
            self._expected = self._taken
        return bool(ksp.getConvergedReason() > 0)

    def multiplier(self, vector: FloatArray, product: FloatArray) -> Callable[[], None]:
        """Refuse: the matrix is not ``kept``."""
        raise AssertionError


def _set_options() -> None:
    """Set the options of multigrid that are not given."""
    options = PETSc.Options(_PREFIX)
    for name, value in _OPTIONS.items():
        if not options.hasName(name):
            options[name] = value


def _level(matrix: PETSc.Mat, held: BoolArray) -> None:
    """Give fixed unknowns a diagonal like those of the others (collective)."""
    diagonal = matrix.getDiagonal()
    values = diagonal.getArray()
    own = np.array([values[~held].sum(), float((~held).sum())])
    total, count = matrix.comm.tompi4py().allreduce(own)
    values[held] = total / max(count, 1.0) or 1.0
    matrix.setDiagonal(diagonal)


def _properties(matrix: PETSc.Mat) -> tuple[bool, bool]:
    """True if a matrix is finite, and if it is symmetric, by products of vectors (collective)."""
    x, y = matrix.createVecs()
    first, last = x.getOwnershipRange()
    own = np.arange(first, last, dtype=np.float64)
    x.setArray(np.cos(own * own))
    y.setArray(np.sin(3.0 * own * own + 1.0))
    Ax, Ay = y.duplicate(), y.duplicate()
    matrix.mult(x, Ax)
    matrix.mult(y, Ay)
    size = y.norm() * Ax.norm()
    return isfinite(size), bool(abs(y.dot(Ax) - x.dot(Ay)) <= _SYMMETRIC * size)


def _orthonormal(matrix: PETSc.Mat, motions: FloatArray) -> list[PETSc.Vec]:
    """Orthonormal vectors of motions (k, rows), without those that others have (collective)."""
    found: list[PETSc.Vec] = []
    for motion in motions:
        vector = matrix.createVecRight()
        vector.setArray(motion.ravel())
        length = vector.norm()
        for _ in range(2):
            for other in found:
                vector.axpy(-vector.dot(other), other)
        if vector.norm() > _NOTHING * length:
            vector.normalize()
            found.append(vector)
    return found
