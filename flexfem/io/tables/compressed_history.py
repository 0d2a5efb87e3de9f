# SPDX-License-Identifier: LGPL-3.0-or-later
"""History table in an HDF5 file of compressed chunks: thousands of columns in bounded memory.

The file has ``columns``, the names, and ``values`` (rows, columns), which grows by blocks of rows,
each of which is compressed once. Rows of the block that is not full yet are in ``tail``: checksum,
number of the row, and the row. Rows there whose number ``values`` has reached are out of date. The
file is open for SWMR ("single writer, multiple readers"): whatever ends the run, and at any moment,
it can be read up to the last row written.
SWMR: https://support.hdfgroup.org/documentation/hdf5/latest/_s_w_m_r_t_n.html
"""

from __future__ import annotations

import errno
import os
import re
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexfem._checks import InputError
from flexfem._files import open_file
from flexfem.io.atomic import raise_together
from flexfem.io.hdf5.arrays import PlainFile, load_h5py
from flexfem.io.hdf5.structure import check_structure
from flexfem.io.tables.names import check_columns

if TYPE_CHECKING:
    from mpi4py import MPI

__all__ = [
    "CompressedHistoryWriter",
    "StoredHistory",
    "compressed_blocks",
    "compressed_columns",
    "read_compressed",
]

type FloatArray = NDArray[np.float64]
#: Rows of a table up to a time, by blocks, and what they are asked with.
type Kept = Callable[[], Iterator[FloatArray]]

_FORMAT = "flexfem history 1"
#: Columns of a chunk at most, numbers of a chunk, and rows of a block at least and at most.
_COLUMNS, _NUMBERS, _LEAST, _MOST = 256, 16384, 64, 1024
#: Numbers of a row of the tail before its values: checksum and number of the row.
_MARKS = 2


class CompressedHistoryWriter:
    """Table ``t, <columns>`` in an HDF5 file; rows are on their way to disk when `write` returns.

    It has the methods of :class:`flexfem.io.tables.history.HistoryWriter`, and holds a block of
    rows in memory, not all.

    Attributes:
        path, columns, comm: as given.
        kept: (0 or 1, 1 + columns) last row of an earlier run that is continued; rank 0.
    """

    def __init__(
        self, path: Path, columns: Sequence[str], comm: MPI.Comm, *, kept: Kept | None = None
    ) -> None:
        """Open the table; collective.

        Args:
            path: The file; its folder is created if missing.
            columns: Names of the columns after ``t``.
            comm: Communicator; only rank 0 touches the file.
            kept: Gives the rows that are continued, on rank 0; None starts a new table.

        Raises:
            ValueError: If names are unusable.
            InputError: If the table to be continued cannot be (on all ranks).
            OSError: If the file cannot be written (on all ranks).
        """
        self.path, self.columns, self.comm = Path(path), tuple(columns), comm
        check_columns(self.columns)
        self._width = 1 + len(self.columns)
        self.kept = np.zeros((0, self._width))
        self._block = np.zeros((0, 0))
        self._filled = self._first = 0  # rows of the block, number of its first one
        self._file: Any = None
        error: Exception | None = None
        if comm.rank == 0:
            self._block = np.zeros((_block_rows(self._width), self._width))
            try:
                self._open(iter(()) if kept is None else kept())
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

    def extend(self, rows: Sequence[FloatArray]) -> None:
        """Append some rows on rank 0.

        Args:
            rows: Time in s and one number per column (1 + columns) each.

        Raises:
            OSError: If the disk does not take them; the table ends before, and is closed.
        """
        if self._file is None:
            raise ValueError(f"HistoryWriter '{self.path}': written after close")
        table = np.array(rows, dtype=np.float64).reshape(len(rows), -1)
        if len(table) and table.shape[1] != self._width:
            raise ValueError(
                f"HistoryWriter '{self.path}': {table.shape[1] - 1} values for {self._width - 1} "
                "columns"
            )
        with self._written():
            self._append(table)

    @property
    def lost(self) -> bool:
        """The file was removed, or replaced by another one, while it is open."""
        if self._file is None:
            return False
        try:
            return not os.path.samestat(os.fstat(self._descriptor()), self.path.stat())
        except OSError:
            return True

    def write_anew(self, rows: Sequence[ArrayLike]) -> None:
        """Write the table again where it was removed, and continue it.

        Args:
            rows: the last ones at least; all are in the removed file, which is open still.

        Raises:
            OSError: If it cannot be written.
        """
        old, pending = self._file, self._block[: self._filled].copy()
        stored = old["values"]
        starts = range(0, stored.shape[0], len(self._block))
        try:
            self._open(stored[k : k + len(self._block)] for k in starts)
            with self._written():
                self._append(pending)
        finally:
            old.close()

    def sync(self) -> None:
        """Bring all rows to disk; rank 0, the others do nothing.

        Raises:
            OSError: If the disk does not take them.
        """
        if self._file is not None:
            os.fsync(self._descriptor())

    def close(self) -> None:
        """Put the last rows to the others, and close the file.

        Raises:
            OSError: If the disk does not take them; they are in the file all the same.
        """
        if self._file is not None:
            with self._written():
                self._store()
                self._file.close()
            self._file = None

    def _open(self, rows: Iterator[FloatArray]) -> None:
        """Make a table of these rows, and put it in the place of that of an earlier run."""
        first = next(rows, None)  # a table that cannot be continued is refused before
        self.path.parent.mkdir(parents=True, exist_ok=True)
        temporary = self.path.with_name(f".{self.path.name}.tmp")
        self._filled = self._first = 0
        try:
            self._file = self._created(temporary)
            with self._written():
                for block in () if first is None else (first, *rows):
                    self._append(block)
                    self.kept = block[-1:] if len(block) else self.kept
            temporary.replace(self.path)
        except BaseException:
            if self._file is not None:
                self._abandon()
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
            raise
        self.path.with_suffix(".csv").unlink(missing_ok=True)  # of an earlier run

    def _created(self, path: Path) -> Any:
        """A new file without rows, open for SWMR."""
        names = [name.encode() for name in ("t", *self.columns)]
        size, width = len(self._block), self._width
        h5py = load_h5py()
        try:
            path.open("wb").close()  # its errors are those of the system
            file = h5py.File(path, "w", libver="v110")
            kind = h5py.string_dtype("utf-8", max(map(len, names)))
            file.attrs["format"] = _FORMAT
            file.create_dataset("columns", data=np.array(names, dtype=kind))
            file.create_dataset(
                "values", (0, width), dtype="<f8", maxshape=(None, width),
                chunks=(size, min(width, _COLUMNS)), compression="gzip", compression_opts=1,
                shuffle=True, fletcher32=True,
            )  # fmt: skip
            tail = file.create_dataset("tail", (size, width + _MARKS), dtype="<f8")
            tail[:] = 0.0
            file.swmr_mode = True
        except (OSError, RuntimeError) as error:
            raise _system_error(error, self.path) from error
        return file

    def _append(self, rows: FloatArray) -> None:
        """Add rows (m, 1 + columns), blocks of which are compressed once they are full."""
        while len(rows):
            begin = self._filled
            part, rows = rows[: len(self._block) - begin], rows[len(self._block) - begin :]
            self._filled += len(part)
            self._block[begin : self._filled] = part
            if self._filled == len(self._block):
                self._store()
            else:
                self._note(begin, part)

    def _note(self, begin: int, rows: FloatArray) -> None:
        """Write rows of the block that is not full yet into the tail."""
        marked = np.empty((len(rows), self._width + _MARKS), dtype="<f8")
        marked[:, 1] = self._first + begin + np.arange(len(rows))
        marked[:, _MARKS:] = rows
        marked[:, 0] = _checksums(marked)
        tail = self._file["tail"]
        tail[begin : begin + len(rows)] = marked
        tail.flush()

    def _store(self) -> None:
        """Compress the rows of the block."""
        values, end = self._file["values"], self._first + self._filled
        if self._filled:
            values.resize(end, 0)
            values[self._first :] = self._block[: self._filled]
            values.flush()
        self._first, self._filled = end, 0

    def _descriptor(self) -> int:
        return int(self._file.id.get_vfd_handle())

    @contextmanager
    def _written(self) -> Iterator[None]:
        """Close the table where the disk does not take what is written within."""
        try:
            yield
        except (OSError, RuntimeError) as error:
            self._abandon()
            raise _system_error(error, self.path) from error

    def _abandon(self) -> None:
        """Close the table without writing anything more.

        HDF5 tries again to write what it holds whenever a file is closed, and crashes when Python
        ends if it cannot: so it writes that into the null device.
        """
        file, self._file = self._file, None
        null = os.open(os.devnull, os.O_RDWR)
        os.dup2(null, file.id.get_vfd_handle())
        os.close(null)
        with suppress(OSError, RuntimeError):
            file.close()


class StoredHistory(Mapping[str, FloatArray]):
    """Columns of a table that a run has written, each read when it is asked for."""

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        """Note the file and the names of its columns."""
        self._path, self._columns = path, tuple(columns)

    def __getitem__(self, name: str) -> FloatArray:
        """Read a column (rows,)."""
        if name not in self._columns:
            raise KeyError(name)
        with _Table(self._path) as table:
            return table.read([name])[name]

    def __iter__(self) -> Iterator[str]:
        """Names of the columns."""
        return iter(self._columns)

    def __len__(self) -> int:
        """Return the number of columns."""
        return len(self._columns)


def read_compressed(path: Path, columns: Sequence[str] | None = None) -> dict[str, FloatArray]:
    """Read a table, which a run may be writing.

    Args:
        path: the file.
        columns: names of those to read; None for all.

    Returns:
        One array (rows,) per column, in the order of the file.

    Raises:
        ValueError: it cannot be read, is something else or damaged, or has no such column.
    """
    with _careful(path) as table:
        return table.read(table.names if columns is None else columns)


def compressed_columns(path: Path) -> list[str]:
    """Names of the columns of a table.

    Raises:
        ValueError: it cannot be read, is something else or damaged.
    """
    with _careful(path) as table:
        return table.names


def compressed_blocks(path: Path, names: Sequence[str]) -> Iterator[FloatArray]:
    """Rows of a table by blocks.

    Args:
        path: the file.
        names: of its columns.

    Raises:
        InputError: it cannot be read, or has other columns.
    """
    with _careful(path) as table:
        if table.names != [*names]:
            raise InputError(f"history '{path}': cannot be continued, it has other columns")
        yield from table.blocks()


@contextmanager
def _careful(path: Path) -> Iterator[_Table]:
    """A table in a file that may be forged."""
    owner = f"history '{path}'"
    open_file(owner, path).close()
    try:
        check_structure(path, live=True)
        with _Table(path) as table:
            yield table
    except InputError:
        raise
    except Exception as error:  # whatever HDF5's library makes of a damaged file
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{owner}: {reason}") from error


class _Table:
    """A table that is open for reading.

    Attributes:
        names: of the columns.
    """

    def __init__(self, path: Path) -> None:
        """Open the file."""
        self._file = load_h5py().File(path, "r", libver="v110", swmr=True)
        try:
            file = PlainFile(self._file, path.stat().st_size)
            if file.text("format") != _FORMAT:
                raise ValueError(f"it is no table of the format '{_FORMAT}'")
            self.names = file.texts("columns")
            width = len(self.names)
            self._values = file.compressed("values")
            self._tail = file.array("tail")
            if self._values.shape[1:] != (width,) or self._tail.shape[1:] != (width + _MARKS,):
                raise ValueError(f"its rows are not those of {width} columns")
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> _Table:
        """Use the table within a block."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self._file.close()

    def read(self, columns: Sequence[str]) -> dict[str, FloatArray]:
        """Columns by name, in the order of the file."""
        for name in columns:
            if name not in self.names:
                raise ValueError(f"no column '{name}'")
        known = set(columns)
        chosen = np.array([k for k, name in enumerate(self.names) if name in known], dtype=np.int64)
        count = self._values.shape[0]
        rest, step = self._rest(count), self._values.chunks[1]
        found = np.empty((len(chosen), count + len(rest)))
        found[:, count:] = rest[:, chosen].T
        for first in np.unique(chosen // step) * step:  # each chunk is decompressed once
            mine = (chosen >= first) & (chosen < first + step)
            part = self._values[:count, first : first + step]
            found[mine, :count] = part[:, chosen[mine] - first].T
        return {self.names[k]: row for k, row in zip(chosen.tolist(), found, strict=True)}

    def blocks(self) -> Iterator[FloatArray]:
        """All rows, some at a time."""
        count, step = self._values.shape[0], self._values.chunks[0]
        for first in range(0, count, step):
            yield np.asarray(self._values[first : min(first + step, count)], dtype=np.float64)
        yield self._rest(count)

    def _rest(self, count: int) -> FloatArray:
        """Rows in the tail that follow so many."""
        marked = self._tail[()]
        whole = marked[marked[:, 0] == _checksums(marked)]
        places = {number: k for k, number in enumerate(whole[:, 1].tolist())}
        rows: list[int] = []
        while count + len(rows) in places:
            rows.append(places[count + len(rows)])
        rest: FloatArray = whole[rows, _MARKS:].astype(np.float64)
        return rest


def _block_rows(width: int) -> int:
    """Rows of a block of so many columns."""
    return min(max(_NUMBERS // width, _LEAST), _MOST)


def _checksums(marked: NDArray[Any]) -> list[float]:
    """Checksums of numbered rows (m, 2 + width), never zero."""
    return [float(zlib.crc32(row[1:].tobytes()) + 1) for row in marked]


def _system_error(error: Exception, path: Path) -> OSError:
    """An error of HDF5's library as the one of the system that it tells about in many words."""
    told = re.search(r"\berrno = (\d+)", str(error))
    number = int(told[1]) if told else getattr(error, "errno", None)
    reason = os.strerror(number) if number else " ".join(str(error).split())
    return OSError(number or errno.EIO, reason, str(path))
