# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tables of words and numbers as CSV files."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexfem.io.atomic import raise_together, replace_file

if TYPE_CHECKING:
    from mpi4py import MPI

__all__ = ["write_table"]


def write_table(
    path: Path, rows: Sequence[Mapping[str, Any]], comm: MPI.Comm | None = None
) -> None:
    """Write rows with the same columns, replacing an earlier file as a whole (collective).

    Args:
        path: The file; its folder is created if missing.
        rows: Values by column, in the order of the columns; at least one row.
        comm: Communicator of which only rank 0 writes; None for one process.

    Raises:
        ValueError: On all ranks, if there are no rows or they have different columns.
        OSError: On all ranks, if the file cannot be written.
    """
    if not rows or any(list(row) != list(rows[0]) for row in rows):
        raise ValueError(f"table '{path}': there must be rows, all with the same columns")
    error: Exception | None = None
    if comm is None or comm.rank == 0:
        text = io.StringIO()
        writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(path, [text.getvalue().encode()])
        except OSError as exc:
            error = exc
    if comm is not None:
        raise_together(comm, error)
    elif error is not None:
        raise error
