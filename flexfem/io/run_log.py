# SPDX-License-Identifier: LGPL-3.0-or-later
"""Log files for the output of processes."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

__all__ = ["run_log"]


def run_log(path: Path, *, append: bool = False) -> BinaryIO:
    """A file for the output of a process, empty unless appended to; to be closed.

    Raises:
        OSError: It cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    return path.open("ab" if append else "wb", buffering=0)
