# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stiff springs beside the frozen operator, such as the normal parts of closed contacts.

Their rows J and slopes D change from iteration to iteration and would need new factors of
``B + J^T D J``. With the factors of B, joints included, the forces ``lambda = D J x`` follow from

    (J B^-1 J^T + D^-1) lambda = J y,   y = B^-1 r,   x = y - B^-1 J^T lambda,

which is well posed however large the slopes. Forces are sought in the span of directions whose
responses ``B^-1 J^T p`` are known from one frozen solve each, such that the rows' motions that are
left are the least; while they are too large, they are the next direction (generalised conjugate
residuals; Eisenstat, Elman, Schultz 1983). All solves of an iteration share the directions: there
are no more of them than springs, and the last solves need none. Directions and motions are scaled
by ``1 / sqrt(c + 1/D)``, c a typical compliance of the rows, since slopes differ by decades.
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from flexfem._types import FloatArray
from flexfem.solvers.frozen.vectors import StepVectors
from flexfem.system.system import Shifts, System

__all__ = ["SpringRows", "StiffRows"]

#: Accuracy of the forces, as the part of the rows' scaled motion that is left, and largest number
#: of directions.
_ACCURACY, _MOST = 1e-2, 100
#: Slope of springs that have none, whose forces stay zero; part of a direction's motions below which
#: it depends on the others.
_NO_SLOPE, _DEPENDENT = 1e-200, 1e-12


class SpringRows(Protocol):
    """Springs of this rank along rows of motion.

    Attributes:
        slopes: derivatives (c,) of their forces by their motions, not negative, N/m.
    """

    @property
    def slopes(self) -> FloatArray:
        """See above."""
        ...

    def motions(self) -> FloatArray:
        """Motions (c,) for the blocks' steps, ``J x`` (collective)."""
        ...

    def push(self, forces: FloatArray) -> None:
        """Add ``J^T forces`` to the blocks' residuals (collective)."""
        ...


class StiffRows:
    """Correction of frozen solves by springs.

    Attributes:
        active: True if there are springs on any rank.
    """

    def __init__(
        self, system: System, vectors: StepVectors, solve: Callable[[FloatArray], FloatArray]
    ) -> None:
        """Store the frozen solve for the blocks' residuals and given values (r,) of the rows."""
        self._system, self._vectors, self._solve = system, vectors, solve
        self.active = False
        self._values = np.zeros(system.constraints.size)

    def take(self, rows: SpringRows | None, shifts: Shifts) -> None:
        """Use springs for the next solves, none for a matrix without stiffness (collective)."""
        self.active = False
        scale = shifts.scale * shifts.stiffness
        if rows is None or scale == 0.0:
            return
        slopes = scale * rows.slopes
        if self._vectors.sum(np.array([float(np.count_nonzero(slopes))]))[0]:
            self.active = True
            self._forces = _Forces(rows, slopes, self._respond, self._products)

    def correct(self, correction: FloatArray) -> FloatArray:
        """Add the springs to the frozen solve whose steps are in the blocks (collective).

        The blocks' residuals are kept.

        Args:
            correction: the multipliers' correction (r,) by the frozen solve.

        Returns:
            That with the springs.
        """
        if not self.active:
            return correction
        kept = [part.block.residual.copy() for part in self._system.parts]
        solution = self._vectors.collect(correction)
        for part, response in zip(self._forces.solve(), self._forces.responses, strict=True):
            solution -= part * response
        for part, residual in zip(self._system.parts, kept, strict=True):
            part.block.residual[:] = residual
        return -self._vectors.put(solution)

    def _respond(self, rows: SpringRows, forces: FloatArray) -> FloatArray:
        """Frozen solution for forces (c,) of the springs alone, also in the blocks' steps."""
        for part in self._system.parts:
            part.block.residual[:] = 0.0
        rows.push(forces)
        return self._vectors.collect(self._solve(self._values))

    def _products(self, rows: FloatArray, vector: FloatArray) -> FloatArray:
        """Inner products (k,) of rows (k, c) with a vector (c,) over all ranks."""
        return self._vectors.sum(rows @ vector)


class _Forces:
    """Forces of the springs of one iteration: directions with known responses."""

    def __init__(
        self, rows: SpringRows, slopes: FloatArray,
        respond: Callable[[SpringRows, FloatArray], FloatArray],
        products: Callable[[FloatArray, FloatArray], FloatArray],
    ) -> None:  # fmt: skip
        self._rows, self._slopes = rows, slopes
        self._respond, self._products = respond, products
        self._compliance = 1.0 / np.maximum(slopes, _NO_SLOPE)
        self._scaling = np.zeros(0)
        self.responses: list[FloatArray] = []
        self._directions: list[FloatArray] = []
        # scaled motions of the directions: an orthonormal basis times a triangle
        self._basis, self._triangle = np.zeros((0, len(slopes))), np.zeros((0, 0))

    def solve(self) -> FloatArray:
        """Parts of the responses in that to the springs' forces, for the blocks' steps."""
        motions = self._rows.motions()
        if not self.responses and not self._begin(motions):
            return np.zeros(0)
        found = self._products(self._basis, self._scaling * motions)
        while True:
            left = motions - (found @ self._basis) / self._scaling
            parts = np.linalg.solve(self._triangle, found)
            if self._enough(parts, left) or not self._extend(left):
                return parts
            found = self._products(self._basis, self._scaling * motions)

    def _enough(self, parts: FloatArray, left: FloatArray) -> bool:
        """True if the springs' forces for the motions (c,) that are left are small beside all."""
        forces = parts @ np.array(self._directions)
        error, size = self._norm(self._slopes * left), self._norm(forces)
        return not error > _ACCURACY * size

    def _begin(self, motions: FloatArray) -> bool:
        """Find the scaling by the springs' forces for motions without reaction, if there are."""
        forces = self._slopes * motions
        size = self._norm(forces)
        if not 0.0 < size < np.inf:
            return False
        forces /= size
        response = self._respond(self._rows, forces)
        moved = self._rows.motions()
        self._scaling = 1.0 / np.sqrt(self._norm(moved) + self._compliance)
        return self._append(forces, response, self._scaling * (moved + self._compliance * forces))

    def _extend(self, left: FloatArray) -> bool:
        """Add a direction for motions (c,) that are left; False if it depends on the others."""
        forces = self._scaling**2 * left
        size = self._norm(forces)
        if not size > 0.0 or len(self.responses) >= _MOST:
            return False
        forces /= size
        response = self._respond(self._rows, forces)
        moved = self._scaling * (self._rows.motions() + self._compliance * forces)
        return self._append(forces, response, moved)

    def _append(self, forces: FloatArray, response: FloatArray, moved: FloatArray) -> bool:
        """Add the response of a direction, and its scaled motions (c,) to the basis."""
        whole, column = self._norm(moved), np.zeros(len(self._basis))
        for _ in range(2):
            along = self._products(self._basis, moved)
            moved -= along @ self._basis
            column += along
        size = self._norm(moved)
        if not size > _DEPENDENT * whole:
            return False
        count = len(column)
        triangle = np.zeros((count + 1, count + 1))
        triangle[:count, :count] = self._triangle
        triangle[:count, count], triangle[count, count] = column, size
        self._triangle, self._basis = triangle, np.vstack([self._basis, moved / size])
        self._directions.append(forces)
        self.responses.append(response)
        return True

    def _norm(self, vector: FloatArray) -> float:
        return float(np.sqrt(self._products(vector[np.newaxis], vector)[0]))
