# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cables of a rank: residual, matrix and measures."""

from mpi4py import MPI

import numpy as np
from scipy.sparse import csr_array

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.nodes.motion import add_motion_of_points
from flexfem.families.cable_net import kernels
from flexfem.families.cable_net.cables import Cables
from flexfem.families.cable_net.steps import CableSteps
from flexfem.families.common.corotating_axes import CorotatingAxes
from flexfem.families.common.corotating_loops import (
    add_to_nodes,
    inertial_into,
    positions_into,
    turn_blocks,
)
from flexfem.families.common.node_pairs import NodePairs
from flexfem.layout.elements import StresslessElements
from flexfem.layout.tangent_request import EXACT, TangentRequest

__all__ = ["CableElements"]

#: Numbers of cables that lose energy.
_DAMPERS = [kernels.DAMPING, kernels.ALWAYS, kernels.CATCH]


class CableElements(StresslessElements):
    """All cables of nets of this rank.

    Attributes:
        cables: the cables.
        body: (m,) number of the body of each; size: (m,) rest length, m.

    The methods of :class:`flexfem.layout.elements.ElementFamily` are described there.
    """

    law_owner: str | None = None
    chained = False
    thin = False
    stressed = False

    def __init__(self, cables: Cables, block: FrameBlock) -> None:
        """Prepare pairs of nodes and masses (collective).

        Args:
            cables: those that this rank owns.
            block: their nodes, at the start.
        """
        self.cables, self.body = cables, cables.body
        self.size = np.ascontiguousarray(cables.numbers[:, kernels.REST])
        self._damped = np.flatnonzero(cables.numbers[:, _DAMPERS].any(axis=1))
        self.viscous = len(self._damped) > 0
        count = len(block.frames)
        self._pairs = NodePairs(count, [cables.nodes])
        self._points, self._vectors, self._rates = np.zeros((3, count, 3))
        self._start = np.ascontiguousarray(block.start_frames[:, :3])
        self._mass = self._masses(np.ones(len(cables.nodes), dtype=np.bool_))
        self._axes = CorotatingAxes(block)
        self._steps: CableSteps | None = None

    def _masses(self, chosen: BoolArray) -> csr_array:
        """Mass matrix (n, n) of one direction of the chosen (m,) cables, kg."""
        cables, index = self.cables, self._pairs.index[0][chosen]
        own = cables.mass[chosen, np.newaxis, np.newaxis] * np.array([[2.0, 1.0], [1.0, 2.0]]) / 6.0
        own[:, [0, 1], [0, 1]] += cables.fittings[chosen]
        values = np.bincount(index.ravel(), own.ravel(), len(self._pairs.rows))
        count = len(self._points)
        return csr_array((values, (self._pairs.rows, self._pairs.columns)), shape=(count, count))

    @property
    def support(self) -> IntArray:
        """See :class:`flexfem.layout.elements.ResultantElements`."""
        return self.cables.nodes.astype(np.int64)

    @property
    def couplings(self) -> list[tuple[IndexArray, IndexArray]]:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return self._pairs.couplings

    def _move(self, block: FrameBlock) -> None:
        """Take positions and velocities of the trial state."""
        positions_into(block.frames, self._points)
        if self.viscous:
            inertial_into(block.frames, block.velocity, self._rates)

    def add_residual(
        self, block: FrameBlock, gravity: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> None:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        self._move(block)
        inertial_into(block.frames, block.acceleration, self._vectors)
        total: FloatArray = self._mass @ (self._vectors - gravity)
        cables = self.cables
        kernels.add_forces(cables.nodes, cables.numbers, self._points, self._rates, total)
        add_to_nodes(block.frames, total, scale, block.residual)

    def values(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> FloatArray:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        pairs, cables = self._pairs, self.cables
        blocks = np.zeros((len(pairs.rows), 3, 3))
        self._move(block)
        kernels.tangents(
            cables.nodes, cables.numbers, self._points, self._rates,
            scale * np.array([shifts[2], shifts[0]]), pairs.index[0], blocks,
        )  # fmt: skip
        masses = scale * float(shifts[1]) * self._mass.data
        for a in range(3):
            blocks[:, a, a] += masses
        turn_blocks(pairs.rows, pairs.columns, block.frames, blocks)
        return blocks.ravel()

    def add_action(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> None:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        self._move(block)
        inertial_into(block.frames, block.step, self._vectors)
        total: FloatArray = float(shifts[1]) * (self._mass @ self._vectors)
        cables = self.cables
        kernels.add_products(
            cables.nodes, cables.numbers, self._points, self._rates,
            np.array([shifts[2], shifts[0]]), self._vectors, total,
        )  # fmt: skip
        add_to_nodes(block.frames, total, scale, block.residual)

    def accept(self, block: FrameBlock) -> None:
        """Rotate the axes of the nodes with the cables around them (collective)."""
        positions_into(block.frames, self._points)
        self._axes.turn(block, self._add_rotations)

    def _add_rotations(self, sums: FloatArray) -> None:
        """Add the rotations of the cables, times their lengths, to their nodes (n, 9)."""
        cables = self.cables
        kernels.add_rotations(cables.nodes, cables.numbers, self._start, self._points, sums)

    def resultants(
        self, frames: FloatArray, chosen: IntArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Strains and elastic tensions (m, 6), in the first column; the strain of slack cables.

        It is the one by their length, which is negative.
        """
        positions_into(frames, self._points)
        found = np.zeros((2, len(self.body), 6))
        found[0, :, 0] = self.cables.measured(kernels.strains, self._points)
        taut = self.cables.measured(kernels.taut_parts, self._points)
        found[1, :, 0] = self.cables.numbers[:, kernels.STIFFNESS] * taut
        every = found if chosen is None else found[:, chosen]
        return every[0], every[1]

    def stretches(self, frames: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.elements.ElementFamily`: lengths are always positive."""
        return np.ones(len(self.body))

    def energies(self, frames: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        positions_into(frames, self._points)
        return self.cables.measured(kernels.energies, self._points)

    def viscosity(self, block: FrameBlock) -> tuple[FloatArray, FloatArray]:
        """Forces of the dampers, N, and strains, the first of six numbers each."""
        self._move(block)
        forces, strains = np.zeros((2, len(self.size), 6))
        own = self.cables.nodes, self.cables.numbers
        kernels.viscosity(*own, self._points, self._rates, forces, strains)
        return forces[self._damped], strains[self._damped]

    @property
    def viscous_at(self) -> tuple[IntArray, FloatArray]:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return self._damped, self.size[self._damped]

    def step_forces(self, comm: MPI.Intracomm, count: int, dissipates: bool) -> CableSteps:
        """See :class:`flexfem.layout.elements.SteppedElements`."""
        self._steps = CableSteps(self.cables, self._pairs, self._mass)
        return self._steps

    def losses(self, before: FloatArray, after: FloatArray, h: float) -> FloatArray:
        """See :class:`flexfem.layout.elements.SteppedElements`."""
        positions_into(before, self._vectors)
        positions_into(after, self._points)
        return self.cables.measured(kernels.step_losses, self._vectors, self._points, 1.0 / h)

    def add_motion(self, block: FrameBlock, chosen: BoolArray, motion: FloatArray) -> None:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        positions_into(block.frames, self._points)
        inertial_into(block.frames, block.velocity, self._vectors)
        mass = self._mass if chosen.all() else self._masses(chosen)
        add_motion_of_points(mass, self._points, self._vectors, motion)
