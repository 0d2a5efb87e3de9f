# SPDX-License-Identifier: LGPL-3.0-or-later
"""Folders of arrays of which any rows can be read: NumPy's files, and facts in JSON.

Each block of an array has a checksum, and all of them with the facts a digest, so that what is read
is what was written, whichever rows that are.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import zlib
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np

from flexfem._checks import InputError
from flexfem._files import open_file, read_text
from flexfem._types import IntArray

__all__ = ["ArrayFolder", "write_arrays"]

_FACTS = "facts.json"
#: Array of the checksums.
_SUMS = "checksums"
#: Bytes of an array that have one of them.
_BLOCK = 65_536
#: Bytes of the facts, at most.
_LARGEST = 10_000_000


class ArrayFolder:
    """Folder that :func:`write_arrays` has written; files are opened for each reading.

    Attributes:
        owner: prefix of messages.
        path: the folder.
    """

    def __init__(self, owner: str, path: Path) -> None:
        """Name the folder; nothing is read."""
        self.owner, self.path = owner, path

    def facts(self) -> dict[str, Any]:
        """Read the facts.

        Raises:
            InputError: they are missing or damaged.
        """
        owner = f"{self.owner}: {_FACTS}"
        try:
            text = read_text(f"{owner} cannot be read", self.path / _FACTS, _LARGEST)
            found = json.loads(text)
        except (json.JSONDecodeError, RecursionError) as error:
            raise InputError(f"{owner} is damaged: {error}") from None
        if not isinstance(found, dict):
            raise InputError(f"{owner} is damaged: it is no object")
        return found

    @cached_property
    def checksums(self) -> dict[str, IntArray]:
        """Checksums of the blocks of each array.

        Raises:
            InputError: facts or checksums are not those that were written.
        """
        facts, sums = self.facts(), self._rows(_SUMS, (-1,), np.int64, 0, None, None)
        try:
            if facts.pop("digest") != _digest(facts, sums):
                raise ValueError("it does not have the digest that was written")
            return {name: sums[first:end] for name, (first, end) in facts["blocks"].items()}
        except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
            raise InputError(f"{self.owner}: {_FACTS} is damaged: {error}") from None

    def rows(
        self, name: str, shape: tuple[int, ...], kind: type, first: int = 0, end: int | None = None
    ) -> Any:
        """Read rows ``first`` to ``end`` of an array, all by default.

        Args:
            name: of the array.
            shape: that it must have, -1 for any length.
            kind: type of its numbers, ``numpy.float64`` or ``numpy.int64``.
            first: first row.
            end: row after the last; None for all further ones.

        Raises:
            InputError: the file is missing, damaged or another one.
        """
        blocks = self.checksums.get(name, np.empty(0, dtype=np.int64))
        return self._rows(name, shape, kind, first, end, blocks)

    def _rows(
        self, name: str, shape: tuple[int, ...], kind: type, first: int, end: int | None,
        blocks: IntArray | None,
    ) -> Any:  # fmt: skip
        """See :meth:`rows`; ``blocks`` are the checksums of the array, None if it has none."""
        owner = f"{self.owner}: {name}.npy"
        with open_file(f"{owner} cannot be read", self.path / f"{name}.npy") as file:
            try:
                if np.lib.format.read_magic(file) != (1, 0):
                    raise ValueError("it has another version of the format")
                found, fortran, dtype = np.lib.format.read_array_header_1_0(file)
                given = tuple(n if n >= 0 else found[0] for n in shape) if found else shape
                if fortran or dtype != np.dtype(kind) or found != given:
                    raise ValueError(f"it holds {dtype} of shape {found}, not {given}")
                end = found[0] if end is None else end
                width, size = math.prod(found[1:]), math.prod(found) * dtype.itemsize
                if os.fstat(file.fileno()).st_size != file.tell() + size:
                    raise ValueError(f"it does not have the {size} bytes of its shape {found}")
                start, stop = (row * width * dtype.itemsize for row in (first, end))
                low = start if blocks is None else start - start % _BLOCK
                high = stop if blocks is None else min(stop + -stop % _BLOCK, size)
                file.seek(low, 1)
                data = np.fromfile(file, np.uint8, high - low)
                if blocks is not None:
                    _check(data, low, blocks)
                values = data[start - low : stop - low].view(dtype)
                return values.reshape(end - first, *found[1:])
            except (ValueError, SyntaxError, TokenError, EOFError, OSError) as error:
                raise InputError(f"{owner} is damaged: {error}") from None

    def chosen(self, name: str, shape: tuple[int, ...], kind: type, rows: Any) -> Any:
        """Read some rows (k,) of an array, of which those that are near each other at once."""
        known, inverse = np.unique(rows, return_inverse=True)
        if not len(known):
            return self.rows(name, shape, kind, 0, 0)
        ends = np.flatnonzero(np.diff(known) > _GAP) + 1
        parts = [
            self.rows(name, shape, kind, int(part[0]), int(part[-1]) + 1)[part - part[0]]
            for part in np.split(known, ends)
        ]
        return np.concatenate(parts)[inverse]


#: Rows that are read in vain rather than that the file is opened once more.
_GAP = 1000


def _check(data: Any, start: int, blocks: IntArray) -> None:
    """Compare the bytes of an array from the start of a block on with the checksums of all blocks.

    Raises:
        ValueError: they are others than those that were written.
    """
    first, sums = start // _BLOCK, _sums(data)
    known = blocks[first : first + len(sums)]
    differ = np.flatnonzero(known != sums[: len(known)])
    if len(differ) or len(known) < len(sums):
        block = int(differ[0]) if len(differ) else len(known)
        raise ValueError(
            f"its numbers are not those that were written, from byte {start + block * _BLOCK} on"
        )


def _sums(values: Any) -> IntArray:
    """Checksums (k,) of the blocks of a contiguous array."""
    data = values.reshape(-1).view(np.uint8)
    starts = range(0, len(data), _BLOCK)
    return np.array([zlib.crc32(data[k : k + _BLOCK]) for k in starts], dtype=np.int64)


def _digest(facts: Mapping[str, Any], sums: IntArray) -> str:
    """Digest of facts and checksums."""
    text = json.dumps(facts, sort_keys=True).encode()
    return hashlib.blake2b(text + sums.tobytes(), digest_size=16).hexdigest()


def write_arrays(
    owner: str, path: Path, facts: Mapping[str, Any], arrays: Mapping[str, Any]
) -> None:
    """Write arrays and facts into a new folder, the facts with a digest of everything last.

    Args:
        owner: prefix of messages.
        path: the folder, which must not exist, or be empty.
        facts: what JSON can hold.
        arrays: by the names of their files.

    Raises:
        InputError: it exists and is not empty, or cannot be written.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        if any(path.iterdir()):
            raise InputError(f'{owner}: the folder "{path}" is not empty; give another name')
        sums, blocks, count = [np.empty(0, dtype=np.int64)], dict[str, tuple[int, int]](), 0
        for name, values in arrays.items():
            own = np.ascontiguousarray(values)
            _write(path, name, own)
            sums.append(_sums(own))
            blocks[name] = count, count + len(sums[-1])
            count += len(sums[-1])
        _write(path, _SUMS, np.concatenate(sums))
        written = {**facts, "blocks": blocks}
        written["digest"] = _digest(written, np.concatenate(sums))
        (path / _FACTS).write_text(json.dumps(written, indent=1), encoding="utf-8")
    except OSError as error:
        raise InputError(f'{owner}: "{path}" cannot be written: {error.strerror}') from None


def _write(path: Path, name: str, values: Any) -> None:
    with (path / f"{name}.npy").open("xb") as file:
        np.lib.format.write_array(file, values, version=(1, 0))
