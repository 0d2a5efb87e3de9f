# SPDX-License-Identifier: LGPL-3.0-or-later
"""Folders of arrays of which any rows can be read: NumPy's files, and facts in JSON."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np

from flexfem._checks import InputError
from flexfem._files import open_file, read_text

__all__ = ["ArrayFolder", "write_arrays"]

_FACTS = "facts.json"
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
                width = math.prod(found[1:])
                size = file.tell() + math.prod(found) * dtype.itemsize
                if os.fstat(file.fileno()).st_size != size:
                    raise ValueError(f"it does not have the {size} bytes of its shape {found}")
                file.seek(first * width * dtype.itemsize, 1)
                values = np.fromfile(file, dtype, (end - first) * width)
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


def write_arrays(
    owner: str, path: Path, facts: Mapping[str, Any], arrays: Mapping[str, Any]
) -> None:
    """Write arrays and facts into a new folder, the facts last.

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
        for name, values in arrays.items():
            with (path / f"{name}.npy").open("xb") as file:
                np.lib.format.write_array(file, np.ascontiguousarray(values), version=(1, 0))
        (path / _FACTS).write_text(json.dumps(facts, indent=1), encoding="utf-8")
    except OSError as error:
        raise InputError(f'{owner}: "{path}" cannot be written: {error.strerror}') from None
