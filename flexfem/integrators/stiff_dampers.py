# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dampers of joints that end accelerations of the nodes they act on within much less than a step.

A damper c of a row with the gradient g exerts the impulse ``dt c g u`` over a step with the rates
u. It is a row with the equation ``g u - L / (dt c) = 0`` beside those of constraints.
"""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.constraints.batch import Constraints
from flexfem.core.laws import FRICTION_LAWS, LawKind
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.system.system import System

__all__ = ["StiffDampers", "damping_of_rows"]

#: Laws whose force is linear in the rate, or has a part that is, with the damping coefficient.
_LINEAR_PART = (LawKind.SPRING, *FRICTION_LAWS)
#: Mobility (1/kg) of what has no mass.
_MASSLESS = 1e30
#: ``dt c g^2 / m`` from which on a step is far from resolving a damper.
_FAR = 100.0


@dataclass(frozen=True)
class StiffDampers:
    """Rows with dampers that a step does not resolve.

    Attributes:
        chosen: (r,) True for these rows.
        coefficients: (r,) c, N s/m or N m s/rad.
        any: True if there are any, on any rank.
        far: True if a step is far from resolving one of them.
    """

    chosen: BoolArray
    coefficients: FloatArray
    any: bool
    far: bool

    @classmethod
    def of(cls, system: System, masses: TangentSolver, dt: float) -> StiffDampers:
        """Those with ``dt c g^2 / m > 1`` (collective); steps of the blocks are work space.

        The masses m are those of the nodes, which what is attached to them makes larger.

        Args:
            system: with evaluated rows.
            masses: solver whose matrix is that of the masses.
            dt: size of the step, s.
        """
        rows = system.constraints
        if not system.comm.allreduce(rows.damped, op=MPI.LOR):
            return cls(np.zeros(rows.size, dtype=np.bool_), np.zeros(rows.size), False, False)
        for part, mass in zip(system.parts, masses.diagonals(), strict=True):
            step = np.full_like(mass, _MASSLESS)
            part.block.owned_step[:] = np.divide(1.0, mass, out=step, where=mass > 1.0 / _MASSLESS)
            part.block.spread_step()
        system.interface.update_steps()
        coefficients = damping_of_rows(rows)
        ratios = dt * coefficients * rows.mobilities(system.interface.steps)
        largest = system.comm.allreduce(float(ratios.max(initial=0.0)), op=MPI.MAX)
        return cls(ratios > 1.0, coefficients, largest > 1.0, largest > _FAR)

    def use(self, rows: Constraints, dt: float) -> None:
        """Replace the equations of evaluated rows with laws by those of these dampers."""
        rigid, stiff = rows.rigid, self.chosen
        rows.leave_out(~rigid)
        rows.coupling[:] = 0.0
        rows.compliance[stiff] = 1.0 / (dt * self.coefficients[stiff])
        rows.step_jacobian[:] = rows.gradients_of(rigid | stiff)


def damping_of_rows(rows: Constraints) -> FloatArray:
    """(r,) damping coefficients (N s/m or N m s/rad) of evaluated rows, zero without or negative.

    Friction counts with its viscous part. What it has besides is bounded, and so slows nodes down,
    but does not drive them.
    """
    kinds = rows.elastic[:, 0]
    slopes = np.divide(
        rows.slopes[:, 1], rows.compliance, out=np.zeros(rows.size), where=rows.compliance > 0.0
    )
    given = np.isin(kinds, _LINEAR_PART)
    found: FloatArray = np.where(given, rows.elastic[:, 2], slopes) * rows.active
    found[np.isin(kinds, (LawKind.RIGID, LawKind.POTENTIAL))] = 0.0
    found[found < 0.0] = 0.0
    return found
