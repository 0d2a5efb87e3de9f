# SPDX-License-Identifier: LGPL-3.0-or-later
"""Refinement of a frozen step: GMRES on the consistent tangent, preconditioned by the frozen solve.

The blocks' steps and the multipliers of a solution are one vector: owned unknowns of all parts,
then this rank's rows.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.runs import starts
from flexfem.solvers.linear.gmres import minimal_residual
from flexfem.system.mechanics import Mechanics
from flexfem.system.system import PartStrains, Shifts, System

__all__ = ["Refined", "Refinement"]

#: A refined step solves the linearised equations to this relative accuracy, in at most so many
#: sweeps of action and solve.
_INNER, _SWEEPS = 0.02, 8


@dataclass(frozen=True)
class Refined:
    """Result of the refinement of a step.

    Attributes:
        defect: Error of the frozen operator, relative to the step.
        exact: True if the step solves the linearised equations, so that fresh factors would not
            help.
        missed: Error of the frozen operator, a vector of this rank.
    """

    defect: float
    exact: bool
    missed: FloatArray


class Refinement:
    """Corrections of frozen steps by the action of the consistent tangent.

    Attributes:
        sizes: (n_parts + 1,) first unknown of each part in vectors.
    """

    def __init__(self, system: System, mechanics: Mechanics) -> None:
        """Store the system whose equations ``mechanics`` are solved."""
        self._system, self._mechanics = system, mechanics
        self.sizes = starts([p.block.sizes[0] for p in system.parts])

    def correct(
        self,
        shifts: Shifts,
        strains: PartStrains,
        correction: FloatArray,
        solve: Callable[[FloatArray], FloatArray],
    ) -> tuple[FloatArray, Refined]:
        """Correct the last frozen step (collective).

        Args:
            shifts: factors of the scheme.
            strains: strains of each part whose stresses are used in the tangent.
            correction: correction of the multipliers (r,) by the frozen solve; the blocks have
                their steps and the residuals of this solve.
            solve: frozen solve for a correction of the steps: blocks' steps for their residuals and
                given values (r,) of the rows; returns the multipliers' correction.

        Returns:
            The multipliers' correction, after that of the blocks' steps, and a :class:`Refined`.
        """
        system, mechanics, count = self._system, self._mechanics, self.sizes[-1]
        rows = system.constraints
        hessians = mechanics.hessians(system, rows.multipliers)

        def apply(vector: FloatArray) -> FloatArray:
            multipliers = self._put(vector)
            for part in system.parts:
                part.block.residual[:] = 0.0
            mechanics.subtract_tangent(system, shifts, hessians, strains)
            system.add_constraint_forces(-multipliers)
            return -self._collect(solve(rows.yielding(multipliers)))

        solution = self._collect(correction)
        # residual of the linearised equations
        system.add_constraint_forces(correction)
        mechanics.subtract_tangent(system, shifts, hessians, strains)
        residual = self._collect(solve(rows.values + rows.yielding(solution[count:])))
        size, missed = np.sqrt(self.squares(solution, residual)).tolist()
        more, exact = minimal_residual(
            apply, residual, missed, self._products, _INNER * size, _SWEEPS
        )
        multipliers = self._put(solution + more)
        return -multipliers, Refined(missed / size if size > 0.0 else 0.0, exact, residual)

    def squares(self, *vectors: FloatArray) -> FloatArray:
        """Squares of the norms of the blocks' parts over all ranks (collective)."""
        count = self.sizes[-1]
        return self._sum(np.array([v[:count] @ v[:count] for v in vectors]))

    def _products(self, rows: FloatArray, vector: FloatArray) -> FloatArray:
        """Inner products (k,) of rows (k, n) with a vector: the blocks' parts, over all ranks."""
        count = self.sizes[-1]
        return self._sum(rows[:, :count] @ vector[:count])

    def _sum(self, values: FloatArray) -> FloatArray:
        if self._system.comm.size > 1:
            self._system.comm.Allreduce(MPI.IN_PLACE, values)
        return values

    def _put(self, solution: FloatArray) -> FloatArray:
        """Write the blocks' parts of a solution to their steps; the multipliers' part."""
        for part, (start, end) in zip(self._system.parts, pairwise(self.sizes), strict=True):
            part.block.owned_step[:] = solution[start:end].reshape(-1, part.block.width)
        return solution[self.sizes[-1] :]

    def _collect(self, correction: FloatArray) -> FloatArray:
        """Steps of the owned nodes of all blocks, then of this rank's multipliers, as a vector.

        ``S dL = Phi - G~ y`` is the correction; steps are to be subtracted.
        """
        steps = [p.block.owned_step.ravel() for p in self._system.parts]
        return np.concatenate([*steps, -correction])
