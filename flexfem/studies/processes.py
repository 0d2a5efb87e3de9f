# SPDX-License-Identifier: LGPL-3.0-or-later
"""Commands that start this very interpreter, on several ranks where asked for."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from flexfem.launch import program

__all__ = ["python_command"]


def python_command(arguments: Sequence[str], ranks: int) -> list[str]:
    """The command that starts this very interpreter.

    Raises:
        ValueError: There is no mpirun for several ranks.
    """
    # -P: modules of the working folder are not imported in place of those of the libraries
    run = [sys.executable, "-P", *arguments]
    if ranks == 1:
        return run
    mpirun = program("mpirun")
    if mpirun is None:
        raise ValueError(f"{ranks} ranks need mpirun, which is not on PATH")
    return [mpirun, "-n", str(ranks), *run]
