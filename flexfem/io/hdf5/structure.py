# SPDX-License-Identifier: LGPL-3.0-or-later
"""Structure of HDF5 files that may be forged, read by a process of its own first.

The HDF5 library may crash, or never come to an end, on a file whose inner structure is damaged. So
a short-lived process that may take little time and memory reads names, shapes and attributes before
this one opens the file: ``python -P structure.py FILE SECONDS LIVE`` ends with 0 if it can.
"""

import os
import resource
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from flexfem.launch import environment_of_runs

__all__ = ["check_structure"]

#: Seconds of the processor for the whole structure, and how many times as much on a busy computer.
_SECONDS, _BUSY = 20, 6
#: Bytes of memory beyond those of the file.
_ROOM = 2**30
#: Exit code with which the reason is on stderr.
_REFUSED = 3


def check_structure(path: Path, *, live: bool = False) -> None:
    """Let another process read the structure of a file.

    Args:
        path: the file, a plain one.
        live: another process may be writing it (SWMR), or have been killed as it did.

    Raises:
        OSError: no process can be started.
        ValueError: it cannot be read, as far as the HDF5 library gets.
    """
    command = [sys.executable, "-P", __file__, str(path), str(_SECONDS), str(int(live))]
    try:
        ended = subprocess.run(
            command, env=environment_of_runs(), stdin=subprocess.DEVNULL, capture_output=True,
            check=False, timeout=_BUSY * _SECONDS,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise ValueError(_no_end()) from None
    if ended.returncode == -signal.SIGXCPU:
        raise ValueError(_no_end())
    if ended.returncode < 0:
        name = signal.Signals(-ended.returncode).name
        raise ValueError(f"its structure is damaged: the HDF5 library crashes on it ({name})")
    if ended.returncode:
        told = ended.stderr.decode(errors="replace").split("\n")
        raise ValueError(next(filter(None, reversed(told)), "its structure cannot be read"))


def _no_end() -> str:
    return f"its structure is damaged: the HDF5 library has not read it after {_SECONDS} s"


def read_structure(path: str, live: bool = False) -> None:
    """Read all names, shapes and attributes; arrays are not read.

    Raises:
        Exception: whatever the HDF5 library makes of it.
    """
    import h5py

    with h5py.File(path, "r", swmr=live) as file:
        _look_at("/", file)
        file.visititems(_look_at)


def _look_at(name: str, item: Any) -> None:
    """Read the properties that readers use."""
    dict(item.attrs)
    if hasattr(item, "keys"):
        for link in item:
            item.get(link, getlink=True)
    elif hasattr(item, "shape"):
        for what in ("shape", "dtype", "chunks", "is_virtual", "external"):
            getattr(item, what)
        item.id.get_storage_size()


def _limit(path: str, seconds: int) -> None:
    """Let this process have so much more time, and memory for a file."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    room = pages * resource.getpagesize() + _ROOM + Path(path).stat().st_size
    used = resource.getrusage(resource.RUSAGE_SELF)
    _lower(resource.RLIMIT_AS, room)
    _lower(resource.RLIMIT_CPU, int(used.ru_utime + used.ru_stime) + 1 + seconds)
    _lower(resource.RLIMIT_CORE, 0)


def _lower(kind: int, limit: int) -> None:
    hard = resource.getrlimit(kind)[1]
    least = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
    resource.setrlimit(kind, (least, hard))


def _main(path: str, seconds: int, live: bool) -> int:
    import h5py  # noqa: F401 before the limits, which are for the file

    _limit(path, seconds)
    try:
        read_structure(path, live)
    except Exception as error:  # as above
        print(" ".join(str(error).split()) or type(error).__name__, file=sys.stderr)
        return _REFUSED
    return 0


if __name__ == "__main__":
    code = _main(sys.argv[1], int(sys.argv[2]), sys.argv[3] == "1")
    sys.stderr.flush()
    os._exit(code)  # the library may crash once more when it is left
