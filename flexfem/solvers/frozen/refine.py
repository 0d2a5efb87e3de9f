# SPDX-License-Identifier: LGPL-3.0-or-later
"""Refinement of a frozen step: GMRES on the exact tangent, preconditioned by the frozen solve."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray
from flexfem.solvers.frozen.vectors import StepVectors
from flexfem.solvers.linear.gmres import minimal_residual
from flexfem.system.mechanics import KeptAction, Mechanics
from flexfem.system.system import PartStrains, Shifts, System

__all__ = ["KeptOperator", "Refined", "Refinement"]

#: A refined step solves the linearised equations to this relative accuracy, in at most so many
#: sweeps of action and solve.
_INNER, _SWEEPS = 0.02, 8
#: With contacts the accuracy follows the contraction of the iteration, squared, within bounds:
#: as they open and close more is of no use, and near the end each iteration has the search for
#: contacts beside its solves (Eisenstat, Walker, SIAM J. Sci. Comput. 17 (1996) 16-32).
_INNER_CONTACTS = 1e-3, 0.05


#: Frozen solve for the blocks' residuals and given values (r,) of the rows: the steps are left in
#: the blocks, the multipliers' correction (r,) is returned.
_Solve = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class KeptOperator:
    """The frozen operator of one step.

    Attributes:
        action: of its matrices.
        solve: without contacts.
        solve_beyond: for a correction of steps, with contacts.
    """

    action: KeptAction
    solve: _Solve
    solve_beyond: _Solve


@dataclass(frozen=True)
class Refined:
    """Result of the refinement of a step.

    Attributes:
        defect: Error of the frozen operator, relative to the step.
        exact: True if the step solves the linearised equations, so that fresh factors would not
            help.
        missed: Error of the frozen operator, a vector of this rank.
        stale: Part of it that is that of kept matrices alone, without contacts; 0 if these are not
            used, see ``Refinement``.
    """

    defect: float
    exact: bool
    missed: FloatArray
    stale: float = 0.0


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
        frozen: KeptOperator,
        contraction: float = 1.0,
    ) -> tuple[FloatArray, Refined]:
        """Correct the last frozen step (collective).

        With barriers, sweeps take the frozen matrices where these are accurate enough; the error of
        a step is always that of the exact tangent.

        Args:
            shifts: factors of the scheme.
            strains: strains of each part whose stresses are used in the tangent.
            correction: correction of the multipliers (r,) by the frozen solve; the blocks have
                their steps and the residuals of this solve.
            frozen: the operator of this solve.
            contraction: of the last iteration.

        Returns:
            The multipliers' correction, after that of the blocks' steps, and a :class:`Refined`.
        """
        system, mechanics, vectors = self._system, self._mechanics, self._vectors
        rows, solve = system.constraints, frozen.solve_beyond
        hessians = mechanics.hessians(system, rows.multipliers)

        def apply(vector: FloatArray) -> FloatArray:
            multipliers = vectors.put(vector)
            for part in system.parts:
                part.block.residual[:] = 0.0
            mechanics.subtract_tangent(system, shifts, hessians, strains, kept)
            system.add_constraint_forces(-multipliers)
            return -vectors.collect(solve(rows.yielding(multipliers)))

        solution = vectors.collect(correction)
        # residual of the linearised equations
        system.add_constraint_forces(correction)
        kept, change = None, 0.0
        if system.repels and (found := self._change(shifts, strains, frozen)) is not None:
            kept, change = frozen.action, found
        mechanics.subtract_tangent(system, shifts, hessians, strains, kept)
        yielding = rows.yielding(solution[vectors.sizes[-1] :])
        residual = vectors.collect(solve(rows.values + yielding))
        inner = _INNER
        if system.contacts:
            least = _INNER_CONTACTS[0] if system.repels else _INNER_CONTACTS[1]
            inner = min(max(contraction**2, least), _INNER_CONTACTS[1])
        size, missed = np.sqrt(vectors.squares(solution, residual)).tolist()
        if kept is not None and change * missed > inner * size * size:
            kept = None
        more, exact = minimal_residual(
            apply, residual, missed, vectors.products, inner * size, _SWEEPS
        )
        multipliers = vectors.put(solution + more)
        over = 1.0 / size if size > 0.0 else 0.0
        return -multipliers, Refined(over * missed, exact, residual, over * change)

    def _change(self, shifts: Shifts, strains: PartStrains, frozen: KeptOperator) -> float | None:
        """Norm of what the frozen matrices miss of the last step, without contacts (collective).

        It is added to the residuals: the kept action is that of the exact tangent then. None if no
        matrices are kept.
        """
        system, vectors = self._system, self._vectors
        blocks = [part.block for part in system.parts]
        before = [(block.residual.copy(), block.owned_step.copy()) for block in blocks]
        for block in blocks:
            block.residual[:] = 0.0
        strained = zip(system.parts, strains, strict=True)
        used = 0.0
        for part, own in strained:
            if frozen.action(part, 1.0):
                used = 1.0
                self._mechanics.add_own_action(system, part, shifts, -1.0, own)
        missed = [block.residual.copy() for block in blocks]
        square = None
        if vectors.sum(np.array([used]))[0]:
            correction = frozen.solve(np.zeros(system.constraints.size))
            (square,) = vectors.squares(vectors.collect(correction))
        for block, (residual, step), change in zip(blocks, before, missed, strict=True):
            block.residual[:], block.owned_step[:] = residual + change, step
        return None if square is None else float(np.sqrt(square))
