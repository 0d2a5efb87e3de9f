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
from flexfem.families.solid.cells import CHUNK, Kernels, Motion, SolidCells, still
from flexfem.families.solid.step_forms import SolidStepForms
from flexfem.kernels.driver import CellKernel, Cells
from flexfem.kernels.records import Memory
from flexfem.lie import se3

__all__ = ["SolidSteps"]


class _StepCells(SolidCells):
    """Cells of one law and kind, whose forces are means over a step."""

    def __init__(self, comm: MPI.Intracomm, cells: SolidCells, dissipates: bool) -> None:
        """Compile the kernels (collective) for some cells, whose data are taken over."""
        vars(self).update(vars(cells))
        own = cells.kernels.forms
        forms = SolidStepForms(own.law, own.kind, own.sizes, dissipates)
        self.kernels = Kernels.compiled(comm, forms, without=("energy", "fields", "resistance"))
        width = sum(count for _, count in self.kernels.columns.values())
        self._own = np.zeros((len(self.nodes), width))
        for name in cells.kernels.columns:
            self.data(name)[:] = cells.data(name)
        self._plain = self._cells(self._own)
        if dissipates:
            self.data("_shear")[:], self.data("_bulk")[:] = cells.rest_moduli.T[:, :, np.newaxis]

    def begin(self, which: str, motion: Memory) -> None:
        """Take the dilatation at the positions as that at another place, see ``step_forms``."""
        if self.kernels.dilatation and len(self.nodes):
            moments = self._evaluated(self.kernels.calls["moments"], self._plain, motion)
            self.data(f"{which}_dilatation")[:] = self._projected(moments)

    def set_law(self, law: FloatArray, share: float | None = None) -> None:
        """Set the law of the step, see ``StepNodes``, and the share of the last change, if any."""
        self.data("_per_step")[:] = law[1]
        if "_half" in self.kernels.columns:
            self.data("_half")[:] = law[0]
            if share is not None:
                self.data("_share")[:] = share

    def losses(self, motion: Memory) -> FloatArray:
        """Energies (m,) that the viscous forces take in the step, J."""
        return self._evaluated(self.kernels.calls["loss"], self._plain, motion)[:, 0]

    def reverse(self) -> None:
        """Exchange the dilatations at both ends of the last step."""
        if self.kernels.dilatation:
            ends = [self.data(f"{which}_dilatation") for which in ("_before", "_last")]
            ends[0][:], ends[1][:] = ends[1].copy(), ends[0].copy()

    def by_last(
        self, call: CellKernel, motion: Memory, last: FloatArray, first: int, scale: float
    ) -> FloatArray:
        """``scale`` times derivatives (r, 3 k, 3 k) of the forces of some settled cells.

        They are those by positions at the end of the last step.

        Args:
            call: ``last_column`` of the kernels.
            motion: of the nodes.
            last: (n, 3) their positions at the end of the last step, as the motion has them.
            first: the first cell.
            scale: see above.
        """
        own = self._own[first : first + CHUNK].copy()
        width, few = 3 * self.nodes.shape[1], self.kernels.dilatation
        steps = np.zeros((width, 2 * width + 2 * few))
        steps[:, :width] = scale * np.eye(width)
        cells = self._cells(own, first, steps)
        found = self._columns(call, cells, motion)
        if few:  # multipliers change by the dilatation, of which their projections are linear
            calls, multipliers = self.kernels.calls, np.zeros((few, 2 * width + 2 * few))
            multipliers[:, -few:] = np.eye(few)
            by = self._columns(calls["column"], self._cells(own, first, multipliers), motion)
            swelled = self._columns(calls["moments_column"], cells, still(last))
            rows, names = np.s_[first : first + len(own)], ("_half", "_share", "_bulk")
            factors = np.prod([self.data(name)[rows, 0] for name in names], axis=0)
            swelled = self._projection[rows] @ swelled
            found -= by @ (factors[:, np.newaxis, np.newaxis] * swelled)
        return found

    def _swelling(self, cells: Cells, motion: Memory, by_multiplier: FloatArray) -> FloatArray:
        """See :class:`SolidCells`; forces over a step are no derivatives of the moments."""
        width = 3 * self.nodes.shape[1]
        return self._columns(self.kernels.calls["moments_column"], cells, motion)[:, :, :width]


class SolidSteps:
    """Mean forces of all solids of a rank over a step and their derivatives.

    See :class:`flexfem.layout.elements.StepForces`. Nodes are points: the attributes say so.

    Attributes:
        centres: (n, 3) zero.
        offset: False.
    """

    offset = False

    def __init__(
        self, comm: MPI.Intracomm, groups: Sequence[SolidCells], pairs: NodePairs, mass: csr_array,
        dissipates: bool,
    ) -> None:  # fmt: skip
        """Compile the kernels (collective).

        Args:
            comm: communicator.
            groups: the cells.
            pairs: of nodes that they couple.
            mass: (n, n) of one direction, kg.
            dissipates: True with numerical dissipation.
        """
        self._groups = [_StepCells(comm, group, dissipates) for group in groups]
        self._pairs, self._mass = pairs, mass
        count = mass.shape[0]
        self.centres = np.zeros((count, 3))
        names = "points", "velocity", "step", "rate", "start", "before", "last"
        self._motion = Motion(**{name: np.zeros((count, 3)) for name in names})
        self._dissipates = dissipates

    def begin(self, state: StepNodes, before: FloatArray, share: float) -> None:
        """See :class:`flexfem.layout.elements.StepForces`."""
        if self._dissipates:
            self._start("_before", before, self._motion.before)
            self._start("_last", state.frames0, self._motion.last)
        self._start("_start", state.frames0, self._motion.start)
        for group in self._groups:
            group.set_law(state.law, share)

    def by_last(
        self, state: StepNodes, before: FloatArray, share: float, scale: float
    ) -> tuple[FloatArray, FloatArray]:
        """See :class:`flexfem.layout.elements.StepForces`.

        Forces depend on differences of strains at both ends of the last step.
        """
        self._settle(state)
        by_end = self._by_last(state, state.frames0, scale)
        by_start = self._by_last(state, before, -scale)
        positions_into(state.frames0, self._motion.last)
        return by_end, by_start

    def _by_last(self, state: StepNodes, frames: FloatArray, scale: float) -> FloatArray:
        """Blocks (k, 3, 3) of derivatives by twists at the end (n, 12) of the last step."""
        pairs, last = self._pairs, self._motion.last
        blocks = np.zeros((len(pairs.rows), 3, 3))
        positions_into(frames, last)
        for group, index in zip(self._groups, pairs.index, strict=True):
            call = group.kernels.lasting["last_column"]  # of all ranks, also of those without cells
            for first in group.chunks():
                own = group.by_last(call, self._motion.memory, last, first, scale)
                add_blocks(own, index, first, blocks)
        turns = se3.rotation(state.frames)[pairs.rows].swapaxes(1, 2)
        found: FloatArray = turns @ blocks @ se3.rotation(frames)[pairs.columns]
        return found

    def exchange(self, state: StepNodes) -> None:
        """See :class:`flexfem.layout.elements.StepForces`."""
        self._start("_start", state.frames0, self._motion.start)
        motion = self._motion
        if self._dissipates:
            motion.before[:], motion.last[:] = motion.last.copy(), motion.before.copy()
        for group in self._groups:
            if self._dissipates:
                group.reverse()
            group.set_law(state.law)

    def _start(self, which: str, frames: FloatArray, points: FloatArray) -> None:
        """Take positions at the start of this step or of the last one."""
        positions_into(frames, points)
        self._motion.points[:] = points
        for group in self._groups:
            group.begin(which, self._motion.memory)

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
        self._start("_start", before, self._motion.start)
        for group in self._groups:
            group.set_law(np.array([0.0, 1.0 / h]), 0.0)
        positions_into(after, self._motion.points)
        return [
            group.losses(self._motion.memory)
            if group.kernels.damped
            else np.zeros(len(group.nodes))
            for group in self._groups
        ]
