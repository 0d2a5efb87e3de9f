# SPDX-License-Identifier: LGPL-3.0-or-later
"""Damaged files against the readers: each gives what it reads or refuses in one line.

``python -m tests.fuzz_readers --inputs 100000`` makes that many files out of valid ones, with bytes
turned over, parts lost, doubled and moved, and numbers and words put in that mean harm. Whatever a
reader answers other than a result or a ValueError of one line with the file's name is a finding:
another exception or a warning, more than five seconds of the processor, a new file, or memory
beyond a gigabyte more than at the beginning. The same seed makes the same files. A file under way
is on the disk: what ends the process by a signal can be looked at.

A reader is a row of a table in one of the modules ``MODULES``: its name, and a ``Reader``.
"""

import argparse
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import numpy as np

__all__ = ["Reader", "Tally", "all_readers", "any_of", "fuzz"]

#: Modules with a table READERS of names and readers.
MODULES = ("tests.fuzz_meshes", "tests.fuzz_files", "tests.fuzz_views")

#: Seconds of the processor that an input may take, and bytes that all may need.
PATIENCE, ROOM = 5.0, 2**30

_NUMBERS = re.compile(rb"(?<![\w.])[+-]?\d+(?:\.\d*)?(?:[eE][+-]?\d+)?")
_HEADERS = re.compile(rb"[A-Za-z$*<][^\n]{0,80}\n[^\n]*")
_HARMFUL = (
    b"0", b"-1", b"1", b"2", b"3", b"7", b"100", b"99999", b"1000000000", b"2147483647",
    b"-2147483648", b"4294967295", b"9223372036854775807", b"18446744073709551615",
    b"1" + b"0" * 400, b"1e308", b"-1e400", b"1e-400", b"nan", b"inf", b"1_0", b"1e", b"0x10",
    b"\xd9\xa1", b"\xc2\xb2", b"", b"1 1", b"1\x002",
)  # fmt: skip
_PIECES = (
    b"\0", b"\xff\xfe", b"\n", b"\r\n", b" ", b'"', b"'", b",", b"*", b"$", b"<", b">", b"&",
    b"\x1a",
)  # fmt: skip
_WHOLE = ("<i4", ">i4", "<i8", ">i8")
_WHOLES = (0, -1, 1, 2, 255, 10**9, 2**31 - 1, -(2**31))


@dataclass(frozen=True)
class Reader:
    """A function that reads a file.

    Attributes:
        ending: Of the file's name.
        samples: Makes the contents of valid files.
        read: Reads the file of this name; in several ways with `any_of`.
        words: Lines that mean harm in this format.
    """

    ending: str
    samples: Callable[[], Sequence[bytes]]
    read: Callable[[Path], object]
    words: tuple[bytes, ...] = ()


@dataclass
class Tally:
    """Counts of the results of the inputs.

    Attributes:
        inputs: How many there were.
        read: How many were read.
        refused: How many were refused.
        findings: Descriptions of what was wrong, each kind once, with an input that shows it.
    """

    inputs: int
    read: int
    refused: int
    findings: dict[str, bytes]


class _TooLongError(BaseException):
    """Reading takes longer than `PATIENCE`; not to be caught by what is tested."""


def all_readers(modules: Sequence[str] = MODULES) -> dict[str, Reader]:
    """All readers of some modules by name."""
    found: dict[str, Reader] = {}
    for name in modules:
        found |= import_module(name).READERS
    return found


def any_of(*ways: Callable[[Path], object]) -> Callable[[Path], object]:
    """Return a function that reads a file in several ways and refuses what none of them reads."""

    def read(path: Path) -> object:
        made, refused = [], []
        for way in ways:
            try:
                made.append(way(path))
            except ValueError as error:
                if not _is_clear(error, path):
                    raise
                refused.append(error)
        if not made:
            raise refused[0]
        return made

    return read


def fuzz(reader: Reader, inputs: int, seed: int, folder: Path) -> Tally:
    """Read damaged files, after the valid ones.

    Args:
        reader: What is tested.
        inputs: How many.
        seed: Of the random numbers.
        folder: Empty; files are made in it.
    """
    rng, samples = np.random.default_rng(seed), list(reader.samples())
    tally = Tally(0, 0, 0, {})
    for number in range(inputs):
        whole = number < len(samples)
        content = samples[number] if whole else damaged(rng, samples, reader.words)
        finding = _finding(reader, content, folder, tally)
        tally.inputs += 1
        if whole and tally.refused:
            finding = finding or "a valid file is refused"
        if finding:
            tally.findings.setdefault(finding, content)
    return tally


def damaged(rng: np.random.Generator, samples: Sequence[bytes], words: Sequence[bytes]) -> bytes:
    """Return the content of a file out of valid ones, changed once to four times."""
    content = samples[rng.integers(len(samples))]
    changes = (_number, _number, _count, _count, _byte, _whole, _lost, _doubled, _moved, _piece)
    for _ in range(rng.integers(1, 5)):
        chance = rng.random()
        if words and chance < 0.1:
            at = _line_start(rng, content)
            content = content[:at] + words[rng.integers(len(words))] + content[at:]
        elif chance < 0.13:
            content = _spliced(rng, content, samples[rng.integers(len(samples))])
        else:
            content = changes[rng.integers(len(changes))](rng, content)
    return content[: 2**20]


def _pick[T](rng: np.random.Generator, choices: Sequence[T]) -> T:
    return choices[rng.integers(len(choices))]


def _place(rng: np.random.Generator, content: bytes) -> int:
    return int(rng.integers(len(content) + 1))


def _line_start(rng: np.random.Generator, content: bytes) -> int:
    return content.find(b"\n", _place(rng, content)) + 1


def _number(rng: np.random.Generator, content: bytes) -> bytes:
    """Put something else in the place of a number of a text."""
    start = max(0, _place(rng, content) - 200)
    found = list(_NUMBERS.finditer(content, start, start + 400))
    return _replaced(rng, content, found)


def _count(rng: np.random.Generator, content: bytes) -> bytes:
    """Put something else in the place of a number beside or below a word, where counts stand."""
    heads = list(_HEADERS.finditer(content))
    if not heads:
        return content
    head = _pick(rng, heads)
    return _replaced(rng, content, list(_NUMBERS.finditer(content, *head.span())))


def _replaced(rng: np.random.Generator, content: bytes, found: Sequence[re.Match[bytes]]) -> bytes:
    if not found:
        return content
    match = _pick(rng, found)
    return content[: match.start()] + _pick(rng, _HARMFUL) + content[match.end() :]


def _byte(rng: np.random.Generator, content: bytes) -> bytes:
    values = bytearray(content)
    for _ in range(rng.integers(1, 5)):
        if values:
            values[rng.integers(len(values))] ^= 1 << int(rng.integers(8))
    return bytes(values)


def _whole(rng: np.random.Generator, content: bytes) -> bytes:
    """Write a whole number over some bytes, as counts stand in binary files."""
    number = np.array(_pick(rng, _WHOLES)).astype(_pick(rng, _WHOLE)).tobytes()
    at = _place(rng, content)
    return content[:at] + number + content[at + len(number) :]


def _lost(rng: np.random.Generator, content: bytes) -> bytes:
    """Lose the end, some bytes or a line."""
    at, kind = _place(rng, content), rng.integers(3)
    if kind == 0:
        return content[:at]
    if kind == 1:
        return content[:at] + content[at + int(rng.integers(1, 40)) :]
    at = _line_start(rng, content)
    return content[:at] + content[content.find(b"\n", at) + 1 or at :]


def _doubled(rng: np.random.Generator, content: bytes) -> bytes:
    """Repeat some lines, or bytes many times."""
    if rng.random() < 0.1:
        at = _place(rng, content)
        return content[:at] + content[at : at + 1] * int(rng.integers(2, 100000)) + content[at:]
    start = _line_start(rng, content)
    end = start + int(rng.integers(1, 400))
    return content[:end] + content[start:end] + content[end:]


def _moved(rng: np.random.Generator, content: bytes) -> bytes:
    """Put some lines elsewhere."""
    first, second, third = sorted(_line_start(rng, content) for _ in range(3))
    return content[:first] + content[second:third] + content[first:second] + content[third:]


def _piece(rng: np.random.Generator, content: bytes) -> bytes:
    at = _place(rng, content)
    return content[:at] + _pick(rng, _PIECES) + content[at:]


def _spliced(rng: np.random.Generator, content: bytes, other: bytes) -> bytes:
    return content[: _place(rng, content)] + other[_place(rng, other) :]


def _is_clear(error: ValueError, path: Path) -> bool:
    return len(str(error).splitlines()) == 1 and path.name in str(error)


def _finding(reader: Reader, content: bytes, folder: Path, tally: Tally) -> str:
    """Read a file and return what is wrong with the answer, "" for nothing."""
    path = folder / f"input{reader.ending}"
    path.write_bytes(content)
    try:
        with _alarm():
            reader.read(path)
        tally.read += 1
    except ValueError as error:
        tally.refused += 1
        if not _is_clear(error, path):
            where = traceback.extract_tb(error.__traceback__)[-1]
            return f"a message that is not one line with the file's name, {_at(where)}: {error}"
    except _TooLongError as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return f"more than {PATIENCE:g} s of the processor, {_at(where)}"
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        where = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__}, {_at(where)}"
    if others := sorted(found.name for found in folder.iterdir() if found != path):
        shutil.rmtree(folder)
        folder.mkdir()
        return f"new files: {', '.join(others)}"
    return ""


def _at(frame: traceback.FrameSummary) -> str:
    return f"{Path(frame.filename).name}:{frame.lineno} {frame.name}"


@contextmanager
def _alarm() -> Iterator[None]:
    signal.setitimer(signal.ITIMER_PROF, PATIENCE)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def _ring(number: int, frame: object) -> None:
    raise _TooLongError


def _limit_memory() -> None:
    """Let this process have no more than it has and a gigabyte."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    room = pages * resource.getpagesize() + ROOM
    resource.setrlimit(resource.RLIMIT_AS, (room, resource.getrlimit(resource.RLIMIT_AS)[1]))


def _report(name: str, tally: Tally, seconds: float, keep: Path | None) -> None:
    print(
        f"{name}: {tally.inputs} files, {tally.read} read, {tally.refused} refused, "
        f"{seconds:.1f} s, {len(tally.findings)} findings",
        flush=True,
    )
    for number, (finding, content) in enumerate(tally.findings.items()):
        print(f"  {finding}\n    {content[:300]!r}", flush=True)
        if keep is not None:
            (keep / f"{name}_{number}").write_bytes(content)


def main() -> int:
    """Read files of the command line's number; 1 where something was found."""
    parser = argparse.ArgumentParser(description="Damaged files against the readers.")
    parser.add_argument("--inputs", type=int, default=10000, help="of all readers together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--module", action="append", choices=MODULES, help="only its readers")
    parser.add_argument("--reader", action="append", help="only the one of this name")
    parser.add_argument("--keep", type=Path, help="folder for inputs that show what was found")
    options = parser.parse_args()
    readers = all_readers(options.module or MODULES)
    names = options.reader or list(readers)
    signal.signal(signal.SIGPROF, _ring)
    warnings.simplefilter("error")
    found = 0
    with tempfile.TemporaryDirectory(prefix="flexfem-fuzz-") as top:
        _limit_memory()
        for name in names:
            folder = Path(top) / name
            folder.mkdir()
            begin = time.perf_counter()
            tally = fuzz(readers[name], max(1, options.inputs // len(names)), options.seed, folder)
            _report(name, tally, time.perf_counter() - begin, options.keep)
            found += len(tally.findings)
    return min(found, 1)


if __name__ == "__main__":
    sys.exit(main())
