# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linearised buckling: loads at which the linearly extrapolated tangent becomes singular.

With the matrices A_0 and A_1 of two equilibria at t_0 and t_1, ``A_0 x = mu (A_0 - A_1) x`` gives
``t = t_0 + mu (t_1 - t_0)``. It is exact if the state before buckling changes little, as in a
straight column; otherwise the singular points of the exact path are to be used.
"""

from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np

from flexfem._types import FloatArray
from flexfem.solvers.linear.tangent import TangentSolver, of_multipliers
from flexfem.solvers.statics.equilibrium import Equilibrium
from flexfem.system.mechanics import END_POINT

__all__ = ["LinearBuckling", "linear_in_stiffness"]

#: Relative imaginary part above which an eigenvalue is not a buckling load.
_REAL = 1e-6
#: Size above which it is none either: what changes the stiffness by so little is round-off.
_LARGEST = 1e12


def linear_in_stiffness(tangent: TangentSolver) -> PETSc.Mat:
    """The assembled matrix in one piece, linear in the stiffness of springs (collective).

    Their equations are scaled by less than it, which changes where it does, and so would what lies
    between two matrices, with the largest stiffness in the model.
    """
    rows = tangent.system.constraints
    compliance = rows.compliance[rows.owned_rows]
    matrix = tangent.matrix.convert("aij", PETSc.Mat())
    elastic = compliance > 0.0
    matrix.diagonalScale(of_multipliers(matrix, 1.0 / np.where(elastic, compliance, 1.0)))
    return matrix


class LinearBuckling:
    """Buckling loads from the difference to a first equilibrium."""

    def __init__(self, equilibrium: Equilibrium) -> None:
        """Store the matrix at the present equilibrium (collective)."""
        self._equilibrium = equilibrium
        self._start = equilibrium.loading.t
        self._first = self._matrix()

    def _matrix(self) -> PETSc.Mat:
        equilibrium = self._equilibrium
        END_POINT.evaluate(equilibrium.system, equilibrium.shifts)
        equilibrium.assemble()
        return linear_in_stiffness(equilibrium.tangent)

    def solve(self, count: int) -> list[tuple[float, list[FloatArray]]]:
        """Load parameters of least distance from the first equilibrium (collective).

        Args:
            count: number of modes.

        Returns:
            Load parameter and motion, (n_owned, width) of each block; fewer than ``count`` if there
            are no more, nothing if the matrix did not change.
        """
        first = self._first
        difference = self._matrix()
        difference.aypx(-1.0, first, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        if difference.norm() <= np.finfo(float).eps * first.norm():
            return []
        solver = SLEPc.EPS().create(comm=first.comm)
        solver.setOperators(first, difference)
        solver.setProblemType(SLEPc.EPS.ProblemType.GNHEP)
        solver.setDimensions(nev=min(count, first.getSize()[0]))
        solver.setTolerances(tol=1e-10)
        solver.setTarget(0.0)
        solver.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
        transform = solver.getST()
        transform.setType(SLEPc.ST.Type.SINVERT)
        pc = transform.getKSP().getPC()
        transform.getKSP().setType(PETSc.KSP.Type.PREONLY)
        pc.setType(PETSc.PC.Type.LU)
        pc.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        solver.solve()
        found = self._pairs(solver, count)
        solver.destroy()
        difference.destroy()
        return found

    def _pairs(self, solver: SLEPc.EPS, count: int) -> list[tuple[float, list[FloatArray]]]:
        """Converged pairs with real eigenvalues."""
        loading, found = self._equilibrium.loading, []
        vector, _ = self._first.createVecs()
        for i in range(min(solver.getConverged(), count)):
            value = solver.getEigenpair(i, vector)
            if abs(value.imag) <= _REAL * abs(value) and abs(value) <= _LARGEST:
                t = self._start + value.real * (loading.t - self._start)
                found.append((t, self._blocks(vector.getArray())))
        return sorted(found, key=lambda pair: abs(pair[0] - self._start))

    def _blocks(self, values: FloatArray) -> list[FloatArray]:
        """A vector's part of each block: rows of a rank are those of its blocks one by one."""
        blocks, at = [], 0
        for part in self._equilibrium.system.parts:
            size = part.block.sizes[0]
            blocks.append(np.array(values[at : at + size]).reshape(-1, part.block.width))
            at += size
        return blocks
