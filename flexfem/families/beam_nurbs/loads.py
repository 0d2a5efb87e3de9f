# SPDX-License-Identifier: LGPL-3.0-or-later
"""Uniform loads along NURBS beams as forces at control points."""

from collections.abc import Iterator

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.beam_nurbs.curves import NurbsLines
from flexfem.layout.node_loads import Force
from flexfem.layout.numbered_model import NumberedModel
from flexfem.layout.placed_loads import acts_at_nodes, loads_along, spread_load
from flexfem.lie import se3

__all__ = ["nurbs_beam_forces"]


def nurbs_beam_forces(
    serial: NumberedModel, curves: NurbsLines, block: FrameBlock
) -> Iterator[Force]:
    """Uniform loads along NURBS beams on the control points that this rank owns."""
    for number, load, name in loads_along(serial, curves.beams):
        if acts_at_nodes(load, "nurbs"):
            yield from spread_load(_control_points(curves, name, block), load, number)


def _control_points(
    curves: NurbsLines, name: str, block: FrameBlock
) -> Iterator[tuple[int, FloatArray, float]]:
    """Control points with the integrals of their shape functions: exact for dead forces."""
    beam = curves.index(name)
    nodes, inverse = np.unique(curves.nodes(beam), return_inverse=True)
    lengths = np.bincount(inverse.ravel(), curves.integrals(beam).ravel())
    local = block.owned_index(nodes)
    for k in np.flatnonzero(local >= 0):
        yield int(local[k]), se3.frame(np.zeros(3), np.eye(3)), float(lengths[k])
