# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads along NURBS beams as forces at control points, if these are exact, or inside elements."""

from collections.abc import Iterator

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.load import Load
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.beam_nurbs.curves import NurbsLines
from flexfem.layout.element_places import holds
from flexfem.layout.line_loads import LineForce
from flexfem.layout.lines import ElementPlace
from flexfem.layout.node_loads import Force
from flexfem.layout.numbered_model import NumberedModel
from flexfem.layout.placed_loads import (
    loads_along,
    marker_forces_inside,
    spread_load,
    varying_forces,
)
from flexfem.lie import se3

__all__ = ["nurbs_line_forces", "nurbs_node_forces"]


def nurbs_node_forces(
    serial: NumberedModel, curves: NurbsLines, block: FrameBlock
) -> Iterator[Force]:
    """Uniform loads along NURBS beams on the control points that this rank owns."""
    for number, load, name in loads_along(serial, curves.beams):
        if _at_nodes(load):
            yield from spread_load(_control_points(curves, name, block), load, number)


def nurbs_line_forces(
    serial: NumberedModel, kind: int, curves: NurbsLines, block: FrameBlock
) -> Iterator[LineForce]:
    """Loads inside the elements of NURBS beams on this rank."""
    yield from marker_forces_inside(serial, kind, block)
    for number, load, name in loads_along(serial, curves.beams):
        if _at_nodes(load):
            continue
        if load.uniform:
            yield from _at_gauss_points(serial, curves, name, block, load, number)
        else:
            yield from varying_forces(serial, name, block, load, number)


def _at_nodes(load: Load) -> bool:
    """Return True if a load along a beam acts at control points: uniform dead forces.

    The rotations of control points are not those of the beam, so that follower loads are excluded.
    """
    return load.uniform and not load.follower and not load.has_moment


def _at_gauss_points(
    serial: NumberedModel, curves: NurbsLines, name: str, block: FrameBlock, load: Load,
    number: int,
) -> Iterator[LineForce]:  # fmt: skip
    """A uniform load along a beam at the Gauss points of its elements on this rank."""
    (force, moment), line = load.wrench, serial.line(name)
    xi, lengths = curves.gauss(curves.index(name))
    offset = se3.frame(np.zeros(3), np.eye(3))
    for e in range(len(line.nodes)):
        if holds(block, ElementPlace.on(line, e, 0.0)):
            for at, ds in zip(xi, lengths[e], strict=True):
                place = ElementPlace.on(line, e, float(at))
                yield LineForce(place, offset, ds * force, ds * moment, load.follower, number)


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
