# SPDX-License-Identifier: LGPL-3.0-or-later
"""Halo exchange of nodal rows: values of other ranks' nodes brought here, sums brought back."""

from collections.abc import Iterator, Mapping

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.la.exchange import exchange

__all__ = ["HaloExchange", "send_numbers"]

_TAG = 1204


def send_numbers(comm: MPI.Intracomm, lists: list[IntArray]) -> list[IntArray]:
    """Send one list of numbers to each rank; returns those received (collective)."""
    counts = np.array([len(one) for one in lists], dtype=np.int64)
    received = np.empty_like(counts)
    comm.Alltoall(counts, received)
    out = np.empty(int(received.sum()), dtype=np.int64)
    ends, starts = np.cumsum(received), np.cumsum(received) - received
    comm.Alltoallv(
        [np.concatenate([np.empty(0, np.int64), *lists]).astype(np.int64), counts],
        [out, received],
    )
    return [out[a:b] for a, b in zip(starts, ends, strict=True)]


class HaloExchange:
    """Moves rows of arrays that have one row for every node of the model.

    Only rows of nodes that this rank owns or has requested are valid.

    Attributes:
        foreign: nodes of other ranks that are brought here.
    """

    def __init__(self, comm: MPI.Intracomm, owner: IntArray, wanted: IntArray) -> None:
        """Ask the owners (collective).

        Args:
            comm: communicator.
            owner: (n,) rank of every node.
            wanted: nodes whose rows are needed here.
        """
        self._comm = comm
        ranks = owner[wanted]
        foreign = [wanted[ranks == r] if r != comm.rank else wanted[:0] for r in range(comm.size)]
        self.foreign: IntArray = np.concatenate(foreign)
        self._asked = _neighbours(foreign)
        self._given = _neighbours(send_numbers(comm, foreign))

    def bring(self, values: FloatArray) -> None:
        """Bring the rows of ``values`` (n, k) of the foreign nodes from their owners."""
        for nodes, rows in self._exchanged(values, self._given, self._asked):
            values[nodes] = rows

    def add_back(self, values: FloatArray) -> None:
        """Add the rows of ``values`` (n, k) of the foreign nodes to those of their owners."""
        # nodes are different within a message: ``np.add.at`` takes 1.6 times as long
        for nodes, rows in self._exchanged(values, self._asked, self._given):
            values[nodes] += rows

    def _exchanged(
        self, values: FloatArray, given: Mapping[int, IntArray], asked: Mapping[int, IntArray]
    ) -> Iterator[tuple[IntArray, FloatArray]]:
        """Send rows of nodes to some neighbours; nodes and rows of messages from the others."""
        width = values.shape[1]
        rows = {rank: np.empty((len(nodes), width)) for rank, nodes in asked.items()}
        sent = [(rank, values[nodes]) for rank, nodes in given.items()]
        exchange(self._comm, rows.items(), sent, _TAG)
        return zip(asked.values(), rows.values(), strict=True)


def _neighbours(lists: list[IntArray]) -> dict[int, IntArray]:
    """Those of the lists of all ranks that are not empty, by rank."""
    return {rank: nodes for rank, nodes in enumerate(lists) if len(nodes)}
