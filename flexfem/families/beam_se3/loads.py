# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads along SE(3) beams as forces at nodes, if they are uniform, or inside elements."""

from collections.abc import Iterator, Sequence

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.load import Load
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.beam_se3.mesh import BeamMesh
from flexfem.layout.line_loads import LineForce
from flexfem.layout.node_loads import Force
from flexfem.layout.numbered_model import NumberedModel
from flexfem.layout.placed_loads import (
    loads_along,
    marker_forces_inside,
    spread_load,
    varying_forces,
)
from flexfem.lie import se3
from flexfem.model.bodies.basic import Beam

__all__ = ["se3_line_forces", "se3_node_forces"]


def se3_node_forces(
    serial: NumberedModel, mesh: BeamMesh, beams: Sequence[Beam], block: FrameBlock
) -> Iterator[Force]:
    """Uniform loads along SE(3) beams on the nodes that this rank owns."""
    for number, load, name in loads_along(serial, beams):
        if _at_nodes(load):
            beam = [b.name for b in serial.model.beams].index(name)
            yield from spread_load(_half_cells(mesh, beam, block), load, number)


def se3_line_forces(
    serial: NumberedModel, kind: int, beams: Sequence[Beam], block: FrameBlock
) -> Iterator[LineForce]:
    """Loads inside the elements of SE(3) beams on this rank."""
    yield from marker_forces_inside(serial, kind, block)
    for number, load, name in loads_along(serial, beams):
        if not _at_nodes(load):
            yield from varying_forces(serial, name, block, load, number)


def _at_nodes(load: Load) -> bool:
    """Return True if a load along a beam acts at nodes."""
    return load.uniform and not load.has_moment


def _half_cells(
    mesh: BeamMesh, beam: int, block: FrameBlock
) -> Iterator[tuple[int, FloatArray, float]]:
    """Owned node, section frame relative to it, and half length of both ends of a beam's cells.

    Half of each cell's load at either end is exact for the linear positions of the element.
    """
    nodes, ends = mesh.nodes(beam), mesh.cells.frames[mesh.cells.body == beam]
    relative = se3.compose(se3.inverse(ends[:, 0]), ends[:, 1])
    half = 0.5 * np.linalg.norm(se3.log(relative)[:, :3], axis=1)
    frames = se3.compose(se3.inverse(mesh.frames[nodes]), ends)
    for side in range(2):
        local = block.owned_index(nodes[:, side])
        for k in np.flatnonzero(local >= 0):
            yield int(local[k]), frames[k, side], float(half[k])
