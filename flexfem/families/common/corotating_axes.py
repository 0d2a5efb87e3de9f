# SPDX-License-Identifier: LGPL-3.0-or-later
"""Corotating axes of the nodes of shells and solids, which rotate with the material around them."""

from collections.abc import Callable

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.nodes.ghosted_rows import GhostedRows
from flexfem.families.common.corotating_loops import turn_nodes

__all__ = ["CorotatingAxes"]


class CorotatingAxes:
    """Update of the axes of a block's nodes; axes of Dirichlet conditions are not rotated."""

    def __init__(self, block: FrameBlock) -> None:
        """Allocate the sums of rotations around the nodes (collective)."""
        self._sums = GhostedRows(block.comm, block.index_map, 9)
        self._fixed = np.zeros(len(block.frames), dtype=np.bool_)
        if block.dirichlet is not None:
            self._fixed = block.dirichlet[:, :3].any(axis=1)

    def turn(self, block: FrameBlock, add_rotations: Callable[[FloatArray], None]) -> None:
        """Rotate the axes of the accepted and the trial state (collective).

        Args:
            block: the nodes.
            add_rotations: adds the weighted rotations since the start of this rank's elements
                around each node to sums (n, 9).
        """
        sums = self._sums.values
        sums[:] = 0.0
        add_rotations(sums)
        if block.has_ghosts:
            self._sums.add_ghosts()
            self._sums.spread()
        turn_nodes(
            sums, block.start_frames, self._fixed, block.frames0, block.frames,
            block.velocity, block.acceleration,
        )  # fmt: skip
