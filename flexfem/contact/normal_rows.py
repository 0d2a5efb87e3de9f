# SPDX-License-Identifier: LGPL-3.0-or-later
"""Normal parts of the tangents of closed contacts, as springs between points and surfaces.

The normal part of a tangent is ``J^T D J``: the rows J give the approach of point and surface for
the blocks' steps, the slopes D the force for it. Geometric parts, friction and damping are not
here.
"""

from collections.abc import Mapping

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.carriers import Carriers
from flexfem.contact.detection.narrow_phase import MOST
from flexfem.contact.frames import SurfaceFrames
from flexfem.contact.law.data import AREAS, NORMAL, PLACE, SLOPE
from flexfem.contact.obstacles.rigid_surface import RigidContact
from flexfem.contact.obstacles.triangles import TriangleContact
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.kernels.compiled import kernel

__all__ = ["NormalRows"]


class NormalRows:
    """Rows of the contacts that are closed on this rank at the last evaluation.

    Attributes:
        slopes: derivative of the normal force of each by its gap, (c,), N/m.
        rub: False: friction is explicit.
        keys: numbers (c,) of slave, surface and place among the slave's contacts with it.
    """

    def __init__(self, carriers: Carriers, frames: SurfaceFrames) -> None:
        """Store points and surfaces of the contacts; no rows."""
        self._carriers, self._frames = carriers, frames
        self._steps, self._forces = np.zeros((2, len(carriers.serial.start), 3))
        self.rub = False
        self.clear()

    def clear(self) -> None:
        """Forget all rows."""
        self.slopes, self.keys = np.zeros(0), np.zeros(0, np.int64)
        self._after = 0  # number after those of the surfaces that have been added
        self._nodes, self._weights = np.zeros((0, 4), np.int64), np.zeros((0, 4))
        self._normals = np.zeros((0, 3))
        self._surfaces, self._twists = np.zeros(0, np.int64), np.zeros((0, 6))

    def add_triangles(self, made: TriangleContact) -> None:
        """Add the closed contacts of nodes with triangles."""
        slaves, triangles = made.ends.T
        masters = made.masters.triangles[triangles]
        numbers = made.contacts
        weights = np.column_stack([np.ones(made.count), -numbers[:, AREAS : AREAS + 3]])
        nodes = np.column_stack([made.slaves.nodes[slaves], masters])
        slopes = made.slaves.stiffness[slaves] * numbers[:, SLOPE]
        self._add_keys(slaves, len(made.slaves.nodes))
        self._add(nodes, weights, numbers[:, NORMAL : NORMAL + 3], slopes, -1, None)

    def add_surface(self, made: RigidContact, surface: int) -> None:
        """Add the closed contacts of nodes with a rigid surface of a number."""
        slaves, numbers = made.ends[:, 0], made.contacts
        normals, arms = numbers[:, NORMAL : NORMAL + 3], numbers[:, PLACE : PLACE + 3]
        R = self._frames.frames[surface, 3:].reshape(3, 3)
        nodes = np.repeat(made.slaves.nodes[slaves, np.newaxis], 4, axis=1)
        weights = np.tile([1.0, 0.0, 0.0, 0.0], (made.count, 1))
        twists = -np.column_stack([normals, np.cross(arms, normals)])
        slopes = made.slaves.stiffness[slaves] * numbers[:, SLOPE]
        self._add_keys(slaves, len(made.slaves.nodes))
        self._add(nodes, weights, normals @ R.T, slopes, surface, twists)

    def _add_keys(self, slaves: IntArray, count: int) -> None:
        """Append keys of contacts of slaves (c,), ascending, of which a surface has ``count``."""
        place = np.arange(len(slaves)) - np.searchsorted(slaves, slaves)
        self.keys = np.concatenate([self.keys, self._after + MOST * slaves + place])
        self._after += MOST * count

    def _add(
        self, nodes: IntArray, weights: FloatArray, normals: FloatArray, slopes: FloatArray,
        surface: int, twists: FloatArray | None,
    ) -> None:  # fmt: skip
        """Append rows: means of points (c, 4) along normals (c, 3), and twists of a surface."""
        count = len(slopes)
        self._nodes = np.concatenate([self._nodes, nodes])
        self._weights = np.concatenate([self._weights, weights])
        self._normals = np.concatenate([self._normals, normals])
        self.slopes = np.concatenate([self.slopes, slopes])
        self._surfaces = np.concatenate([self._surfaces, np.full(count, surface)])
        twists = np.zeros((count, 6)) if twists is None else twists
        self._twists = np.concatenate([self._twists, twists])

    @property
    def blocks(self) -> dict[int, FrameBlock]:
        """See ``SpringRows``: their coupling is not found."""
        return {}

    def coupled(
        self, compliances: Mapping[int, FloatArray]
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """See ``SpringRows``."""
        raise NotImplementedError

    def motions(self) -> FloatArray:
        """Motions (c,) of the rows for the blocks' steps, m, positive as gaps open (collective)."""
        self._carriers.move(self._steps)
        found = np.empty(len(self.slopes))
        _motions_into(self._nodes, self._weights, self._normals, self._steps, found)
        if len(self._frames.moving):
            twists = self._frames.twists()[self._surfaces]
            found += np.einsum("ca,ca->c", self._twists, twists)
        return found

    def push(self, forces: FloatArray) -> None:
        """Add the transposed rows times ``forces`` (c,) to the blocks' residuals (collective)."""
        carriers, frames = self._carriers, self._frames
        self._forces[:] = frames.wrenches[:] = 0.0
        _spread(self._nodes, self._weights, self._normals, forces, self._forces)
        if len(frames.moving):
            np.add.at(frames.wrenches, self._surfaces, self._twists * forces[:, np.newaxis])
        carriers.gather(self._forces)
        frames.gather()
        for kind in carriers.by_kind:
            carriers.add_forces(kind, self._forces)
        for kind in np.unique(frames.kind[frames.moving]).tolist():
            frames.add_wrenches(kind)


@kernel
def _motions_into(
    nodes: IntArray, weights: FloatArray, normals: FloatArray, steps: FloatArray, out: FloatArray
) -> None:
    """Write weighted means of steps (n, 3) along normals."""
    for c in range(len(nodes)):
        total = 0.0
        for p in range(nodes.shape[1]):
            step, along = steps[nodes[c, p]], 0.0
            for a in range(3):
                along += normals[c, a] * step[a]
            total += weights[c, p] * along
        out[c] = total


@kernel
def _spread(
    nodes: IntArray, weights: FloatArray, normals: FloatArray, forces: FloatArray,
    residual: FloatArray,
) -> None:  # fmt: skip
    """Add forces along normals to the points' residual (n, 3)."""
    for c in range(len(nodes)):
        for p in range(nodes.shape[1]):
            for a in range(3):
                residual[nodes[c, p], a] += weights[c, p] * forces[c] * normals[c, a]
