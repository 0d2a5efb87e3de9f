# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces inside the elements of a part."""

from typing import Protocol

from flexfem._types import FloatArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock

__all__ = ["InnerForces"]


class InnerForces(Protocol):
    """Forces of loads inside elements with equally many nodes, all of them on this rank.

    Attributes:
        nodes: (n, k) local nodes of the elements.
        body: number of the body of each row of :meth:`states`.
    """

    nodes: IntArray
    body: IntArray

    def add_residual(self, block: FrameBlock, factors: FloatArray, scale: float) -> None:
        """Subtract ``scale`` times the forces from the block's residual."""
        ...

    def tangent(self, block: FrameBlock, factors: FloatArray, scale: float) -> FloatArray:
        """(n, k width, k width) derivative of the residual along local twists."""
        ...

    def add_action(self, block: FrameBlock, factors: FloatArray, scale: float) -> None:
        """Add ``scale`` times the tangent applied to the block's step to its residual."""
        ...

    def states(self, block: FrameBlock, factors: FloatArray) -> FloatArray:
        """Force, moment, position and angular velocity of each, inertial axes, (n, 12).

        A force may have several rows, whose work is that of the force.
        """
        ...
