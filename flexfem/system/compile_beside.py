# SPDX-License-Identifier: LGPL-3.0-or-later
"""Processes that compile loops beside a first run, before it comes to need them.

A run compiles its loops one after the other, most of them at its start, and so would a core alone
be at work. ``loops.txt`` lists loops, those first that most models with these modules call;
``python -m tests.list_loops`` writes it. A loop that is not in it is compiled when the run needs
it.
"""

import atexit
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any

from numba import types
from numba.core.dispatcher import Dispatcher

from flexfem.launch import environment_of_runs
from flexfem.lie.compile_once import busy

__all__ = ["compile_beside"]

LIST = Path(__file__).with_name("loops.txt")
#: Loops whose absence from the cache shows a first run, and how many of these must be absent.
_LOOKED_AT, _ABSENT = 8, 4
#: Processes at most: the longest loops are a fifth of the whole.
_MOST = 4
#: Variable that is 0 where no processes shall be started.
SWITCH = "FLEXFEM_COMPILE_BESIDE"
_ARRAY = re.compile(r"(readonly )?array\((\w+), (\d)d, C\)")
_TUPLE = re.compile(r"UniTuple\((\w+) x (\d+)\)")
_STARTED: list[subprocess.Popen[bytes]] = []


def compile_beside(ranks: int) -> None:
    """Start the processes, where most of the loops in the loaded modules were never compiled.

    Args:
        ranks: of the run, which wait for one another while one of them compiles.
    """
    cores = len(os.sched_getaffinity(0))
    if _STARTED or cores < 2 or os.environ.get(SWITCH) == "0":
        return
    modules = {name for name in sys.modules if name.startswith("flexfem.")}
    first = list(islice(_listed(modules), _LOOKED_AT))
    if sum(not loop._cache._cache_file._load_index() for loop, _ in first) < _ABSENT:
        return
    atexit.register(_end)
    for _ in range(min(_MOST, max(1, cores - ranks))):
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", __name__], env=environment_of_runs(),
            stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        _STARTED.append(process)
        assert process.stdin is not None
        process.stdin.write(" ".join(modules).encode())
        process.stdin.close()


def _end() -> None:
    """What is not compiled at the end of a run was not needed by it."""
    for process in _STARTED:
        process.terminate()
        process.wait()


def _listed(modules: set[str]) -> Iterator[tuple[Any, tuple[Any, ...]]]:
    """Loops of the list in some modules, with the types of their arguments."""
    for line in LIST.read_text(encoding="ascii").splitlines():
        module, function, *kinds = line.split("\t")
        if module in modules:
            loop = getattr(import_module(module), function, None)
            if isinstance(loop, Dispatcher):
                yield loop, tuple(_kind(kind) for kind in kinds)


def _kind(text: str) -> Any:
    """The type of what numba prints so."""
    if found := _ARRAY.fullmatch(text):
        readonly, scalar, dimensions = found.groups()
        return types.Array(getattr(types, scalar), int(dimensions), "C", readonly=bool(readonly))
    if found := _TUPLE.fullmatch(text):
        return types.UniTuple(getattr(types, found[1]), int(found[2]))
    return types.boolean if text == "bool" else getattr(types, text)


def _compile(modules: set[str]) -> None:
    """Compile what no other process is compiling, for as long as the run goes on."""
    run = os.getppid()
    for loop, signature in _listed(modules):
        if os.getppid() != run:
            break
        if not busy(loop, signature):
            loop.compile(signature)


if __name__ == "__main__":
    import mpi4py

    mpi4py.rc.initialize = False
    _compile(set(sys.stdin.read().split()))
