# SPDX-License-Identifier: LGPL-3.0-or-later
"""Limits of a mesh file: memory in proportion to its size, text that is text, numbers.

Files may come from anywhere. Their counts, ranges, other files and compression are compared here
with their contents before anything is allocated, so that a few bytes cannot ask for gigabytes or
hours.
"""

import math
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

from flexfem._files import open_file

__all__ = [
    "LARGEST",
    "Allowance",
    "TextFiles",
    "check_regular",
    "decoded",
    "included",
    "real",
    "whole",
]

#: Bytes of a file that is read at once.
LARGEST = 16_000_000_000

#: Bytes that any file may need beyond its size, and further bytes for each byte of it.
_BASE, _PER_BYTE = 400_000_000, 100
#: Characters of a line, files that include each other, and all files of a mesh.
_LINE, _DEPTH, _FILES = 1_000_000, 20, 1000

# Controls and separators of lines that editors do not take for the end of one
_BLANKS = dict.fromkeys([*range(9), *range(11, 32), *range(127, 160), 0x2028, 0x2029], " ")

_WHOLE = re.compile(r"[+-]?[0-9]{1,18}")
_DIGITS = r"([+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+))"
# 7.0, .7E1, 7.D0; with a bare exponent also 0.7+1
_REAL = re.compile(_DIGITS + r"(?:[EeDd]([+-]?[0-9]{1,4}))?")
_BARE = re.compile(_DIGITS + r"(?:[EeDd]?([+-][0-9]{1,4})|[EeDd]([0-9]{1,4}))?")


class Allowance:
    """Memory that reading a file may take for data that it implies but does not contain."""

    def __init__(self, path: Path) -> None:
        """Begin with the allowance of a file of this size."""
        self.path = path
        self._left = float(_BASE)
        self.hold(path)

    def hold(self, path: Path) -> None:
        """Add the allowance of another file of the mesh."""
        self._left += _PER_BYTE * path.stat().st_size

    def take(self, size: float, what: str) -> None:
        """Take some memory.

        Args:
            size: Bytes, at least about right.
            what: For the message.

        Raises:
            ValueError: It is more than there is left.
        """
        self._left -= size
        if self._left < 0.0:
            raise ValueError(
                f'mesh file "{self.path}": {what} would need more memory than a file of this size '
                "may ask for"
            )


class TextFiles:
    """The text files of a mesh: one, and those that it includes."""

    def __init__(self, path: Path) -> None:
        """Begin with the file that the others are included in."""
        self.allowance = Allowance(path)
        self._open: list[Path] = []
        self._count = 0

    def lines(self, path: Path) -> Iterator[tuple[int, str]]:
        """Yield number and text of the lines of a file.

        Text is UTF-8, or else taken as Latin-1, line by line, so that different names stay so.

        Raises:
            ValueError: It is no text, or a line is too long.
        """
        with open_file(f'mesh file "{path}" cannot be read', path) as file:
            number = 0
            while raw := file.readline(_LINE + 1):
                number += 1
                if len(raw) > _LINE:
                    _fail(path, number, f"more than {_LINE} characters")
                if b"\0" in raw:
                    _fail(path, number, "no text, it has a zero byte")
                yield number, decoded(raw)

    @contextmanager
    def entered(self, path: Path) -> Iterator[None]:
        """Read a file and those that it includes in this context.

        Raises:
            ValueError: It is no regular file, or files include each other without end.
        """
        resolved = path.resolve()
        if resolved in self._open or len(self._open) > _DEPTH:
            raise ValueError(f'mesh file "{path}": INCLUDE without end')
        self._count += 1
        if self._count > _FILES:
            raise ValueError(f'mesh file "{path}": INCLUDE of more than {_FILES} files')
        if self._open:
            self.allowance.hold(path)
        self._open.append(resolved)
        yield
        self._open.pop()


def decoded(raw: bytes) -> str:
    """Return a line as text, UTF-8 or else Latin-1, with blanks for controls."""
    try:
        text = raw.decode()
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    return text.translate(_BLANKS)


def check_regular(path: Path) -> None:
    """Raise unless a path is that of a file that can be read to its end.

    Raises:
        ValueError: There is nothing, or a folder, a pipe or a device.
    """
    if reason := _unreadable(path):
        raise ValueError(f'mesh file "{path}" {reason}')


def included(path: Path, number: int, keyword: str, name: str) -> Path:
    """Return the path of a file that a line of another one includes.

    Raises:
        ValueError: It is not there, or no regular file.
    """
    inner = path.parent / name
    if reason := _unreadable(inner):
        _fail(path, number, f'{keyword}: file "{name}" {reason}')
    return inner


def _unreadable(path: Path) -> str:
    """Return why a path is none of a regular file, "" if it is."""
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):  # ValueError: a zero byte in the name
        return "does not exist"
    if stat.S_ISREG(mode):
        return ""
    return "is a folder" if stat.S_ISDIR(mode) else "is a pipe or a device"


def whole(text: str) -> int | None:
    """Return a whole number of ASCII digits, None for anything else."""
    return int(text) if _WHOLE.fullmatch(text) else None


def real(text: str, *, bare_exponent: bool = False) -> float | None:
    """Return a finite decimal number with an exponent after E or D, None for anything else.

    Args:
        text: Without surrounding blanks.
        bare_exponent: True if the letter may be missing, as in 7.0+3.
    """
    found = (_BARE if bare_exponent else _REAL).fullmatch(text)
    if found is None:
        return None
    mantissa, *exponents = found.groups()
    value = float(f"{mantissa}e{next(filter(None, exponents), 0)}")
    return value if math.isfinite(value) else None


def _fail(path: Path, number: int, reason: str) -> NoReturn:
    raise ValueError(f'mesh file "{path}", line {number}: {reason}')
