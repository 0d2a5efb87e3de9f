# SPDX-License-Identifier: LGPL-3.0-or-later
"""History table: one CSV row per step, first column the time."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexfem.io.atomic import raise_together, replace_file

if TYPE_CHECKING:
    from mpi4py import MPI


class HistoryWriter:
    """Table ``t, <columns>`` in a CSV file; every row is on its way to disk when `write` returns.

    Numbers are written so that reading them gives the same floating-point values.
    """

    def __init__(
        self,
        path: Path,
        columns: Sequence[str],
        comm: MPI.Comm,
        unwrap: Sequence[str] = (),
        *,
        resume: float | None = None,
    ) -> None:
        """Open the table; collective.

        Args:
            path: The file; its folder is created if missing.
            columns: Names of the columns after ``t``.
            comm: Communicator; only rank 0 touches the file. Construction is collective.
            unwrap: Names of angle columns (rad) to be continued across jumps of 2 pi.
            resume: Keep the rows of an earlier run up to this time (s); None starts a new table.

        Raises:
            ValueError: If names are unusable, or the table to be continued has other columns.
            OSError: If the file cannot be written (on all ranks).
        """
        self.path, self.columns, self.comm = Path(path), tuple(columns), comm
        _check_columns(self.columns, unwrap)
        self._angles = [i for i, c in enumerate(self.columns) if c in set(unwrap)]
        self._previous: NDArray[np.float64] | None = None
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
        if self.comm.rank != 0:
            return
        if self._stream is None:
            raise ValueError(f"HistoryWriter '{self.path}': written after close")
        row = np.array(values, dtype=np.float64).reshape(-1)
        if len(row) != len(self.columns):
            raise ValueError(
                f"HistoryWriter '{self.path}': {len(row)} values for {len(self.columns)} columns"
            )
        if self._angles:
            row = self._unwrapped(row)
        self._stream.write(",".join(map(repr, [float(t), *row.tolist()])) + "\n")
        self._stream.flush()

    def close(self) -> None:
        """Close the file."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def _open(self, resume: float | None) -> None:
        header = ",".join(("t", *self.columns))
        self.path.parent.mkdir(parents=True, exist_ok=True)
        lines = [header]
        if resume is not None and self.path.exists():
            lines += self._kept_rows(header, resume)
        replace_file(self.path, [("\n".join(lines) + "\n").encode()])
        self._stream = self.path.open("a", encoding="utf-8")

    def _kept_rows(self, header: str, resume: float) -> list[str]:
        old, *rows = _complete_lines(self.path) or [""]
        if old != header:
            raise ValueError(
                f"HistoryWriter '{self.path}': cannot continue a table with other columns"
            )
        limit = resume + 1e-12 * abs(resume)
        kept = [row for row in rows if float(row.split(",", 1)[0]) <= limit]
        if kept:
            self._previous = np.array([float(x) for x in kept[-1].split(",")[1:]])
        return kept

    def _unwrapped(self, row: NDArray[np.float64]) -> NDArray[np.float64]:
        if self._previous is not None:
            jump = self._previous[self._angles] - row[self._angles]
            # A value that is not a number must not poison the rows after it.
            turns = np.where(np.isfinite(jump), np.round(jump / (2.0 * np.pi)), 0.0)
            row[self._angles] += 2.0 * np.pi * turns
            lost = ~np.isfinite(row)
            self._previous = np.where(lost, self._previous, row)
        else:
            self._previous = row.copy()
        return row


def read_history(path: Path) -> dict[str, NDArray[np.float64]]:
    """Read a history table.

    A last row cut short by a killed run is left out.

    Args:
        path: The CSV file.

    Returns:
        One array (rows,) per column, in the order of the file.

    Raises:
        ValueError: If the file is not a table of numbers.
        OSError: If it cannot be read.
    """
    lines = _complete_lines(Path(path))
    if not lines:
        raise ValueError(f"history '{path}': no header")
    names = lines[0].split(",")
    table = np.zeros((0, len(names)))
    if len(lines) > 1:
        try:
            table = np.loadtxt(io.StringIO("\n".join(lines[1:])), delimiter=",", ndmin=2)
        except ValueError as exc:
            raise ValueError(f"history '{path}': {exc}") from exc
    if table.shape[1] != len(names):
        raise ValueError(f"history '{path}': {table.shape[1]} values for {len(names)} columns")
    return {name: table[:, i].copy() for i, name in enumerate(names)}


def _complete_lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").split("\n")[:-1]


def _check_columns(columns: tuple[str, ...], unwrap: Sequence[str]) -> None:
    for name in columns:
        if not name or name == "t" or name != name.strip() or set(name) & set(',"\n\r'):
            raise ValueError(f"HistoryWriter: {name!r} cannot be the name of a column")
        if columns.count(name) > 1:
            raise ValueError(f"HistoryWriter: two columns are named '{name}'")
    for name in unwrap:
        if name not in columns:
            raise ValueError(f"HistoryWriter: no column '{name}' to unwrap")
