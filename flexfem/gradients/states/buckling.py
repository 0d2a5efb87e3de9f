# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of the load factors of linearised buckling.

``A_0 x = mu (A_0 - A_1) x`` with the matrices of the first and the last equilibrium, see
``solvers.statics.buckling``. With the left vector y, ``B = (1 - mu) A_0 + mu A_1`` and
``y^T B = 0``:

``dmu = y^T ((1 - mu) dA_0 + mu dA_1) x / (y^T (A_0 - A_1) x)``,  ``dt = dmu (t_1 - t_0)``,

and the mean of several equal ones by the mean of this over vectors with ``Y^T (A_0 - A_1) X``
diagonal.

Both matrices change with a parameter at a fixed state and along the change of their equilibria,
``dq/dp = - A^-1 F_p``, which is found first: their differences are those of matrices of neighbours
moved along it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.gradients.equations.step_tangent import BlockVectors
from flexfem.gradients.motion.trajectory import StoppedError
from flexfem.gradients.states.eigenvectors import (
    SHIFT,
    ComplexArray,
    Inverse,
    Vectors,
    classes_of,
    equal,
    times,
    vectors_of,
)
from flexfem.gradients.states.neighbours import MATRICES, Parameter, check_without_sliders
from flexfem.gradients.states.path import SINGULAR, Direction, Equilibria, NearPath
from flexfem.solvers.statics.buckling import LinearBuckling

__all__ = ["BucklingLoads"]


class BucklingLoads:
    """Buckling loads of a path from its first and last equilibrium.

    Attributes:
        loads: load factors by distance from the first equilibrium.
    """

    def __init__(self, path: Equilibria, groups: Sequence[Sequence[int]]) -> None:
        """Find them (collective).

        Args:
            path: the path.
            groups: loads, from 1, whose means are differentiated.

        Raises:
            InputError: there are fewer, or one of these is equal to one outside its group.
        """
        check_without_sliders(path.system)
        self._path = path
        path.go_to(0)
        problem = LinearBuckling(path.equilibrium)
        path.go_to(path.rows - 1)
        found = problem.solve(max(number for group in groups for number in group) + 1)
        self.loads = [t for t, _ in found]
        self._span = float(path.times[-1] - path.times[0])
        for group in groups:
            self._check(group)
        matrices = []
        for row in self._rows:
            path.go_to(row)
            matrices.append(path.matrix())
        self._vectors = {
            numbers: self._of(matrices, [found[k - 1] for k in numbers])
            for numbers in classes_of(self.loads, groups)
        }

    @property
    def _rows(self) -> tuple[int, int]:
        """Rows of the history of both matrices."""
        return 0, self._path.rows - 1

    def _check(self, group: Sequence[int]) -> None:
        for number in group:
            if number > len(self.loads):
                raise InputError(
                    f"gradient: there is no buckling:{number}, {len(self.loads)} buckling loads "
                    "were found"
                )
            alike = equal(self.loads, number)
            if not set(alike) <= set(group):
                raise InputError(
                    f"gradient: buckling loads {alike[0]} to {alike[-1]} are equal "
                    f"({self.loads[number - 1]:g}), and have no derivatives one by one; take their "
                    f"mean, buckling:{alike[0]}-{alike[-1]}"
                )

    def _of(
        self, matrices: list[PETSc.Mat], found: Sequence[tuple[float, list[FloatArray]]]
    ) -> Vectors:
        """Vectors of equal loads, from these and their motions (collective)."""
        first, last = matrices
        mean = float(np.mean([t for t, _ in found]))
        mu = (mean - float(self._path.times[0])) / self._span
        shifted, same = mu * (1.0 + SHIFT), PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN
        matrix = first.copy()
        matrix.scale(1.0 - shifted)
        matrix.axpy(shifted, last, same)
        inverse = Inverse(matrix)
        if not inverse.regular:
            raise StoppedError(SINGULAR)

        def weigh(x: ComplexArray, transposed: bool) -> ComplexArray:
            return times(first, x, transposed=transposed) - times(last, x, transposed=transposed)

        rows = np.zeros(self._path.system.constraints.size)
        starts = [self._path.vector(motion, rows).astype(np.complex128) for _, motion in found]
        return vectors_of(mu, inverse, starts, self._total, weigh)

    def _total(self, values: ComplexArray) -> ComplexArray:
        """Sums over the ranks."""
        self._path.system.comm.Allreduce(MPI.IN_PLACE, values, op=MPI.SUM)
        return values

    def gradients(self, parameters: Sequence[Parameter]) -> dict[int, FloatArray]:
        """Derivatives (parameters,) of the loads by their numbers (collective).

        Those of equal ones are that of their mean.
        """
        found = {k: np.zeros(len(parameters), dtype=np.complex128) for k in self._vectors}
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
                    for numbers, own in self._vectors.items():
                        change = own.mean(partial(times, matrix))
                        found[numbers][p] += weight * share(own.value.real) * change
                    matrix.destroy()
        for changes in found.values():
            self._total(changes)
        return {k: changes.real * self._span for ks, changes in found.items() for k in ks}

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
