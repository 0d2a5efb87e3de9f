# SPDX-License-Identifier: LGPL-3.0-or-later
"""Halo exchange of nodal rows: values of other ranks' nodes brought here, sums brought back."""

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray, IntArray

__all__ = ["HaloExchange", "send_numbers"]


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
        self._given = send_numbers(comm, foreign)
        self.foreign: IntArray = np.concatenate(foreign)
        self._mine: IntArray = np.concatenate(self._given)
        self._counts = [
            np.array([len(one) for one in lists], dtype=np.int64)
            for lists in (self._given, foreign)
        ]

    def bring(self, values: FloatArray) -> None:
        """Bring the rows of ``values`` (n, k) of the foreign nodes from their owners."""
        width = values.shape[1]
        here = np.empty((len(self.foreign), width))
        given, asked = self._counts
        self._comm.Alltoallv([values[self._mine], width * given], [here, width * asked])
        values[self.foreign] = here

    def add_back(self, values: FloatArray) -> None:
        """Add the rows of ``values`` (n, k) of the foreign nodes to those of their owners."""
        width = values.shape[1]
        here = np.empty((len(self._mine), width))
        given, asked = self._counts
        self._comm.Alltoallv([values[self.foreign], width * asked], [here, width * given])
        first = 0
        for rows in self._given:  # each of them once: ``np.add.at`` takes 1.6 times as long
            values[rows] += here[first : first + len(rows)]
            first += len(rows)
