# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads of a model as forces at the nodes and places of this rank."""

from collections.abc import Iterator

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.frame_block import FrameBlock
from flexfem.core.load import Load
from flexfem.lie import se3
from flexfem.system.assembly import Assembly
from flexfem.system.element_places import holds
from flexfem.system.line_loads import LineForce
from flexfem.system.node_loads import Force
from flexfem.system.placement import BEAMS, NURBS

__all__ = ["line_forces", "node_forces"]


def node_forces(serial: Assembly, kind: int, block: FrameBlock) -> list[Force]:
    """Loads on the nodes of a block that this rank owns."""
    forces = []
    for number, load in enumerate(serial.model.loads):
        force, moment = load.wrench
        for marker in load.markers:
            local = serial.local_node(marker, kind, block)
            if local >= 0:
                frame = serial.marker_frame(marker)
                forces.append(Force(local, frame, force, moment, load.follower, number))
        for name in load.beams:
            for node, frame, part in _shares(serial, kind, load, name, block):
                forces.append(
                    Force(node, frame, part * force, part * moment, load.follower, number)
                )
    return forces


def _shares(
    serial: Assembly, kind: int, load: Load, name: str, block: FrameBlock
) -> Iterator[tuple[int, FloatArray, float]]:
    """Owned node, section frame relative to it, and length that it carries of a load on a beam."""
    formulation = serial.model[name].formulation
    if kind == BEAMS and formulation == "se3":
        yield from _half_cells(serial, name, block)
    elif kind == NURBS and formulation == "nurbs" and not _at_points(load):
        yield from _control_points(serial, name, block)


def _at_points(load: Load) -> bool:
    """Whether a load along a beam follows rotations, which control points do not have."""
    return load.follower or bool(load.wrench[1].any())


def _control_points(
    serial: Assembly, name: str, block: FrameBlock
) -> Iterator[tuple[int, FloatArray, float]]:
    """Control points with the integrals of their shape functions: exact for dead forces."""
    curves = serial.curves
    assert curves is not None
    beam = curves.index(name)
    nodes, inverse = np.unique(curves.nodes(beam), return_inverse=True)
    lengths = np.bincount(inverse.ravel(), curves.integrals(beam).ravel())
    local = block.owned_index(nodes)
    for k in np.flatnonzero(local >= 0):
        yield int(local[k]), se3.frame(np.zeros(3), np.eye(3)), float(lengths[k])


def line_forces(serial: Assembly, block: FrameBlock) -> list[LineForce]:
    """Loads inside those elements of NURBS beams that this rank holds."""
    forces = []
    for number, load in enumerate(serial.model.loads):
        force, moment = load.wrench
        for marker in load.markers:
            place = serial.place(marker)
            if place is not None and holds(block, place.nodes):
                nodes = block.local_index(place.nodes)
                forces.append(
                    LineForce(
                        nodes, place.shape, place.xi, serial.marker_frame(marker), force, moment,
                        load.follower, number,
                    )
                )  # fmt: skip
        for name in load.beams if _at_points(load) else ():
            if serial.model[name].formulation == "nurbs":
                forces += _points(serial, name, block, load, number)
    return forces


def _points(
    serial: Assembly, name: str, block: FrameBlock, load: Load, number: int
) -> Iterator[LineForce]:
    """A load along a beam at the Gauss points of those of its elements that this rank holds."""
    curves = serial.curves
    assert curves is not None
    beam, (force, moment) = curves.index(name), load.wrench
    xi, lengths = curves.gauss(beam)
    for e, nodes in enumerate(curves.nodes(beam)):
        if not holds(block, nodes):
            continue
        local, shape = block.local_index(nodes), curves.parts[beam].shape[e]
        for at, ds in zip(xi, lengths[e], strict=True):
            offset = se3.frame(np.zeros(3), np.eye(3))
            yield LineForce(
                local, shape, float(at), offset, ds * force, ds * moment, load.follower, number
            )


def _half_cells(
    serial: Assembly, name: str, block: FrameBlock
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
