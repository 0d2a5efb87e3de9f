# SPDX-License-Identifier: LGPL-3.0-or-later
"""Atomic replacement of files, and errors raised together by all ranks."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mpi4py import MPI


def replace_file(path: Path, chunks: Iterable[bytes | memoryview]) -> None:
    """Write a file under a temporary name beside it, then rename it into place.

    Args:
        path: File to create or replace; its folder must exist.
        chunks: Contents, written one after the other.

    Raises:
        OSError: If the file cannot be written; the previous version is left untouched.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        with temporary.open("wb") as stream:
            for chunk in chunks:
                stream.write(chunk)
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
    errors = [e for e in comm.allgather(error) if e is not None]
    if errors:
        raise errors[0]
