# SPDX-License-Identifier: LGPL-3.0-or-later
"""Direct solver: MUMPS, and redundant factorisation of small matrices on every rank."""

from mpi4py import MPI
from petsc4py import PETSc

from flexfem.la.whole import WholeMatrix, taken_whole

__all__ = ["CountingFactors", "DirectSolver", "factorise", "lu_solver"]

#: MUMPS' ICNTL(14), memory beyond its estimate in percent, and the value after the default.
_MEMORY, _ROOM = 14, (100, 500)


class DirectSolver:
    """LU factors of matrices of one size, one after the other."""

    def __init__(self, matrix: PETSc.Mat, prefix: str) -> None:
        """Prepare for matrices like the given one, behind the given options prefix."""
        self._whole = WholeMatrix(matrix) if taken_whole(matrix) else None
        self._comm = matrix.comm.tompi4py()
        self._ksp = lu_solver(PETSc.COMM_SELF if self._whole else matrix.comm, prefix)

    def factor(self, matrix: PETSc.Mat) -> bool:
        """Factorise a matrix; False when it is singular (collective)."""
        if self._whole is None:
            return factorise(self._ksp, matrix)
        regular = factorise(self._ksp, self._whole.update(matrix))
        return bool(self._comm.allreduce(regular, op=MPI.LAND))

    def solve(self, right: PETSc.Vec, solution: PETSc.Vec) -> bool:
        """Solve with the matrix factorised last; False without a solution (collective)."""
        if self._whole is None:
            self._ksp.solve(right, solution)
        else:
            solution.setArray(self._whole.solve(self._ksp.solve, right.getArray(readonly=True)))
        return bool(self._ksp.getConvergedReason() > 0)

    def reset(self) -> None:
        """Release factors and pattern (collective)."""
        self._ksp.reset()


class CountingFactors:
    """Factors of matrices of one pattern with signs of pivots and determinant.

    They are kept from one matrix to the next: MUMPS mixes up messages of factors that end with
    those of the next.
    """

    def __init__(self, matrix: PETSc.Mat, *, symmetric: bool) -> None:
        """Prepare for matrices like the given one (collective)."""
        self._whole = WholeMatrix(matrix) if taken_whole(matrix) else None
        self._comm = matrix.comm.tompi4py()
        self._symmetric = symmetric
        self._pc: PETSc.PC | None = None

    def factor(self, matrix: PETSc.Mat) -> bool:
        """Factorise a matrix; False when it is singular (collective)."""
        if self._whole is not None:
            matrix = self._whole.update(matrix)
        if self._pc is None:
            self._pc = self._create(matrix)
        self._pc.setOperators(matrix)
        self._pc.setUp()
        regular = self._pc.getFailedReason() == PETSc.PC.FailedReason.NOERROR
        if self._whole is not None:
            regular = self._comm.allreduce(regular, op=MPI.LAND)
        if not regular:
            self._pc.destroy()
            self._pc = None  # MUMPS never factorises again with the data of a failure
        return bool(regular)

    def _create(self, matrix: PETSc.Mat) -> PETSc.PC:
        pc = PETSc.PC().create(comm=matrix.comm)
        pc.setType(PETSc.PC.Type.CHOLESKY if self._symmetric else PETSc.PC.Type.LU)
        pc.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        pc.setOperators(matrix)
        pc.setFactorSetUpSolverType()
        factor = pc.getFactorMatrix()
        factor.setMumpsIcntl(13, 1)  # no root front by ScaLAPACK, which would hide pivots
        factor.setMumpsIcntl(33, 1)  # the determinant
        return pc

    @property
    def negative_pivots(self) -> int:
        """Their number: of negative eigenvalues, if the matrix is symmetric."""
        assert self._pc is not None
        return int(self._pc.getFactorMatrix().getMumpsInfog(12))

    @property
    def determinant(self) -> float:
        """A number of the determinant's sign."""
        assert self._pc is not None
        return float(self._pc.getFactorMatrix().getMumpsRinfog(12))


def lu_solver(comm: PETSc.Comm, prefix: str) -> PETSc.KSP:
    """LU by MUMPS behind the given options prefix, for :func:`factorise`."""
    ksp = PETSc.KSP().create(comm=comm)
    ksp.setOptionsPrefix(prefix)
    ksp.setType(PETSc.KSP.Type.PREONLY)
    pc = ksp.getPC()
    pc.setType(PETSc.PC.Type.LU)
    pc.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
    ksp.setFromOptions()
    return ksp


def factorise(ksp: PETSc.KSP, mat: PETSc.Mat) -> bool:
    """Factorise a matrix by a direct solver; False when it is singular (collective).

    Where pivoting needs more memory than MUMPS has estimated, it is given more, which it keeps.
    """
    pc = ksp.getPC()
    for room in (None, *_ROOM):
        ksp.setOperators(mat)
        if room is not None:
            pc.setFactorSetUpSolverType()
            pc.getFactorMatrix().setMumpsIcntl(_MEMORY, room)
        ksp.setUp()
        reason = pc.getFailedReason()
        if reason == PETSc.PC.FailedReason.NOERROR:
            return True
        ksp.reset()  # MUMPS never factorises again with the data of a failure
        if reason != PETSc.PC.FailedReason.FACTOR_OUTMEMORY:
            return False
    return False
