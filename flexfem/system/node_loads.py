# SPDX-License-Identifier: LGPL-3.0-or-later
"""Masses and forces at the nodes of one block, as arrays for the compiled loops."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.bodies.node_forces import add_forces, force_states, force_tangent
from flexfem.bodies.node_inertia import add_inertia, add_mass_motion, inertia_tangent
from flexfem.core.frame_block import FrameBlock

__all__ = ["Force", "NodeForces", "NodeMasses"]


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
        add_inertia(
            self.nodes, self.matrices, gravity, block.frames, block.velocity, block.acceleration,
            scale, block.residual,
        )  # fmt: skip

    def tangent(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        local: bool = False,
    ) -> FloatArray:  # fmt: skip
        """(k, 6, 6) of ``scale (k K + C dv + M dw)``, ``shifts`` = (dv/dn, dw/dn, k).

        With ``local`` the derivative K is that at fixed local velocities and accelerations.
        """
        out = np.empty_like(self.matrices)
        inertia_tangent(
            self.nodes, self.matrices, gravity, block.inertial and not local, block.frames,
            block.velocity, block.acceleration, block.increment, shifts, scale, out,
        )  # fmt: skip
        return out

    def add_motion(self, block: FrameBlock, chosen: BoolArray, motion: FloatArray) -> None:
        """Add energy and momenta of the chosen (k,) masses, see ``flexfem.core.motion``."""
        add_mass_motion(self.nodes, self.matrices, chosen, block.frames, block.velocity, motion)


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
    """Wrenches at nodes, each with the number of the load whose amplitude scales it."""

    def __init__(self, forces: Sequence[Force]) -> None:
        """Store the wrenches."""
        self.nodes: IntArray = np.array([f.node for f in forces], dtype=np.int64)
        self._offsets = np.array([f.offset for f in forces], dtype=np.float64).reshape(-1, 12)
        self._forces = np.array([f.force for f in forces], dtype=np.float64).reshape(-1, 3)
        self._moments = np.array([f.moment for f in forces], dtype=np.float64).reshape(-1, 3)
        self._follower = np.array([f.follower for f in forces], dtype=np.bool_)
        self._load = np.array([f.load for f in forces], dtype=np.int64)

    def add_residual(self, block: FrameBlock, factors: FloatArray, scale: float) -> None:
        """Subtract ``scale`` times the forces from the block's residual."""
        add_forces(
            self.nodes, self._offsets, self._forces, self._moments, self._follower, self._load,
            factors, block.frames, scale, block.residual,
        )  # fmt: skip

    def data(
        self,
    ) -> tuple[IntArray, FloatArray, FloatArray, FloatArray, BoolArray, IntArray]:
        """Nodes, offsets, forces, moments, whether they follow, and loads, as loops expect."""
        return (
            self.nodes, self._offsets, self._forces, self._moments, self._follower, self._load
        )  # fmt: skip

    def tangent(self, block: FrameBlock, factors: FloatArray, scale: float) -> FloatArray:
        """(k, 6, 6) derivative of the residual along local twists."""
        out = np.empty((len(self.nodes), 6, 6))
        force_tangent(
            self.nodes, self._offsets, self._forces, self._moments, self._follower, self._load,
            factors, block.frames, scale, out,
        )  # fmt: skip
        return out

    def states(self, block: FrameBlock, factors: FloatArray) -> FloatArray:
        """(k, 12) force, moment, place and angular velocity of each wrench, inertial axes."""
        out = np.empty((len(self.nodes), 12))
        force_states(
            self.nodes, self._offsets, self._forces, self._moments, self._follower, self._load,
            factors, block.frames, block.velocity, out,
        )  # fmt: skip
        return out
