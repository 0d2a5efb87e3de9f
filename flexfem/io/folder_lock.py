# SPDX-License-Identifier: LGPL-3.0-or-later
"""One run at a time in an output folder."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import socket
from pathlib import Path

from flexfem._checks import InputError

__all__ = ["FolderLock"]

#: File in the folder during a run; it names host and process.
_NAME = ".flexfem_run"
#: Error numbers of file systems without locks.
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP, errno.EINVAL)


class FolderLock:
    """Lock of a folder for one run, from :meth:`take` to :meth:`release`.

    The system holds the lock on the file and drops it when the process ends, however it does: a
    lock left by a killed run blocks nobody. On file systems without locks the process that the file
    names counts, which is known to have ended on this host only.
    """

    def __init__(self, folder: Path) -> None:
        """Note the folder; nothing is touched."""
        self._folder, self._path = folder, folder / _NAME
        self._file = -1
        self._created: list[Path] = []

    def take(self) -> None:
        """Create the folder if it is missing, and lock it.

        Raises:
            InputError: another run has it, or it cannot be written.
        """
        try:
            self._create()
            while not self._lock():
                pass
        except OSError as error:
            self.release()
            raise InputError(str(error)) from error

    def release(self) -> None:
        """Unlock the folder, and remove it if it was created here and is empty."""
        if self._file >= 0:
            with contextlib.suppress(OSError):
                if self._is_mine():
                    self._path.unlink()
            os.close(self._file)
            self._file = -1
        with contextlib.suppress(OSError):
            for folder in self._created:
                folder.rmdir()
        self._created = []

    def _create(self) -> None:
        missing = [path for path in (self._folder, *self._folder.parents) if not path.exists()]
        for path in reversed(missing):
            path.mkdir(exist_ok=True)
            self._created.insert(0, path)
        self._folder.mkdir(exist_ok=True)  # says so if it is a file

    def _lock(self) -> bool:
        """Lock the file; False if another run has removed it meanwhile, which then has ended."""
        self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            other = os.pread(self._file, 1000, 0).decode(errors="replace").split("\n")[:2]
            if error.errno not in _NO_LOCKS or _lives(other):
                os.close(self._file)
                self._file = -1
                raise self._refusal(other, known=error.errno not in _NO_LOCKS) from None
        if not self._is_mine():
            os.close(self._file)
            return False
        with contextlib.suppress(OSError):  # a full disk: the run will say so
            os.ftruncate(self._file, 0)
            os.pwrite(self._file, f"{socket.gethostname()}\n{os.getpid()}\n".encode(), 0)
        return True

    def _is_mine(self) -> bool:
        """Return True if the file is still where it was opened."""
        try:
            return os.path.samestat(os.fstat(self._file), self._path.stat())
        except FileNotFoundError:
            return False

    def _refusal(self, other: list[str], known: bool) -> InputError:
        who = f', process {other[1]} on host "{other[0]}"' if len(other) == 2 else ""
        over = "" if known else f" (remove '{self._path}' if it has ended)"
        return InputError(
            f"output folder '{self._folder}' is in use by another run{who}{over}; wait for its "
            "end, or give another folder"
        )


def _lives(other: list[str]) -> bool:
    """Return True if a process, named by host and number, may still run."""
    if len(other) < 2 or not other[1].isdecimal():
        return False
    if other[0] != socket.gethostname():
        return True
    try:
        os.kill(int(other[1]), 0)
    except ProcessLookupError:
        return False
    except OSError:
        pass
    return True
