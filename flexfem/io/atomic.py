# SPDX-License-Identifier: LGPL-3.0-or-later
"""Atomic replacement of files, and errors of all ranks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexfem._files import replace_file

if TYPE_CHECKING:
    from mpi4py import MPI

__all__ = ["first_error", "raise_together", "replace_file"]


def raise_together(comm: MPI.Comm, error: Exception | None) -> None:
    """Raise the first rank's error on every rank, so that no rank waits for one that has left.

    Collective; also a barrier.

    Args:
        comm: Communicator.
        error: This rank's error, or None.
    """
    found = first_error(comm, error)
    if found is not None:
        raise found


def first_error(comm: MPI.Comm, error: Exception | None) -> Exception | None:
    """The error of the first rank that has one, None without errors.

    Collective, also a barrier. Errors are sent only where there are some: otherwise ranks exchange
    one number, and not as many objects as there are ranks.

    Args:
        comm: Communicator.
        error: This rank's error, or None.
    """
    if comm.size == 1:
        return error
    count = np.array([error is not None], dtype=np.int64)
    comm.Allreduce(count.copy(), count)
    every = comm.allgather(error) if count[0] else []
    return next((found for found in every if found is not None), None)
