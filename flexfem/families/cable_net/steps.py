# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cables of a rank over a step that conserves energy: mean forces and their derivatives."""

import numpy as np
from scipy.sparse import csr_array

from flexfem._types import FloatArray
from flexfem.core.nodes.step_kernels import StepNodes
from flexfem.families.cable_net import kernels
from flexfem.families.cable_net.cables import Cables
from flexfem.families.common.corotating_loops import (
    add_to_nodes,
    inertial_into,
    positions_into,
    turn_blocks,
)
from flexfem.families.common.node_pairs import NodePairs
from flexfem.lie import se3

__all__ = ["CableSteps"]


class CableSteps:
    """Mean forces of all cables of a rank over a step and their derivatives.

    See :class:`flexfem.layout.elements.StepForces`. Nodes are points: the attributes say so.

    Attributes:
        centres: (n, 3) zero.
        offset: False.
    """

    offset = False

    def __init__(self, cables: Cables, pairs: NodePairs, mass: csr_array) -> None:
        """Store the cables, the pairs of nodes that they couple and their masses (n, n), kg."""
        self._cables, self._pairs, self._mass = cables, pairs, mass
        count = mass.shape[0]
        self.centres = np.zeros((count, 3))
        self._start, self._points, self._vectors = np.zeros((3, count, 3))
        self._last = np.zeros(len(cables.nodes))

    def begin(self, state: StepNodes, before: FloatArray, share: float) -> None:
        """See :class:`flexfem.layout.elements.StepForces`."""
        positions_into(before, self._points)
        first = self._cables.measured(kernels.taut_parts, self._points)
        positions_into(state.frames0, self._start)
        taut = self._cables.measured(kernels.taut_parts, self._start)
        self._last[:] = share * (taut - first)

    def exchange(self, state: StepNodes) -> None:
        """See :class:`flexfem.layout.elements.StepForces`."""
        positions_into(state.frames0, self._start)
        self._last *= -1.0

    def _step(self, state: StepNodes) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Positions at both ends, changes over the last step and the law."""
        positions_into(state.frames, self._points)
        return self._start, self._points, self._last, state.law

    def by_last(
        self, state: StepNodes, before: FloatArray, share: float, scale: float
    ) -> tuple[FloatArray, FloatArray]:
        """See :class:`flexfem.layout.elements.StepForces`."""
        by_end = self._by_last(state, state.frames0, share * scale)
        by_start = self._by_last(state, before, -share * scale)
        return by_end, by_start

    def _by_last(self, state: StepNodes, frames: FloatArray, scale: float) -> FloatArray:
        """Blocks (k, 3, 3) of derivatives by twists at an end (n, 12) of the last step."""
        pairs, cables = self._pairs, self._cables
        blocks = np.zeros((len(pairs.rows), 3, 3))
        positions_into(frames, self._vectors)
        kernels.add_last_blocks(
            cables.nodes, cables.numbers, *self._step(state), self._vectors, scale,
            pairs.index[0], blocks,
        )  # fmt: skip
        turns = se3.rotation(state.frames)[pairs.rows].swapaxes(1, 2)
        found: FloatArray = turns @ blocks @ se3.rotation(frames)[pairs.columns]
        return found

    def add_force(self, state: StepNodes, scale: float) -> None:
        """See :class:`flexfem.layout.elements.StepForces`."""
        change = (state.rates - state.rates0)[:, :3] * state.law[1]
        total: FloatArray = self._mass @ (change - state.gravity)
        kernels.add_step_forces(self._cables.nodes, self._cables.numbers, *self._step(state), total)
        add_to_nodes(state.frames, total, scale, state.residual)

    def tangent(self, state: StepNodes, scale: float) -> FloatArray:
        """See :class:`flexfem.layout.elements.StepForces`."""
        pairs, cables = self._pairs, self._cables
        blocks = np.zeros((len(pairs.rows), 3, 3))
        kernels.step_tangents(
            cables.nodes, cables.numbers, *self._step(state), scale, pairs.index[0], blocks
        )
        masses = scale * state.law[1] * state.law[2] * self._mass.data
        for a in range(3):
            blocks[:, a, a] += masses
        turn_blocks(pairs.rows, pairs.columns, state.frames, blocks)
        return blocks

    def add_action(self, state: StepNodes, scale: float) -> None:
        """See :class:`flexfem.layout.elements.StepForces`."""
        inertial_into(state.frames, state.step, self._vectors)
        total: FloatArray = state.law[1] * state.law[2] * (self._mass @ self._vectors)
        kernels.add_step_products(
            self._cables.nodes, self._cables.numbers, *self._step(state), self._vectors, total
        )
        add_to_nodes(state.frames, total, scale, state.residual)
