# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linearised equations of a step, solved with kept factors.

The exact operator is iterated with the frozen one by GMRES, forwards or transposed: both have the
same contraction, so that backwards no factorisation is needed where none was forwards.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Protocol

import numpy as np

from flexfem._types import FloatArray
from flexfem.gradients.equations.iterations import Operator, iterated
from flexfem.gradients.equations.step_tangent import STEP, BlockVectors, joined
from flexfem.gradients.equations.unilateral import Unilateral
from flexfem.solvers.frozen.policy import FrozenPolicy
from flexfem.solvers.frozen.solver import FrozenSolver
from flexfem.solvers.frozen.transposed import TransposedSolver
from flexfem.solvers.frozen.vectors import StepVectors
from flexfem.solvers.newton.policy import Policy
from flexfem.system.mechanics import END_POINT, Mechanics
from flexfem.system.system import Shifts, System

__all__ = ["Derivatives", "LinearizedStep", "UnsolvedError"]

#: Newton step at a recovered solution, m or rad, up to which it is one.
_MISSED = 1e-6


class UnsolvedError(RuntimeError):
    """Linearised equations could not be solved."""


class Derivatives(Protocol):
    """Derivatives of the equations of blocks and rows at the end of a step.

    Attributes:
        forces: those that elements and rows do not have.
        turning: True if directors turn with others.
    """

    turning: bool

    @property
    def forces(self) -> Sequence[Unilateral]:
        """See the class."""
        ...

    def take(self, shifts: Shifts) -> None:
        """Compute them at the trial state, and leave residuals evaluated (collective)."""

    def turned(self, blocks: BlockVectors) -> BlockVectors:
        """Local twists with the turns of directors, of those without, in place."""
        ...

    def turned_transposed(self, blocks: BlockVectors) -> BlockVectors:
        """The transposed of :meth:`turned`, in place."""
        ...

    def apply(
        self, blocks: BlockVectors, multipliers: FloatArray, matrix: int = STEP
    ) -> tuple[BlockVectors, FloatArray]:
        """Change by local twists and multipliers; see ``step_tangent.StepTangent``."""
        ...

    def apply_transposed(
        self, blocks: BlockVectors, multipliers: FloatArray, matrix: int = STEP
    ) -> tuple[BlockVectors, FloatArray]:
        """The transposed of :meth:`apply` (collective)."""
        ...


class LinearizedStep:
    """Linearised equations at the end of a step.

    Attributes:
        tangent: the exact derivatives.
        applications: number of products with them so far.
        factorizations: number of factorisations so far.
    """

    def __init__(
        self, system: System, policy: Policy, accuracy: float, tangent: Derivatives,
        mechanics: Mechanics = END_POINT,
    ) -> None:  # fmt: skip
        """Take the factors of a policy, if it keeps any (collective).

        Args:
            system: the system.
            policy: that of the motion.
            accuracy: relative one of solutions.
            tangent: the exact derivatives.
            mechanics: equations whose matrices are factorised, if the policy keeps none.
        """
        self._system, self._accuracy = system, accuracy
        self.tangent = tangent
        own = policy.frozen if isinstance(policy, FrozenPolicy) else FrozenSolver(system, mechanics)
        self._frozen = own
        self._transposed = TransposedSolver(system, own)
        self._vectors = StepVectors(system)
        self.applications = self.factorizations = 0

    def take(self, shifts: Shifts) -> None:
        """Linearise at the trial state, the solution of a step (collective).

        Raises:
            UnsolvedError: the equations are singular, or the state is no solution.
        """
        system = self._system
        self.tangent.take(shifts)
        if self._frozen.shifts != shifts:
            self._use(shifts)
        self._prepare(shifts)
        self._frozen.unspring()  # the transposed operator has none
        self._frozen.again(system.constraints.values)
        missed = system.largest_step()
        if not missed <= _MISSED:
            raise UnsolvedError(
                f"gradient: the step to t = {system.time:.6g} s cannot be recovered from the "
                f"states at its ends, its equations are off by {missed:.2g} (m or rad)"
            )

    def _use(self, shifts: Shifts) -> None:
        """Use the kept factors of a step size, or factorise (collective)."""
        before = self._system.counters.factorizations
        self._frozen.use(shifts, self._system.present)
        self.factorizations += self._system.counters.factorizations - before

    def factor(self, shifts: Shifts) -> None:
        """Factorise the bodies at the trial state (collective)."""
        if not self._frozen.exact:
            self.factorizations += 1
        self._frozen.factor(shifts)

    def _prepare(self, shifts: Shifts) -> None:
        if not (self._frozen.prepare(shifts) and self._transposed.prepare()):
            raise UnsolvedError("gradient: the linearised equations of a step are singular")

    def solve(
        self, blocks: BlockVectors, rows: FloatArray, *, transposed: bool = False,
        guess: FloatArray | None = None, accuracy: float | None = None,
    ) -> tuple[FloatArray, BlockVectors]:  # fmt: skip
        """Solve the linearised equations, or the transposed ones (collective).

        Args:
            blocks: right-hand sides of the blocks.
            rows: (r,) of the rows, the same on all ranks that have a row.
            transposed: True for the transposed equations.
            guess: a vector to begin with.
            accuracy: relative one of the solution, None for that of all others.

        Returns:
            The solution as a vector, see :meth:`parts`, and the residuals of the blocks; of the
            transposed equations also those along fixed unknowns.

        Raises:
            UnsolvedError: the iteration does not converge, with new factors neither.
        """
        tangent, given = self.tangent, blocks
        if transposed:
            blocks = tangent.turned_transposed([own.copy() for own in given])
        operator = Operator(
            self._action(transposed=transposed),
            partial(self.preconditioned, transposed=transposed), self.products,
        )  # fmt: skip
        solution, left = self.solved(operator, joined(blocks, rows), guess, accuracy)
        missed = self.parts(left)[0]
        if not transposed:
            return joined(tangent.turned(self.parts(solution)[0]), self.parts(solution)[1]), missed
        if tangent.turning:
            forces, _ = tangent.apply_transposed(*self.parts(solution))
            missed = [a - b for a, b in zip(given, forces, strict=True)]
        return solution, missed

    def solved(
        self, operator: Operator, right: FloatArray, guess: FloatArray | None,
        accuracy: float | None,
    ) -> tuple[FloatArray, FloatArray]:  # fmt: skip
        """Solve equations that are preconditioned by the frozen operator (collective).

        Args:
            operator: of the equations.
            right: their right-hand sides.
            guess: a vector to begin with.
            accuracy: see :meth:`solve`.

        Returns:
            The solution and what it misses of the right-hand sides.

        Raises:
            UnsolvedError: see :meth:`solve`.
        """
        accuracy = accuracy or self._accuracy
        found = iterated(operator, right, accuracy, None if self._frozen.exact else guess)
        if found is None:
            shifts = self._frozen.shifts
            assert shifts is not None
            self.factor(shifts)
            self._prepare(shifts)
            found = iterated(operator, right, accuracy, None)
        if found is None:
            raise UnsolvedError("gradient: the linearised equations of a step could not be solved")
        return found

    @property
    def products(self) -> Callable[[FloatArray, FloatArray], FloatArray]:
        """Inner products of vectors, see :class:`Operator`."""
        return self._vectors.products

    def _action(self, *, transposed: bool) -> Callable[[FloatArray], FloatArray]:
        """The operator on vectors, counted."""
        tangent = self.tangent

        def counted(vector: FloatArray) -> FloatArray:
            self.applications += 1
            blocks, rows = self.parts(vector)
            if transposed:
                forces, values = tangent.apply_transposed(blocks, rows)
                return joined(tangent.turned_transposed(forces), values)
            moved = tangent.turned([own.copy() for own in blocks])
            return joined(*tangent.apply(moved, rows))

        return counted

    def preconditioned(self, vector: FloatArray, *, transposed: bool) -> FloatArray:
        """Solve with the frozen operator, forwards or transposed."""
        blocks, rows = self.parts(vector)
        for part, values in zip(self._system.parts, blocks, strict=True):
            part.block.residual[:] = 0.0
            part.block.owned_residual[:] = values
        if transposed:
            return self._vectors.collect(-self._transposed.solve(rows))
        _, multipliers = self._frozen.again(rows)
        return self._vectors.collect(-multipliers)

    def parts(self, vector: FloatArray) -> tuple[BlockVectors, FloatArray]:
        """Views of the parts of a vector: those of blocks, and that of the rows (r,)."""
        *own, rows = np.split(vector, self._vectors.sizes[1:])
        parts = zip(own, self._system.parts, strict=True)
        return [values.reshape(-1, part.block.width) for values, part in parts], rows
