# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frames of the rigid surfaces of simple shapes, fixed to nodes or the ground, on every rank."""

from collections.abc import Iterator, Mapping, Sequence

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.pairs import RigidPlace
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.lie import se3, so3

__all__ = ["SurfaceFrames"]


class SurfaceFrames:
    """Frames of some rigid surfaces, and wrenches on the nodes that carry them.

    Twists of a surface and of its node, in their own axes, are related by a constant matrix.

    Attributes:
        frames: present frames, (k, 12).
        maps: twists of the surfaces for those of the nodes, (k, 6, 6).
        kind: kind of block of each carrier, -1 for the ground, (k,).
        numbers: global number of each carrier in its block, (k,).
        wrenches: force and moment on each surface in its axes, scaled, (k, 6).
    """

    def __init__(
        self, comm: MPI.Intracomm, places: Sequence[RigidPlace], blocks: Mapping[int, FrameBlock]
    ) -> None:
        """Find the carriers (collective)."""
        self._comm, count = comm, len(places)
        self._offsets = np.array([place.frame for place in places]).reshape(-1, 12)
        self.frames = np.array([place.start for place in places]).reshape(-1, 12)
        self.wrenches = np.zeros((count, 6))
        self.kind: IntArray = np.full(count, -1)
        self._local: IntArray = np.full(count, -1)
        self.numbers: IntArray = np.full(count, -1)
        self.maps = np.tile(np.eye(6), (count, 1, 1))
        for k, place in enumerate(places):
            if place.carrier is None:
                continue
            kind, node = place.carrier
            R, arm = se3.rotation(place.frame), so3.skew(se3.position(place.frame))
            self.maps[k] = np.block([[R.T, -R.T @ arm], [np.zeros((3, 3)), R.T]])
            self.kind[k] = kind
            self._local[k] = blocks[kind].owned_index(np.array([node]))[0]
            if self._local[k] >= 0:
                self.numbers[k] = blocks[kind].offset + self._local[k]
        comm.Allreduce(MPI.IN_PLACE, self.numbers, op=MPI.MAX)
        self._blocks = blocks
        self.moving: IntArray = np.flatnonzero(self.kind >= 0)
        self._own: IntArray = np.flatnonzero(self._local >= 0)

    def update(self) -> None:
        """Exchange the frames of moving surfaces (collective)."""
        if not len(self.moving):
            return
        table = np.zeros((len(self.frames), 12))
        for k in self._own:
            table[k] = self._blocks[int(self.kind[k])].frames[self._local[k]]
        self._sum(table)
        self.frames[self.moving] = se3.compose(table[self.moving], self._offsets[self.moving])

    def twists(self) -> FloatArray:
        """Steps of the surfaces, (k, 6) in their axes (collective)."""
        steps = np.zeros((len(self.frames), 6))
        for k in self._own:
            steps[k] = self.maps[k] @ self._blocks[int(self.kind[k])].step[self._local[k]]
        self._sum(steps)
        return steps

    def _sum(self, values: FloatArray) -> None:
        if len(self.moving) and self._comm.size > 1:
            self._comm.Allreduce(MPI.IN_PLACE, values)

    def gather(self) -> None:
        """Sum the wrenches of all ranks (collective)."""
        self._sum(self.wrenches)

    def add_wrenches(self, kind: int) -> None:
        """Add gathered wrenches to the residual of a block."""
        for k in self._own:
            if self.kind[k] == kind:
                self._blocks[kind].residual[self._local[k]] += self.maps[k].T @ self.wrenches[k]

    def block(self, kind: int) -> FrameBlock:
        """Block of a kind."""
        return self._blocks[kind]

    def sums(self, kind: int) -> Iterator[tuple[int, FloatArray]]:
        """Local nodes of a block that carry surfaces on this rank, and gathered wrenches."""
        for k in self._own:
            if self.kind[k] == kind:
                yield int(self._local[k]), self.wrenches[k]
