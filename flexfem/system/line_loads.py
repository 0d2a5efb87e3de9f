# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces at places inside NURBS elements, as arrays for the compiled loops."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.bodies.line_forces import (
    add_line_forces,
    line_force_states,
    line_force_tangent,
)
from flexfem.core.frame_block import FrameBlock
from flexfem.system.element_places import ElementPlaces

__all__ = ["LineForce", "LineForces", "by_degree"]


@dataclass(frozen=True)
class LineForce:
    """One wrench at a place: components inertial (dead) or in the axes of ``offset`` (follower)."""

    nodes: IntArray
    shape: FloatArray
    xi: float
    offset: FloatArray
    force: FloatArray
    moment: FloatArray
    follower: bool
    load: int


class LineForces(ElementPlaces):
    """Wrenches at places in elements of one degree, with the loads whose amplitudes scale them.

    Attributes:
        body: (n,) number of the beam of each.
    """

    def __init__(self, forces: Sequence[LineForce], node_body: IntArray) -> None:
        """Store the wrenches, at least one; ``node_body`` gives the beams of all nodes."""
        super().__init__(
            np.array([f.nodes for f in forces], dtype=np.int64),
            np.array([f.shape for f in forces]),
            np.array([f.xi for f in forces]),
        )
        self.body: IntArray = node_body[self.nodes[:, 0]]
        self._wrenches: tuple[FloatArray, FloatArray, FloatArray, BoolArray, IntArray] = (
            np.array([f.offset for f in forces]),
            np.array([f.force for f in forces]),
            np.array([f.moment for f in forces]),
            np.array([f.follower for f in forces], dtype=np.bool_),
            np.array([f.load for f in forces], dtype=np.int64),
        )

    def add_residual(self, block: FrameBlock, factors: FloatArray, scale: float) -> None:
        """Subtract ``scale`` times the forces from the block's residual."""
        add_line_forces(
            self.nodes, self.shape, self.xi, *self._wrenches, factors, block.frames, scale,
            block.residual,
        )  # fmt: skip

    def tangent(self, block: FrameBlock, factors: FloatArray, scale: float) -> FloatArray:
        """(n, 6k, 6k) derivative of the residual along local twists."""
        size = 6 * self.nodes.shape[1]
        out = np.empty((len(self.xi), size, size))
        line_force_tangent(
            self.nodes, self.shape, self.xi, *self._wrenches, factors, block.frames, scale, out
        )
        return out

    def add_action(self, block: FrameBlock, factors: FloatArray, scale: float) -> None:
        """Add ``scale`` times the tangent applied to the block's step to its residual."""
        steps = block.step[self.nodes].reshape(len(self.xi), -1, 1)
        action = self.tangent(block, factors, scale) @ steps
        np.add.at(block.residual, self.nodes, action.reshape(*self.nodes.shape, 6))

    def states(self, block: FrameBlock, factors: FloatArray) -> FloatArray:
        """(n, 12) force, moment, place and angular velocity of each wrench, inertial axes."""
        out = np.empty((len(self.xi), 12))
        points, twists = self.motion(block)
        line_force_states(points, twists, *self._wrenches, factors, out)
        return out


def by_degree(forces: Sequence[LineForce], node_body: IntArray) -> list[LineForces]:
    """Wrenches grouped by the number of nodes of their elements."""
    counts = sorted({len(force.nodes) for force in forces})
    return [LineForces([f for f in forces if len(f.nodes) == k], node_body) for k in counts]
