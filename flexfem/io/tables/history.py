# SPDX-License-Identifier: LGPL-3.0-or-later
"""History table: one row per step, first column the time; written as CSV, read in any format."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexfem._checks import InputError
from flexfem._files import read_text
from flexfem.io.atomic import raise_together, replace_file
from flexfem.io.tables.compressed_history import compressed_columns, read_compressed
from flexfem.io.tables.names import check_columns

if TYPE_CHECKING:
    from mpi4py import MPI


class FolderLostError(OSError):
    """The output folder was removed, or replaced, while a run wrote into it.

    Attributes:
        replaced: another run writes there now.
    """

    def __init__(self, folder: Path, replaced: bool) -> None:
        """Say so."""
        kept = (
            "it holds other results now, which are left as they are"
            if replaced
            else "the table, a checkpoint and the summary are rewritten, earlier fields are lost"
        )
        super().__init__(f"output folder '{folder}' was removed during the run, {kept}")
        self.folder, self.replaced = folder, replaced

    def __reduce__(self) -> tuple[type, tuple[Path, bool]]:
        """For other ranks."""
        return type(self), (self.folder, self.replaced)


class HistoryWriter:
    """Table ``t, <columns>`` in a CSV file; every row is on its way to disk when `write` returns.

    Numbers are written so that reading them gives the same floating-point values.

    Attributes:
        path, columns, comm: as given.
        kept: (n, 1 + columns) rows of an earlier run that are continued; rank 0.
    """

    def __init__(
        self,
        path: Path,
        columns: Sequence[str],
        comm: MPI.Comm,
        *,
        resume: float | None = None,
    ) -> None:
        """Open the table; collective.

        Args:
            path: The file; its folder is created if missing.
            columns: Names of the columns after ``t``.
            comm: Communicator; only rank 0 touches the file. Construction is collective.
            resume: Keep the rows of an earlier run up to this time (s); None starts a new table.

        Raises:
            ValueError: If names are unusable.
            InputError: If the table to be continued has other columns, or is no table of numbers.
            OSError: If the file cannot be written (on all ranks).
        """
        self.path, self.columns, self.comm = Path(path), tuple(columns), comm
        check_columns(self.columns)
        self.kept = np.zeros((0, 1 + len(self.columns)))
        self._stream: TextIO | None = None
        error: Exception | None = None
        if comm.rank == 0:
            try:
                self._open(resume)
            except (OSError, ValueError) as exc:
                error = exc
        raise_together(comm, error)

    def write(self, t: float, values: ArrayLike) -> None:
        """Append one row; rank 0 writes, the others do nothing.

        Args:
            t: Time in s.
            values: One number per column; ignored on ranks other than 0.
        """
        if self.comm.rank == 0:
            self.extend([np.append(float(t), np.array(values, dtype=np.float64))])

    def extend(self, rows: Sequence[NDArray[np.float64]]) -> None:
        """Append some rows on rank 0.

        Args:
            rows: Time in s and one number per column (1 + columns) each.
        """
        if self._stream is None:
            raise ValueError(f"HistoryWriter '{self.path}': written after close")
        for row in rows:
            if len(row) != 1 + len(self.columns):
                raise ValueError(
                    f"HistoryWriter '{self.path}': {len(row) - 1} values for {len(self.columns)} "
                    "columns"
                )
        try:
            self._stream.write("".join(",".join(map(repr, row.tolist())) + "\n" for row in rows))
            self._stream.flush()
        except OSError:
            # rows that the disk does not take are not written again when Python ends
            with contextlib.suppress(OSError):
                self.close()
            with contextlib.suppress(OSError):
                _cut_torn_row(self.path)
            raise

    @property
    def lost(self) -> bool:
        """The file was removed, or replaced by another one, while it is open."""
        if self._stream is None:
            return False
        try:
            return not os.path.samestat(os.fstat(self._stream.fileno()), self.path.stat())
        except OSError:
            return True

    def write_anew(self, rows: Sequence[ArrayLike]) -> None:
        """Write the table again where it was removed, and continue it.

        Args:
            rows: all so far, (1 + columns) each.

        Raises:
            OSError: If it cannot be written.
        """
        self.close()
        self._open(None)
        self.extend([np.asarray(row, dtype=np.float64) for row in rows])

    def sync(self) -> None:
        """Bring all rows to disk; rank 0, the others do nothing.

        Raises:
            OSError: If the disk does not take them.
        """
        if self._stream is not None:
            os.fsync(self._stream.fileno())

    def close(self) -> None:
        """Close the file."""
        if self._stream is not None:
            stream, self._stream = self._stream, None
            stream.close()

    def _open(self, resume: float | None) -> None:
        header = ",".join(("t", *self.columns))
        self.path.parent.mkdir(parents=True, exist_ok=True)
        lines = [header]
        if resume is not None and self.path.exists():
            lines += self._kept_rows(header, resume)
        replace_file(self.path, [("\n".join(lines) + "\n").encode()])
        self.path.with_suffix(".h5").unlink(missing_ok=True)  # of an earlier run
        self._stream = self.path.open("a", encoding="utf-8")

    def _kept_rows(self, header: str, resume: float) -> list[str]:
        old, *rows = _complete_lines(self.path) or [""]
        if old != header:
            raise InputError(f"history '{self.path}': cannot be continued, it has other columns")
        limit = resume + 1e-12 * abs(resume)
        try:
            table = np.array([[float(x) for x in row.split(",")] for row in rows])
            table = table.reshape(len(rows), 1 + len(self.columns))
        except ValueError as error:
            raise InputError(f"history '{self.path}': cannot be continued, {error}") from error
        keep = table[:, 0] <= limit
        self.kept = table[keep]
        return [rows[i] for i in np.flatnonzero(keep)]


class AngleColumns:
    """Continues angles across jumps of 2 pi, row by row.

    Attributes:
        previous: Last value of every column that was a number, None before the first row.
    """

    def __init__(self, columns: Sequence[str], angles: Sequence[str]) -> None:
        """Note which columns are angles (rad).

        Raises:
            ValueError: If an angle is none of the columns.
        """
        for name in angles:
            if name not in columns:
                raise ValueError(f"AngleColumns: no column '{name}' to unwrap")
        self._angles = [i for i, name in enumerate(columns) if name in set(angles)]
        self.previous: NDArray[np.float64] | None = None

    def unwrap(self, values: ArrayLike) -> NDArray[np.float64]:
        """The next row with its angles continued."""
        row = np.array(values, dtype=np.float64)
        if not self._angles:
            return row
        if self.previous is None:
            self.previous = row.copy()
            return row
        jump = self.previous[self._angles] - row[self._angles]
        # A value that is not a number must not poison the rows after it.
        turns = np.where(np.isfinite(jump), np.round(jump / (2.0 * np.pi)), 0.0)
        row[self._angles] += 2.0 * np.pi * turns
        self.previous = np.where(np.isfinite(row), row, self.previous)
        return row


def read_history(
    path: str | PathLike[str], columns: Sequence[str] | None = None
) -> dict[str, NDArray[np.float64]]:
    """Read a history table.

    A last row cut short by a killed run is left out.

    Args:
        path: The file, ``history.csv`` or ``history.h5``.
        columns: Names of the columns to read; None for all.

    Returns:
        One array (rows,) per column, in the order of the file.

    Raises:
        ValueError: If the file cannot be read, is not a table of numbers, or has no such column.
    """
    path = Path(path)
    if path.suffix == ".h5":
        return read_compressed(path, columns)
    table = _read_text(path)
    for name in columns or ():
        if name not in table:
            raise ValueError(f"history '{path}': no column '{name}'")
    return {k: v for k, v in table.items() if columns is None or k in columns}


def history_columns(path: Path) -> list[str]:
    """Names of the columns of a history table.

    Raises:
        ValueError: If the file cannot be read, or is no table.
    """
    if path.suffix == ".h5":
        return compressed_columns(path)
    lines = _complete_lines(path)
    return lines[0].split(",") if lines else []


def _read_text(path: Path) -> dict[str, NDArray[np.float64]]:
    """Read a CSV file."""
    lines = _complete_lines(path)
    if not lines:
        raise ValueError(f"history '{path}': no header")
    names = lines[0].split(",")
    table = np.zeros((0, len(names)))
    if len(lines) > 1:
        if not any(line.strip() for line in lines[1:]):
            raise ValueError(f"history '{path}': its lines are empty")
        try:
            table = np.loadtxt(io.StringIO("\n".join(lines[1:])), delimiter=",", ndmin=2)
        except ValueError as exc:
            raise ValueError(f"history '{path}': {exc}") from exc
    if table.shape[1] != len(names):
        raise ValueError(f"history '{path}': {table.shape[1]} values for {len(names)} columns")
    return {name: table[:, i].copy() for i, name in enumerate(names)}


def _cut_torn_row(path: Path) -> None:
    """Remove the text after the last complete row."""
    with path.open("r+b") as file:
        file.truncate(file.read().rfind(b"\n") + 1)


def _complete_lines(path: Path) -> list[str]:
    return read_text(f"history '{path}'", path, sys.maxsize - 1).split("\n")[:-1]
