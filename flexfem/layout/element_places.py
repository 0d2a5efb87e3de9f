# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points inside elements of beams as arrays of this rank: their motion and ranks."""

from collections.abc import Sequence

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.bodies.line_forces import Places, line_twists
from flexfem.core.marker import Observed
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.places.line_points import NURBS
from flexfem.layout.lines import ElementPlace
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3

__all__ = ["ElementPlaces", "holds", "place_arrays", "places_on_rank"]

#: Increment (m, rad) of central differences of twists.
_SPAN = 1e-5


class ElementPlaces:
    """Points in elements of one kind with equally many nodes, all of whose nodes are on this rank.

    Attributes:
        nodes: (n, k) local nodes.
        xi: (n,) coordinates in the elements, 0 to 1.
        places: the points in the format of the compiled loops.
    """

    def __init__(
        self, nodes: IntArray, shape: FloatArray, xi: FloatArray, element: int = NURBS,
        turns: FloatArray | None = None,
    ) -> None:  # fmt: skip
        """Store the places."""
        turns = np.empty((len(nodes), 0, 9)) if turns is None else turns
        self.nodes, self.xi = nodes, xi
        self.places = Places(element=element, nodes=nodes, shape=shape, xi=xi, turns=turns)
        # the same for nodes in the order of the points
        self._apart = Places(
            element=element, nodes=np.arange(nodes.size).reshape(nodes.shape), shape=shape, xi=xi,
            turns=turns,
        )  # fmt: skip

    @classmethod
    def of(cls, places: Sequence[ElementPlace], block: FrameBlock) -> "ElementPlaces":
        """Make the arrays of one or more points."""
        return cls(*place_arrays(places, block))

    def at(self, frames: FloatArray, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Frames (n, 12) and local twists (n, 6) of the points, given those of all nodes."""
        points, twists = np.empty((len(self.xi), 12)), np.empty((len(self.xi), 6))
        line_twists(self.places.memory, frames, velocity, points, twists)
        return points, twists

    def motion(self, block: FrameBlock) -> tuple[FloatArray, FloatArray]:
        """Frames (n, 12) and local twists (n, 6) at the trial state."""
        return self.at(block.frames, block.velocity)

    def twist_rates(self, block: FrameBlock) -> FloatArray:
        """(n, 6) rates of the local twists at the trial state.

        Their change by their dependence on the frames is a central difference along the motion.
        """
        frames, velocity = block.frames[self.nodes], block.velocity[self.nodes]
        fastest = np.abs(velocity).max(axis=(1, 2), initial=0.0)
        spans = _SPAN / np.maximum(fastest, 1e-30)
        twists, count = [], len(self.xi)
        for way in (spans, -spans):
            moved = se3.retract(frames, way[:, np.newaxis, np.newaxis] * velocity)
            out = np.empty((count, 6))
            line_twists(
                self._apart.memory, moved.reshape(-1, 12), velocity.reshape(-1, 6),
                np.empty((count, 12)), out,
            )  # fmt: skip
            twists.append(out)
        rates: FloatArray = self.at(block.frames, block.acceleration)[1]
        rates += (twists[0] - twists[1]) / (2.0 * spans[:, np.newaxis])
        return rates


def place_arrays(
    places: Sequence[ElementPlace], block: FrameBlock
) -> tuple[IntArray, FloatArray, FloatArray, int, FloatArray]:
    """Local nodes, shape functions, coordinates, kind of element and rotations of points."""
    return (
        block.local_index(np.array([place.nodes for place in places])),
        np.array([place.shape for place in places]),
        np.array([place.xi for place in places]),
        places[0].element,
        np.array([place.turns for place in places]),
    )


def holds(block: FrameBlock, place: ElementPlace) -> bool:
    """Return True if an element is on this rank; see ``FrameBlock.elements``."""
    if block.elements is not None:
        return bool(np.isin(place.cell, block.elements))
    return bool(block.owned_index(place.nodes[-1:])[0] >= 0)


def places_on_rank(
    serial: NumberedModel, kind: int, block: FrameBlock, markers: Sequence[Observed]
) -> list[tuple[ElementPlaces, IntArray]]:
    """Markers inside elements on this rank, in groups, and their numbers among the given ones."""
    found: dict[tuple[int, int], list[tuple[int, ElementPlace]]] = {}
    for which, marker in enumerate(markers):
        place = serial.place(marker)
        if place is not None and place.kind == kind and holds(block, place):
            found.setdefault((len(place.nodes), place.element), []).append((which, place))
    groups = []
    for places in found.values():
        points = ElementPlaces.of([place for _, place in places], block)
        groups.append((points, np.array([which for which, _ in places], dtype=np.int64)))
    return groups
