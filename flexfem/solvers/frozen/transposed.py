# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solves with the transposed operator of a frozen solver, from the same factors.

With ``A`` the matrices of the bodies and ``G~``, ``C`` the derivatives of the rows the operator is
``[[A, G^T], [G~, -C]]``. Its transposed one is of the same form with ``A^T`` and ``G``, ``G~``
exchanged, so that the multipliers' complement is ``S^T = G A^-T G~^T + C``. Nothing is factorised
but this small system. A solve takes two with the factors of the bodies.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.constraints.batch import Constraints
from flexfem.solvers.frozen.bodies import FlexibleBodies, RigidBodies
from flexfem.solvers.frozen.interface import MultiplierSystem
from flexfem.solvers.frozen.pieces import Bodies
from flexfem.solvers.frozen.solver import FrozenSolver
from flexfem.solvers.linear.schur_kernels import BodyColumns
from flexfem.system.system import System

__all__ = ["TransposedSolver"]


class TransposedSolver:
    """Solves with the transposed operator of a frozen solver, at the state it was prepared for."""

    def __init__(self, system: System, frozen: FrozenSolver) -> None:
        """Set up the multipliers' system (collective)."""
        self._system, self._frozen = system, frozen
        self._multipliers = MultiplierSystem(system, transposed=True)
        self._sides = [
            _Side(bodies, group)
            for group in self._multipliers.groups
            for bodies in frozen.bodies
            if bodies.group.part is group.part
        ]

    def prepare(self) -> bool:
        """Factorise the multipliers' system after ``FrozenSolver.prepare`` (collective)."""
        self._multipliers.follow_sliders()
        for side in self._sides:
            side.transpose()
        with _exchanged(self._system.constraints):
            return self._multipliers.factor(True)

    def solve(self, values: FloatArray) -> FloatArray:
        """Solve for the blocks' residuals and right-hand sides (r,) of the rows (collective).

        The solution for the blocks is left in their steps; returned is that of the rows (r,), the
        same on all ranks that have a row.
        """
        rows = self._system.constraints
        for side in self._sides:
            side.bodies.group.own.right[:] = side.residual
            side.bodies.solve(transposed=True)
        if not rows.size_global:
            return np.zeros(0)
        with _exchanged(rows):
            correction = self._multipliers.solve(values, self._sides)
            for side in self._sides:
                right = side.bodies.group.own.right
                right[:] = side.residual
                rows.add_forces(correction, side.bodies.group.part.interface_nodes, right)
        for side in self._sides:
            side.bodies.solve(transposed=True)
        return -correction


class _Side:
    """Bodies of one part, with transposed compliances in the multipliers' system."""

    def __init__(self, bodies: RigidBodies | FlexibleBodies, group: Bodies) -> None:
        """Store the bodies, and their columns in the multipliers' system."""
        self.bodies, self._own = bodies, group.own
        self.residual = group.part.block.residual
        self._order = _transposition(group.own)
        local = group.part.interface_nodes[group.own.columns[:, 0]]
        self._held = np.flatnonzero(local >= 0)
        self._nodes = local[self._held]

    def transpose(self) -> None:
        """Copy the transposed compliances of the bodies."""
        self._own.compliances[:] = self.bodies.group.own.compliances[self._order]

    def respond(self, y: FloatArray) -> None:
        """Write the bodies' steps into interface nodes and components (n, 6)."""
        columns, step = self._own.columns, self.bodies.group.part.block.step
        y[columns[:, 0], columns[:, 1]] = 0.0
        held = columns[self._held]
        y[held[:, 0], held[:, 1]] = step[self._nodes, held[:, 1]]


def _transposition(own: BodyColumns) -> IntArray:
    """Places of the entries of all transposed compliances."""
    found = [np.empty(0, dtype=np.int64)]
    for first, end in zip(own.compliance_start[:-1], own.compliance_start[1:], strict=True):
        width = round(np.sqrt(end - first))
        found.append(np.arange(first, end).reshape(width, width).T.ravel())
    return np.concatenate(found)


@contextmanager
def _exchanged(rows: Constraints) -> Iterator[None]:
    """Let loops over rows take forces for steps and steps for forces."""
    own = rows.own
    forces, steps = own.force_jacobian, own.step_jacobian
    own.force_jacobian, own.step_jacobian = steps, forces
    try:
        yield
    finally:
        own.force_jacobian, own.step_jacobian = forces, steps
