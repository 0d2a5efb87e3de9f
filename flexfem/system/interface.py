# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interface nodes, at which joints attach, and their exchange between ranks.

Every rank keeps a table of the nodes its joints touch. Owned nodes are copied from their block,
the others arrive by one message per neighbouring rank: 24 numbers a node (frame, increment,
velocity). Joints between bodies on two ranks are evaluated on both, so that no force, gradient or
multiplier ever has to be sent.
"""

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.frame_block import FrameBlock
from flexfem.core.frame_kernels import Nodes
from flexfem.lie._blocks import copy_entries
from flexfem.lie.compiled import kernel
from flexfem.lie.records import Memory, unpack
from flexfem.system.node_key import NodeKey
from flexfem.system.row_data import Slots

__all__ = ["Interface", "NodeDirectory"]

_WIDTH = 24
#: of the messages between neighbours
_TAG = 1202


class NodeDirectory:
    """Owner, local and global number of nodes that several ranks must agree on.

    Attributes:
        owner: rank that owns each node.
        number: global node number within the block.
        local: local index in the block where owned, else -1.
    """

    def __init__(
        self, comm: MPI.Intracomm, keys: Sequence[NodeKey], blocks: Sequence[FrameBlock | None]
    ) -> None:
        """Look up every key on every rank (collective; keys must agree between ranks)."""
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
def _collect(memory: Memory, local: IntArray, slots: IntArray, out: Memory) -> None:
    """Copy the state of nodes of ``Nodes`` to their ``slots`` in ``Slots``."""
    nodes, face = unpack(Nodes, memory), unpack(Slots, out)
    for k in range(local.size):
        node, slot = local[k], slots[k]
        copy_entries(nodes.frames[node], face.frames[slot])
        copy_entries(nodes.increment[node], face.increments[slot])
        copy_entries(nodes.velocity[node], face.velocities[slot])


class Interface:
    """Table of the nodes that this rank's joints touch.

    Attributes:
        keys: node of each slot.
        frames, increments, velocities: current values, (n, 12), (n, 6), (n, 6).
        steps: (n, 6) Newton steps after ``update_steps``.
        inertial: (n,) translations are integrated in inertial axes; width: (n,) unknowns.
        slots: these arrays, as compiled loops take them.
        kind: kind of block of each slot; local: local node where owned, else -1.
        number: global number of the node within its block.
        held: (n, 6) unknowns that stay as they are, on which joints have no effect.
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
            keys: all nodes that carry joints, the same on every rank.
            needed_by: ranks that need each of them.
        """
        directory = NodeDirectory(comm, keys, blocks)
        mine = [k for k, ranks in enumerate(needed_by) if comm.rank in ranks]
        self.comm = comm
        self.keys = [keys[k] for k in mine]
        self.slot_of = {key: slot for slot, key in enumerate(self.keys)}
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
        self.slots = Slots(
            frames=self.frames, increments=self.increments, velocities=self.velocities,
            inertial=self.inertial,
        )  # fmt: skip
        widths = [0 if block is None else block.width for block in blocks]
        self.width: IntArray = np.array(
            [widths[kind] for kind in self.kind.tolist()], dtype=np.int64
        )
        self._sources = [
            (block, self.local[slots], slots)
            for kind, block in enumerate(blocks)
            if block is not None
            for slots in [np.flatnonzero((self.kind == kind) & (self.local >= 0))]
            if len(slots)
        ]
        self._plan(directory, mine, needed_by)
        held = np.zeros((len(mine), 6))
        for block, local, slots in self._sources:
            if block.held is not None:
                held[slots, : block.width] = block.held[local]
        self._exchange((held,))
        self.held: BoolArray = held > 0.0

    def _plan(
        self, directory: NodeDirectory, mine: Sequence[int], needed_by: Sequence[Sequence[int]]
    ) -> None:
        """Lists of slots to send to and to receive from each neighbour, in the order of keys."""
        send: dict[int, list[int]] = {}
        receive: dict[int, list[int]] = {}
        for slot, k in enumerate(mine):
            owner = int(directory.owner[k])
            if owner == self.comm.rank:
                for rank in needed_by[k]:
                    if rank != owner:
                        send.setdefault(rank, []).append(slot)
            else:
                receive.setdefault(owner, []).append(slot)
        self._send = _buffers(send)
        self._receive = _buffers(receive)

    def update(self) -> None:
        """Fetch frames, increments and velocities of all slots (collective)."""
        for block, local, slots in self._sources:
            _collect(block.nodes.memory, local, slots, self.slots.memory)
        self._exchange((self.frames, self.increments, self.velocities))

    def update_steps(self) -> None:
        """Fetch the blocks' steps at all slots (collective)."""
        for block, local, slots in self._sources:
            self.steps[slots] = block.step[local]
        self._exchange((self.steps,))

    def _exchange(self, tables: Sequence[FloatArray]) -> None:
        """Send owned slots of the tables to the ranks that need them."""
        if not (self._send or self._receive):
            return
        width = sum(table.shape[1] for table in tables)
        requests = [
            self.comm.Irecv(buffer[: len(slots) * width], source=rank, tag=_TAG)
            for rank, slots, buffer in self._receive
        ]
        for rank, slots, buffer in self._send:
            data = buffer[: len(slots) * width]
            np.concatenate(
                [table[slots] for table in tables], axis=1, out=data.reshape(len(slots), width)
            )
            requests.append(self.comm.Isend(data, dest=rank, tag=_TAG))
        MPI.Request.Waitall(requests)
        for _, slots, buffer in self._receive:
            data, at = buffer[: len(slots) * width].reshape(len(slots), width), 0
            for table in tables:
                table[slots] = data[:, at : at + table.shape[1]]
                at += table.shape[1]


def _buffers(
    slots: dict[int, list[int]],
) -> list[tuple[int, npt.NDArray[np.int64], FloatArray]]:
    return [
        (rank, np.array(s, dtype=np.int64), np.empty(len(s) * _WIDTH))
        for rank, s in sorted(slots.items())
    ]
