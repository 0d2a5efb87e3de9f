# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces at points inside elements of beams, as arrays for the compiled loops."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.bodies.line_forces import (
    add_line_forces,
    line_force_states,
    line_force_tangent,
)
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.layout.element_places import ElementPlaces, place_arrays
from flexfem.layout.lines import ElementPlace
from flexfem.layout.node_loads import wrenches

__all__ = ["LineForce", "LineForces", "by_kind"]


@dataclass(frozen=True)
class LineForce:
    """One wrench at a point: components inertial (dead) or in the axes of ``offset`` (follower)."""

    place: ElementPlace
    offset: FloatArray
    force: FloatArray
    moment: FloatArray
    follower: bool
    load: int


class LineForces(ElementPlaces):
    """Wrenches at points in elements of one kind, with the loads whose amplitudes scale them.

    Attributes:
        body: (n,) number of the beam of each.
    """

    def __init__(self, forces: Sequence[LineForce], node_body: IntArray, block: FrameBlock) -> None:
        """Store the wrenches, at least one; ``node_body`` gives the beams of all nodes."""
        super().__init__(*place_arrays([force.place for force in forces], block))
        self.body: IntArray = node_body[self.nodes[:, -1]]
        self._wrenches = wrenches(forces)

    def add_residual(self, block: FrameBlock, factors: FloatArray, scale: float) -> None:
        """Subtract ``scale`` times the forces from the block's residual."""
        add_line_forces(
            self.places.memory, self._wrenches.memory, block.nodes.memory, factors, scale
        )

    def tangent(self, block: FrameBlock, factors: FloatArray, scale: float) -> FloatArray:
        """(n, k width, k width) derivative of the residual along local twists."""
        size = 6 * self.nodes.shape[1]
        out = np.empty((len(self.xi), size, size))
        line_force_tangent(
            self.places.memory, self._wrenches.memory, block.nodes.memory, factors, scale, out
        )
        if block.width == 6:
            return out
        own, count = np.s_[: block.width], self.nodes.shape[1]
        moved = out.reshape(-1, count, 6, count, 6)[:, :, own, :, own]
        return moved.reshape(len(out), block.width * count, block.width * count)

    def add_action(self, block: FrameBlock, factors: FloatArray, scale: float) -> None:
        """Add ``scale`` times the tangent applied to the block's step to its residual."""
        steps = block.step[self.nodes, : block.width]
        action = self.tangent(block, factors, scale) @ steps.reshape(len(steps), -1, 1)
        np.add.at(block.residual[:, : block.width], self.nodes, action.reshape(steps.shape))

    def states(self, block: FrameBlock, factors: FloatArray) -> FloatArray:
        """(n, 12) force, moment, position and angular velocity of each wrench, inertial axes."""
        out = np.empty((len(self.xi), 12))
        points, twists = self.motion(block)
        line_force_states(points, twists, self._wrenches.memory, factors, out)
        return out


def by_kind(
    forces: Sequence[LineForce], node_body: IntArray, block: FrameBlock
) -> list[LineForces]:
    """Wrenches grouped by the number of nodes and the interpolation of their elements."""
    groups: dict[tuple[int, int], list[LineForce]] = {}
    for force in forces:
        groups.setdefault((len(force.place.nodes), force.place.element), []).append(force)
    return [LineForces(groups[k], node_body, block) for k in sorted(groups)]
