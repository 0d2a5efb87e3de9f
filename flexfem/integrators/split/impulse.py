# SPDX-License-Identifier: LGPL-3.0-or-later
"""Impulses of a constrained system: ``M W + G^T m = -r`` and ``G W = 0``.

G has the gradients of the constraint equations alone: springs and dampers exert no impulses.

Damped impulses have ``M + h C`` in the place of M, with the linear damping C of elements, in a step
of size h: it spreads impulses at single nodes before the step is over. That is a part of a scheme
(``stiff_damping``).

The mass matrix hardly changes in the nodes' own axes, so its factors are kept, those of the start,
those with damping as well, and the solution is refined by residuals with the exact matrix.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from math import inf, isfinite

from flexfem._types import FloatArray
from flexfem.contact.barrier.contacts import BarrierContacts
from flexfem.solvers.frozen.solver import FrozenSolver
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.system.mechanics import END_POINT, VISCOUS
from flexfem.system.system import MASS, System

__all__ = ["Impulse", "zero_increments"]

#: Largest relative correction of velocities at which refinement ends, with damping, where no energy
#: is to be kept, as well, the error that is accepted, and the number of corrections before masses
#: are factorised anew.
_TOLERANCE, _DAMPED_TOLERANCE, _ACCEPTED, _SWEEPS = 1e-11, 1e-9, 1e-8, 25


@contextmanager
def zero_increments(system: System) -> Iterator[None]:
    """Let derivatives be those along velocities, which they are at increments of zero."""
    blocks = [part.block for part in system.parts]
    increments = [block.increment.copy() for block in blocks]
    for block in blocks:
        block.increment[:] = 0.0
    yield
    for block, own in zip(blocks, increments, strict=True):
        block.increment[:] = own


class Impulse:
    """Solver for the jumps of velocities and the constraints' share of impulses."""

    def __init__(self, system: System, *, damped: bool = False) -> None:
        """Store the system; masses are factorised at the first call (collective).

        Args:
            system: the system.
            damped: True to spread impulses by the damping of elements.
        """
        self._system, self.damped = system, damped and system.viscous()
        self._mechanics, self._shifts = (VISCOUS if self.damped else END_POINT), MASS
        self._kept: FrozenSolver | None = None
        self._tangent: TangentSolver | None = None

    def solve(self, h: float = 0.0, values: FloatArray | None = None) -> FloatArray | None:
        """Solve for the blocks' residuals r; rows are evaluated at the trial state (collective).

        Equations of the rows are replaced.

        Args:
            h: size of the step, s, in which damping spreads impulses; 0 for accelerations.
            values: (r,) of ``-G W``, None for zero.

        Returns:
            Multipliers m (r,), and ``-W`` in the blocks' steps; None if masses are singular.
        """
        system, rows = self._system, self._system.constraints
        if self.damped:
            self._shifts = replace(MASS, velocity=h)
        right = [part.block.owned_residual.copy() for part in system.parts]
        rigid = rows.rigid
        rows.multipliers[:] = 0.0
        rows.leave_out(~rigid)
        rows.step_jacobian[:] = rows.gradients_of(rigid)
        rows.values[:] = 0.0 if values is None else values * rigid
        rows.coupling[:] = 0.0
        with zero_increments(system):
            return self._found(right)

    def restitute(self, contacts: BarrierContacts, h: float, means: FloatArray) -> bool | None:
        """Impulses of restitution at the end of a step of size h, s (collective).

        The changes of velocities are left in the blocks' steps; rows are evaluated at the trial
        state, and their equations are replaced.

        Args:
            contacts: of the system.
            h: size of the step, s.
            means: becomes mean multipliers over the step (r,).

        Returns:
            True, None if there are no impulses, False if masses are singular.
        """

        def solve() -> bool:
            multipliers = self.solve(h)
            if multipliers is not None:
                means[:] = multipliers * self._system.constraints.rigid
            return multipliers is not None

        found = contacts.pull(h, solve)
        if not found:
            means[:] = 0.0
            return found
        for part in self._system.parts:
            part.block.owned_step[:] *= -h
        return True

    def _found(self, right: list[FloatArray]) -> FloatArray | None:
        """Solution for given residuals, see :meth:`solve`."""
        if self._tangent is None:
            for fresh in (False, True):
                found = self._refined(right, fresh)
                if found is not None:
                    return found
        return self._direct(right)

    def _refined(self, right: list[FloatArray], fresh: bool) -> FloatArray | None:
        """Solution with kept or ``fresh`` factors; None if it does not converge (collective)."""
        system, kept = self._system, self._factors(fresh)
        for part, own in zip(system.parts, right, strict=True):
            part.block.owned_residual[:] = own
        success, change, _ = kept.step(self._shifts, system.present)
        if not success:
            return None
        multipliers, last = -change, inf
        tolerance = _DAMPED_TOLERANCE if self.damped else _TOLERANCE
        if kept.exact:
            return multipliers
        for _ in range(_SWEEPS):
            before = [part.block.owned_step.copy() for part in system.parts]
            _, change = kept.again(self._defects(right, multipliers))
            multipliers = multipliers - change
            correction = system.largest_step()
            for part, steps in zip(system.parts, before, strict=True):
                part.block.owned_step[:] += steps
            size = system.largest_step()
            if correction <= tolerance * size:
                return multipliers
            if not isfinite(correction):
                return None
            if correction >= last:
                break
            last = correction
        return multipliers if correction <= _ACCEPTED * size else None

    def _defects(self, right: list[FloatArray], multipliers: FloatArray) -> FloatArray:
        """Residuals of the blocks, left there, and values (r,) of the rows (collective)."""
        system, rows = self._system, self._system.constraints
        self._mechanics.multiply_mass(system, -1.0, self._shifts)
        for part, own in zip(system.parts, right, strict=True):
            part.block.owned_residual[:] += own
        system.add_constraint_forces(multipliers)
        system.interface.update_steps()
        changes = rows.changes(system.interface.steps) * rows.rigid
        return rows.values - changes - rows.yielding(multipliers)

    def _factors(self, fresh: bool) -> FrozenSolver:
        """Solver with the factors of the masses at the start, or of the trial state."""
        if self._kept is None:
            self._kept = (
                FrozenSolver(self._system, self._mechanics) if self.damped
                else FrozenSolver.of_masses(self._system)
            )  # fmt: skip
        if fresh:
            self._kept.factor(self._shifts)
        elif self.damped:
            self._kept.use(self._shifts, self._system.present)
        return self._kept

    def _direct(self, right: list[FloatArray]) -> FloatArray | None:
        """Solution by the whole matrix, for bodies whose masses are singular (collective)."""
        system = self._system
        if self._tangent is None:
            self._tangent = TangentSolver(system)
        system.counters.mass_factorizations += 1
        self._tangent.assemble(self._shifts, mechanics=self._mechanics)
        if not (self._tangent.factor() and self._tangent.solve(right, system.constraints.values)):
            return None
        return -self._tangent.multiplier_step
