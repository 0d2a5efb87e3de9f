# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stabilised index-2 form of the Lie-group generalized-alpha method.

Arnold, Brüls, Cardona, "Error analysis of generalized-alpha Lie group time integration methods for
constrained mechanical systems", Numer. Math. 129 (2015) 149-179, after Gear, Leimkuhler, Gupta
(1985): constraints and their rates, ``Phi = 0`` and ``G v + dPhi/dt = 0``, are both satisfied at
the end of every step, since positions have an additional increment ``p`` besides the integrated
one. Multipliers are of second order from the first step on in every group, where index 3 shows
first order at first on R^3 x SO(3).

The increment satisfies ``A p + G^T mu = 0`` with the exact derivatives ``A`` of the equations by
increments at the end of the step: it changes the forces of all bodies by forces of joints alone.
For rigid bodies ``A`` is close to the mass matrix; of flexible ones that alone would move single
nodes against the elements around them, and disturb accelerations by ``p/h^2``. ``p`` is of third
order in the step, and a part of the solution like all others, whatever matrices have been computed.
A Newton iteration solves twice with one matrix: for the dynamics with the rates of the rows,
divided by ``dv/dn`` so that their derivatives are G as the step shrinks; then for the change of
``p`` with the residuals of its equation and of the rows.
"""

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.differences import STENCIL
from flexfem.integrators.generalized_alpha import GeneralizedAlpha
from flexfem.solvers.newton.iteration import Equations
from flexfem.system.mechanics import END_POINT, EndPoint, SolveAgain
from flexfem.system.moving_apart import Moved
from flexfem.system.system import Shifts, System

__all__ = ["Rates", "StabilizedIndex2"]

#: Span of differences of drives, as a part of the step.
_SPAN = 1.0 / 16.0


@dataclass
class StabilizedIndex2(GeneralizedAlpha):
    """Coefficients of the scheme, those of generalized-alpha."""

    def _equations(self, h: float, tolerance: float) -> Equations:
        return _PositionsAndRates(self.rates(h), self._mechanics, tolerance)

    def rates(self, h: float) -> "Rates":
        """Rates of constraints as equations of a step of size ``h`` (s)."""
        return Rates(self.shifts(h).velocity, _SPAN * h)


@dataclass(frozen=True)
class Rates:
    """Rates of constraints as equations.

    Attributes:
        velocity: dv/dn of the step, by which they are divided, 1/s.
        span: time over which drives are differentiated, s.
    """

    velocity: float
    span: float

    def use(self, system: System, shifts: Shifts, mechanics: EndPoint) -> FloatArray:
        """Replace constraints, which have been evaluated, by their rates.

        Args:
            system: at the trial state.
            shifts: with which derivatives are those of rates.
            mechanics: that has evaluated them.

        Returns:
            Values of the constraints (r,), zero for other rows.
        """
        by_time = self._by_time(system, shifts, mechanics)
        return system.constraints.use_rates(shifts.velocity, by_time, self.velocity)

    def _by_time(
        self, system: System, shifts: Shifts, mechanics: EndPoint
    ) -> tuple[FloatArray, FloatArray]:
        """Rates of all rows (r,), and of their gradients (t, 2, 6), at fixed positions."""
        rows = system.constraints
        values, gradients = np.zeros(rows.size), np.zeros_like(rows.force_jacobian)
        if not rows.driven:
            return values, gradients
        for k, weight in STENCIL:
            rows.set_time(system.instant + k * self.span)
            rows.evaluate(shifts.dynamics)
            values += weight / self.span * rows.values
            gradients += weight / self.span * rows.force_jacobian
        rows.set_time(system.instant)
        mechanics.evaluate_rows(system, shifts)
        return values, gradients


class _PositionsAndRates:
    """Equations of motion, and constraints on positions and velocities."""

    def __init__(self, rates: Rates, mechanics: EndPoint, tolerance: float) -> None:
        """Store the equations.

        Args:
            rates: those of the constraints.
            mechanics: the equations of motion.
            tolerance: p up to this, m or rad, is not corrected for errors of the matrix.
        """
        self._rates, self._mechanics, self._tolerance = rates, mechanics, tolerance
        self._shifts: Shifts | None = None
        self._gaps: FloatArray = np.zeros(0)
        self._multipliers: FloatArray = np.zeros(0)
        # largest entries of all changes of p in this step, summed up
        self._way = 0.0

    def evaluate(self, system: System, shifts: Shifts) -> None:
        """See :class:`Equations`."""
        self._mechanics.evaluate(system, shifts)
        self._gaps = self._rates.use(system, shifts, self._mechanics)
        self._shifts = shifts

    def correct(self, system: System, again: SolveAgain | None) -> Moved:
        """See :class:`Equations`."""
        assert again is not None
        moved = END_POINT.correct(system, again)
        system.interface.update_steps()
        rows = system.constraints
        gaps = self._gaps - rows.rigid * rows.changes(system.interface.steps)
        success, change = again(gaps + self._put_defects(system))
        self._multipliers = self._multipliers - change
        shift = system.shift(-1.0)
        self._way += shift
        largest = float(np.max([moved.largest, shift]))
        return moved._replace(largest=largest, success=success)

    def _put_defects(self, system: System) -> FloatArray:
        """Set the residuals to those of the equation of p (collective).

        Returns:
            Those of the rows of force laws, which change along p as well (r,).
        """
        rows = system.constraints
        for part in system.parts:
            part.block.residual[:] = 0.0
        if not any(part.block.shifted for part in system.parts):
            self._way, self._multipliers = 0.0, np.zeros(rows.size)
        if not system.comm.allreduce(self._way, op=MPI.MAX) > self._tolerance:
            return np.zeros(rows.size)
        assert self._shifts is not None
        for part in system.parts:
            part.block.put_shifts()
        for contacts in system.contacts:
            if not contacts.evaluated:
                contacts.evaluate()
        hessians = self._mechanics.hessians(system, rows.multipliers)
        self._mechanics.subtract_tangent(system, self._shifts, hessians)
        for part in system.parts:
            np.negative(part.block.residual, out=part.block.residual)
        system.add_constraint_forces(self._multipliers)
        changes = rows.value_changes(system.interface.steps) - rows.yielding(self._multipliers)
        return np.where(rows.rigid, 0.0, changes)
