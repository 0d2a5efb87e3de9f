# SPDX-License-Identifier: LGPL-3.0-or-later
"""Uniform loads along SE(3) beams as forces at nodes."""

from collections.abc import Iterator, Sequence

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.layout.node_loads import Force
from flexfem.layout.numbered_model import NumberedModel
from flexfem.layout.placed_loads import acts_at_nodes, loads_along, spread_load
from flexfem.lie import se3
from flexfem.model.bodies.basic import Beam

__all__ = ["se3_beam_forces"]


def se3_beam_forces(
    serial: NumberedModel, beams: Sequence[Beam], block: FrameBlock
) -> Iterator[Force]:
    """Uniform loads along SE(3) beams on the nodes that this rank owns."""
    for number, load, name in loads_along(serial, beams):
        if acts_at_nodes(load, "se3"):
            yield from spread_load(_half_cells(serial, name, block), load, number)


def _half_cells(
    serial: NumberedModel, name: str, block: FrameBlock
) -> Iterator[tuple[int, FloatArray, float]]:
    """Owned node, section frame relative to it, and half length of both ends of a beam's cells.

    Half of each cell's load at either end is exact for the linear positions of the element.
    """
    body = [b.name for b in serial.model.beams].index(name)
    cells = np.flatnonzero(serial.cells.body == body)
    nodes, ends = serial.cells.cells[cells], serial.cells.frames[cells]
    relative = se3.compose(se3.inverse(ends[:, 0]), ends[:, 1])
    half = 0.5 * np.linalg.norm(se3.log(relative)[:, :3], axis=1)
    frames = se3.compose(se3.inverse(serial.frames[nodes]), ends)
    for side in range(2):
        local = block.owned_index(nodes[:, side])
        for k in np.flatnonzero(local >= 0):
            yield int(local[k]), frames[k, side], float(half[k])
