# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elements with an energy of nodal positions that is compiled from UFL.

Cells of one energy, shape and degree form a group. Energy, forces and stiffnesses of a cell are
tabulated by the kernels that FFCx generates of the energy and its derivatives.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.common.corotating_axes import CorotatingAxes
from flexfem.families.common.corotating_loops import (
    add_blocks,
    add_to_nodes,
    inertial_into,
    positions_into,
    turn_blocks,
)
from flexfem.families.common.node_pairs import NodePairs
from flexfem.kernels.driver import (
    ALL_COLUMNS,
    CellKernel,
    Cells,
    add_products,
    evaluate,
    plain_cells,
)
from flexfem.kernels.records import Float2D, Record
from flexfem.layout.elements import StresslessElements
from flexfem.layout.tangent_request import EXACT, TangentRequest

__all__ = ["EnergyCells", "EnergyElements", "EnergyKernels", "Points"]


class Points(Record):
    """Positions (n, 3) of nodes, m."""

    points: Float2D


@dataclass(frozen=True)
class EnergyKernels:
    """Kernels of an energy (s = 1), its forces (s = 3 k), stiffnesses (s = 9 k^2), J, N, N/m."""

    energy: CellKernel
    force: CellKernel
    stiffness: CellKernel


@dataclass(frozen=True)
class EnergyCells:
    """Cells of this rank with one energy.

    Attributes:
        kernels: kernels of the energy.
        nodes: (m, k) local nodes.
        start: (m, k, 3) their positions at the start, m.
        parameters: (m, p) of the energy.
        mass: (m, k, k) products of shape functions with the density, kg.
        size: (m,) lengths, areas or volumes at the start.
        body: (m,) number of the body.
        corners: number of corners of a cell, the first nodes.
    """

    kernels: EnergyKernels
    nodes: IndexArray
    start: FloatArray
    parameters: FloatArray
    mass: FloatArray
    size: FloatArray
    body: IntArray
    corners: int

    def with_mass(self, form: CellKernel, density: FloatArray) -> "EnergyCells":
        """The cells with their masses and sizes.

        Args:
            form: kernel of the products of the shape functions.
            density: (m,) kg per length, area or volume.
        """
        count = self.nodes.shape[1]
        products = self._tabulated(form, Points(points=np.zeros((1, 3))))
        products = products.reshape(-1, count, count)
        size: FloatArray = products.sum(axis=(1, 2))
        return replace(self, mass=density[:, np.newaxis, np.newaxis] * products, size=size)

    @cached_property
    def _cells(self) -> Cells:
        """The cells in the format of the kernel driver."""
        start = self.start.reshape(len(self.nodes), 3 * self.nodes.shape[1])
        return plain_cells(self.parameters, self.nodes, start)

    def energies(self, at: Points) -> FloatArray:
        """Energies (m,) at positions of the nodes, J."""
        return self._tabulated(self.kernels.energy, at)[:, 0]

    def forces(self, at: Points) -> FloatArray:
        """Derivatives (m, k, 3) of the energies by the nodes' positions, N."""
        return self._tabulated(self.kernels.force, at).reshape(-1, self.nodes.shape[1], 3)

    def stiffnesses(self, at: Points) -> FloatArray:
        """Second derivatives (m, 3 k, 3 k), N/m."""
        width = 3 * self.nodes.shape[1]
        return self._tabulated(self.kernels.stiffness, at).reshape(-1, width, width)

    def add_action(self, at: Points, steps: FloatArray, factor: float, forces: FloatArray) -> None:
        """Add ``factor`` times the second derivatives times steps to forces, (n, 3) both."""
        matrices, cells = self._tabulated(self.kernels.stiffness, at), self._cells.memory
        add_products(ALL_COLUMNS, cells, matrices, steps, factor, False, forces)

    def _tabulated(self, which: CellKernel, at: Points) -> FloatArray:
        out = np.empty((len(self.nodes), which.size))
        evaluate(which.memory, self._cells.memory, at.memory, np.empty(1), out)
        return out

    def rotations(self, points: FloatArray) -> FloatArray:
        """Rotations (m, 3, 3) of the cells since the start: polar parts of their deformations."""
        own = points[self.nodes[:, : self.corners]]
        start = self.start[:, : self.corners]
        now, then = own - own[:, :1], start - start[:, :1]
        if self.corners == 2:
            return _turned_onto(then[:, 1], now[:, 1])
        U, _, V = np.linalg.svd(np.einsum("mia,mib->mab", now, then))
        U[:, :, 2] *= np.sign(np.linalg.det(U) * np.linalg.det(V))[:, np.newaxis]
        R: FloatArray = U @ V
        return R

    def stretches(self, points: FloatArray) -> FloatArray:
        """Volumes (m,) of the corners of solid cells relative to the start; ones for the others."""
        if self.corners < 4:
            return np.ones(len(self.nodes))
        own, start = points[self.nodes[:, :4]], self.start[:, :4]
        now, then = own[:, 1:] - own[:, :1], start[:, 1:] - start[:, :1]
        ratio: FloatArray = np.linalg.det(now) / np.linalg.det(then)
        return ratio


class EnergyElements(StresslessElements):
    """All elements of bodies with an energy in UFL of this rank.

    Attributes:
        groups: the cells.
        body: (m,) number of the body of each cell; size: (m,) size at the start.

    The methods of :class:`flexfem.layout.elements.ElementFamily` are described there.
    """

    law_owner: str | None = None
    chained = False
    thin = False
    stressed = False
    viscous = False

    def __init__(self, groups: Sequence[EnergyCells], block: FrameBlock) -> None:
        """Prepare pairs of nodes (collective).

        Args:
            groups: the cells that this rank owns.
            block: their nodes, at the start.
        """
        self.groups = list(groups)
        self.body = np.concatenate([np.empty(0, np.int64), *(g.body for g in groups)])
        self.size = np.concatenate([np.empty(0), *(g.size for g in groups)])
        self._pairs = NodePairs(len(block.frames), [g.nodes for g in groups])
        count = len(block.frames)
        self._points, self._vectors = np.empty((count, 3)), np.empty((count, 3))
        self._at = Points(points=self._points)
        self._axes = CorotatingAxes(block)

    @property
    def couplings(self) -> list[tuple[IndexArray, IndexArray]]:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return self._pairs.couplings

    def add_residual(
        self, block: FrameBlock, gravity: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> None:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        positions_into(block.frames, self._points)
        inertial_into(block.frames, block.acceleration, self._vectors)
        felt = self._vectors - gravity
        total = np.zeros_like(self._points)
        for group in self.groups:
            forces = group.forces(self._at) + group.mass @ felt[group.nodes]
            np.add.at(total, group.nodes, forces)
        add_to_nodes(block.frames, total, scale, block.residual)

    def values(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> FloatArray:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        pairs = self._pairs
        blocks = np.zeros((len(pairs.rows), 3, 3))
        positions_into(block.frames, self._points)
        for group, index in zip(self.groups, pairs.index, strict=True):
            count = group.nodes.shape[1]
            matrices = np.zeros((len(group.nodes), count, 3, count, 3))
            if shifts[2] != 0.0:
                own = group.stiffnesses(self._at)
                matrices += scale * float(shifts[2]) * own.reshape(matrices.shape)
            for a in range(3):
                matrices[:, :, a, :, a] += scale * float(shifts[1]) * group.mass
            add_blocks(matrices.reshape(-1, 3 * count, 3 * count), index, 0, blocks)
        turn_blocks(pairs.rows, pairs.columns, block.frames, blocks)
        return blocks.ravel()

    def add_action(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> None:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        positions_into(block.frames, self._points)
        inertial_into(block.frames, block.step, self._vectors)

        total = np.zeros_like(self._points)
        for group in self.groups:
            np.add.at(
                total, group.nodes, float(shifts[1]) * (group.mass @ self._vectors[group.nodes])
            )
            if shifts[2] != 0.0:
                group.add_action(self._at, self._vectors, float(shifts[2]), total)
        add_to_nodes(block.frames, total, scale, block.residual)

    def accept(self, block: FrameBlock) -> None:
        """Rotate the axes of the nodes with the cells around them (collective)."""
        positions_into(block.frames, self._points)
        self._axes.turn(block, self._add_rotations)

    def _add_rotations(self, sums: FloatArray) -> None:
        """Add the rotations of the cells, times their sizes, to their nodes (n, 9)."""
        for group in self.groups:
            turns = group.rotations(self._points).reshape(-1, 1, 9)
            np.add.at(sums, group.nodes, group.size[:, np.newaxis, np.newaxis] * turns)

    def resultants(
        self, frames: FloatArray, chosen: IntArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """See :class:`flexfem.layout.elements.ElementFamily`; an energy defines no strains.

        Raises:
            NotImplementedError: always.
        """
        raise NotImplementedError("an energy in UFL has no stress resultants")

    def stretches(self, frames: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        positions_into(frames, self._points)
        return self._of_groups([g.stretches(self._points) for g in self.groups])

    def energies(self, frames: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        positions_into(frames, self._points)
        return self._of_groups([g.energies(self._at) for g in self.groups])

    def _of_groups(self, values: Sequence[FloatArray]) -> FloatArray:
        return np.concatenate([np.empty(0), *values])

    def add_motion(self, block: FrameBlock, chosen: BoolArray, motion: FloatArray) -> None:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        positions_into(block.frames, self._points)
        inertial_into(block.frames, block.velocity, self._vectors)
        first = 0
        for group in self.groups:
            own = chosen[first : first + len(group.nodes)]
            first += len(group.nodes)
            x, v = self._points[group.nodes[own]], self._vectors[group.nodes[own]]
            momenta = group.mass[own] @ v
            motion[0] += 0.5 * float((momenta * v).sum())
            motion[1] += float(group.mass[own].sum())
            motion[2:5] += (group.mass[own] @ x).sum(axis=(0, 1))
            motion[5:8] += momenta.sum(axis=(0, 1))
            motion[8:11] += np.cross(x, momenta).sum(axis=(0, 1))


def _turned_onto(then: FloatArray, now: FloatArray) -> FloatArray:
    """Smallest rotations (m, 3, 3) of directions (m, 3); the identity between opposite ones."""
    a = then / np.linalg.norm(then, axis=1, keepdims=True)
    b = now / np.linalg.norm(now, axis=1, keepdims=True)
    v, c = np.cross(a, b), np.einsum("mi,mi->m", a, b)
    K = np.zeros((len(a), 3, 3))
    K[:, 0, 1], K[:, 0, 2], K[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    K -= np.swapaxes(K, 1, 2)
    opposite = c < -1.0 + 1e-6
    factor = np.where(opposite, 0.0, 1.0 / np.where(opposite, 1.0, 1.0 + c))
    turned = np.eye(3) + K + factor[:, np.newaxis, np.newaxis] * (K @ K)
    turned[opposite] = np.eye(3)
    return turned
