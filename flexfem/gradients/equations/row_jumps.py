# SPDX-License-Identifier: LGPL-3.0-or-later
"""Changes ``G u`` of rows along jumps u of rates, and how they change with positions."""

from __future__ import annotations

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.gradients.equations.step_tangent import (
    BlockVectors,
    add_row_forces,
    collected,
    put_steps,
    row_changes,
)
from flexfem.system.system import System

__all__ = ["RowJumps"]


class RowJumps:
    """Derivatives of ``G u`` at the trial state by local twists, with jumps that do not turn."""

    def __init__(self, system: System, jumps: BlockVectors) -> None:
        """Compute them (collective).

        Args:
            system: the system, whose rows are evaluated.
            jumps: u of each block, (n_owned, w), in local axes.
        """
        self._system, self._jumps = system, jumps
        face = system.interface
        put_steps(system, jumps)
        face.velocities[:] = face.steps
        slopes = np.tile([0.0, 1.0], (system.constraints.size, 1))
        self._bends = system.constraints.rate_changes(slopes, 0.0, held=True)
        face.update()

    def changes(self, moves: BlockVectors, jumps: BlockVectors | None = None) -> FloatArray:
        """Changes (r,) by local twists, and by changes of the jumps (collective)."""
        system = self._system
        turned = [
            _turned(part.block, own, q)
            for part, own, q in zip(system.parts, self._jumps, moves, strict=True)
        ]
        if jumps is not None:
            turned = [a + b for a, b in zip(turned, jumps, strict=True)]
        put_steps(system, turned)
        found = system.constraints.changes(system.interface.steps)
        put_steps(system, moves)
        return found + row_changes(system, self._bends)

    def transposed(self, factors: FloatArray) -> tuple[BlockVectors, BlockVectors]:
        """Factors (r,) of rows times derivatives by local twists, and by jumps (collective)."""
        system = self._system
        nothing = [np.zeros_like(own) for own in self._jumps]
        put_steps(system, nothing)
        system.add_constraint_forces(factors)
        forces = collected(system)
        put_steps(system, nothing)
        add_row_forces(system, self._bends, factors)
        moments = [
            turned + _moments(part.block, own, jump)
            for part, turned, own, jump in zip(
                system.parts, collected(system), forces, self._jumps, strict=True
            )
        ]
        return moments, forces


def _turned(block: FrameBlock, jump: FloatArray, twists: FloatArray) -> FloatArray:
    """Changes of jumps (n, w) in local axes as nodes turn by twists (n, w)."""
    found = np.zeros_like(jump)
    if block.inertial and block.width == 6:
        found[:, :3] = np.cross(jump[:, :3], twists[:, 3:])
    return found


def _moments(block: FrameBlock, forces: FloatArray, jump: FloatArray) -> FloatArray:
    """Factors of twists in forces (n, w) times the changes of :func:`_turned`."""
    found = np.zeros_like(jump)
    if block.inertial and block.width == 6:
        found[:, 3:] = np.cross(forces[:, :3], jump[:, :3])
    return found
