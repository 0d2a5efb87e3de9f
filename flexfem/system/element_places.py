# SPDX-License-Identifier: LGPL-3.0-or-later
"""Places inside NURBS elements as arrays of this rank: their motion, and who holds them."""

from collections.abc import Sequence

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.bodies.line_forces import line_twists
from flexfem.core.frame_block import FrameBlock
from flexfem.core.marker import Observed
from flexfem.system.assembly import Assembly
from flexfem.system.lines import ElementPlace
from flexfem.system.nurbs_lines import NurbsLines

__all__ = ["ElementPlaces", "held_elements", "held_places", "holds"]


class ElementPlaces:
    """Places in elements with equally many nodes, all of whose nodes are on this rank.

    Attributes:
        nodes: (n, k) local nodes.
        shape: (n, k, k) coefficients of the shape functions; xi: (n,) places in the elements.
    """

    def __init__(self, nodes: IntArray, shape: FloatArray, xi: FloatArray) -> None:
        """Store the places."""
        self.nodes, self.shape, self.xi = nodes, shape, xi

    def at(self, frames: FloatArray, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Frames (n, 12) and local twists (n, 6) of the places, given those of all nodes."""
        points, twists = np.empty((len(self.xi), 12)), np.empty((len(self.xi), 6))
        line_twists(self.nodes, self.shape, self.xi, frames, velocity, points, twists)
        return points, twists

    def motion(self, block: FrameBlock) -> tuple[FloatArray, FloatArray]:
        """Frames (n, 12) and local twists (n, 6) at the trial state."""
        return self.at(block.frames, block.velocity)


def holds(block: FrameBlock, nodes: IntArray) -> bool:
    """Whether an element is this rank's: it is that of the owner of its last control point."""
    return bool(block.owned_index(nodes[-1:])[0] >= 0)


def held_elements(curves: NurbsLines, block: FrameBlock) -> list[IntArray]:
    """Numbers along each beam of the elements that this rank holds."""
    return [
        np.flatnonzero(block.owned_index(curves.nodes(beam)[:, -1]) >= 0)
        for beam in range(len(curves.beams))
    ]


def held_places(
    serial: Assembly, kind: int, block: FrameBlock, markers: Sequence[Observed]
) -> list[tuple[ElementPlaces, IntArray]]:
    """Markers inside elements that this rank holds, in groups, and which of them these are."""
    found: dict[int, list[tuple[int, ElementPlace]]] = {}
    for which, marker in enumerate(markers):
        place = serial.place(marker)
        if place is not None and place.kind == kind and holds(block, place.nodes):
            found.setdefault(len(place.nodes), []).append((which, place))
    groups = []
    for places in found.values():
        points = ElementPlaces(
            block.local_index(np.array([place.nodes for _, place in places])),
            np.array([place.shape for _, place in places]),
            np.array([place.xi for _, place in places]),
        )
        groups.append((points, np.array([which for which, _ in places], dtype=np.int64)))
    return groups
