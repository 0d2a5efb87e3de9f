# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static responses of a body with fixed, moved or no interfaces.

Regions of rigid interfaces are eliminated: their rows are fixed. All other conditions on the
motion, ``C^T u = q`` (means over the regions of averaged interfaces; for a body without interfaces
that its motion has no part of a rigid one), are met by their multipliers::

    K u + C lambda = f,  C^T u = q,  u = g in the fixed rows.

A body without rigid interfaces is pinned in as many rows as it has rigid motions R, which are
superposed again: pins carry nothing, since the multipliers balance the force,
``R^T (f - C lambda) = 0`` (Farhat, Géradin 1998). So one Cholesky factorisation suffices.
"""

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.la.direct import factorise
from flexfem.la.whole import WholeMatrix, taken_whole
from flexfem.reduction.fem.body.blocks import global_rows, multiply, projected, total

__all__ = ["StaticResponse", "independent_rows"]


class StaticResponse:
    """Displacements by given forces, the conditions on the motion being met."""

    def __init__(
        self,
        comm: MPI.Intracomm,
        stiffness: PETSc.Mat,
        fixed: IntArray,
        conditions: FloatArray,
        rigid: FloatArray,
    ) -> None:
        """Factorise (collective).

        Args:
            comm: communicator of the mesh.
            stiffness: of all rows.
            fixed: this rank's rows that interfaces prescribe.
            conditions: C, this rank's rows.
            rigid: R, this rank's rows of the rigid motions that the body has.

        Raises:
            ArithmeticError: fixed interfaces leave the body free to move.
        """
        self._comm, self._stiffness, self._conditions = comm, stiffness, conditions
        self._rigid = rigid if total(comm, np.array([len(fixed)]))[0] == 0 else rigid[:, :0]
        self.fixed: BoolArray = np.zeros(len(rigid), dtype=np.bool_)
        self.fixed[fixed] = True
        if self._rigid.shape[1]:
            self.fixed[independent_rows(comm, rigid)] = True
        self._pinned = bool(self._rigid.shape[1])
        self._factorise()
        self._reactions = self._fixed_response(conditions)
        self._bordered = self._border()

    def _factorise(self) -> None:
        matrix = self._stiffness.copy()
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        matrix.zeroRowsColumns(global_rows(matrix, np.flatnonzero(self.fixed)), diag=_mean(matrix))
        matrix.setOption(PETSc.Mat.Option.SPD, True)
        self._whole = WholeMatrix(matrix) if taken_whole(matrix) else None
        if self._whole is not None:
            matrix = self._whole.update(matrix)
            matrix.setOption(PETSc.Mat.Option.SPD, True)
        ksp = PETSc.KSP().create(comm=matrix.comm)
        ksp.setType(PETSc.KSP.Type.PREONLY)
        pc = ksp.getPC()
        pc.setType(PETSc.PC.Type.CHOLESKY)
        pc.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        if not factorise(ksp, matrix):
            raise ArithmeticError("its stiffness is singular")
        self._ksp, self._factor = ksp, pc.getFactorMatrix()
        self._solution = matrix.createVecRight()
        self._matrix = matrix

    def _fixed_response(self, force: FloatArray) -> FloatArray:
        """Displacements with the fixed rows at rest."""
        columns = force.shape[1]
        if columns == 0:
            return np.zeros_like(force)
        free = np.where(self.fixed[:, np.newaxis], 0.0, force)
        if self._whole is not None:
            return self._whole.own(self._solved(self._whole.rows(free))).copy()
        return self._solved(free)

    def _solved(self, right: FloatArray) -> FloatArray:
        """Solutions (n, k) for the rows of the factorised matrix."""
        comm = self._matrix.comm
        if right.shape[1] == 1:
            rhs = PETSc.Vec().createWithArray(np.ascontiguousarray(right[:, 0]), comm=comm)
            self._factor.solve(rhs, self._solution)
            rhs.destroy()
            single: FloatArray = self._solution.getArray().copy()[:, np.newaxis]
            return single
        sizes = (self._matrix.getSizes()[0], (None, right.shape[1]))
        rhs = PETSc.Mat().createDense(sizes, array=np.asfortranarray(right), comm=comm)
        found = PETSc.Mat().createDense(sizes, comm=comm)
        found.setUp()
        self._factor.matSolve(rhs, found)
        result: FloatArray = found.getDenseArray()[: len(right)].copy()
        rhs.destroy()
        found.destroy()
        return result

    def _border(self) -> FloatArray:
        """Matrix of multipliers and rigid motions, and the scale that makes it well conditioned."""
        count, rigid = self._conditions.shape[1], self._rigid.shape[1]
        matrix = np.zeros((count + rigid, count + rigid))
        if count + rigid == 0:
            self._scale = np.zeros(0)
            return matrix
        compliance = projected(self._comm, self._conditions, self._reactions)
        matrix[:count, :count] = -0.5 * (compliance + compliance.T)
        matrix[:count, count:] = projected(self._comm, self._conditions, self._rigid)
        matrix[count:, :count] = matrix[:count, count:].T
        scale = np.ones(count + rigid)
        own = np.diagonal(compliance)
        scale[:count] = 1.0 / np.sqrt(np.where(own > 0.0, own, 1.0))
        coupling = np.abs(scale[:count, np.newaxis] * matrix[:count, count:])
        scale[count:] = 1.0 / coupling.max(axis=0, initial=1e-300)
        self._scale = scale
        return scale[:, np.newaxis] * matrix * scale

    def respond(self, force: FloatArray, conditions: FloatArray | None = None) -> FloatArray:
        """Displacements (rows, columns) by forces, fixed rows at rest (collective).

        Args:
            force: this rank's rows.
            conditions: q for each column; zero if None.
        """
        u = self._fixed_response(force)
        count = self._conditions.shape[1]
        if len(self._scale) == 0:
            return u
        given = 0.0 if conditions is None else conditions
        rhs = np.concatenate([
            given - projected(self._comm, self._conditions, u),
            projected(self._comm, self._rigid, force),
        ])  # fmt: skip
        scale = self._scale[:, np.newaxis]
        answer = scale * np.linalg.solve(self._bordered, scale * rhs)
        u -= self._reactions @ answer[:count]
        u += self._rigid @ answer[count:]
        return u

    def move(self, fixed: FloatArray, conditions: FloatArray) -> FloatArray:
        """Displacements without forces (collective).

        Args:
            fixed: prescribed displacements in the rows of rigid interfaces, zero elsewhere.
            conditions: q for each column.
        """
        force = -multiply(self._stiffness, fixed)
        shift = projected(self._comm, self._conditions, fixed)
        return fixed + self.respond(force, conditions - shift)


def _mean(matrix: PETSc.Mat) -> float:
    """Mean of the diagonal: rows that are fixed are of the size of the others."""
    diagonal = matrix.getDiagonal()
    return float(diagonal.sum() / diagonal.getSize())


def independent_rows(comm: MPI.Intracomm, motions: FloatArray) -> IntArray:
    """This rank's share of rows in which motions are independent, one for each (collective).

    Elimination with complete pivoting, columns scaled to one.
    """
    work = motions / np.sqrt(total(comm, np.sum(motions**2, axis=0)))
    rows = []
    for _ in range(motions.shape[1]):
        flat = int(np.argmax(np.abs(work))) if work.size else -1
        row, column = divmod(flat, work.shape[1])
        mine = float(np.abs(work[row, column])) if work.size else -1.0
        found = comm.allgather(mine)
        first = int(np.argmax(found))
        pivot = comm.bcast((column, work[row].copy()) if comm.rank == first else None, root=first)
        if comm.rank == first:
            rows.append(row)
        column, values = pivot
        work = work - np.outer(work[:, column], values / values[column])
    return np.array(rows, dtype=np.int64)
