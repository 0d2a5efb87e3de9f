# SPDX-License-Identifier: LGPL-3.0-or-later
"""Atomic replacement of files, and errors raised together by all ranks."""

from __future__ import annotations

from collections.abc import Buffer, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mpi4py import MPI


def replace_file(path: Path, chunks: Iterable[Buffer]) -> None:
    """Write a file under a temporary name beside it, then rename it into place.

    Args:
        path: File to create or replace; its folder must exist.
        chunks: Contents, one after the other.

    Raises:
        OSError: If the file cannot be written; the previous version is left untouched.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        with temporary.open("wb") as stream:
            stream.write(b"".join(chunks))  # one call of the system, which costs more than a copy
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


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
