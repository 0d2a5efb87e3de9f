# SPDX-License-Identifier: LGPL-3.0-or-later
"""Serial data of all SE(3) beams of a model: nodes of the mesh numbered, frames at the start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.inertia import inertia_about
from flexfem.families.beam_se3.elements import BeamCells, node_frames
from flexfem.families.common.initial_velocities import initial_velocities
from flexfem.lie import se3
from flexfem.materials.section import Section
from flexfem.mesh.line_mesh import section_frames
from flexfem.model.bodies.basic import Beam
from flexfem.model.model import Model

__all__ = ["BeamMesh"]

#: Gauss points in a cell, relative to its length.
_GAUSS = 0.5 + 0.5 / np.sqrt(3.0) * np.array([-1.0, 1.0])


@dataclass(frozen=True, eq=False)
class BeamMesh:
    """Nodes and cells of all SE(3) beams, the same on every rank.

    Attributes:
        cells: all cells with their frames; nodes are numbered among those that they use.
        points, frames, velocities: (n, 3), (n, 12) and (n, 6) of the nodes at the start.
        body_of_node: (n,) number of the beam in the model.
        sections: the beams' different sections, by the numbers in ``cells``.
        node_of_mesh: number of each node by its number in the model's mesh.
    """

    cells: BeamCells
    points: FloatArray
    frames: FloatArray
    velocities: FloatArray
    body_of_node: IntArray
    sections: list[Section]
    node_of_mesh: dict[int, int]

    @classmethod
    def of(cls, model: Model) -> BeamMesh:
        """Data of a model with SE(3) beams."""
        beams, mesh = model.beams_of("se3"), model.mesh
        assert mesh is not None  # checked by validate()
        rows = [_along(model, beam) for beam in beams]
        used, nodes = np.unique(np.concatenate([mesh.cells[r] for r in rows]), return_inverse=True)
        points, counts = mesh.points[used], [len(r) for r in rows]
        ends = np.concatenate(
            [
                section_frames(mesh.points, mesh.cells[r], beam.orientation)
                for r, beam in zip(rows, beams, strict=True)
            ]
        )
        nodes = nodes.reshape(-1, 2).astype(np.int64)
        sections = list({id(b.section): b.section for b in beams}.values())
        number = {id(s): i for i, s in enumerate(sections)}
        cells = BeamCells(
            cells=nodes,
            body=np.repeat([model.beams.index(b) for b in beams], counts),
            section=np.repeat([number[id(b.section)] for b in beams], counts),
            frames=se3.frame(points[nodes], ends),
            damping=np.repeat([b.damping for b in beams], counts),
        )
        body_of_node = np.empty(len(used), dtype=np.int64)
        body_of_node[nodes] = cells.body[:, np.newaxis]
        frames, velocities = node_frames(nodes, cells.frames, len(used)), np.zeros((len(used), 6))
        for beam in beams:
            own = np.unique(nodes[cells.body == model.beams.index(beam)])
            velocities[own] = initial_velocities(beam, frames[own])
        node_of_mesh = {int(node): i for i, node in enumerate(used)}
        return cls(cells, points, frames, velocities, body_of_node, sections, node_of_mesh)

    def numbers(self, nodes: Sequence[int]) -> IntArray:
        """Numbers of nodes given by their numbers in the model's mesh."""
        return np.array([self.node_of_mesh[node] for node in nodes], dtype=np.int64)

    def nodes(self, beam: int) -> IntArray:
        """(m, 2) nodes of the cells of a beam, by its number in the model."""
        nodes: IntArray = self.cells.cells[self.cells.body == beam].astype(np.int64)
        return nodes

    def common_nodes(self) -> IntArray:
        """(k, 2) numbers of two beams for each node that both have."""
        count = int(self.cells.body.max()) + 1
        pairs = np.unique(count * self.cells.cells.ravel() + np.repeat(self.cells.body, 2))
        node, body = np.divmod(pairs, count)
        again = node[1:] == node[:-1]
        return np.stack([body[:-1][again], body[1:][again]], axis=1)

    def inertia(self, beam: int, section: Section, origin: FloatArray) -> FloatArray:
        """Inertia matrix (6, 6) of a beam at the start about a frame (12,)."""
        ends = self.cells.frames[self.cells.body == beam]
        twists = se3.log(se3.compose(se3.inverse(ends[:, 0]), ends[:, 1]))
        weights = 0.5 * np.linalg.norm(twists[:, :3], axis=1)
        total = np.zeros((6, 6))
        for xi in _GAUSS:
            frames = se3.retract(ends[:, 0], xi * twists)
            total += inertia_about(origin, frames, section.inertia, weights)
        return total


def _along(model: Model, beam: Beam) -> IntArray:
    """Cells of a beam ordered along it, so that consecutive cells are neighbours in space."""
    rows = model.beam_cells(beam)
    assert model.mesh is not None
    assert beam.group is not None
    order = model.mesh.order(beam.group)
    if order is None:
        return rows
    rank = np.empty(len(model.mesh.points), dtype=np.int64)
    rank[order] = np.arange(len(order))
    return rows[np.argsort(rank[model.mesh.cells[rows]].min(axis=1), kind="stable")]
