# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solid elements of a rank: residual, matrix and measures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mpi4py import MPI

import numpy as np
from scipy.sparse import csr_array

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.nodes.motion import add_motion_of_points
from flexfem.core.state import Numbering
from flexfem.families.common.corotating_axes import CorotatingAxes
from flexfem.families.common.corotating_loops import (
    add_blocks,
    add_to_nodes,
    inertial_into,
    positions_into,
    turn_blocks,
)
from flexfem.families.common.node_pairs import NodePairs
from flexfem.families.solid.cells import Motion, SolidCells
from flexfem.families.solid.steps import SolidSteps
from flexfem.layout.elements import StresslessElements, one_width
from flexfem.layout.tangent_request import EXACT, Strains, TangentRequest

__all__ = ["SolidElements"]


class _Axes(CorotatingAxes):
    """Axes of nodes; those of plane bodies, fixed along z alone, rotate about it."""

    def __init__(self, block: FrameBlock, plane: BoolArray) -> None:
        """Find the nodes whose axes stay, those with Dirichlet conditions (collective)."""
        super().__init__(block)
        if block.dirichlet is not None:
            across = block.dirichlet[:, 2] & ~plane
            self._fixed = block.dirichlet[:, :2].any(axis=1) | across


class SolidElements(StresslessElements):
    """All solid elements of this rank.

    Attributes:
        groups: the cells.
        body: (m,) number of the body of each cell; size: (m,) volume at the start, m^3.
        pairs: of nodes that cells couple; mass: (n, n) mass matrix of one direction, kg.

    The methods of :class:`flexfem.layout.elements.ElementFamily` are described there.
    """

    law_owner: str | None = None
    chained = False
    thin = False
    stressed = False
    multigrid = True
    bulk_over_shear = 0.0

    def __init__(
        self, groups: Sequence[SolidCells], block: FrameBlock, plane: BoolArray, cells: int
    ) -> None:
        """Prepare pairs of nodes and masses (collective).

        Args:
            groups: the cells that this rank owns.
            block: their nodes, at the start.
            plane: (n,) True for nodes of plane bodies.
            cells: number of cells of the family on all ranks.
        """
        self.groups = list(groups)
        self.body = np.concatenate([np.empty(0, np.int64), *(g.body for g in groups)])
        self.size = self._of_groups([g.size for g in groups])
        self.viscous = any(g.kernels.damped for g in groups)
        self.pairs = NodePairs(len(block.frames), [g.nodes for g in groups])
        count = len(block.frames)
        self._points, self._vectors = np.empty((count, 3)), np.empty((count, 3))
        names = "points", "velocity", "step", "rate", "start", "before", "last"
        arrays = [self._points, *(np.zeros((count, 3)) for _ in names[1:])]
        self._motion = Motion(**dict(zip(names, arrays, strict=True)))
        self.mass = self._masses(np.ones(len(self.body), dtype=np.bool_))
        self._axes = _Axes(block, plane)
        self.remembering = len(self._histories) > 0
        self.rate_dependent = any(g.kernels.rate_dependent for g in self._histories)
        self._settled = np.full((count, 3), np.nan)
        self._time = self._accepted = 0.0
        self._name, self._cells = f"{block.name}_history", cells
        self._steps: SolidSteps | None = None

    def _masses(self, chosen: BoolArray) -> csr_array:
        """Mass matrix of one direction of this rank's nodes with the chosen cells (m,), kg."""
        pairs, first = self.pairs, 0
        values = np.zeros(len(pairs.rows))
        for group, index in zip(self.groups, pairs.index, strict=True):
            own = chosen[first : first + len(group.nodes)]
            first += len(group.nodes)
            values += np.bincount(index[own].ravel(), group.mass[own].ravel(), len(values))
        count = len(self._points)
        return csr_array((values, (pairs.rows, pairs.columns)), shape=(count, count))

    def node_masses(self) -> FloatArray:
        """See :class:`flexfem.layout.elements.MultigridElements`."""
        found: FloatArray = self.mass.diagonal()
        return found

    @property
    def support(self) -> IntArray:
        """See :class:`flexfem.layout.elements.ResultantElements`."""
        return one_width([g.nodes for g in self.groups])

    @property
    def couplings(self) -> list[tuple[IndexArray, IndexArray]]:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return self.pairs.couplings

    def _settle(self, frames: FloatArray, continued: Strains | None = None) -> None:
        """Take positions, and what follows from them in the cells, or is continued."""
        positions_into(frames, self._points)
        if continued is None and np.array_equal(self._points, self._settled):
            return
        for k, group in enumerate(self.groups):
            group.settle(self._motion.memory, None if continued is None else continued[k])
        self._settled[:] = self._points if continued is None else np.nan

    def _move(self, block: FrameBlock, continued: Strains | None = None) -> None:
        """Take positions and velocities of the trial state."""
        self._settle(block.frames, continued)
        if self.viscous:
            inertial_into(block.frames, block.velocity, self._motion.velocity)

    def add_residual(
        self, block: FrameBlock, gravity: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> None:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        self._move(block, request.strains)
        inertial_into(block.frames, block.acceleration, self._vectors)
        total: FloatArray = self.mass @ (self._vectors - gravity)
        for group in self.groups:
            group.add_forces(self._motion.memory, total)
            if request.strains is not None:
                self._motion.step[:] = self._points
                group.add_stiffening(self._motion.memory, 1.0, total)
        add_to_nodes(block.frames, total, scale, block.residual)

    def values(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> FloatArray:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        pairs = self.pairs
        blocks = np.zeros((len(pairs.rows), 3, 3))
        self._move(block, request.strains)
        if shifts[2] != 0.0 or self.viscous:
            for group, index in zip(self.groups, pairs.index, strict=True):
                factors = scale * float(shifts[2]), scale * float(shifts[0])
                for first in group.chunks():
                    own = group.matrices(self._motion.memory, first, *factors)
                    add_blocks(own, index, first, blocks)
        masses = scale * float(shifts[1]) * self.mass.data
        for a in range(3):
            blocks[:, a, a] += masses
        turn_blocks(pairs.rows, pairs.columns, block.frames, blocks)
        return blocks.ravel()

    def add_action(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> None:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        self._move(block, request.strains)
        inertial_into(block.frames, block.step, self._vectors)
        total: FloatArray = float(shifts[1]) * (self.mass @ self._vectors)
        if shifts[2] != 0.0 or self.viscous:
            self._motion.step[:] = float(shifts[2]) * self._vectors
            self._motion.rate[:] = float(shifts[0]) * self._vectors
            for group in self.groups:
                group.add_action(self._motion.memory, 1.0, total)
        add_to_nodes(block.frames, total, scale, block.residual)

    def continued_strains(self, frames: FloatArray, steps: FloatArray) -> Strains | None:
        """See :class:`flexfem.layout.elements.ElementFamily`: dilatation and stresses of the cells.

        What rotations and changes of volume of second order add to them is large in slender solids,
        and in those that are nearly incompressible.
        """
        self._settle(frames)
        inertial_into(frames, steps, self._motion.step)
        return [group.continued(self._motion.memory) for group in self.groups]

    def set_time(self, t: float) -> None:
        """Set the time to which internal variables advance, and parameters that change, s."""
        self._time = t
        for group in self.groups:
            if group.set_time(t, t - self._accepted):
                self._settled[:] = np.nan

    def powers(self, block: FrameBlock, gravity: FloatArray) -> FloatArray:
        """Powers (m,) of parameters that change with time, W."""
        self._settle(block.frames)
        return self._of_groups([g.powers(self._time, self._motion.memory) for g in self.groups])

    def lost(self) -> FloatArray:
        """Energies (m,) that internal variables have dissipated, J."""
        return self._of_groups([group.lost for group in self.groups])

    def history(self) -> dict[str, tuple[Numbering, FloatArray]]:
        """Internal variables of each group that has some, with the numbers of its cells."""
        return {
            f"{self._name}_{k}": (
                Numbering(g.number, np.ones(len(g.number), dtype=np.bool_), self._cells),
                g.data("history"),
            )
            for k, g in enumerate(self._histories)
        }

    def advance(self, block: FrameBlock) -> None:
        """See :class:`flexfem.layout.elements.HistoryElements`."""
        self._settle(block.frames)
        for group in self._histories:
            group.advance(self._motion.memory)
            self._settled[:] = np.nan
        self._accepted = self._time

    def history_derivatives(self) -> SolidHistories | None:
        """See :class:`flexfem.layout.elements.HistoryElements` (collective the first time).

        Internal variables that change the thickness or the dilatation of a cell have none.
        """
        for group in self._histories:
            kind, split = group.kind, group.kernels.forms.law.split
            if kind.plane == "stress" or (kind.dilatation >= 0 and not split):
                return None
            _ = group.kernels.remembering
        return SolidHistories(self._histories, self._motion)

    def restore_history(self, history: Mapping[str, FloatArray]) -> None:
        """Accept internal variables at the time set last."""
        self._accepted = self._time
        for k, group in enumerate(self._histories):
            group.data("history")[:] = history[f"{self._name}_{k}"]
            group.set_time(self._time, 0.0)
        self._settled[:] = np.nan

    @property
    def _histories(self) -> list[SolidCells]:
        return [group for group in self.groups if len(group.kernels.initial)]

    def accept(self, block: FrameBlock) -> None:
        """Rotate the axes of the nodes with the cells around them (collective)."""
        self.advance(block)
        self._axes.turn(block, self._add_rotations)

    def _add_rotations(self, sums: FloatArray) -> None:
        """Add the deformation gradients of the cells, times their volumes, to nodes (n, 9)."""
        for group in self.groups:
            turned = group.size[:, np.newaxis] * group.deformations(self._points).reshape(-1, 9)
            for k in range(group.nodes.shape[1]):
                np.add.at(sums, group.nodes[:, k], turned)

    def resultants(
        self, frames: FloatArray, chosen: IntArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Mean Green strains and Cauchy stresses (m, 6) of cells, of all or the ``chosen`` ones."""
        self._settle(frames)
        means = [
            g.means(g.fields(self._motion.memory), np.arange(len(g.nodes))) for g in self.groups
        ]
        every = np.concatenate([np.empty((0, 13)), *means])
        every = every if chosen is None else every[chosen]
        return every[:, 6:12], every[:, :6]

    def stretches(self, frames: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        positions_into(frames, self._points)
        return self._of_groups([g.stretches(self._points) for g in self.groups])

    def energies(self, frames: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        self._settle(frames)
        return self._of_groups([g.energies(self._motion.memory) for g in self.groups])

    def fields(self, block: FrameBlock) -> list[FloatArray]:
        """Fields (m, j, 13) of each group at the trial state; see ``forms.FIELDS``."""
        self._move(block)
        return [group.fields(self._motion.memory) for group in self.groups]

    def viscosity(self, block: FrameBlock) -> tuple[FloatArray, FloatArray]:
        """Viscous forces on the nodes of the cells, N, and their positions, three numbers of six.

        The mean of the ones times the change of the others is what a step takes: the mean power of
        both ends would count velocities that change sign.
        """
        self._move(block)
        forces, places = [np.empty((0, 3))], [np.empty((0, 3))]
        for group in self._damped:
            forces.append(group.resistance(self._motion.memory))
            places.append(self._points[group.nodes].reshape(-1, 3))
        both = [np.pad(np.concatenate(found), ((0, 0), (0, 3))) for found in (forces, places)]
        return both[0], both[1]

    def step_forces(self, comm: MPI.Intracomm, count: int, dissipates: bool) -> SolidSteps:
        """See :class:`flexfem.layout.elements.SteppedElements`."""
        self._steps = SolidSteps(comm, self.groups, self.pairs, self.mass, dissipates)
        return self._steps

    def losses(self, before: FloatArray, after: FloatArray, h: float) -> FloatArray:
        """See :class:`flexfem.layout.elements.SteppedElements`."""
        assert self._steps is not None  # the steps' forces have been made
        return self._of_groups(self._steps.losses(before, after, h))

    @property
    def viscous_at(self) -> tuple[IntArray, FloatArray]:
        """Cell of each row of :meth:`viscosity`, and ones: forces are those of whole cells."""
        firsts = np.cumsum([0, *(len(g.nodes) for g in self.groups)])
        cells = [
            np.repeat(first + np.arange(len(g.nodes)), g.nodes.shape[1])
            for first, g in zip(firsts[:-1], self.groups, strict=True)
            if g.kernels.damped
        ]
        rows = np.concatenate([np.empty(0, np.int64), *cells]).astype(np.int64)
        return rows, np.ones(len(rows))

    @property
    def _damped(self) -> list[SolidCells]:
        return [group for group in self.groups if group.kernels.damped]

    def _of_groups(self, values: Sequence[FloatArray]) -> FloatArray:
        return np.concatenate([np.empty(0), *values])

    def add_motion(self, block: FrameBlock, chosen: BoolArray, motion: FloatArray) -> None:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        positions_into(block.frames, self._points)
        inertial_into(block.frames, block.velocity, self._vectors)
        mass = self.mass if chosen.all() else self._masses(chosen)
        add_motion_of_points(mass, self._points, self._vectors, motion)


class SolidHistories:
    """See :class:`flexfem.layout.elements.HistoryDerivatives`; of settled cells."""

    def __init__(self, groups: Sequence[SolidCells], motion: Motion) -> None:
        """Store the cells with internal variables, and the motion of their nodes."""
        self._groups, self._motion = groups, motion

    def ended(self) -> FloatArray:
        """See :class:`flexfem.layout.elements.HistoryDerivatives`."""
        found = [group.advanced(self._motion.memory) for group in self._groups]
        return _in_row(found)

    def ahead(self, block: FrameBlock, change: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.elements.HistoryDerivatives`."""
        inertial_into(block.frames, block.step, self._motion.step)
        memory = self._motion.memory
        return _in_row([group.advanced_along(memory, own) for group, own in self._split(change)])

    def add_ends(self, block: FrameBlock, factors: FloatArray) -> None:
        """See :class:`flexfem.layout.elements.HistoryDerivatives`."""
        total = np.zeros_like(self._motion.points)
        for group, own in self._split(factors):
            group.add_advanced_factors(self._motion.memory, own, total)
        add_to_nodes(block.frames, total, 1.0, block.residual)

    def before(self, factors: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.elements.HistoryDerivatives`."""
        memory = self._motion.memory
        return _in_row([group.advanced_factors(memory, own) for group, own in self._split(factors)])

    def add_forces(self, block: FrameBlock, change: FloatArray, scale: float) -> None:
        """See :class:`flexfem.layout.elements.HistoryDerivatives`."""
        total = np.zeros_like(self._motion.points)
        for group, own in self._split(change):
            group.add_forces_of_history(self._motion.memory, own, total)
        add_to_nodes(block.frames, total, scale, block.residual)

    def powers(self, block: FrameBlock) -> FloatArray:
        """See :class:`flexfem.layout.elements.HistoryDerivatives`."""
        inertial_into(block.frames, block.step, self._motion.step)
        return _in_row([group.powers_of_history(self._motion.memory) for group in self._groups])

    def _split(self, numbers: FloatArray) -> list[tuple[SolidCells, FloatArray]]:
        """Cells with their numbers (m, z q)."""
        found, at = [], 0
        for group in self._groups:
            shape = group.data("history").shape
            size = shape[0] * shape[1]
            found.append((group, numbers[at : at + size].reshape(shape)))
            at += size
        return found


def _in_row(parts: Sequence[FloatArray]) -> FloatArray:
    return np.concatenate([np.zeros(0), *(own.ravel() for own in parts)])
