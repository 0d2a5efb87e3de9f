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
moved along it, with steps as long as suit ``y^T dB x``, see ``points``.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
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
from flexfem.gradients.states.neighbours import (
    Parameter,
    check_without_sliders,
    derivatives_by,
    derivatives_of_classes,
)
from flexfem.gradients.states.path import SINGULAR, Direction, Equilibria, NearPath
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.solvers.statics.buckling import LinearBuckling, linear_in_stiffness

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
        matrices, self._tangents = list[PETSc.Mat](), list[TangentSolver]()
        for row in self._rows:
            path.go_to(row)
            matrices.append(linear_in_stiffness(path.assemble()))
            self._tangents.append(path.tangent())
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

        def apply(x: ComplexArray) -> ComplexArray:
            return (1.0 - mu) * times(first, x) + mu * times(last, x)

        rows = np.zeros(self._path.system.constraints.size)
        starts = [self._path.vector(motion, rows).astype(np.complex128) for _, motion in found]
        return vectors_of(mu, inverse, starts, self._total, apply, weigh)

    def _total(self, values: ComplexArray) -> ComplexArray:
        """Sums over the ranks."""
        self._path.system.comm.Allreduce(MPI.IN_PLACE, values, op=MPI.SUM)
        return values

    def gradients(self, parameters: Sequence[Parameter]) -> dict[int, FloatArray]:
        """Derivatives (parameters,) of the loads by their numbers (collective).

        Those of equal ones are that of their mean.
        """
        return derivatives_of_classes(parameters, self._changes, self._vectors)

    def _changes(self, parameter: Parameter) -> FloatArray:
        """Derivatives of all vectors' loads by a number (collective)."""
        every = list(self._vectors.values())
        values = np.array([one.value.real for one in every])

        def difference(step: float) -> ComplexArray:
            near = [
                NearPath(self._path, parameter.beside(by), parameter.text) for by in (-step, step)
            ]
            total = np.zeros(len(every), dtype=np.complex128)
            for number, share in enumerate((1.0 - values, values)):
                change = self._matrix_change(number, near, step)
                total += share * [one.mean(partial(times, change)) for one in every]
                change.destroy()
            return self._total(total) * self._span / (2.0 * step)

        rounding = self._span * np.array([one.rounding for one in every])
        return derivatives_by(parameter, difference, rounding).real

    def _matrix_change(self, number: int, near: Sequence[NearPath], step: float) -> PETSc.Mat:
        """Difference of the neighbours' matrices at the first or the last row (collective)."""
        self._path.go_to(self._rows[number])
        direction = self._direction(self._tangents[number], near, step)
        matrices = []
        for one, way in zip(near, (-step, step), strict=True):
            one.go_to_present()
            one.move(direction, way)
            matrices.append(linear_in_stiffness(one.assemble()))
        before, after = matrices
        after.axpy(-1.0, before, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        before.destroy()
        return after

    def _direction(
        self, tangent: TangentSolver, near: Sequence[NearPath], step: float
    ) -> Direction:
        """Change of the present equilibrium with a parameter (collective)."""
        for one in near:
            one.go_to_present()
        (before, low), (after, high) = (one.residual() for one in near)
        blocks = [(b - a) / (2.0 * step) for a, b in zip(before, after, strict=True)]
        return self._path.direction(tangent, blocks, (high - low) / (2.0 * step))
