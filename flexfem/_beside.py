# SPDX-License-Identifier: LGPL-3.0-or-later
"""Start and end of the background processes that compile loops for a first run.

Their work is in ``flexfem.system.compile_beside``. Nothing here takes long to import, so that a
command starts them before it loads DOLFINx and PETSc.
"""

import atexit
import json
import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from flexfem import launch

__all__ = ["LIST", "start", "start_early", "started", "tell"]

#: The loops: a line of JSON for each, which begins with the names of its module and of itself.
LIST = Path(__file__).parent / "system" / "loops.txt"
#: Variable that is 0 where no processes shall be started.
SWITCH = "FLEXFEM_COMPILE_BESIDE"
#: Processes at most: the longest loops are a fifth of the whole.
_MOST = 4
#: First loops of the list, of which no trace is found before a first run.
_LOOKED_AT = 4
_STARTED: list[subprocess.Popen[bytes]] = []


def started() -> bool:
    """Return True if this program has started processes."""
    return bool(_STARTED)


def start_early() -> None:
    """Start them where no loop was ever compiled, on the first rank, before a model is built.

    Where loops are out of date, that is seen when there is a model.
    """
    if launch.rank() == 0 and not _traces():
        start(launch.ranks_here()[0])


def start(ranks: int) -> None:
    """Start processes on the cores that are left, one at least; none on one core.

    Args:
        ranks: of the run on this computer, which wait for one another while one of them compiles.
    """
    cores = len(launch.cores())
    if _STARTED or cores < 2 or os.environ.get(SWITCH) == "0":
        return
    atexit.register(_end)
    for _ in range(min(_MOST, max(1, cores - ranks))):
        try:
            process = subprocess.Popen(
                [sys.executable, "-P", "-m", "flexfem.system.compile_beside", str(os.getpid())],
                env=launch.environment_of_runs(), stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            )  # fmt: skip
        except OSError:  # no more processes for this user, no memory
            return
        _STARTED.append(process)


def tell(modules: Iterable[str]) -> None:
    """Send the loaded modules to the processes, once."""
    text = " ".join(modules).encode()
    for process in _STARTED:
        if process.stdin is not None and not process.stdin.closed:
            try:
                with process.stdin as stream:
                    stream.write(text)
            except OSError:  # it has ended
                pass


def _end() -> None:
    """Stop the processes: loops not compiled at the end of a run were not needed by it."""
    for process in _STARTED:
        process.terminate()
    for process in _STARTED:
        process.wait()


def _traces() -> bool:
    """Return True if one of the first loops was ever compiled, by the names of cache files."""
    if folder := os.environ.get("NUMBA_CACHE_DIR"):
        places = [Path(folder)]
    else:
        caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        places = [caches / "numba"]
    lines = LIST.read_text(encoding="ascii").splitlines()
    first = [json.loads(line)[:2] for line in lines[:_LOOKED_AT]]
    for module, function in first:
        home, name = module.rsplit(".", 1)
        parent = LIST.parents[2].joinpath(*home.split("."))
        found = [parent.glob(f"__pycache__/{name}.{function}-*.nbi")] if not folder else []
        found += [place.glob(f"{parent.name}_*/{name}.{function}-*.nbi") for place in places]
        if any(True for files in found for _ in files):
            return True
    return False
