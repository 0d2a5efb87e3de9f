# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stabilised index-2 form of the Lie-group generalized-alpha method.

Arnold, Brüls, Cardona, "Error analysis of generalized-alpha Lie group time integration methods for
constrained mechanical systems", Numer. Math. 129 (2015) 149-179, after Gear, Leimkuhler, Gupta
(1985): constraints and their rates, ``Phi = 0`` and ``G v + dPhi/dt = 0``, are both satisfied at
the end of every step, since positions have an additional increment ``p`` besides the integrated
one. Multipliers are of second order from the first step on in every group, where index 3 shows
first order at first on R^3 x SO(3).

The increment is ``p = A^-1 G^T mu`` with the iteration matrix ``A``, which is close to the mass
matrix for rigid bodies and gives smooth corrections of flexible ones. A Newton iteration solves
twice with one matrix: for the dynamics with the rates of the rows, divided by ``dv/dn`` so that
their derivatives are G as the step shrinks; then for ``p`` with the residuals of the rows. ``p`` is
of third order in the step; different matrices (``frozen``, ``updated``) change it by a part of
that.
"""

from dataclasses import dataclass, replace

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.differences import STENCIL
from flexfem.integrators.generalized_alpha import GeneralizedAlpha
from flexfem.solvers.newton.iteration import Equations, SolveAgain
from flexfem.system.mechanics import END_POINT, Correction, EndPoint
from flexfem.system.system import Shifts, System

__all__ = ["StabilizedIndex2"]

#: Span of differences of drives, as a part of the step.
_SPAN = 1.0 / 16.0


@dataclass
class StabilizedIndex2(GeneralizedAlpha):
    """Coefficients of the scheme, those of generalized-alpha."""

    def _equations(self, h: float) -> Equations:
        return _PositionsAndRates(_SPAN * h, self._mechanics)


class _PositionsAndRates:
    """Equations of motion, and constraints on positions and velocities."""

    def __init__(self, span: float, mechanics: EndPoint) -> None:
        """Store the equations of motion, and ``span`` (s), over which drives are differentiated."""
        self._span, self._mechanics = span, mechanics
        self._gaps: FloatArray = np.zeros(0)

    def evaluate(self, system: System, shifts: Shifts) -> None:
        """See :class:`Equations`."""
        self._mechanics.evaluate(system, shifts)
        by_time = self._by_time(system, shifts)
        self._gaps = system.constraints.use_rates(shifts.velocity, by_time)

    def _by_time(self, system: System, shifts: Shifts) -> FloatArray:
        """Rates of all rows (r,) at fixed positions."""
        rows, total = system.constraints, np.zeros(system.constraints.size)
        if not rows.driven:
            return total
        for k, weight in STENCIL:
            rows.set_time(system.instant + k * self._span)
            rows.evaluate(shifts.dynamics)
            total += weight / self._span * rows.values
        rows.set_time(system.instant)
        self._mechanics.evaluate_rows(system, shifts)
        return total

    def correct(self, system: System, again: SolveAgain | None) -> Correction:
        """See :class:`Equations`."""
        assert again is not None
        moved = END_POINT.correct(system, again).moved
        system.interface.update_steps()
        rows = system.constraints
        gaps = self._gaps - rows.rigid * rows.changes(system.interface.steps)
        for part in system.parts:
            part.block.residual[:] = 0.0
        success = again(gaps)
        largest = float(np.max([moved.largest, system.shift(-1.0)]))
        return Correction(success, replace(moved, largest=largest))
