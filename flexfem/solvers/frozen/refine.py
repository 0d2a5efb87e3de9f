# SPDX-License-Identifier: LGPL-3.0-or-later
"""Refinement of a frozen step: GMRES on the exact tangent, preconditioned by the frozen solve."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray
from flexfem.solvers.frozen.vectors import StepVectors
from flexfem.solvers.linear.gmres import minimal_residual
from flexfem.system.mechanics import Mechanics
from flexfem.system.system import PartStrains, Shifts, System

__all__ = ["Refined", "Refinement"]

#: A refined step solves the linearised equations to this relative accuracy, in at most so many
#: sweeps of action and solve.
_INNER, _SWEEPS = 0.02, 8
#: The same with contacts, whose own tangents are not more accurate.
_INNER_CONTACTS = 0.05


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
    """Corrections of frozen steps by the action of the consistent tangent."""

    def __init__(self, system: System, mechanics: Mechanics, vectors: StepVectors) -> None:
        """Store the system whose equations ``mechanics`` are solved, and its vectors."""
        self._system, self._mechanics, self._vectors = system, mechanics, vectors

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
        system, mechanics, vectors = self._system, self._mechanics, self._vectors
        rows = system.constraints
        hessians = mechanics.hessians(system, rows.multipliers)

        def apply(vector: FloatArray) -> FloatArray:
            multipliers = vectors.put(vector)
            for part in system.parts:
                part.block.residual[:] = 0.0
            mechanics.subtract_tangent(system, shifts, hessians, strains)
            system.add_constraint_forces(-multipliers)
            return -vectors.collect(solve(rows.yielding(multipliers)))

        solution = vectors.collect(correction)
        # residual of the linearised equations
        system.add_constraint_forces(correction)
        mechanics.subtract_tangent(system, shifts, hessians, strains)
        yielding = rows.yielding(solution[vectors.sizes[-1] :])
        residual = vectors.collect(solve(rows.values + yielding))
        inner = _INNER_CONTACTS if system.contacts else _INNER
        size, missed = np.sqrt(vectors.squares(solution, residual)).tolist()
        more, exact = minimal_residual(
            apply, residual, missed, vectors.products, inner * size, _SWEEPS
        )
        multipliers = vectors.put(solution + more)
        return -multipliers, Refined(missed / size if size > 0.0 else 0.0, exact, residual)
