# SPDX-License-Identifier: LGPL-3.0-or-later
"""The equations of motion inverted at a shift: ``P(sigma) = K + sigma C + sigma^2 M`` with G.

A shift off the real axis makes P complex. With real matrices it is factorised as ``[[Re P, -Im P],
[Im P, Re P]]`` of twice the size (the first of the real forms of Day and Heroux, SIAM J. Sci.
Comput. 23 (2001) 480-498).
"""

from typing import Any, Self

from petsc4py import PETSc

import numpy as np
import numpy.typing as npt

from flexfem.la.direct import DirectSolver
from flexfem.solvers.modal.pencil import Pencil

__all__ = ["ShiftedInverse", "SingularShiftError", "real_form"]


class SingularShiftError(Exception):
    """A matrix has no factors at a shift: it is an eigenvalue, or rounding makes it one."""

    @classmethod
    def at(cls, shift: complex) -> Self:
        """The error at a shift, 1/s."""
        return cls(f"the linearised equations are singular at the shift {abs(shift):.3g} 1/s")


def real_form(real: PETSc.Mat, imaginary: PETSc.Mat, factor: float) -> PETSc.Mat:
    """``[[A, -s B], [s B, A]]`` for ``A + i s B`` (collective)."""
    plus, minus = imaginary.copy(), imaginary.copy()
    plus.scale(factor)
    minus.scale(-factor)
    nest = PETSc.Mat().createNest([[real, minus], [plus, real]], comm=real.comm)
    return nest.convert("aij", PETSc.Mat())


class ShiftedInverse:
    """``P(sigma)^-1`` and products with the matrices of a problem, of real or complex vectors.

    Attributes:
        pencil: the problem.
        shift: sigma, 1/s.
        paired: P is complex, and so are its solutions.
    """

    def __init__(self, pencil: Pencil, shift: complex) -> None:
        """Factorise (collective).

        Args:
            pencil: the problem.
            shift: real or imaginary, 1/s.

        Raises:
            SingularShiftError: on all ranks.
        """
        self.pencil, self.shift = pencil, shift
        self.paired = shift.imag != 0.0 and pencil.damped
        lin = pencil.linearization
        self._x, self._y = lin.vector(), lin.vector()
        matrix = self._matrix()
        self._solver = DirectSolver(matrix, "modes_")
        if not self._solver.factor(matrix):
            raise SingularShiftError.at(shift)
        self._b, self._z = matrix.createVecs()

    def _matrix(self) -> PETSc.Mat:
        matrices = self.pencil.matrices
        real = matrices.stiffness.copy()
        real.axpy(self.shift.real, matrices.damping)
        real.axpy((self.shift**2).real, matrices.mass)
        if not self.paired:
            return real
        return real_form(real, matrices.damping, self.shift.imag)

    def apply(self, _: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """``P^-1 x`` as a preconditioner (collective)."""
        self._solver.solve(x, y)

    def times(self, matrix: PETSc.Mat, nodal: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """A matrix times values (n,) of this rank's nodes, on its whole range (collective)."""
        if np.iscomplexobj(nodal):
            return self.times(matrix, nodal.real) + 1j * self.times(matrix, nodal.imag)
        self._x.getArray()[: len(nodal)] = nodal
        matrix.mult(self._x, self._y)
        return np.array(self._y.getArray(readonly=True))

    def solve(self, rhs: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Solution (n,) for this rank's nodes from a right side of its whole range (collective)."""
        unknowns, size = self.pencil.linearization.unknowns, len(rhs)
        if self.paired:
            self._b.setArray(np.concatenate([rhs.real, rhs.imag]))
            self._solver.solve(self._b, self._z)
            found = self._z.getArray(readonly=True)
            return np.asarray(found[:unknowns] + 1j * found[size : size + unknowns])
        if np.iscomplexobj(rhs):
            return self.solve(rhs.real) + 1j * self.solve(rhs.imag)
        self._b.setArray(rhs)
        self._solver.solve(self._b, self._z)
        return np.array(self._z.getArray(readonly=True)[:unknowns])
