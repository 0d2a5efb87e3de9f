# SPDX-License-Identifier: LGPL-3.0-or-later
"""Locks by which one process compiles a loop while others that need it wait.

Ranks of a run need the same loops at the same time. Without locks each of them would compile all
loops, on shared cores, and all but one of the results would be discarded.
"""

import fcntl
import time
from functools import cache
from pathlib import Path
from typing import Any
from zlib import crc32

from flexfem._files import open_lock
from flexfem._packages import without_collection

__all__ = ["busy", "compile_once"]

#: Seconds between two attempts to take a lock.
_PAUSE = 0.01
#: Seconds after which a loop is compiled in any case: no loop takes a tenth of that, so that the
#: holder of the lock must have been stopped.
_PATIENCE = 60.0


@cache
def _lock_file(folder: str) -> int | None:
    """Descriptor of the file of a cache folder whose bytes are the locks of its loops.

    It stays open, since closing any descriptor of a file releases all its locks.
    """
    return open_lock(Path(folder) / "compiling.lock")


def _lock(file: int, at: int) -> bool:
    """Try to lock a byte of a file within some time; return True if it is locked."""
    end = time.monotonic() + _PATIENCE
    while time.monotonic() < end:
        try:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, at)
        except (BlockingIOError, PermissionError):
            time.sleep(_PAUSE)
        except OSError:  # a file system without locks
            return False
        else:
            return True
    return False


def _place(kept: Any, signature: Any) -> int:
    """Return the byte of the file that is the lock of a loop."""
    return crc32(f"{kept._cache_file._index_name} {signature}".encode())


def busy(loop: Any, signature: Any) -> bool:
    """Return True if another process is compiling a loop for some types of arguments.

    Args:
        loop: numba's dispatcher, with a cache on disk.
        signature: the types.
    """
    file = _lock_file(loop._cache.cache_path)
    if file is None:
        return False
    at = _place(loop._cache, signature)
    try:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, at)
    except (BlockingIOError, PermissionError):
        return True
    except OSError:  # a file system without locks
        return False
    fcntl.lockf(file, fcntl.LOCK_UN, 1, at)
    return False


def compile_once(loop: Any) -> None:
    """Restrict the compilation of a loop to one process at a time.

    Args:
        loop: numba's dispatcher, with a cache on disk.
    """
    kept, compile_loop = loop._cache, loop.compile
    load = kept.load_overload
    held: list[tuple[int, int]] = []

    def load_or_lock(signature: Any, context: Any) -> Any:
        found = load(signature, context)
        file = None if found is not None else _lock_file(kept.cache_path)
        if file is None:
            return found
        at = _place(kept, signature)
        if not _lock(file, at):
            return None
        held.append((file, at))
        return load(signature, context)  # another process may have compiled it meanwhile

    def compile_alone(signature: Any) -> Any:
        before = len(held)
        try:
            with without_collection():
                return compile_loop(signature)
        finally:
            for file, at in held[before:]:
                fcntl.lockf(file, fcntl.LOCK_UN, 1, at)
            del held[before:]

    kept.load_overload, loop.compile = load_or_lock, compile_alone
