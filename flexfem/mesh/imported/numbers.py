# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers in a section of a file, as text or binary, never more than the file holds."""

import struct
import warnings
from typing import Any, NoReturn, Protocol

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import IntArray
from flexfem.mesh.imported.limits import decoded

__all__ = ["BinaryNumbers", "Numbers", "TextNumbers"]

#: Kind of the numbers ("int", "size" or "double"), and how many of them.
type Field = tuple[str, int]

_DIGITS = b"0123456789+-.eE \t\r\n\v\f"
# Whole numbers up to here are exact among the real ones
_EXACT = 2.0**53


class Numbers(Protocol):
    """Numbers one after another."""

    owner: str

    def records(self, count: int, *fields: Field) -> list[npt.NDArray[Any]]:
        """Return the next records, an array of shape (count, n) for each field.

        Raises:
            ValueError: There are not so many.
        """
        ...

    def whole(self, *kinds: str) -> list[int]:
        """Return the next whole numbers of some kinds.

        Raises:
            ValueError: There are not so many.
        """
        ...

    def counted(self) -> int:
        """Return a number that format 2 writes as text always.

        Raises:
            ValueError: There is none.
        """
        ...

    def rest(self) -> IntArray:
        """Return all that follow, as whole numbers of the kind "int"."""
        ...

    def skip(self, count: int) -> None:
        """Take so many of those as used."""
        ...


class TextNumbers:
    """The numbers of a section that is text."""

    def __init__(self, owner: str, body: bytes) -> None:
        """Read all of them.

        Raises:
            ValueError: Something is no number.
        """
        self.owner = owner
        self._values = _parsed(owner, body)
        self._next = 0

    def records(self, count: int, *fields: Field) -> list[npt.NDArray[Any]]:
        """See `Numbers`."""
        widths = [width for _, width in fields]
        rows = self._take(count, sum(widths)).reshape(count, sum(widths))
        parts = np.split(rows, np.cumsum(widths)[:-1], axis=1)
        return [
            part if kind == "double" else self._whole(part)
            for (kind, _), part in zip(fields, parts, strict=True)
        ]

    def whole(self, *kinds: str) -> list[int]:
        """See `Numbers`."""
        return [int(number) for number in self._whole(self._take(1, len(kinds)))]

    def counted(self) -> int:
        """See `Numbers`."""
        return self.whole("int")[0]

    def rest(self) -> IntArray:
        """See `Numbers`."""
        return self._whole(self._values[self._next :])

    def skip(self, count: int) -> None:
        """See `Numbers`."""
        self._next += count

    def finish(self) -> None:
        """Raise unless all have been used.

        Raises:
            ValueError: Some are left.
        """
        if left := len(self._values) - self._next:
            raise ValueError(f"{self.owner}: it has {left} numbers more than it says")

    def _take(self, count: int, width: int) -> npt.NDArray[np.float64]:
        left = len(self._values) - self._next
        if count < 0 or count * width > left:
            _too_many(self.owner, count)
        start, self._next = self._next, self._next + count * width
        return self._values[start : self._next]

    def _whole(self, values: npt.NDArray[np.float64]) -> IntArray:
        wrong = (np.abs(values) >= _EXACT) | (values != np.trunc(values))
        if wrong.any():
            raise ValueError(f"{self.owner}: {values[wrong][0]:g} is no whole number")
        return values.astype(np.int64)


def _parsed(owner: str, body: bytes) -> npt.NDArray[np.float64]:
    if not body.strip():
        return np.empty(0)
    if strange := body.translate(None, _DIGITS):
        raise ValueError(f"{owner}: {_checks.show(decoded(strange[:20]))} is in place of numbers")
    try:
        with warnings.catch_warnings():  # which NumPy before 2.5 answers with
            warnings.simplefilter("error", DeprecationWarning)
            return np.fromstring(body, dtype=np.float64, sep=" ")
    except (ValueError, DeprecationWarning):
        raise ValueError(f"{owner}: it has something else than numbers") from None


class BinaryNumbers:
    """The numbers of a section that is binary."""

    def __init__(self, owner: str, content: bytes, start: int, sizes: int, order: str) -> None:
        """Begin.

        Args:
            owner: Begin of messages.
            content: Of the whole file.
            start: Where the section begins in it.
            sizes: Bytes of a number of the kind "size", 4 or 8.
            order: Of the bytes, "<" or ">".
        """
        self.owner = owner
        self.position = start
        self._content = content
        self._order, self._codes = order, {"int": "i", "size": "q" if sizes == 8 else "i"}
        self._types = {"int": f"{order}i4", "size": f"{order}i{sizes}", "double": f"{order}f8"}

    def records(self, count: int, *fields: Field) -> list[npt.NDArray[Any]]:
        """See `Numbers`."""
        kind = np.dtype([(str(i), self._types[k], (n,)) for i, (k, n) in enumerate(fields)])
        left = len(self._content) - self.position
        if count < 0 or count * kind.itemsize > left:
            _too_many(self.owner, count)
        rows = np.frombuffer(self._content, kind, count, self.position)
        self.position += count * kind.itemsize
        return [_native(rows[str(i)], k) for i, (k, _) in enumerate(fields)]

    def whole(self, *kinds: str) -> list[int]:
        """See `Numbers`."""
        one = struct.Struct(self._order + "".join(self._codes[kind] for kind in kinds))
        if self.position + one.size > len(self._content):
            _too_many(self.owner, 1)
        self.position += one.size
        return list(one.unpack_from(self._content, self.position - one.size))

    def counted(self) -> int:
        """See `Numbers`."""
        end = self._content.find(b"\n", self.position)
        text = self._content[self.position : end].strip()
        if not 0 < end <= self.position + 40 or not text.isdigit():
            raise ValueError(f"{self.owner}: a number is missing at its begin")
        self.position = end + 1
        return int(text)

    def rest(self) -> IntArray:
        """See `Numbers`."""
        count = (len(self._content) - self.position) // 4
        return np.frombuffer(self._content, self._types["int"], count, self.position)

    def skip(self, count: int) -> None:
        """See `Numbers`."""
        self.position += 4 * count


def _native(column: npt.NDArray[Any], kind: str) -> npt.NDArray[Any]:
    return column.astype(np.float64 if kind == "double" else np.int64)


def _too_many(owner: str, count: int) -> NoReturn:
    raise ValueError(f"{owner}: it ends before {count} rows that it says follow")
