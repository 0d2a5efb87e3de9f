# SPDX-License-Identifier: LGPL-3.0-or-later
"""Masses and forces at the nodes of one block, as arrays for the compiled loops."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.bodies.node_forces import Wrenches, add_forces, force_states, force_tangent
from flexfem.bodies.node_inertia import add_inertia, add_mass_motion, inertia_tangent
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.nodes.frame_kernels import Nodes
from flexfem.kernels.sequence import Call, Number

__all__ = ["Force", "NodeForces", "NodeMasses", "Wrench", "wrenches"]


class NodeMasses:
    """Inertia matrices fixed to nodes: rigid bodies, point masses.

    Attributes:
        nodes: (k,) local node of each; matrices: (k, 6, 6) about the node in its axes.
    """

    def __init__(self, nodes: Sequence[int], matrices: Sequence[FloatArray]) -> None:
        """Store the masses."""
        self.nodes: IntArray = np.array(nodes, dtype=np.int64)
        self.matrices = np.array(matrices, dtype=np.float64).reshape(-1, 6, 6)

    def add_residual(self, block: FrameBlock, gravity: FloatArray, scale: float) -> None:
        """Add ``scale`` times inertia and gravity forces to the block's residual."""
        nodes = self._state(block)
        add_inertia(self.nodes, self.matrices, nodes.memory, gravity, scale)

    def residual_call(self, block: FrameBlock, gravity: FloatArray, scale: Number) -> Call:
        """Call of the loop of :meth:`add_residual`."""
        return Call(add_inertia, self.nodes, self.matrices, block.nodes.memory, gravity, scale)

    def tangent(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        local: bool = False,
    ) -> FloatArray:  # fmt: skip
        """(k, 6, 6) of ``scale (k K + C dv + M dw)``, ``shifts`` = (dv/dn, dw/dn, k).

        With ``local`` the derivative K is that at fixed local velocities and accelerations.
        """
        out, nodes = np.empty_like(self.matrices), self._state(block)
        inertia_tangent(
            self.nodes, self.matrices, nodes.memory, gravity, block.inertial and not local,
            shifts, scale, out,
        )  # fmt: skip
        return out

    def _state(self, block: FrameBlock) -> Nodes:
        """State of the nodes, without turns of axes that nodes with positions alone do not have.

        Where a model rotates steadily, their velocities hold its spin as well.
        """
        if block.width == 6 or not block.velocity[self.nodes, 3:].any():
            return block.nodes
        velocity = np.pad(block.velocity[:, :3], ((0, 0), (0, 3)))
        return Nodes(**(vars(block.nodes) | {"velocity": velocity}))

    def tangent_call(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: Number,
        out: FloatArray,
    ) -> Call:  # fmt: skip
        """Call of the loop of :meth:`tangent`, which writes to ``out`` (k, 6, 6)."""
        return Call(
            inertia_tangent, self.nodes, self.matrices, block.nodes.memory, gravity, block.inertial,
            shifts, scale, out,
        )  # fmt: skip

    def add_motion(self, block: FrameBlock, chosen: BoolArray, motion: FloatArray) -> None:
        """Add energy and momenta of the chosen (k,) masses, see ``flexfem.core.nodes.motion``."""
        add_mass_motion(self.nodes, self.matrices, chosen, block.frames, block.velocity, motion)


class Wrench(Protocol):
    """Force and moment at a point, see :class:`Wrenches`."""

    @property
    def offset(self) -> FloatArray:
        """(12,) frame of the point relative to its carrier."""

    @property
    def force(self) -> FloatArray:
        """(3,) N."""

    @property
    def moment(self) -> FloatArray:
        """(3,) N m."""

    @property
    def follower(self) -> bool:
        """True if both are in the axes of the point."""

    @property
    def load(self) -> int:
        """Number of the load whose amplitude scales them."""


def wrenches(given: Sequence[Wrench]) -> Wrenches:
    """Record of wrenches for compiled loops."""
    return Wrenches(
        offsets=np.array([w.offset for w in given], dtype=np.float64).reshape(-1, 12),
        forces=np.array([w.force for w in given], dtype=np.float64).reshape(-1, 3),
        moments=np.array([w.moment for w in given], dtype=np.float64).reshape(-1, 3),
        follower=np.array([w.follower for w in given], dtype=np.bool_),
        load=np.array([w.load for w in given], dtype=np.int64),
    )


@dataclass(frozen=True)
class Force:
    """One wrench at a node: components inertial (dead) or in the axes of ``offset`` (follower)."""

    node: int
    offset: FloatArray
    force: FloatArray
    moment: FloatArray
    follower: bool
    load: int


class NodeForces:
    """Wrenches at nodes, each with the number of the load whose amplitude scales it.

    Attributes:
        nodes: (k,) local node of each.
        wrenches: wrenches at points fixed to the nodes, in the format of the compiled loops.
    """

    def __init__(self, forces: Sequence[Force]) -> None:
        """Store the wrenches."""
        self.nodes: IntArray = np.array([f.node for f in forces], dtype=np.int64)
        self.wrenches = wrenches(forces)

    def add_residual(self, block: FrameBlock, factors: FloatArray, scale: float) -> None:
        """Subtract ``scale`` times the forces from the block's residual."""
        add_forces(self.nodes, self.wrenches.memory, block.nodes.memory, factors, scale)

    def residual_call(self, block: FrameBlock, factors: FloatArray, scale: Number) -> Call:
        """Call of the loop of :meth:`add_residual`."""
        return Call(
            add_forces, self.nodes, self.wrenches.memory, block.nodes.memory, factors, scale
        )

    def tangent(self, block: FrameBlock, factors: FloatArray, scale: float) -> FloatArray:
        """(k, 6, 6) derivative of the residual along local twists."""
        out = np.empty((len(self.nodes), 6, 6))
        force_tangent(self.nodes, self.wrenches.memory, block.nodes.memory, factors, scale, out)
        return out

    def states(self, block: FrameBlock, factors: FloatArray) -> FloatArray:
        """(k, 12) force, moment, position and angular velocity of each wrench, inertial axes."""
        out = np.empty((len(self.nodes), 12))
        force_states(self.nodes, self.wrenches.memory, block.nodes.memory, factors, out)
        return out
