# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interface nodes, to which joints are attached, and their exchange between ranks.

Every rank has a table of the nodes of its joints. Owned nodes are copied from their block,
the others are received in one message per neighbouring rank: 24 numbers a node (frame, increment,
velocity). Joints between bodies on two ranks are evaluated on both, so that no force, gradient or
multiplier ever has to be sent.
"""

from collections.abc import Callable, Sequence
from functools import cached_property

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.constraints.rows.data import InterfaceNodes
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.nodes.frame_kernels import Nodes
from flexfem.kernels.compiled import kernel
from flexfem.kernels.records import Memory, unpack
from flexfem.kernels.sequence import Call, Step, sequence
from flexfem.la.exchange import exchange
from flexfem.layout.node_key import NodeKey
from flexfem.lie._blocks import copy_entries

__all__ = ["Interface", "NodeDirectory"]

_WIDTH = 24
#: of the messages between neighbours
_TAG = 1202


class NodeDirectory:
    """Owner, local and global number of nodes, the same owner and number on all ranks.

    Attributes:
        owner: rank that owns each node.
        number: global node number within the block.
        local: local index in the block where owned, else -1.
    """

    def __init__(
        self, comm: MPI.Intracomm, keys: Sequence[NodeKey], blocks: Sequence[FrameBlock | None]
    ) -> None:
        """Look up every key on every rank (collective; the same keys on all ranks)."""
        count = len(keys)
        self.local: IntArray = np.full(count, -1, dtype=np.int64)
        found = np.full((2, count), -1, dtype=np.int64)
        table = np.array(keys, dtype=np.int64).reshape(-1, 2)
        for kind, block in enumerate(blocks):
            if block is None:
                continue
            of_kind = np.flatnonzero(table[:, 0] == kind)
            local = block.owned_index(table[of_kind, 1])
            mine = of_kind[local >= 0]
            self.local[mine] = local[local >= 0]
            found[0, mine], found[1, mine] = comm.rank, block.offset + self.local[mine]
        comm.Allreduce(MPI.IN_PLACE, found, op=MPI.MAX)
        self.owner: IntArray = found[0]
        self.number: IntArray = found[1]


@kernel
def _collect(memory: Memory, local: IntArray, interface_nodes: IntArray, out: Memory) -> None:
    """Copy the state of nodes of ``Nodes`` to their ``interface_nodes`` in ``InterfaceNodes``."""
    nodes, face = unpack(Nodes, memory), unpack(InterfaceNodes, out)
    for k in range(local.size):
        node, interface_node = local[k], interface_nodes[k]
        copy_entries(nodes.frames[node], face.frames[interface_node])
        copy_entries(nodes.increment[node], face.increments[interface_node])
        copy_entries(nodes.velocity[node], face.velocities[interface_node])


@kernel
def _pack(memory: Memory, interface_nodes: IntArray, out: FloatArray) -> None:
    """Write the state of nodes of ``InterfaceNodes`` into the rows (k, 24) of a message."""
    face = unpack(InterfaceNodes, memory)
    for k in range(interface_nodes.size):
        node = interface_nodes[k]
        copy_entries(face.frames[node], out[k, :12])
        copy_entries(face.increments[node], out[k, 12:18])
        copy_entries(face.velocities[node], out[k, 18:])


@kernel
def _unpack(memory: Memory, interface_nodes: IntArray, received: FloatArray) -> None:
    """Read what :func:`_pack` has written."""
    face = unpack(InterfaceNodes, memory)
    for k in range(interface_nodes.size):
        node = interface_nodes[k]
        copy_entries(received[k, :12], face.frames[node])
        copy_entries(received[k, 12:18], face.increments[node])
        copy_entries(received[k, 18:], face.velocities[node])


class Interface:
    """Table of the nodes of this rank's joints.

    Attributes:
        keys: node of each interface node.
        frames, increments, velocities: current values, (n, 12), (n, 6), (n, 6).
        steps: (n, 6) Newton steps after ``update_steps``.
        inertial: (n,) True where translations are integrated in inertial axes; width: (n,)
            unknowns.
        interface_nodes: these arrays in the format of the compiled loops.
        kind: kind of block of each interface node; local: local node where owned, else -1.
        number: global number of the node within its block.
        held: (n, 6) True for fixed unknowns, on which joints have no effect.
    """

    def __init__(
        self,
        comm: MPI.Intracomm,
        blocks: Sequence[FrameBlock | None],
        keys: Sequence[NodeKey],
        needed_by: Sequence[Sequence[int]],
    ) -> None:
        """Set up the exchange (collective).

        Args:
            comm: communicator.
            blocks: the blocks by kind.
            keys: all nodes with joints, the same on every rank.
            needed_by: ranks that need each of them.
        """
        directory = NodeDirectory(comm, keys, blocks)
        mine = [k for k, ranks in enumerate(needed_by) if comm.rank in ranks]
        self.comm = comm
        self.keys = [keys[k] for k in mine]
        self.node_of = {key: node for node, key in enumerate(self.keys)}
        self.kind: IntArray = np.array([key[0] for key in self.keys], dtype=np.int64)
        self.local: IntArray = directory.local[mine]
        self.number: IntArray = directory.number[mine]
        self.frames = np.zeros((len(mine), 12))
        self.increments = np.zeros((len(mine), 6))
        self.velocities = np.zeros((len(mine), 6))
        self.steps = np.zeros((len(mine), 6))
        inertial = [block is not None and block.inertial for block in blocks]
        self.inertial: BoolArray = np.array(
            [inertial[kind] for kind in self.kind.tolist()], dtype=np.bool_
        )
        self.interface_nodes = InterfaceNodes(
            frames=self.frames, increments=self.increments, velocities=self.velocities,
            inertial=self.inertial,
        )  # fmt: skip
        widths = [0 if block is None else block.width for block in blocks]
        self.width: IntArray = np.array(
            [widths[kind] for kind in self.kind.tolist()], dtype=np.int64
        )
        self._sources = [
            (block, self.local[nodes], nodes)
            for kind, block in enumerate(blocks)
            if block is not None
            for nodes in [np.flatnonzero((self.kind == kind) & (self.local >= 0))]
            if len(nodes)
        ]
        self._plan(directory, mine, needed_by)
        held = np.zeros((len(mine), 6))
        for block, local, nodes in self._sources:
            if block.dirichlet is not None:
                held[nodes, : block.width] = block.dirichlet[local]
        self._exchange(held)
        self.held: BoolArray = held > 0.0

    def _plan(
        self, directory: NodeDirectory, mine: Sequence[int], needed_by: Sequence[Sequence[int]]
    ) -> None:
        """Lists of nodes to send to and to receive from each neighbour, in the order of keys."""
        send: dict[int, list[int]] = {}
        receive: dict[int, list[int]] = {}
        for node, k in enumerate(mine):
            owner = int(directory.owner[k])
            if owner == self.comm.rank:
                for rank in needed_by[k]:
                    if rank != owner:
                        send.setdefault(rank, []).append(node)
            else:
                receive.setdefault(owner, []).append(node)
        self._send = _buffers(send)
        self._receive = _buffers(receive)

    def update(self) -> None:
        """Fetch frames, increments and velocities of all interface nodes (collective)."""
        self._update()

    @property
    def steps_of_update(self) -> list[Step]:
        """What :meth:`update` does, for sequences that contain it."""
        memory = self.interface_nodes.memory
        collect: list[Step] = [
            Call(_collect, block.nodes.memory, local, nodes, memory)
            for block, local, nodes in self._sources
        ]
        if not (self._send or self._receive):
            return collect
        # a reference to this object would outlive its run
        comm = self.comm
        received = [(rank, buffer) for rank, _, buffer in self._receive]
        sent = [(rank, buffer) for rank, _, buffer in self._send]
        return [
            *collect,
            *(Call(_pack, memory, nodes, buffer) for _, nodes, buffer in self._send),
            lambda: exchange(comm, received, sent, _TAG),
            *(Call(_unpack, memory, nodes, buffer) for _, nodes, buffer in self._receive),
        ]

    @cached_property
    def _update(self) -> Callable[[], None]:
        return sequence(self.steps_of_update)

    def update_steps(self) -> None:
        """Fetch the blocks' steps at all interface nodes (collective)."""
        for block, local, nodes in self._sources:
            self.steps[nodes] = block.step.take(local, axis=0)
        self._exchange(self.steps)

    def rigid_twists(self, twist: FloatArray) -> FloatArray:
        """Local twists (n, 6), see :meth:`FrameBlock.rigid_twists` (collective)."""
        found = np.zeros((len(self.keys), 6))
        for block, local, nodes in self._sources:
            found[nodes] = block.rigid_twists(twist)[local]
        self._exchange(found)
        return found

    def _exchange(self, table: FloatArray) -> None:
        """Send the rows of owned nodes in a table to the ranks that need them."""
        sent = [(rank, table[nodes]) for rank, nodes, _ in self._send]
        received = [(rank, np.empty_like(table[nodes])) for rank, nodes, _ in self._receive]
        exchange(self.comm, received, sent, _TAG)
        for (_, values), (_, nodes, _) in zip(received, self._receive, strict=True):
            table[nodes] = values


def _buffers(
    interface_nodes: dict[int, list[int]],
) -> list[tuple[int, npt.NDArray[np.int64], FloatArray]]:
    return [
        (rank, np.array(s, dtype=np.int64), np.empty((len(s), _WIDTH)))
        for rank, s in sorted(interface_nodes.items())
    ]
