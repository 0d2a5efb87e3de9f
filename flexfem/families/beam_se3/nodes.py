# SPDX-License-Identifier: LGPL-3.0-or-later
"""Serial data of all SE(3) beams of a model: nodes of the mesh numbered, frames at the start."""

import numpy as np

from flexfem._types import IntArray
from flexfem.families.beam_se3.elements import BeamCells, node_frames
from flexfem.families.common.initial_velocities import initial_velocities
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.mesh.line_mesh import section_frames
from flexfem.model.bodies.basic import Beam
from flexfem.model.model import Model

__all__ = ["number_nodes"]


def number_nodes(serial: NumberedModel, beams: list[Beam]) -> None:
    """Enter the nodes and cells of the beams into the serial data of a model."""
    model, mesh = serial.model, serial.model.mesh
    assert mesh is not None  # checked by validate()
    rows = [_along(model, beam) for beam in beams]
    used, cells = np.unique(np.concatenate([mesh.cells[r] for r in rows]), return_inverse=True)
    serial.node_of_mesh = {int(node): i for i, node in enumerate(used)}
    serial.points = mesh.points[used]
    counts = [len(r) for r in rows]
    ends = np.concatenate(
        [
            section_frames(mesh.points, mesh.cells[r], beam.orientation)
            for r, beam in zip(rows, beams, strict=True)
        ]
    )
    cells = cells.reshape(-1, 2).astype(np.int64)
    sections = list({id(b.section): b.section for b in beams}.values())
    number = {id(s): i for i, s in enumerate(sections)}
    serial.sections = sections
    serial.cells = BeamCells(
        cells=cells,
        body=np.repeat([model.beams.index(b) for b in beams], counts),
        section=np.repeat([number[id(b.section)] for b in beams], counts),
        frames=se3.frame(serial.points[cells], ends),
        damping=np.repeat([b.damping for b in beams], counts),
    )
    serial.body_of_node = np.empty(len(used), dtype=np.int64)
    serial.body_of_node[cells] = serial.cells.body[:, np.newaxis]
    serial.frames = node_frames(cells, serial.cells.frames, len(used))
    serial.velocities = np.zeros((len(used), 6))
    for beam in beams:
        nodes = np.unique(cells[serial.cells.body == model.beams.index(beam)])
        serial.velocities[nodes] = initial_velocities(beam, serial.frames[nodes])


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
