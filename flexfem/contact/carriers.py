# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact points on this rank: positions, motion and the nodes to which they are fixed.

Arrays have one row for every point of the model; only those of points here or nearby are used. A
point belongs to the rank that owns its node, one between two others to that of the first. Points on
the ground are distributed.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.obstacles.carried import (
    Carried,
    add_carried,
    add_couples,
    add_over_cayley_step,
    add_over_step,
    add_turned,
    carried_into,
    compliances_into,
    moved_into,
    rates_into,
    spins_into,
    spread_means,
    turned_into,
    weigh_means,
)
from flexfem.contact.surfaces.collected import GROUND
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.nodes.halo import HaloExchange

__all__ = ["CarriedPoints", "Carriers", "NodeLoads", "Points"]


class Points(Protocol):
    """Serial data of points, those fixed to nodes first.

    Attributes:
        kind: kind of block of the node of each fixed point, ``GROUND`` for none, (n,).
        node: number of the node in its block, (n,).
        arms: positions in the axes of the nodes, m, (n, 3).
        held: fixed unknowns of the nodes, (n, 6).
        start: positions of all points at the start, m, (n + d, 3).
        parents, weights: fixed points that each of the others is a mean of, and their weights,
            (d, q).
        carried: number of points fixed to nodes.
    """

    @property
    def kind(self) -> IntArray: ...  # noqa: D102

    @property
    def node(self) -> IntArray: ...  # noqa: D102

    @property
    def arms(self) -> FloatArray: ...  # noqa: D102

    @property
    def held(self) -> BoolArray: ...  # noqa: D102

    @property
    def start(self) -> FloatArray: ...  # noqa: D102

    @property
    def parents(self) -> IntArray: ...  # noqa: D102

    @property
    def weights(self) -> FloatArray: ...  # noqa: D102

    @property
    def carried(self) -> int: ...  # noqa: D102


@dataclass
class CarriedPoints:
    """Points fixed to the nodes of one block on this rank.

    Attributes:
        block: the block.
        own: the points whose nodes this rank owns; ghosts: those of ghost nodes.
    """

    block: FrameBlock
    own: Carried
    ghosts: Carried

    @property
    def turns(self) -> bool:
        """True if the nodes have rotations."""
        return self.block.width == 6

    @property
    def rows(self) -> IntArray:
        """Rows (k,) of the points whose nodes this rank owns."""
        return self.own.rows

    @property
    def local(self) -> IntArray:
        """Nodes (k,) of these points."""
        return self.own.local

    @property
    def arms(self) -> FloatArray:
        """Arms (k, 3) of these points, m."""
        return self.own.arms

    @property
    def loads(self) -> FloatArray:
        """Forces (k, 3) on these at the last evaluation in the axes of the nodes, N."""
        return self.own.loads

    @cached_property
    def lengths(self) -> FloatArray:
        """Lengths (k,) of the arms, m."""
        return np.linalg.norm(self.arms, axis=1)

    @classmethod
    def of(cls, points: Points, kind: int, block: FrameBlock) -> "CarriedPoints":
        """Select the points of a kind."""
        rows = np.flatnonzero(points.kind == kind)
        rows = rows[np.isin(points.node[rows], block.node_ids)]
        local = block.local_index(points.node[rows]) if len(rows) else rows
        owned = local < block.owned

        def part(chosen: BoolArray) -> Carried:
            return Carried(
                turns=block.width == 6, rows=rows[chosen], local=local[chosen],
                arms=points.arms[rows[chosen]], loads=np.zeros((int(chosen.sum()), 3)),
            )  # fmt: skip

        return cls(block, part(owned), part(~owned))


@dataclass(frozen=True)
class NodeLoads:
    """Loads on nodes of one block.

    Attributes:
        entries: numbers of the forces that they are of, (e,).
        nodes: of the block, (e,).
        loads: in their axes, N and N m, (e, w).
    """

    entries: IntArray
    nodes: IntArray
    loads: FloatArray


class Carriers:
    """All points on this rank, and their exchange with other ranks.

    Attributes:
        serial: the points of the model.
        by_kind: those that each block carries.
        home: rank of every point, (n + d,).
        numbers: global number of each carrier in its block, (n,).
    """

    def __init__(
        self, comm: MPI.Intracomm, points: Points, blocks: Mapping[int, FrameBlock]
    ) -> None:
        """Exchange the owners of nodes (collective).

        Args:
            comm: communicator.
            points: the points of the model.
            blocks: blocks with points, by kind.
        """
        self._comm, self.serial = comm, points
        self.by_kind = {kind: CarriedPoints.of(points, kind, one) for kind, one in blocks.items()}
        known = np.full((2, points.carried), -1, dtype=np.int64)
        for one in self.by_kind.values():
            known[0, one.rows], known[1, one.rows] = comm.rank, one.block.offset + one.local
        comm.Allreduce(MPI.IN_PLACE, known, op=MPI.MAX)
        owner, self.numbers = known
        ground = np.flatnonzero(points.kind == GROUND)
        owner[ground] = np.arange(len(ground)) * comm.size // max(len(ground), 1)
        self.home: IntArray = np.concatenate([owner, owner[points.parents[:, 0]]])
        between = np.flatnonzero(self.home[points.carried :] == comm.rank)
        self._between = (
            points.parents[between], points.weights[between], points.carried + between
        )  # fmt: skip
        self._exchange: HaloExchange | None = None
        self.ask(np.zeros(0, np.int64))

    @property
    def here(self) -> IntArray:
        """Points of this rank."""
        return np.flatnonzero(self.home == self._comm.rank)

    def ask(self, nodes: IntArray) -> None:
        """Set up the exchange of some points of other ranks, each maybe often (collective)."""
        if self._comm.size > 1:
            wanted = np.zeros(len(self.home), dtype=np.bool_)
            wanted[nodes] = wanted[self._between[0]] = True
            self._exchange = HaloExchange(self._comm, self.home, np.flatnonzero(wanted))

    def bring(self, values: FloatArray) -> None:
        """Receive rows of ``values`` (n + d, k) from other ranks (collective)."""
        if self._exchange is not None:
            self._exchange.bring(values)

    def add_back(self, values: FloatArray) -> None:
        """Add rows of ``values`` (n + d, k) for other ranks to theirs (collective)."""
        if self._exchange is not None:
            self._exchange.add_back(values)

    def place(self, points: FloatArray, ghosts: bool = False) -> None:
        """Write the positions of the points here and nearby into (n + d, 3) (collective)."""
        for one in self.by_kind.values():
            nodes = one.block.nodes.memory
            carried_into(nodes, one.own.memory, points)
            if ghosts:
                carried_into(nodes, one.ghosts.memory, points)
        self.bring(points)
        weigh_means(*self._between, points)

    def move(self, steps: FloatArray) -> None:
        """Write the inertial steps of the points here and nearby (n + d, 3) (collective)."""
        for one in self.by_kind.values():
            moved_into(one.block.nodes.memory, one.own.memory, steps)
        self.bring(steps)
        weigh_means(*self._between, steps)

    def compliances(self, of_nodes: Mapping[int, FloatArray], out: FloatArray) -> None:
        """Write compliances (n + d, 9) of the fixed points here and nearby (collective).

        Args:
            of_nodes: by the kind of block, compliances (n_owned, k, w, w) of its nodes; the first
                ones are taken.
            out: 3 x 3 numbers of each point, m/N.
        """
        for kind, one in self.by_kind.items():
            own = np.ascontiguousarray(of_nodes[kind][:, 0])
            compliances = own.reshape(len(own), own.shape[1] * own.shape[2])
            compliances_into(one.block.nodes.memory, one.own.memory, compliances, out)
        self.bring(out)

    def loads_of(self, points: IntArray, forces: FloatArray) -> dict[int, NodeLoads]:
        """Loads on the nodes of this rank, by kind, of forces (k, 3) on fixed points (k,)."""
        found = {}
        for kind, one in self.by_kind.items():
            place = np.full(len(self.home), -1)
            place[one.rows] = np.arange(len(one.rows))
            entries = np.flatnonzero(place[points] >= 0)
            at = place[points[entries]]
            local = one.local[at]
            turns = one.block.frames[local, 3:].reshape(-1, 3, 3)
            loads = np.einsum("ea,eab->eb", forces[entries], turns)
            if one.turns:
                loads = np.concatenate([loads, np.cross(one.arms[at], loads)], axis=1)
            found[kind] = NodeLoads(entries, local, loads)
        return found

    def spin(self, spins: FloatArray) -> None:
        """Write the rotation vectors of the step of points here (n + d, 3); zero where unknown."""
        spins[:] = 0.0
        for one in self.by_kind.values():
            spins_into(one.block.nodes.memory, one.own.memory, spins)

    def turn(self, spins: FloatArray) -> None:
        """Write the changes of the spins of points here (n + d, 3) by the blocks' steps."""
        spins[:] = 0.0
        for one in self.by_kind.values():
            turned_into(one.block.nodes.memory, one.own.memory, spins)

    def rates(self, rates: FloatArray, spins: FloatArray) -> None:
        """Write velocities and angular velocities of points here, each (n + d, 3)."""
        rates[:] = spins[:] = 0.0
        for one in self.by_kind.values():
            rates_into(one.block.nodes.memory, one.own.memory, rates, spins)

    def share(self, values: FloatArray) -> None:
        """Complete values (n + d, 3) of points here: nearby, and of means (collective)."""
        self.bring(values)
        weigh_means(*self._between, values)

    def add_couples(self, kind: int, couples: FloatArray) -> None:
        """Add gathered couples (n + d, 3) over a step to a block's residual."""
        one = self.by_kind[kind]
        add_couples(one.block.nodes.memory, one.own.memory, couples)

    def gather(self, forces: FloatArray) -> None:
        """Add forces (n + d, 3) on all points to those of the nodes' owners (collective)."""
        spread_means(*self._between, forces)
        self.add_back(forces)

    def largest(self, values: FloatArray) -> FloatArray:
        """Largest values (n + d,) of all ranks at the points here, 0 elsewhere (collective)."""
        most = np.empty_like(values)
        self._comm.Allreduce(values, most, op=MPI.MAX)
        return np.where(self.home == self._comm.rank, most, 0.0)

    def add_loads(self, kind: int, forces: FloatArray, scale: float) -> None:
        """Add gathered forces (n + d, 3), which have been scaled, to a block's residual."""
        one = self.by_kind[kind]
        loads = one.loads
        add_carried(one.block.nodes.memory, one.own.memory, forces, loads)
        loads /= scale

    def add_over_step(self, kind: int, forces: FloatArray, scale: float, *, cayley: bool) -> None:
        """Add gathered forces (n + d, 3) over a step, which have been scaled, to a residual.

        ``cayley`` is True where nodes rotate by Cayley vectors.
        """
        one = self.by_kind[kind]
        add = add_over_cayley_step if cayley else add_over_step
        add(one.block.nodes.memory, one.own.memory, forces)
        one.own.loads /= scale

    def at_nodes(self, kind: int, stiffness: FloatArray) -> FloatArray:
        """Bounds (n_owned, 6) of rows of stiffness, N/m and N m, for that of points (n + d,)."""
        one = self.by_kind[kind]
        found, count = np.zeros((one.block.owned, 6)), one.block.owned
        k, arms = stiffness[one.rows], one.lengths
        k = k * (1.0 + arms)
        found[:, :3] = np.bincount(one.local, k, count)[:, np.newaxis]
        found[:, 3:] = np.bincount(one.local, k * arms, count)[:, np.newaxis]
        return found

    def add_forces(self, kind: int, forces: FloatArray) -> None:
        """Add gathered forces (n + d, 3) to a block's residual."""
        one = self.by_kind[kind]
        add_carried(one.block.nodes.memory, one.own.memory, forces, np.empty_like(one.loads))

    def add_changes(self, kind: int, forces: FloatArray, scale: float) -> None:
        """Add changes of gathered forces (n + d, 3) to a block's residual.

        The changes are scaled; that of the last evaluation's loads by the rotation of nodes is
        added.
        """
        self.add_forces(kind, forces)
        one = self.by_kind[kind]
        if one.turns:
            add_turned(one.block.nodes.memory, one.own.memory, scale)
