# SPDX-License-Identifier: LGPL-3.0-or-later
"""Atomic replacement of files, and values and errors of all ranks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexfem._files import replace_file

if TYPE_CHECKING:
    from mpi4py import MPI

__all__ = ["gathered", "raise_together", "replace_file"]


def raise_together(comm: MPI.Comm, error: Exception | None) -> None:
    """Raise the first rank's error on every rank, so that no rank waits for one that has left.

    Collective; also a barrier.

    Args:
        comm: Communicator.
        error: This rank's error, or None.
    """
    gathered(comm, None, error)


def gathered[Value](comm: MPI.Comm, mine: Value, error: Exception | None = None) -> list[Value]:
    """Values of all ranks on every rank; collective, and also a barrier.

    Args:
        comm: Communicator.
        mine: This rank's value.
        error: This rank's error, or None.

    Raises:
        Exception: The first rank's error, on every rank.
    """
    every = comm.allgather((mine, error)) if comm.size > 1 else [(mine, error)]
    for _, found in every:
        if found is not None:
            raise found
    return [value for value, _ in every]
