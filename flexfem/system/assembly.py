# SPDX-License-Identifier: LGPL-3.0-or-later
"""Serial data of a model: nodes numbered, frames at the start, markers resolved."""

from collections.abc import Sequence

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.frame_block import FrameBlock
from flexfem.core.marker import Attachment, Marker
from flexfem.core.pose import Pose
from flexfem.elements.se3_beam import BeamCells, node_frames
from flexfem.lie import se3
from flexfem.mesh.line_mesh import section_frames
from flexfem.mesh.topology import trace_lines
from flexfem.model.bodies import Beam
from flexfem.model.model import Model
from flexfem.system.line_cells import LineCells, se3_line
from flexfem.system.placement import BEAMS, RIGID, NodeKey

__all__ = ["Assembly"]


class Assembly:
    """Serial data of a model in the order of its nodes, the same on every rank.

    Attributes:
        model: the validated model.
        cells: all beam cells with their frames; node numbers count the nodes used by beams.
        points, frames, velocities: of those nodes, (n, 3), (n, 12), (n, 6).
        sections: the beams' different sections, by the numbers in ``cells``.
        rigid_frames: (n, 12) frames of the rigid bodies.
    """

    def __init__(self, model: Model) -> None:
        """Number the beams' nodes and compute all frames at the start."""
        self.model = model
        self._rigid_index = {b.name: i for i, b in enumerate(model.rigid_bodies)}
        if model.beams:
            self._beams()
        self.rigid_frames = np.array(
            [se3.frame(b.position, b.rotation) for b in model.rigid_bodies]
        ).reshape(-1, 12)

    def _beams(self) -> None:
        model, mesh = self.model, self.model.mesh
        assert mesh is not None  # checked by validate()
        rows = [_along(model, beam) for beam in model.beams]
        used, cells = np.unique(np.concatenate([mesh.cells[r] for r in rows]), return_inverse=True)
        self._node_of_mesh = {int(node): i for i, node in enumerate(used)}
        self.points = mesh.points[used]
        counts = [len(r) for r in rows]
        ends = np.concatenate(
            [
                section_frames(mesh.points, mesh.cells[r], beam.orientation)
                for r, beam in zip(rows, model.beams, strict=True)
            ]
        )
        cells = cells.reshape(-1, 2)
        sections = list({id(b.section): b.section for b in model.beams}.values())
        number = {id(s): i for i, s in enumerate(sections)}
        self.sections = sections
        self.cells = BeamCells(
            cells=cells,
            body=np.repeat(np.arange(len(rows)), counts),
            section=np.repeat([number[id(b.section)] for b in model.beams], counts),
            frames=se3.frame(self.points[cells], ends),
            damping=np.repeat([b.damping for b in model.beams], counts),
        )
        self._body_of_node = np.empty(len(used), dtype=np.int64)
        self._body_of_node[cells] = self.cells.body[:, np.newaxis]
        self.frames = node_frames(cells, self.cells.frames, len(used))
        self.velocities = np.zeros((len(used), 6))
        for body, beam in enumerate(model.beams):
            nodes = np.unique(cells[self.cells.body == body])
            back = np.swapaxes(se3.rotation(self.frames[nodes]), -1, -2)
            speed = beam.velocity + np.cross(beam.angular_velocity, self.points[nodes])
            self.velocities[nodes, :3] = np.einsum("nij,nj->ni", back, speed)
            self.velocities[nodes, 3:] = back @ beam.angular_velocity

    def line(self, name: str) -> LineCells:
        """Elements of a beam in order.

        Raises:
            ValueError: the model has no such beam, or it branches or falls apart.
        """
        beam = self.model.get(name)
        if not isinstance(beam, Beam):
            raise ValueError(f'{self.model!r} has no beam "{name}"')
        own = self.cells.body == self.model.beams.index(beam)
        cells = np.flatnonzero(own).astype(np.int64)
        nodes = self.cells.cells[cells]
        order = _chain(nodes)
        if order is None:
            raise ValueError(f'Beam "{name}": group "{beam.group}" branches or falls apart')
        cells = cells[order]
        return se3_line(
            BEAMS, cells, self.cells.cells[cells], self.cells.frames[cells], self.frames
        )

    def point(self, marker: Attachment) -> tuple[LineCells, int, float] | None:
        """Line, element and coordinate of a marker inside an element, None for the others."""
        return None

    def key(self, marker: Attachment) -> NodeKey | None:
        """Node that carries a marker, None for the ground."""
        if not isinstance(marker, Marker):
            return None
        node = self.model.marker_node(marker)
        if node is None:
            return RIGID, self._rigid_index[marker.body]
        return BEAMS, self._node_of_mesh[node]

    def mesh_nodes(self, nodes: Sequence[int]) -> IntArray:
        """Numbers of the beams' nodes given by their numbers in the mesh."""
        return np.array([self._node_of_mesh[node] for node in nodes], dtype=np.int64)

    def local_node(self, marker: Attachment, kind: int, block: FrameBlock) -> int:
        """Local index of a marker's node in the block of a kind, -1 if it is not owned there."""
        key = self.key(marker)
        if key is None or key[0] != kind:
            return -1
        return int(block.owned_index(np.array([key[1]]))[0])

    def bodies(self, kind: int, nodes: IntArray) -> IntArray:
        """Numbers of the bodies that nodes of one kind belong to."""
        return self._body_of_node[nodes] if kind == BEAMS else nodes

    def node_frame(self, key: NodeKey) -> FloatArray:
        """Frame (12,) of a node at the start."""
        frame: FloatArray = (self.frames if key[0] == BEAMS else self.rigid_frames)[key[1]]
        return frame

    def marker_frame(self, marker: Attachment) -> FloatArray:
        """Frame (12,) of a marker relative to its node; absolute for the ground."""
        if not isinstance(marker, Marker):
            return se3.frame(marker.position, marker.rotation)
        key = self.key(marker)
        assert key is not None
        turn = se3.rotation(self.node_frame(key)).T @ marker.rotation
        return se3.frame(marker.offset, turn)

    def marker_pose(self, marker: Attachment) -> Pose:
        """Pose of a marker at the start."""
        frame, key = self.marker_frame(marker), self.key(marker)
        if key is not None:
            frame = se3.compose(self.node_frame(key), frame)
        return Pose(se3.position(frame), se3.rotation(frame))


def _chain(cells: IntArray) -> IntArray | None:
    """Order of cells of one line, all in its direction; None where they branch or fall apart."""
    lines = trace_lines(cells)
    if len(lines) != 1 or lines[0].reversed.any():
        return None
    return lines[0].cells


def _along(model: Model, beam: Beam) -> IntArray:
    """Cells of a beam ordered along it, so that neighbours in number are neighbours in space."""
    rows = model.beam_cells(beam)
    assert model.mesh is not None
    order = model.mesh.order(beam.group)
    if order is None:
        return rows
    rank = np.empty(len(model.mesh.points), dtype=np.int64)
    rank[order] = np.arange(len(order))
    return rows[np.argsort(rank[model.mesh.cells[rows]].min(axis=1), kind="stable")]
