# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strain rates of director triangles, each with nodes of its own."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.shell_director.triangles import UNKNOWNS, DirectorTriangles
from flexfem.families.shell_rotation_free.rate_changes import own_nodes, rate_tangents
from flexfem.lie import so3

__all__ = ["DirectorRates", "rate_changes"]


class DirectorRates:
    """See :class:`flexfem.families.shell_rotation_free.rate_changes.CellRates`.

    Unknowns are translations along the axes of nodes, which they do not rotate, and rotations of
    directors. Rates at fixed ones are inertial velocities and local angular velocities.

    Attributes:
        unknowns: number of unknowns of a triangle.
        sizes: (m, k) m and 1.
    """

    def __init__(self, triangles: DirectorTriangles, block: FrameBlock) -> None:
        """Take the trial state of a block."""
        nodes = triangles.nodes
        self._own = triangles.renumbered(own_nodes(nodes))
        self._frames, self._velocities = block.frames[nodes], block.velocity[nodes].reshape(-1, 6)
        self.unknowns = 3 * len(UNKNOWNS)
        self.sizes = np.ones((len(nodes), self.unknowns))
        self.sizes[:, :18] = np.sqrt(triangles.areas)[:, np.newaxis]

    def moved(self, unknown: int, step: FloatArray) -> FloatArray:
        """See :class:`flexfem.families.shell_rotation_free.rate_changes.CellRates`."""
        frames = self._frames.copy()
        (node, first), axis = UNKNOWNS[unknown // 3], unknown % 3
        turns = frames[:, node, 3:].reshape(-1, 3, 3)
        if first == 0:
            frames[:, node, :3] += step[:, np.newaxis] * turns[:, :, axis]
        else:
            more = so3.exp(step[:, np.newaxis] * np.eye(3)[axis])
            frames[:, node, 3:] = (turns @ more).reshape(-1, 9)
        return self._own.rates(frames.reshape(-1, 12), self._velocities)

    def along(self, unknown: int) -> FloatArray:
        """See :class:`flexfem.families.shell_rotation_free.rate_changes.CellRates`."""
        twists = np.zeros((*self._frames.shape[:2], 6))
        node, first = UNKNOWNS[unknown // 3]
        twists[:, node, first + unknown % 3] = 1.0
        return self._own.rates(self._frames.reshape(-1, 12), twists.reshape(-1, 6))


def rate_changes(
    triangles: DirectorTriangles, block: FrameBlock, starts: FloatArray, *, local: bool
) -> tuple[FloatArray, FloatArray]:
    """Derivatives (m, 27, 27) of forces through strain rates, N/m and so on.

    Args:
        triangles: the triangles.
        block: their nodes.
        starts: strains at the start, less the effect of strain rates.
        local: True for fixed local velocities, which rotations of their nodes turn.

    Returns:
        Those by local twists at fixed rates, and what those by rates of increments have more than
        those by local velocities, times the rate of a rotation by a local twist.
    """
    slow, fast = (
        triangles.response(block.frames, starts, triangles.rates(block.frames, block.velocity), own)
        for own in (0.0, 1.0)
    )
    stiffness = np.zeros((len(triangles.areas), 24, 24))
    for k in range(3):
        at = np.s_[6 * k : 6 * k + 6]
        damped = triangles.damping[:, None, None] * slow.planes[:, k]
        stiffness[:, at, at] = damped + fast.planes[:, k] - slow.planes[:, k]
    stiffness[:, 18:, 18:] = triangles.damping[:, None, None] * triangles.shears
    by_places, along = rate_tangents(DirectorRates(triangles, block), stiffness)
    if local:
        by_places[:, :, 18:] += along.transpose(0, 2, 1) @ (
            stiffness @ _turned(triangles, block, along)
        )
    turns = so3.inverse_tangent(block.increment[triangles.nodes[:, 6:], 3:]) - np.eye(3)
    spins = np.zeros_like(along)
    for k in range(3):
        at = np.s_[18 + 3 * k : 21 + 3 * k]
        spins[:, :, at] = along[:, :, at] @ turns[:, k]
    by_rates: FloatArray = along.transpose(0, 2, 1) @ (stiffness @ spins)
    return by_places, by_rates


def _turned(triangles: DirectorTriangles, block: FrameBlock, along: FloatArray) -> FloatArray:
    """Strain rates (m, 24, 9) by velocities that turn with rotations of the three directors.

    Args:
        triangles: the triangles.
        block: their nodes.
        along: (m, 24, 27) strain rates by rates of all unknowns.
    """
    found, nodes = np.zeros((*along.shape[:2], 9)), triangles.nodes
    for k in range(3):
        turns = -so3.skew(block.velocity[nodes[:, 6 + k], :3])
        for j in range(6):
            own = (nodes[:, j] == nodes[:, 6 + k])[:, np.newaxis, np.newaxis] * turns
            found[:, :, 3 * k : 3 * k + 3] += along[:, :, 3 * j : 3 * j + 3] @ own
    return found
