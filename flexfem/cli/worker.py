# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs of cases one after the other in one process: ``python -m flexfem.cli.worker``.

Each line of stdin is a list in JSON: the working folder, the log file, and the arguments of
``flexfem run``. Output of the run goes into the log. :class:`flexfem.studies.workers.Answer` is a
line on stdout: the exit code, and whether this process takes another run. A run that ends its
process, by an exception or ``sys.exit``, ends this one in the same way. What a run has changed of
the process is put back, so that the next one begins as in a process of its own.
"""

import gc
import json
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

import numpy as np

import flexfem
from flexfem.cli.command import command
from flexfem.io.run_log import run_log
from flexfem.studies.workers import Answer

#: Exit codes from here on are those of signals, which ask this process to end as well.
_SIGNALLED = 128
#: A process leaves its place to a new one after so many runs, or when its memory has become so much
#: larger since its first one: this many times as large, and so many bytes.
_RUNS, _TIMES, _MORE = 500, 2.0, 5e8


def main() -> None:
    """Run what is asked for until stdin ends, or this process has to be renewed."""
    tasks, answers = _channels()
    first, modules = 0.0, 0
    for number, line in enumerate(tasks, 1):
        folder, log, arguments = json.loads(line)
        os.chdir(folder)
        _redirect(Path(log))
        with _surroundings_kept():
            sys.argv = [str(Path(flexfem.__file__).with_name("__main__.py")), "run", *arguments]
            code = command(sys.argv[1:])
        modules = _free(modules)
        first = first or _memory()
        stays = code < _SIGNALLED and number < _RUNS and _memory() <= _TIMES * first + _MORE
        os.write(answers, Answer(code, stays).line())
        if not stays:
            break


def _channels() -> tuple[TextIO, int]:
    """Where tasks come from, and where answers go; runs do not read from there."""
    tasks, answers = os.fdopen(os.dup(0), encoding="utf-8"), os.dup(1)
    nothing, end = os.pipe()
    os.close(end)
    os.dup2(nothing, 0)
    os.close(nothing)
    return tasks, answers


def _redirect(log: Path) -> None:
    """Write the output of this process into a file from now on; the pool has emptied it."""
    sys.stdout.flush()
    sys.stderr.flush()
    with run_log(log, append=True) as stream:
        os.dup2(stream.fileno(), 1)
        os.dup2(stream.fileno(), 2)


@contextmanager
def _surroundings_kept() -> Iterator[None]:
    """Put back folder, environment, paths and modules of a case, warnings and their filters."""
    folder, environment, path = Path.cwd(), dict(os.environ), list(sys.path)
    hook, modules = sys.excepthook, set(sys.modules)
    streams = sys.stdin, sys.stdout, sys.stderr
    with warnings.catch_warnings(), np.errstate():
        yield
    sys.excepthook = hook
    sys.stdout.flush()
    sys.stdin, sys.stdout, sys.stderr = streams
    sys.stdout.flush()
    os.chdir(folder)
    if environment != os.environ:
        os.environ.clear()
        os.environ.update(environment)
    _forget(set(sys.modules) - modules, set(sys.path) - set(path))
    sys.path[:] = path


def _forget(names: set[str], folders: set[str]) -> None:
    """Unload the modules of these that are in the folders: what a case imports beside its file."""
    for name in names:
        file = getattr(sys.modules[name], "__file__", None)
        if file is not None and any(Path(file).is_relative_to(one) for one in folders if one):
            del sys.modules[name]


def _free(modules: int) -> int:
    """Release the objects of a run.

    Args:
        modules: number of modules that the search for garbage leaves out.

    Returns:
        That number afterwards; searching them takes longer than many a run.
    """
    gc.collect()
    if petsc := sys.modules.get("petsc4py.PETSc"):
        petsc.garbage_cleanup()
    if len(sys.modules) != modules:
        gc.freeze()
    return len(sys.modules)


def _memory() -> float:
    """Resident memory of this process in bytes; 0 where it is unknown."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except (OSError, IndexError, ValueError):
        return 0.0
    return float(pages) * os.sysconf("SC_PAGE_SIZE")


if __name__ == "__main__":
    main()
