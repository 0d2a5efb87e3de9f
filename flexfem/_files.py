# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files of users, opened with care: plain files of bounded size, texts in UTF-8.

A pipe would be waited for without end, a device never ends, and a file of another kind or size than
fills the memory: all of them are refused at once, in one line that begins with what the caller
calls the file.
"""

import math
import os
import re
import stat
from collections.abc import Buffer, Iterable
from io import BufferedReader
from os import PathLike
from pathlib import Path

from flexfem._checks import InputError, show

__all__ = ["number_in", "open_file", "open_lock", "read_bytes", "read_text", "replace_file"]

#: First bytes of other encodings, as office programs write them.
_WIDE = (b"\xff\xfe", b"\xfe\xff")
#: Bytes that are read at once of files of unknown size.
_CHUNK = 1 << 20
#: Bytes in which a file must begin as one of its kind.
_HEAD = 4096
#: Nothing in any unit is larger, and products of some such numbers can be computed still.
_HUGE = 1e60
#: A number in decimal digits. Python's float() takes 1_0 for 10 and the digits of all scripts.
_NUMBER = re.compile(
    r"[+-]?((\d+(\.\d*)?|\.\d+)(e[+-]?\d+)?|nan|inf|infinity)", re.ASCII | re.IGNORECASE
)


def open_file(owner: str, path: str | PathLike[str]) -> BufferedReader:
    """Open a plain file for reading, without waiting for anyone.

    Args:
        owner: prefix of messages, such as ``table "steel.csv" cannot be read``.
        path: the file.

    Raises:
        InputError: it is not there, not readable, a folder, a pipe, a socket or a device.
    """
    try:
        # a pipe that nobody writes into must not be waited for, a terminal not become ours
        number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise InputError(f"{owner}: {_reason(error)}") from None
    mode = os.fstat(number).st_mode
    if stat.S_ISREG(mode):
        return os.fdopen(number, "rb")
    os.close(number)
    kind = (
        "Is a directory" if stat.S_ISDIR(mode) else "is not a regular file but a pipe or a device"
    )
    raise InputError(f"{owner}: {kind}")


def open_lock(path: str | PathLike[str]) -> int | None:
    """Descriptor of an empty file for locks, made where it is missing; None where it cannot be."""
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
    try:
        return os.open(path, flags, 0o600)
    except OSError:
        return None


def read_bytes(
    owner: str, path: str | PathLike[str], limit: int, begins: re.Pattern[bytes] | None = None
) -> bytes:
    """Contents of a plain file.

    Args:
        owner: prefix of messages.
        path: the file.
        limit: of its size in bytes.
        begins: required first bytes; of any other file only the first bytes are returned, for the
            caller to refuse, however large it is.

    Raises:
        InputError: it cannot be opened or read, or is larger.
    """
    with open_file(owner, path) as file:
        size = os.fstat(file.fileno()).st_size
        try:
            if begins is not None:
                if not begins.match(head := file.read(_HEAD)):
                    return head
                file.seek(0)
            chunks = [] if size > limit else [file.read(size + 1)]
            read = sum(map(len, chunks))
            while chunks and chunks[-1] and size < read <= limit:  # size unknown to the system
                chunks.append(file.read(_CHUNK))
                read += len(chunks[-1])
        except OSError as error:
            raise InputError(f"{owner}: {_reason(error)}") from None
    if max(size, read) > limit:
        raise InputError(f"{owner}: it has {max(size, read)} bytes, at most {limit} are read")
    return b"".join(chunks)


def read_text(owner: str, path: str | PathLike[str], limit: int) -> str:
    """Text of a plain file in UTF-8, with or without the mark at its beginning.

    Args:
        owner: prefix of messages.
        path: the file.
        limit: of its size in bytes.

    Raises:
        InputError: it cannot be opened or read, is larger, in another encoding, or no text.
    """
    content = read_bytes(owner, path, limit)
    if content.startswith(_WIDE):
        raise InputError(f"{owner}: it is in UTF-16; save it as UTF-8")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        found = content[error.start]
        raise InputError(
            f"{owner}: line {line} is not UTF-8, it has the byte 0x{found:02x}; save it as UTF-8"
        ) from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise InputError(f"{owner}: line {line} has a NUL byte, it is not a text")
    return text


def replace_file(path: Path, chunks: Iterable[Buffer]) -> None:
    """Write a file under a temporary name beside it, then rename it into place.

    Args:
        path: File to create or replace; its folder must exist.
        chunks: Contents, one after the other.

    Raises:
        OSError: If the file cannot be written; the previous version is left untouched.
    """
    temporary = path.with_name(f".{path.name}.tmp")
    try:
        with temporary.open("wb") as stream:
            stream.write(b"".join(chunks))  # one call of the system, which costs more than a copy
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def number_in(text: str) -> float:
    """Number in a field of a text.

    Raises:
        ValueError: it is no number, or none that a computer can hold.
    """
    field = text.strip()
    if not _NUMBER.fullmatch(field):
        raise ValueError(f"must be a number, got {show(field)}")
    value = float(field)
    if not math.isfinite(value):
        raise ValueError(f"must be finite, got {show(field)}")
    if abs(value) > _HUGE:
        raise ValueError(f"must not exceed {_HUGE:g}, got {show(field)}")
    return value


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or " ".join(str(error).split())
