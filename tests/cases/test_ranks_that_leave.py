# SPDX-License-Identifier: LGPL-3.0-or-later
"""Scripts of which one rank leaves before the others come to a run, and cases that one rank alone
cannot build: no rank waits for it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.serial

SCRIPT = """
import sys
{first}
import flexfem as ff
if ff.launch.rank() == {leaving}:
    sys.exit({code})
model = ff.Model("top")
model.add(ff.RigidBody("body", 1.0, (0.1, 0.1, 0.2)))
ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=1e-3, output=sys.argv[1]))
"""


@pytest.mark.parametrize(
    ("first", "leaving", "code"),
    [("", 1, 3), ("from mpi4py import MPI", 0, 0)],
    ids=["before MPI", "with MPI"],
)
def test_sys_exit_on_one_rank(
    first: str, leaving: int, code: int, tmp_path: Path, run: Callable[..., Any]
) -> None:
    """One line names the rank; the exit code is that of a failure, also after sys.exit(0)."""
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(first=first, leaving=leaving, code=code))
    ended = run(2, script, tmp_path / "results", timeout=30)
    assert ended.returncode == 1
    line = f"failed: rank {leaving} of 2 has exited before a run of all ranks\n"
    assert ended.stderr.count(line) == 1
    assert "Traceback" not in ended.stderr
    assert not (tmp_path / "results").exists()


BETWEEN = """
import sys
from mpi4py import MPI
import flexfem as ff
from flexfem import _leaving
_leaving._ALONE = 0.3
try:
    raise SystemExit(5)  # which is caught
except SystemExit:
    pass
if MPI.COMM_WORLD.rank == {leaving}:
    try:
        {end}
    finally:
        pass
{wait}
"""


@pytest.mark.parametrize(("leaving", "end"), [(0, "sys.exit(3)"), (1, "raise SystemExit(3)")])
def test_sys_exit_while_others_wait(
    leaving: int, end: str, tmp_path: Path, run: Callable[..., Any]
) -> None:
    """In a collective call of the script, where they hear nothing."""
    script = tmp_path / "script.py"
    script.write_text(BETWEEN.format(leaving=leaving, end=end, wait="MPI.COMM_WORLD.Barrier()"))
    ended = run(2, script, timeout=30)
    line = f"failed: rank {leaving} of 2 has exited with code 3, others have not\n"
    assert (ended.returncode, ended.stdout, ended.stderr) == (3, "", line)


def test_ranks_that_have_left_well_tell_why_the_program_does_not_end(
    tmp_path: Path, run: Callable[..., Any]
) -> None:
    """Once, and no more than that: the other may have work of its own."""
    script = tmp_path / "script.py"
    wait = "import time; time.sleep(1.0 if MPI.COMM_WORLD.rank == 0 else 0.0)"
    script.write_text(BETWEEN.format(leaving=1, end="sys.exit(0)", wait=wait))
    ended = run(2, script, timeout=30)
    assert (ended.returncode, ended.stdout, ended.stderr.count("\n")) == (0, "", 1)
    assert ended.stderr.startswith(
        "warning: rank 1 of 2 has exited, rank 0 has not for 0.3 s; it never will if it waits in a "
    )


SLOW = """
import sys, time
from mpi4py import MPI
import flexfem as ff
from flexfem import launch
launch._PATIENCE = 0.6
if MPI.COMM_WORLD.rank == {slow}:
    time.sleep({seconds})
if launch.first_message("wrong"):
    launch.say("error: wrong", error=True)
    if MPI.COMM_WORLD.rank == {slow}:
        time.sleep({seconds})
    sys.exit(2)
"""


@pytest.mark.parametrize(("slow", "seconds"), [(0, 0.1), (1, 0.1), (0, 1.0), (1, 1.0)])
def test_ranks_that_come_late(
    slow: int, seconds: float, tmp_path: Path, run: Callable[..., Any]
) -> None:
    """One line and its code, whether the others are still waited for or no more."""
    script = tmp_path / "script.py"
    script.write_text(SLOW.format(slow=slow, seconds=seconds))
    ended = run(2, script, timeout=30)
    assert (ended.returncode, ended.stdout, ended.stderr) == (2, "", "error: wrong\n")


CASE = """
import sys
from mpi4py import MPI
import flexfem as ff
ff.launch._PATIENCE = 0.5
{more}

def build():
    rank, comm = MPI.COMM_WORLD.rank, MPI.COMM_WORLD
    if rank == {failing}:
        {failure}
    comm.bcast(0, root={failing})  # as in a reduction: all ranks are needed
    raise AssertionError("goes on without the other rank")

CASE = ff.Case(name="one", summary="cannot be built on one rank", build=build, dt=1e-3, t_end=1e-2)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
"""
_LINE = "error: build (case.py, line 11): "
_NUMERICAL = "from flexfem._checks import NumericalError"


@pytest.mark.parametrize(
    ("failing", "failure", "program", "line", "code"),
    [
        (
            1,
            'open("no such file")',
            ("-m", "flexfem", "run"),
            _LINE + "FileNotFound",
            2,
        ),
        (0, "1 / 0", (), _LINE + "ZeroDivisionError", 2),
        (1, "raise SystemExit(0)", ("-m", "mpi4py"), _LINE + "sys.exit(0)", 2),
        (1, 'raise NumericalError("no modes")', (), "failed: no modes", 1),
    ],
    ids=["command", "script", "mpi4py", "numerical"],
)
def test_case_that_one_rank_cannot_build(
    failing: int, failure: str, program: tuple[str, ...], line: str, code: int, tmp_path: Path,
    run: Callable[..., Any],
) -> None:  # fmt: skip
    """While the other waits for it in a collective call of ``build``."""
    case = tmp_path / "case.py"
    case.write_text(CASE.format(more=_NUMERICAL, failing=failing, failure=failure))
    trace = ["--traceback"] if program == () else []
    ended = run(2, *program, case, "--output", tmp_path / "results", *trace, timeout=30)
    assert ended.returncode == code
    told = [text for text in ended.stderr.splitlines() if text.startswith(("error:", "failed:"))]
    assert len(told) == 1
    assert told[0].startswith(line)
    # of the rank that fails, and only if it is asked for
    assert ended.stderr.count("Traceback") == len(trace)
    assert (f", in build\n    {failure}\n" in ended.stderr) is bool(trace)
    assert not (tmp_path / "results").exists()


ALONE = """
import sys
import flexfem as ff
from flexfem._checks import InputError
from flexfem.simulation.run import guard as run_guard, setup
run_guard._PATIENCE = 1.0
build = setup.build
def fails(*given, **named):
    if ff.launch.rank() == {leaving}:
        raise InputError("found here alone")
    return build(*given, **named)
setup.build = fails
def model():
    model = ff.Model("top")
    model.add(ff.RigidBody("body", 1.0, (0.1, 0.1, 0.2)))
    return model
"""
#: Ends of the script, and exit code and last words of the run.
ENDS = {
    "script": (
        "ff.simulate(model(), ff.RunOptions(dt=1e-3, t_end=1e-3, output=sys.argv[2]))",
        1, "InputError: found here alone\n",
    ),
    "case": (
        'sys.exit(ff.main(ff.Case("top", "a body", model, dt=1e-3, t_end=1e-3)))',
        2, "error: found here alone\n",
    ),
}  # fmt: skip


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("leaving", [pytest.param(0, marks=pytest.mark.slow), 1])
def test_input_refused_on_one_rank_while_a_model_is_built(
    leaving: int, end: str, tmp_path: Path, run: Callable[..., Any]
) -> None:
    """The others wait in a collective call of the same step: all end, with its error."""
    script, (last, code, words) = tmp_path / "script.py", ENDS[end]
    script.write_text(f"{ALONE.format(leaving=leaving)}\n{last}\n")
    # without the limit: no end at all
    ended = run(2, script, "--output", tmp_path / "results", timeout=90)
    assert ended.returncode == code
    assert ended.stderr.endswith(words)
