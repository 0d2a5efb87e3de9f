# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of the load factors of linearised buckling.

``A_0 x = mu (A_0 - A_1) x`` with the matrices of the first and the last equilibrium, see
``solvers.statics.buckling``. With the left vector y, ``B = (1 - mu) A_0 + mu A_1`` and
``y^T B = 0``:

``dmu = y^T ((1 - mu) dA_0 + mu dA_1) x / (y^T (A_0 - A_1) x)``,  ``dt = dmu (t_1 - t_0)``.

Both matrices change with a parameter at a fixed state and along the change of their equilibria,
``dq/dp = - A^-1 F_p``, which is found first: their differences are those of matrices of neighbours
moved along it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.gradients.equations.step_tangent import BlockVectors
from flexfem.gradients.motion.trajectory import StoppedError
from flexfem.gradients.states.eigenvectors import ComplexArray, Inverse, eigenvectors, times
from flexfem.gradients.states.neighbours import MATRICES, Parameter, check_without_sliders
from flexfem.gradients.states.path import SINGULAR, Direction, Equilibria, NearPath
from flexfem.solvers.statics.buckling import LinearBuckling

__all__ = ["BucklingLoads"]

#: Distance of the shift from an eigenvalue, and of eigenvalues that count as equal, relative.
_SHIFT, _EQUAL = 1e-7, 1e-5


@dataclass(frozen=True)
class _Mode:
    """A buckling load with its vectors, and ``y^T (A_0 - A_1) x``."""

    mu: float
    right: ComplexArray
    left: ComplexArray
    size: complex


class BucklingLoads:
    """Buckling loads of a path from its first and last equilibrium.

    Attributes:
        loads: load factors by distance from the first equilibrium.
    """

    def __init__(self, path: Equilibria, numbers: Sequence[int]) -> None:
        """Find them (collective).

        Args:
            path: the path.
            numbers: those that are differentiated, from 1.

        Raises:
            InputError: there are fewer, or one of these is not simple.
        """
        check_without_sliders(path.system)
        self._path, self._numbers = path, list(numbers)
        path.go_to(0)
        problem = LinearBuckling(path.equilibrium)
        path.go_to(path.rows - 1)
        found = problem.solve(max(numbers) + 1)
        self.loads = [t for t, _ in found]
        self._span = float(path.times[-1] - path.times[0])
        for number in numbers:
            self._check(number)
        matrices = []
        for row in self._rows:
            path.go_to(row)
            matrices.append(path.matrix())
        self._modes = [self._mode(matrices, found[k - 1]) for k in numbers]

    @property
    def _rows(self) -> tuple[int, int]:
        """Rows of the history of both matrices."""
        return 0, self._path.rows - 1

    def _check(self, number: int) -> None:
        if number > len(self.loads):
            raise InputError(
                f"gradient: there is no buckling:{number}, {len(self.loads)} buckling loads were "
                "found"
            )
        own = self.loads[number - 1]
        for k, other in enumerate(self.loads, start=1):
            if k != number and abs(other - own) <= _EQUAL * abs(own):
                raise InputError(
                    f"gradient: buckling:{number} and buckling:{k} are equal ({own:g}), and have "
                    "no derivatives one by one"
                )

    def _mode(self, matrices: list[PETSc.Mat], found: tuple[float, list[FloatArray]]) -> _Mode:
        t, motion = found
        first, last = matrices
        mu = (t - float(self._path.times[0])) / self._span
        shifted, same = mu * (1.0 + _SHIFT), PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
        matrix = first.copy()
        matrix.scale(1.0 - shifted)
        matrix.axpy(shifted, last, same)
        inverse = Inverse(matrix)
        if not inverse.regular:
            raise StoppedError(SINGULAR)

        def weigh(x: ComplexArray, transposed: bool) -> ComplexArray:
            return times(first, x, transposed=transposed) - times(last, x, transposed=transposed)

        start = self._path.vector(motion, np.zeros(self._path.system.constraints.size))
        right, left = eigenvectors(inverse, start.astype(np.complex128), self._total, weigh)
        size = complex(self._total(np.array([np.vdot(left, weigh(right, False))]))[0])
        return _Mode(mu, right, left, size)

    def _total(self, values: ComplexArray) -> ComplexArray:
        """Sums over the ranks."""
        self._path.system.comm.Allreduce(MPI.IN_PLACE, values, op=MPI.SUM)
        return values

    def gradients(self, parameters: Sequence[Parameter]) -> FloatArray:
        """Derivatives (numbers, parameters) of the loads (collective)."""
        found = np.zeros((len(self._numbers), len(parameters)), dtype=np.complex128)
        for p, parameter in enumerate(parameters):
            near = [
                (NearPath(self._path, one.model, parameter.text), one.offset, one.weight)
                for one in parameter.neighbours(MATRICES)
            ]
            for row, share in zip(self._rows, (lambda mu: 1.0 - mu, lambda mu: mu), strict=True):
                self._path.go_to(row)
                direction = self._direction(near)
                for one, offset, weight in near:
                    one.go_to_present()
                    one.move(direction, offset)
                    matrix = one.matrix()
                    for k, mode in enumerate(self._modes):
                        product = np.vdot(mode.left, times(matrix, mode.right))
                        found[k, p] += weight * share(mode.mu) * product / mode.size
                    matrix.destroy()
        return np.ascontiguousarray(self._total(found).real) * self._span

    def _direction(self, near: Sequence[tuple[NearPath, float, float]]) -> Direction:
        """Change of the present equilibrium with a parameter (collective)."""
        blocks: BlockVectors = [np.zeros_like(p.block.owned_step) for p in self._path.system.parts]
        values = np.zeros(self._path.system.constraints.size)
        for one, _, weight in near:
            one.go_to_present()
            own, rows = one.residual()
            blocks = [a + weight * b for a, b in zip(blocks, own, strict=True)]
            values = values + weight * rows
        return self._path.direction(blocks, values)
