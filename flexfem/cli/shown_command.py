# SPDX-License-Identifier: LGPL-3.0-or-later
"""Command lines as the user may type them again."""

import os
import shlex
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from flexfem import launch

__all__ = ["shown_command"]


def shown_command(prog: str | None, argv: Sequence[str], **changes: object) -> str:
    """The command that was given, with other values of some options.

    Args:
        prog: "flexfem" and its command, quoted; None for a program of its own.
        argv: its arguments.
        changes: values of options, which take the place of earlier ones: ``restart=FILE``.
    """
    kept, skip = [], False
    flags = {"--" + name.replace("_", "-"): value for name, value in changes.items()}
    for argument in argv:
        if not skip and argument.partition("=")[0] not in flags:
            kept.append(argument)
        skip = not skip and argument in flags
    for flag, value in flags.items():
        kept += [flag, str(value)]
    words = [_program(prog), shlex.join(kept)]
    if launch.ranks() > 1:
        words.insert(0, f"{_beside('mpirun')} -n {launch.ranks()}")
    return " ".join(words).strip()


def _program(prog: str | None) -> str:
    started = Path(sys.argv[0])
    if prog is None:
        return f"{_beside('python')} {shlex.quote(sys.argv[0])}"
    if started.name != "flexfem":
        return f"{_beside('python')} -m flexfem {prog.removeprefix('flexfem ')}"
    if shutil.which("flexfem") == os.path.abspath(started):  # noqa: PTH100 - links stay as they are
        return prog
    return f"{shlex.quote(sys.argv[0])} {prog.removeprefix('flexfem ')}"


def _beside(name: str) -> str:
    """A program of this Python's environment, by its path unless it is the first on PATH."""
    path = launch.program(name)
    return name if path is None or path == shutil.which(name) else shlex.quote(path)
