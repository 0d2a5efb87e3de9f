# SPDX-License-Identifier: LGPL-3.0-or-later
"""The history of a result folder, in whichever format: opened for a run, found for readers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexfem._checks import InputError
from flexfem.io.atomic import raise_together, replace_file
from flexfem.io.tables.compressed_history import CompressedHistoryWriter, compressed_blocks
from flexfem.io.tables.history import HistoryWriter, read_history

if TYPE_CHECKING:
    from mpi4py import MPI

__all__ = ["FILES", "history_file", "open_history"]

#: Names of the file by format.
FILES = {"csv": "history.csv", "hdf5": "history.h5"}


def history_file(folder: Path) -> Path | None:
    """The history in a result folder, the newer one if there are two; None without any."""
    there = [path for name in FILES.values() if (path := Path(folder) / name).exists()]
    return max(there, key=lambda path: path.stat().st_mtime_ns, default=None)


def open_history(
    folder: Path, format: str, columns: Sequence[str], comm: MPI.Comm, resume: float | None
) -> HistoryWriter | CompressedHistoryWriter:
    """Open the history of a run; collective.

    Args:
        folder: Result folder.
        format: One of :data:`FILES`.
        columns: Names of the columns after ``t``.
        comm: Communicator.
        resume: Keep the rows of an earlier run up to this time (s), whatever their format; None
            starts a new table.

    Raises:
        InputError: The earlier table has other columns, or cannot be read.
        OSError: The file cannot be written.
    """
    path, names = folder / FILES[format], ("t", *columns)
    earlier = None
    if comm.rank == 0 and resume is not None:
        earlier = history_file(folder)
    if format == "hdf5":
        kept = None
        if earlier is not None and resume is not None:
            kept = partial(_rows_until, earlier, names, resume)
        return CompressedHistoryWriter(path, columns, comm, kept=kept)
    error: Exception | None = None
    if earlier is not None and earlier != path and resume is not None:
        try:
            _write_text(path, names, _rows_until(earlier, names, resume))
        except (OSError, ValueError) as exc:
            error = exc
    raise_together(comm, error)
    return HistoryWriter(path, columns, comm, resume=resume)


def _write_text(path: Path, names: Sequence[str], blocks: Iterator[NDArray[np.float64]]) -> None:
    """Write rows of a table of another format as CSV."""
    rows = [",".join(map(repr, row)) for block in blocks for row in block.tolist()]
    replace_file(path, [("\n".join([",".join(names), *rows]) + "\n").encode()])


def _rows_until(path: Path, names: Sequence[str], end: float) -> Iterator[NDArray[np.float64]]:
    """Rows of an earlier run up to a time (s), by blocks."""
    limit = end + 1e-12 * abs(end)
    if path.suffix == ".h5":
        for block in compressed_blocks(path, names):
            yield block[block[:, 0] <= limit]
        return
    try:
        table = read_history(path)
    except ValueError as error:
        raise InputError(f"history '{path}': cannot be continued, {error}") from error
    if [*table] != [*names]:
        raise InputError(f"history '{path}': cannot be continued, it has other columns")
    rows = np.column_stack([*table.values()])
    yield rows[rows[:, 0] <= limit]
