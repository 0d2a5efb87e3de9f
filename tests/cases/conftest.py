# SPDX-License-Identifier: LGPL-3.0-or-later
"""Running programs as a user does, with or without mpirun."""

import os
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from flexfem import launch

ROOT = Path(__file__).parents[2]
#: Lines about fewer bodies than ranks, and fewer cores.
IN_VAIN = re.compile(r"^warning: \d+ (of \d+ )?ranks .*\n", re.MULTILINE)
Run = Callable[..., subprocess.CompletedProcess[str]]
RunCases = Callable[[int, Sequence[Sequence[object]]], subprocess.CompletedProcess[str]]


@pytest.fixture(scope="session")
def environment() -> dict[str, str]:
    """Environment without what a launcher has set, one thread per process."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PMI", "OMPI_", "HYDI_"))}
    own = {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
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


# Runs files of cases as scripts, one after the other; one argument a run: the file and its options.
SCRIPTS = """\
import runpy, sys

for line in sys.argv[1:]:
    sys.argv = line.split("|")
    try:
        runpy.run_path(sys.argv[0], run_name="__main__")
    except SystemExit as end:
        if end.code:
            sys.exit(f"{sys.argv} ended with {end.code}")
"""


@pytest.fixture(scope="session")
def run_cases(run: Run, tmp_path_factory: pytest.TempPathFactory) -> RunCases:
    """Run cases in one process (of each rank): to start one costs more than such a run."""

    def start(ranks: int, runs: Sequence[Sequence[object]]) -> subprocess.CompletedProcess[str]:
        script = tmp_path_factory.mktemp("scripts") / "scripts.py"
        script.write_text(SCRIPTS)
        files = (
            "|".join([str(ROOT / "cases" / f"{case}.py"), *map(str, more)]) for case, *more in runs
        )
        ended = run(ranks, script, *files, timeout=600)
        assert ended.returncode == 0, ended.stderr
        return ended

    return start
