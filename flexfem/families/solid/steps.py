# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solids of a rank over a step that conserves energy: mean forces and their derivatives."""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np
from scipy.sparse import csr_array

from flexfem._types import FloatArray
from flexfem.core.nodes.step_kernels import StepNodes
from flexfem.families.common.corotating_loops import (
    add_blocks,
    add_to_nodes,
    inertial_into,
    positions_into,
    turn_blocks,
)
from flexfem.families.common.node_pairs import NodePairs
from flexfem.families.solid.cells import Kernels, Motion, SolidCells
from flexfem.families.solid.step_forms import SolidStepForms
from flexfem.kernels.driver import Cells
from flexfem.kernels.records import Memory

__all__ = ["SolidSteps"]


class _StepCells(SolidCells):
    """Cells of one law and kind, whose forces are means over a step."""

    def __init__(self, comm: MPI.Intracomm, cells: SolidCells) -> None:
        """Compile the kernels (collective) for some cells, whose data are taken over."""
        vars(self).update(vars(cells))
        own = cells.forms
        self.forms: SolidStepForms = SolidStepForms(own.law, own.kind, own.sizes)
        self.kernels = Kernels.compiled(comm, self.forms, without=("energy", "fields"))
        width = sum(count for _, count in self.kernels.columns.values())
        self._own = np.zeros((len(self.nodes), width))
        for name in cells.kernels.columns:
            self.data(name)[:] = cells.data(name)
        self._plain = self._cells(self._own)

    def begin(self, motion: Memory, per_step: float) -> None:
        """Start a step of size 1/``per_step`` (s) at positions that are those of both ends."""
        self.data("per_step")[:] = per_step
        if self.kernels.dilatation and len(self.nodes):
            moments = self._evaluated(self.kernels.calls["moments"], self._plain, motion)
            self.data("start_dilatation")[:] = self._projected(moments)

    def _swelling(self, cells: Cells, motion: Memory, by_multiplier: FloatArray) -> FloatArray:
        """See :class:`SolidCells`; forces over a step are no derivatives of the moments."""
        width = 3 * self.nodes.shape[1]
        return self._columns("moments_column", cells, motion)[:, :, :width]


class SolidSteps:
    """Mean forces of all solids of a rank over a step and their derivatives.

    See :class:`flexfem.layout.elements.StepForces`. Nodes are points: the attributes say so.

    Attributes:
        centres: (n, 3) zero.
        offset: False.
    """

    offset = False

    def __init__(
        self, comm: MPI.Intracomm, groups: Sequence[SolidCells], pairs: NodePairs, mass: csr_array
    ) -> None:
        """Compile the kernels (collective).

        Args:
            comm: communicator.
            groups: the cells.
            pairs: of nodes that they couple.
            mass: (n, n) of one direction, kg.
        """
        self._groups = [_StepCells(comm, group) for group in groups]
        self._pairs, self._mass = pairs, mass
        count = mass.shape[0]
        self.centres = np.zeros((count, 3))
        self._motion = Motion(
            points=np.zeros((count, 3)), velocity=np.zeros((count, 3)), step=np.zeros((count, 3)),
            rate=np.zeros((count, 3)), start=np.full((count, 3), np.nan),
        )  # fmt: skip
        self._per_step = 0.0

    def begin(self, state: StepNodes, before: FloatArray, share: float) -> None:
        """See :class:`flexfem.layout.elements.StepForces`; solids have no numerical dissipation."""
        self._begin(state.frames0, float(state.law[1]))

    def _begin(self, frames: FloatArray, per_step: float) -> None:
        motion = self._motion
        positions_into(frames, motion.points)
        if self._per_step == per_step and np.array_equal(motion.points, motion.start):
            return
        motion.start[:], self._per_step = motion.points, per_step
        for group in self._groups:
            group.begin(motion.memory, per_step)

    def _settle(self, state: StepNodes) -> None:
        """Take the positions at the end, and what follows from them in the cells."""
        positions_into(state.frames, self._motion.points)
        for group in self._groups:
            group.settle(self._motion.memory)

    def add_force(self, state: StepNodes, scale: float) -> None:
        """See :class:`flexfem.layout.elements.StepForces`."""
        self._settle(state)
        change = (state.rates - state.rates0)[:, :3] * state.law[1]
        total: FloatArray = self._mass @ (change - state.gravity)
        for group in self._groups:
            group.add_forces(self._motion.memory, total)
        add_to_nodes(state.frames, total, scale, state.residual)

    def tangent(self, state: StepNodes, scale: float) -> FloatArray:
        """See :class:`flexfem.layout.elements.StepForces`."""
        pairs = self._pairs
        blocks = np.zeros((len(pairs.rows), 3, 3))
        self._settle(state)
        for group, index in zip(self._groups, pairs.index, strict=True):
            for first in group.chunks():
                add_blocks(
                    group.matrices(self._motion.memory, first, scale, 0.0), index, first, blocks
                )
        masses = scale * state.law[1] * state.law[2] * self._mass.data
        for a in range(3):
            blocks[:, a, a] += masses
        turn_blocks(pairs.rows, pairs.columns, state.frames, blocks)
        return blocks

    def add_action(self, state: StepNodes, scale: float) -> None:
        """See :class:`flexfem.layout.elements.StepForces`."""
        self._settle(state)
        inertial_into(state.frames, state.step, self._motion.step)
        total: FloatArray = state.law[1] * state.law[2] * (self._mass @ self._motion.step)
        for group in self._groups:
            group.add_action(self._motion.memory, 1.0, total)
        add_to_nodes(state.frames, total, scale, state.residual)

    def losses(self, before: FloatArray, after: FloatArray, h: float) -> list[FloatArray]:
        """Energies (m,) that viscosity takes from the cells of each group in a step, J."""
        self._begin(before, 1.0 / h)
        positions_into(after, self._motion.points)
        return [
            group.losses(self._motion.memory)
            if group.kernels.damped
            else np.zeros(len(group.nodes))
            for group in self._groups
        ]
