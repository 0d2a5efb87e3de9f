# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checkpoint files: HDF5 behind a short text with which a damaged file is detected.

The first 512 bytes are an HDF5 user block with the format, the number of bytes that follow and
their checksum (BLAKE2b), so that any damage is noticed before the HDF5 library sees the file. Then

- ``/`` has the attribute ``header``, a JSON text;
- ``/values/<name>`` are arrays that are the same on every rank;
- ``/rows/<numbering>/<name>`` are arrays in the order of the model.

Ranks write their rows one after the other into a file with a temporary name, which becomes the
checkpoint once it is complete and on disk: an interrupted write leaves the former one as it was.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexfem._checks import InputError
from flexfem._files import open_file
from flexfem.core.state import Numbering, State
from flexfem.io.atomic import raise_together
from flexfem.io.hdf5.arrays import PlainFile, load_h5py
from flexfem.io.hdf5.structure import check_structure

if TYPE_CHECKING:
    from mpi4py import MPI

__all__ = ["Checkpoint", "remove_files", "write_checkpoint"]

#: Layout of the file; another one is refused.
_FORMAT = 1
_TAG = 1203  # of the messages between ranks that take turns
_BLOCK = 512  # bytes of the user block: the least that HDF5 has
_SEAL = re.compile(rb"flexfem checkpoint\nformat (\d+)\nbytes (\d+)\nblake2b ([0-9a-f]{64})\n")
_MARK = b"flexfem checkpoint\n"
#: Advice about a damaged checkpoint: the last two are kept.
_OTHER = "use the other one that is kept"


def write_checkpoint(
    path: Path,
    comm: MPI.Comm,
    header: Mapping[str, Any],
    state: State,
    numberings: Mapping[str, Numbering],
) -> None:
    """Write a checkpoint, or leave everything as it is (collective).

    Args:
        path: the file; its folder must exist.
        comm: communicator.
        header: JSON-compatible data; the first rank's is written.
        state: this rank's part.
        numberings: where the rows of the state are, by the names of their groups.

    Raises:
        OSError: on all ranks, if the file cannot be written.
    """
    temporary = path.with_name(f".{path.name}.tmp")

    def write() -> None:
        first = comm.rank == 0
        with _Stream(temporary, "w+" if first else "r+") as stream:
            with _hdf5(stream, "w" if first else "r+") as file:
                if first:
                    _lay_out(file, header, state, numberings)
                for group, arrays in state.rows.items():
                    for name, values in arrays.items():
                        _write_rows(file[f"rows/{group}/{name}"], values, numberings[group])
            stream.check()
            if comm.rank == comm.size - 1:
                stream.seal()

    try:
        _in_turn(comm, write)
        _on_first(comm, lambda: _rename(temporary, path))
    except OSError as error:
        if comm.rank == 0:
            temporary.unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error


class Checkpoint:
    """A checkpoint that was found whole.

    Attributes:
        path: the file.
        header: header as written.
    """

    def __init__(self, path: Path, comm: MPI.Comm) -> None:
        """Check the file on the first rank and read its header (collective).

        Raises:
            InputError: on all ranks; it cannot be read, is something else, or is damaged.
        """
        self.path, self._comm = Path(path), comm
        error, header = None, dict[str, Any]()
        if comm.rank == 0:
            try:
                self._check_seal()
                check_structure(self.path)
                with _hdf5(self.path, "r") as file:
                    header = _header(PlainFile(file, self.path.stat().st_size))
            except Exception as exc:  # whatever HDF5's library makes of a forged file
                error = self._refusal(exc)
        raise_together(comm, error)
        self.header: dict[str, Any] = comm.bcast(header)

    def refuse(self, reason: str) -> InputError:
        """The error with the reason why this file cannot be used."""
        return InputError(f"checkpoint '{self.path}': {reason}")

    def read(self, numberings: Mapping[str, Numbering]) -> State:
        """Read this rank's part, which need not be that of the rank that wrote it (collective).

        Raises:
            InputError: on all ranks; the numbers of rows differ, or the file cannot be read.
        """
        error, state = None, State()
        try:
            with _hdf5(self.path, "r") as file:
                plain = PlainFile(file, self.path.stat().st_size)
                values = {
                    name: plain.values(f"values/{name}").astype(np.float64)
                    for name in plain.names("values")
                }
                rows = {
                    group: {
                        name: self._rows(plain.array(f"rows/{group}/{name}"), numberings[group])
                        for name in plain.names(f"rows/{group}")
                    }
                    for group in numberings
                }
            state = State(values, rows)
        except Exception as exc:  # as above
            error = self._refusal(exc)
        raise_together(self._comm, error)
        return state

    def _check_seal(self) -> None:
        """Check that a plain file is as it was written, whatever wrote it."""
        with open_file(f"checkpoint '{self.path}'", self.path) as file:
            block = file.read(_BLOCK)
            if not block.startswith(_MARK):
                raise ValueError("is not a checkpoint of flexfem")
            found = _SEAL.match(block)
            if found is None or block != _seal(int(found[1]), int(found[2]), found[3].decode()):
                raise ValueError(f"is damaged in its first 512 bytes; {_OTHER}")
            if int(found[1]) != _FORMAT:
                raise ValueError(f"has format {int(found[1])}, this version reads format {_FORMAT}")
            size, digest = _digest(file)
        if size != int(found[2]):
            raise ValueError(
                f"is damaged: {_BLOCK + size} bytes instead of {_BLOCK + int(found[2])}; {_OTHER}"
            )
        if digest != found[3].decode():
            raise ValueError(f"is damaged: the checksum of its contents differs; {_OTHER}")

    def _rows(self, dataset: Any, numbering: Numbering) -> NDArray[np.float64]:
        count = dataset.shape[0] if dataset.shape else 0
        if count != numbering.size:
            raise self.refuse(f"{dataset.name} has {count} rows, not {numbering.size}")
        out = np.empty((len(numbering.numbers), *dataset.shape[1:]))
        for rows, local in _runs(numbering.numbers):
            out[local] = dataset[rows]
        return out

    def _refusal(self, error: Exception) -> InputError:
        if isinstance(error, InputError):
            return error
        if isinstance(error, OSError) and error.strerror:
            return self.refuse(error.strerror)
        return self.refuse(" ".join(str(error).split()) or type(error).__name__)


class _Stream:
    """File under the HDF5 library that keeps the first error of the system to itself.

    The library does not survive a failed write: it tries again when the file is closed, and once
    more at the end of the process.
    """

    def __init__(self, path: Path, mode: str) -> None:
        self._file = io.FileIO(path, mode)
        self._error: OSError | None = None
        self.seek, self.tell = self._file.seek, self._file.tell
        self.read, self.readinto = self._file.read, self._file.readinto

    def __enter__(self) -> _Stream:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def write(self, data: Any) -> int:
        """Write all of the data, or note the error."""
        view = memoryview(data).cast("B")
        size = len(view)
        while len(view) and self._error is None:
            try:
                view = view[self._file.write(view) :]
            except OSError as error:
                self._error = error
        return size

    def truncate(self, size: int) -> int:
        """Set the size of the file, or note the error."""
        try:
            self._file.truncate(size)
        except OSError as error:
            self._error = self._error or error
        return size

    def flush(self) -> None:
        """Nothing is kept back."""

    def check(self) -> None:
        """Raise the error that was kept.

        Raises:
            OSError: something was not written.
        """
        if self._error is not None:
            raise self._error

    def seal(self) -> None:
        """Fill the user block and bring the file to disk.

        Raises:
            OSError: it cannot be written.
        """
        size, digest = _digest(self._file)
        self._file.seek(0)
        self.write(_seal(_FORMAT, size, digest))
        self.check()
        os.fsync(self._file.fileno())


def _header(file: PlainFile) -> dict[str, Any]:
    """The file's header.

    Raises:
        ValueError: it is none.
    """
    try:
        header = json.loads(file.text("header"), parse_constant=_no_number)
    except RecursionError:
        header = None
    if not isinstance(header, dict):
        raise ValueError("its header is no object of JSON")
    return header


def _no_number(text: str) -> None:
    raise ValueError(f"its header has the number {text}")


def _hdf5(file: _Stream | Path, mode: str) -> Any:
    block = {"userblock_size": _BLOCK} if mode == "w" else {}
    return load_h5py().File(file, mode, libver="v110", **block)


def _seal(layout: int, size: int, digest: str) -> bytes:
    text = f"{_MARK.decode()}format {layout}\nbytes {size}\nblake2b {digest}\n"
    return text.encode().ljust(_BLOCK, b"\0")


def _digest(file: Any) -> tuple[int, str]:
    """Number of bytes behind the user block and their checksum."""
    file.seek(_BLOCK)
    digest, size = hashlib.blake2b(digest_size=32), 0
    while block := file.read(1 << 20):
        digest.update(block)
        size += len(block)
    return size, digest.hexdigest()


def _lay_out(
    file: Any, header: Mapping[str, Any], state: State, numberings: Mapping[str, Numbering]
) -> None:
    """Header, values and the room for all rows."""
    file.attrs["header"] = json.dumps(header, sort_keys=True)
    file.create_group("values")
    for name, values in state.values.items():
        file[f"values/{name}"] = values
    for group, arrays in state.rows.items():
        for name, values in arrays.items():
            shape = (numberings[group].size, *values.shape[1:])
            file.create_dataset(f"rows/{group}/{name}", shape, dtype=np.float64)


def _write_rows(dataset: Any, values: NDArray[np.float64], numbering: Numbering) -> None:
    own = np.flatnonzero(numbering.owned)
    for rows, local in _runs(numbering.numbers[own]):
        dataset[rows] = values[own[local]]


def _runs(numbers: NDArray[np.int64]) -> Iterator[tuple[slice, NDArray[np.int64]]]:
    """Runs of successive numbers, and where they are."""
    order = np.argsort(numbers, kind="stable")
    if not len(order):
        return
    breaks = np.flatnonzero(np.diff(numbers[order]) != 1) + 1
    for part in np.split(order, breaks):
        yield slice(int(numbers[part[0]]), int(numbers[part[-1]]) + 1), part


def _in_turn(comm: MPI.Comm, action: Callable[[], None]) -> None:
    """Let one rank act after the other, up to the first that fails (collective)."""
    error: OSError | None = comm.recv(source=comm.rank - 1, tag=_TAG) if comm.rank > 0 else None
    if error is None:
        try:
            action()
        except OSError as exc:
            error = exc
    if comm.rank < comm.size - 1:
        comm.send(error, dest=comm.rank + 1, tag=_TAG)
    raise_together(comm, error)


def _on_first(comm: MPI.Comm, action: Callable[[], None]) -> None:
    """Act on the first rank (collective)."""
    error = None
    if comm.rank == 0:
        try:
            action()
        except OSError as exc:
            error = exc
    raise_together(comm, error)


def _rename(temporary: Path, path: Path) -> None:
    """Give the file its final name."""
    temporary.replace(path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def remove_files(folder: Path, names: re.Pattern[str], kept: Sequence[Path]) -> None:
    """Remove the files of a folder with such names but for those that are kept (absolute paths)."""
    for path in folder.absolute().iterdir():
        if names.fullmatch(path.name) and path not in kept:
            path.unlink(missing_ok=True)
