# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of stops and other rows that are slack between limits, over a step.

Their forces act along discrete gradients D of the rows (``constraints.rows.step_laws``), which
depend on both ends of the step. Derivatives of ``D^T L`` at fixed multipliers L, and of the rows'
equations by the start, are differences of fourth order, one node after the other; those of the
equations by the end are in the rows' own matrices.
"""

from __future__ import annotations

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.core.differences import STENCIL
from flexfem.gradients.equations.node_maps import increments_between, moved
from flexfem.gradients.equations.step_tangent import BlockVectors, forces_on_blocks
from flexfem.gradients.equations.unilateral import StateChange, StateFactors
from flexfem.integrators.split.step import Split
from flexfem.system.system import Shifts, System

__all__ = ["Stops"]

#: Differences of positions, m and rad.
_STEP = 1e-7


class Stops:
    """Derivatives of rows over a step; see ``equations.unilateral.Unilateral``."""

    def __init__(self, system: System, split: Split) -> None:
        """Store the system with its unilateral forces."""
        self._system, self._split = system, split
        rows = system.constraints
        found = rows.term_nodes[rows.unilateral[rows.row_of_term]]
        self._nodes = np.unique(found[found >= 0])  # of the interface
        size = 6 * len(self._nodes)
        self._turning, self._by_start = np.zeros((2, size, size)), np.zeros((rows.size, size))
        self._parts = [part.block for part in system.parts]

    def take(self, shifts: Shifts) -> None:
        """See ``Unilateral``."""
        rows, face = self._system.constraints, self._system.interface
        self._turning[:], self._by_start[:] = 0.0, 0.0
        acting = rows.apart & (rows.multipliers != 0.0)
        ends = self._starts(), face.frames.copy(), face.increments.copy()
        pushed = np.isin(self._nodes, rows.term_nodes[acting[rows.row_of_term]])
        for k in np.flatnonzero(pushed).tolist():
            for axis in range(6):
                for end in (0, 1):
                    at = int(self._nodes[k]), axis, end
                    moved, values = self._slopes(shifts, at, ends, acting)
                    self._turning[end, :, 6 * k + axis] = moved
                    if end == 0:
                        self._by_start[:, 6 * k + axis] = values
        self._evaluate(shifts, *ends)

    def _starts(self) -> FloatArray:
        """Frames (n, 12) of the interface's nodes at the start of the step (collective)."""
        face, system = self._system.interface, self._system
        frames = [part.block.frames.copy() for part in system.parts]
        for part in system.parts:
            part.block.frames[:] = part.block.frames0
        face.update()
        found = face.frames.copy()
        for part, own in zip(system.parts, frames, strict=True):
            part.block.frames[:] = own
        face.update()
        return found

    def _slopes(
        self, shifts: Shifts, at: tuple[int, int, int],
        ends: tuple[FloatArray, FloatArray, FloatArray], acting: BoolArray,
    ) -> tuple[FloatArray, FloatArray]:  # fmt: skip
        """Changes of the loads (6 n,) and equations (r,) by a twist of a node at one end.

        Args:
            shifts: factors of the step.
            at: node, component of the twist, and end.
            ends: frames of both ends, and increments.
            acting: (r,) rows with forces.
        """
        node, axis, end = at
        rows, face = self._system.constraints, self._system.interface
        loads, values = np.zeros(6 * len(self._nodes)), np.zeros(rows.size)
        inertial = bool(face.inertial[node])
        factors = (rows.multipliers * acting)[rows.row_of_term][:, np.newaxis, np.newaxis]
        for part, weight in STENCIL:
            start, after, increments = (one.copy() for one in ends)
            twist, own = part * _STEP * np.eye(6)[[axis]], (start, after)[end]
            own[[node]] = moved(own[[node]], twist, inertial=inertial)
            increments[[node]] = increments_between(start[[node]], after[[node]], inertial=inertial)
            self._evaluate(shifts, start, after, increments)
            forces = np.zeros((len(face.keys) + 1, 6))
            np.add.at(forces, rows.term_nodes, factors * rows.force_jacobian)
            loads += weight / _STEP * forces[self._nodes].ravel()
            values += weight / _STEP * rows.values * acting
        return loads, values

    def _evaluate(
        self, shifts: Shifts, start: FloatArray, end: FloatArray, increments: FloatArray
    ) -> None:
        """Evaluate the rows over a step between two states of the interface."""
        face = self._system.interface
        face.frames[:] = start
        for one in self._split.limited:
            one.restart()
        face.frames[:], face.increments[:] = end, increments
        self._split.evaluate_rows(self._system, shifts)

    def _multiply(self, matrix: FloatArray) -> None:
        """Add loads for the steps at the interface to the residuals."""
        before = [block.residual.copy() for block in self._parts]
        self._on_blocks(matrix @ self._steps)
        for block, own in zip(self._parts, before, strict=True):
            block.residual[:] += own

    def add(self) -> None:
        """See ``Unilateral``."""
        self._multiply(self._turning[1])

    def add_transposed(self) -> None:
        """See ``Unilateral``."""
        self._multiply(self._turning[1].T)

    @property
    def _steps(self) -> FloatArray:
        """Steps of the nodes, flat."""
        return self._system.interface.steps[self._nodes].ravel()

    def _on_blocks(self, loads: FloatArray) -> BlockVectors:
        """Loads of the nodes, flat, on the blocks that own these."""
        every = np.zeros_like(self._system.interface.steps)
        every[self._nodes] = loads.reshape(-1, 6)
        return forces_on_blocks(self._system, every)

    def _put(self, blocks: list[FloatArray]) -> None:
        for block, own in zip(self._parts, blocks, strict=True):
            block.owned_step[:] = own
            block.spread_step()
        self._system.interface.update_steps()

    def add_start(self, change: StateChange) -> FloatArray:
        """See ``Unilateral``."""
        self._put(change.twists)
        self._multiply(self._turning[0])
        found: FloatArray = self._by_start @ self._steps
        return found

    def start_transposed(self, z: list[FloatArray], mu: FloatArray) -> StateFactors:
        """See ``Unilateral``."""
        self._put(z)
        twists = self._on_blocks(self._turning[0].T @ self._steps + self._by_start.T @ mu)
        return StateFactors(twists, [np.zeros_like(own) for own in z])
