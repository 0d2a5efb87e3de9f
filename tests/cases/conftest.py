# SPDX-License-Identifier: LGPL-3.0-or-later
"""Running programs as a user does, with or without mpirun."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from flexfem import launch

ROOT = Path(__file__).parents[2]
#: Lines about fewer bodies than ranks, and fewer cores.
IN_VAIN = re.compile(r"^warning: \d+ (of \d+ )?ranks .*\n", re.MULTILINE)
Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope="session")
def environment() -> dict[str, str]:
    """Environment without what a launcher has set, one thread per process.

    Ranks of MPICH poll while they wait; here they leave their core to others, which are more than
    there are cores: up to three ranks, and as many tests at once as pytest is given.
    """
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PMI", "OMPI_", "HYDI_"))}
    own = {"OMP_NUM_THREADS": "1", "MPIR_CVAR_ENABLE_HEAVY_YIELD": "1", "PYTHONPATH": str(ROOT)}
    return kept | own


@pytest.fixture(scope="session")
def command_line() -> Callable[..., list[str]]:
    """Command line of a Python program on some ranks; skips the test without mpirun."""

    def make(ranks: int, *arguments: object) -> list[str]:
        program = [sys.executable, *map(str, arguments)]
        if ranks == 1:
            return program
        mpirun = launch.program("mpirun")
        if mpirun is None:
            pytest.skip("no mpirun")
        return [mpirun, "-n", str(ranks), *program]

    return make


@pytest.fixture(scope="session")
def run(environment: dict[str, str], command_line: Callable[..., list[str]]) -> Run:
    """Run a Python program on some ranks; a run that hangs is a failure.

    Warnings about too many ranks are left out: they depend on the machine.
    """

    def start(
        ranks: int, *arguments: object, cwd: Path | None = None, timeout: float = 400
    ) -> subprocess.CompletedProcess[str]:
        ended = subprocess.run(
            command_line(ranks, *arguments),
            capture_output=True,
            text=True,
            check=False,
            env=environment,
            cwd=cwd,
            timeout=timeout,
        )
        ended.stderr = IN_VAIN.sub("", ended.stderr)
        return ended

    return start
