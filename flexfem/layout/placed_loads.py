# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads of a model as forces at the nodes and points of this rank."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.load import Load
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.places.line_points import arc_length
from flexfem.layout.element_places import holds
from flexfem.layout.line_loads import LineForce
from flexfem.layout.lines import ElementPlace, Line
from flexfem.layout.node_loads import Force
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.loads.line_load import LineLoad
from flexfem.model.bodies.basic import Beam

__all__ = [
    "load_at_points",
    "loads_along",
    "marker_forces",
    "marker_forces_inside",
    "spread_load",
    "varying_forces",
]

#: Least number of Gauss points of an element for varying loads; the number of nodes if larger.
_GAUSS = 3


def marker_forces(
    serial: NumberedModel, kind: int, block: FrameBlock, turning: bool = True
) -> Iterator[Force]:
    """Loads of markers on the nodes of a block that this rank owns.

    ``turning`` is True if follower forces and moments act on nodes.
    """
    for number, load in enumerate(serial.model.loads):
        if not turning and (load.follower or load.has_moment):
            continue
        for marker in load.markers:
            force, moment = load.wrench
            local = serial.local_node(marker, kind, block)
            if local >= 0:
                frame = serial.marker_frame(marker)
                yield Force(local, frame, force, moment, load.follower, number)


def loads_along(serial: NumberedModel, beams: Sequence[Beam]) -> Iterator[tuple[int, Load, str]]:
    """Loads along some beams with their numbers and the beams' names."""
    names = {beam.name for beam in beams}
    for number, load in enumerate(serial.model.loads):
        for name in load.beams:
            if name in names:
                yield number, load, name


def spread_load(
    shares: Iterable[tuple[int, FloatArray, float]], load: Load, number: int
) -> Iterator[Force]:
    """A load along a beam at nodes, each with its tributary length."""
    force, moment = load.wrench
    for node, frame, part in shares:
        yield Force(node, frame, part * force, part * moment, load.follower, number)


def marker_forces_inside(
    serial: NumberedModel, kind: int, block: FrameBlock
) -> Iterator[LineForce]:
    """Loads of markers inside the elements of beams of a kind on this rank."""
    for number, load in enumerate(serial.model.loads):
        for marker in load.markers:
            force, moment = load.wrench
            place = serial.place(marker)
            if place is not None and place.kind == kind and holds(block, place):
                offset = serial.marker_frame(marker)
                yield LineForce(place, offset, force, moment, load.follower, number)


def varying_forces(
    serial: NumberedModel, name: str, block: FrameBlock, load: Load, number: int
) -> Iterator[LineForce]:
    """A load along a beam at the Gauss points of pieces of its elements on this rank."""
    assert isinstance(load, LineLoad)
    line = serial.line(name)
    offset = se3.frame(np.zeros(3), np.eye(3))
    for e in range(len(line.nodes)):
        if holds(block, ElementPlace.on(line, e, 0.0)):
            for xi, force, moment in load_at_points(line, load, e):
                place = ElementPlace.on(line, e, xi)
                yield LineForce(place, offset, force, moment, load.follower, number)


def load_at_points(
    line: Line, load: LineLoad, element: int, parts: int = 1
) -> Iterator[tuple[float, FloatArray, FloatArray]]:
    """Coordinate, force (N) and moment (N m) of each Gauss point of an element under a load.

    Args:
        line: the beam's elements.
        load: load that varies along the beam.
        element: number of the element along the line.
        parts: number of parts of each piece between the load's breakpoints.
    """
    unit = line.length if load.coordinate == "fraction" else 1.0
    at, weights = np.polynomial.legendre.leggauss(max(line.nodes.shape[1], _GAUSS))
    for start, end in pairwise(line.cuts(element, unit * load.breakpoints)):
        for low, high in pairwise(np.linspace(start, end, parts + 1)):
            for x, w in zip(at, weights, strict=True):
                xi = float(low + 0.5 * (1.0 + x) * (high - low))
                s, speed, _ = arc_length(line.arc[element], xi)
                ds = 0.5 * w * (high - low) * speed
                force, moment = load.at((line.starts[element] + s) / unit)
                yield xi, ds * force, ds * moment
