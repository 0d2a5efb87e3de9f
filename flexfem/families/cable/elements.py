# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cables with mass of a rank: inertia and weight on nodes at their guides."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._faults import FAILURES, noted
from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.runs import starts
from flexfem.families.cable.inertia import (
    Cables,
    Motion,
    add_flow_motion,
    add_forces,
    tangent_columns,
)
from flexfem.families.common.corotating_loops import add_to_nodes, inertial_into, positions_into
from flexfem.layout.elements import StresslessElements
from flexfem.layout.tangent_request import EXACT, TangentRequest

__all__ = ["CableMasses", "HeavyCable"]

#: Mass of every node in matrices, as a part of the cable's. A point on a straight cable moves
#: without any inertia along it, and so does one on the axis of a sheave: matrices of cables alone
#: would be singular. Residuals are without it; it changes frequencies by half of this.
_LITTLE = 1e-9


@dataclass(frozen=True)
class HeavyCable:
    """A cable with mass.

    Attributes:
        owner: it in messages.
        number: in its family.
        nodes: (m,) local nodes: of its guides, then points on the axes of its sheaves.
        radii: (g,) of its guides, m, zero of points.
        lowest: (g,) angles (rad) from which ranges of a full turn have those around sheaves.
        density: kg/m of unstretched cable.
        rest: rest length, m, with its first two rates, (3,), at a time, s.
        winch: function of the user's by which it changes; None if it is constant.
    """

    owner: str
    number: int
    nodes: IntArray
    radii: FloatArray
    lowest: FloatArray
    density: float
    rest: Callable[[float], FloatArray]
    winch: Callable[..., object] | None

    @property
    def tips(self) -> IntArray:
        """(g,) nodes on the axes of its guides, -1 for points."""
        found = np.full(len(self.radii), -1, dtype=np.int64)
        found[self.radii > 0.0] = self.nodes[len(self.radii) :]
        return found


class CableMasses(StresslessElements):
    """Inertia and weight of all cables with mass of this rank; their stretch is that of their rows.

    Attributes:
        body: (c,) number of each cable in its family.

    The methods of :class:`flexfem.layout.elements.ElementFamily` are described there.
    """

    law_owner: str | None = None
    chained = False
    thin = False
    stressed = False
    viscous = False

    def __init__(self, cables: Sequence[HeavyCable], nodes: int) -> None:
        """Collect the cables of this rank, with so many nodes."""
        self._cables = list(cables)
        self.body = np.array([cable.number for cable in cables], dtype=np.int64)
        self._nodes = [cable.nodes.astype(np.int32) for cable in cables]
        points, velocity, acceleration, self._room = np.zeros((4, nodes, 3))
        self._motion = Motion(points=points, velocity=velocity, acceleration=acceleration)
        none, nothing = np.empty(0, dtype=np.int64), np.empty(0)
        self._own = Cables(
            start=starts([len(cable.radii) for cable in cables]),
            centre=np.concatenate([none, *(c.nodes[: len(c.radii)] for c in cables)]),
            tip=np.concatenate([none, *(cable.tips for cable in cables)]),
            radius=np.concatenate([nothing, *(cable.radii for cable in cables)]),
            lowest=np.concatenate([nothing, *(cable.lowest for cable in cables)]),
            density=np.array([cable.density for cable in cables]),
            rest=np.zeros((len(cables), 3)),
        )
        self._powers = np.zeros(len(cables))
        self._driven = [c for c, cable in enumerate(cables) if cable.winch is not None]
        for c in range(len(cables)):
            self._set_rest(c, 0.0)

    def set_time(self, t: float) -> None:
        """Set the rest lengths to those of a time, s."""
        for c in self._driven:
            self._set_rest(c, t)

    def _set_rest(self, c: int, t: float) -> None:
        """Set the rest length of a cable, not a number where its function fails."""
        cable = self._cables[c]
        try:
            self._own.rest[c] = cable.rest(t)
        except FAILURES as error:
            noted(cable.owner, cable.winch or cable.rest, error)
            self._own.rest[c] = np.nan

    @property
    def couplings(self) -> list[tuple[IndexArray, IndexArray]]:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return [(own[np.newaxis], own[np.newaxis]) for own in self._nodes]

    def add_residual(
        self, block: FrameBlock, gravity: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> None:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        self._read(block)
        total = np.zeros_like(self._motion.points)
        add_forces(self._own.memory, self._motion.memory, gravity, scale, total, self._powers)
        add_to_nodes(block.frames, total, 1.0, block.residual)

    def powers(self, block: FrameBlock, gravity: FloatArray) -> FloatArray:
        """(c,) what winches add to the energy besides the work of the stretch of each cable, W.

        That is the energy of the material that comes in, and the work against inertia and weight
        along the cable.
        """
        self._read(block)
        total = np.zeros_like(self._motion.points)
        add_forces(self._own.memory, self._motion.memory, gravity, 1.0, total, self._powers)
        return self._powers.copy()

    def values(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> FloatArray:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        self._read(block)
        matrices = [scale * self._matrix(c, gravity, shifts) for c in range(len(self._cables))]
        return np.concatenate([np.empty(0), *(matrix.ravel() for matrix in matrices)])

    def add_action(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> None:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        self._read(block)
        steps, total = np.empty_like(self._motion.points), np.zeros_like(self._motion.points)
        inertial_into(block.frames, block.step, steps)
        for c, own in enumerate(self._nodes):
            force = self._matrix(c, gravity, shifts) @ steps[own].ravel()
            total[own] += force.reshape(-1, 3)
        add_to_nodes(block.frames, total, scale, block.residual)

    def _matrix(self, c: int, gravity: FloatArray, shifts: FloatArray) -> FloatArray:
        """Matrix of a cable (3 m, 3 m), see ``values``."""
        nodes = self._nodes[c].astype(np.int64)
        matrix: FloatArray = np.empty((3 * len(nodes), 3 * len(nodes)))
        tangent_columns(
            self._own.memory, self._motion.memory, c, nodes, gravity, shifts, self._room, matrix
        )
        mass = self._own.density[c] * self._own.rest[c, 0]
        matrix += _LITTLE * mass * shifts[1] * np.eye(len(matrix))
        return matrix

    def _read(self, block: FrameBlock) -> None:
        """Read the motion of the nodes."""
        positions_into(block.frames, self._motion.points)
        inertial_into(block.frames, block.velocity, self._motion.velocity)
        inertial_into(block.frames, block.acceleration, self._motion.acceleration)

    def accept(self, block: FrameBlock) -> None:
        """See :class:`flexfem.layout.elements.ElementFamily`."""

    def resultants(
        self, frames: FloatArray, chosen: IntArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """See :class:`flexfem.layout.elements.ElementFamily`; the tension is that of the rows.

        Raises:
            NotImplementedError: always.
        """
        raise NotImplementedError("the mass of a cable has no stress resultants")

    def stretches(self, frames: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return np.ones(len(self.body))

    def energies(self, frames: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.elements.ElementFamily`; rows have the energy of stretch."""
        return np.zeros(len(self.body))

    def add_motion(self, block: FrameBlock, chosen: BoolArray, motion: FloatArray) -> None:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        self._read(block)
        for c in np.flatnonzero(chosen):
            add_flow_motion(self._own.memory, self._motion.memory, int(c), motion)
