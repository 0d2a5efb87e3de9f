# SPDX-License-Identifier: LGPL-3.0-or-later
"""Exchange of arrays with some other ranks, by one message to each."""

from collections.abc import Iterable

from mpi4py import MPI

from flexfem._types import FloatArray

__all__ = ["exchange"]


def exchange(
    comm: MPI.Intracomm, received: Iterable[tuple[int, FloatArray]],
    sent: Iterable[tuple[int, FloatArray]], tag: int,
) -> None:  # fmt: skip
    """Send arrays and receive others; returns when all are there.

    Args:
        comm: communicator.
        received: ranks, and contiguous arrays for what comes from them, of the size that they send.
        sent: ranks, and contiguous arrays for them.
        tag: of the messages.
    """
    requests = [comm.Irecv(values, source=rank, tag=tag) for rank, values in received]
    requests += [comm.Isend(values, dest=rank, tag=tag) for rank, values in sent]
    MPI.Request.Waitall(requests)
