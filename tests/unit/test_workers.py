# SPDX-License-Identifier: LGPL-3.0-or-later
"""Workers: many runs in one process, whatever they do to it."""

import os
import time
from pathlib import Path

import pytest

import flexfem as ff
from flexfem.studies.workers import Answer

pytestmark = pytest.mark.serial

# A case that is refused when it has left traces in its process, or ended it.
MOODY = """\
import os
import sys
import time

import flexfem as ff


def build(act):
    if act == "die":
        os.kill(os.getpid(), 9)
    if act == "leave":
        os._exit(5)
    if act == "sleep":
        print("asleep", flush=True)
        time.sleep(60)
    traces = [name for name in ("TRACE",) if name in os.environ]
    os.environ["TRACE"] = "1"
    os.chdir("/")
    read = sys.stdin.read()
    sys.stdout = sys.stderr
    raise ValueError(f"{os.getpid()} {traces} {read!r}")


CASE = ff.Case(
    name="moody", summary="", build=build, dt=1e-3, t_end=0.02,
    options=(ff.Option("act", str, "refuse", ""),),
)
"""


def test_a_worker_makes_many_runs_and_is_replaced_when_it_dies(command_folder: Path) -> None:
    """Runs find the process as it was at first; nothing is left of any worker at the end."""
    Path("moody.py").write_text(MOODY)
    told, codes = [], []
    with ff.Workers(jobs=1) as workers:
        for number, act in enumerate(("refuse", "refuse", "die", "refuse", "leave", "sleep")):
            log = Path(f"log{number}")
            workers.start(number, ["moody.py", f"--act={act}", f"--output=out{number}"], log)
            assert (workers.full, workers.running) == (True, [number])
            end = time.monotonic() + 60.0
            while not (ended := workers.ended()) and "asleep" not in log.read_text():
                assert time.monotonic() < end
            codes += ended
            told.append(log.read_text())
        begin = time.monotonic()
    assert time.monotonic() < begin + 10.0  # the run that sleeps has been interrupted
    assert codes == [(0, 2), (1, 2), (2, -9), (3, 2), (4, 5)]
    first, second, third = (told[k].split("ValueError: ")[1].split(" ", 1) for k in (0, 1, 3))
    assert first[0] == second[0] != third[0]
    assert first[1] == second[1] == third[1] == "[] ''\n"  # no traces, and nothing to read
    for pid in (first[0], third[0]):  # neither running nor a zombie
        with pytest.raises(ProcessLookupError):
            os.kill(int(pid), 0)


def test_numbers_and_answers() -> None:
    with pytest.raises(ValueError, match="jobs must be a whole number >= 1, got 0"):
        ff.Workers(jobs=0)
    with pytest.raises(TypeError, match="ranks"):
        ff.Workers(ranks="2")
    with pytest.raises(ValueError, match="give neither"):
        ff.sweep("heavy_top", {"dt": [1e-3]}, jobs=2, workers=ff.Workers(1))
    for answer in (Answer(0, True), Answer(130, False)):
        assert Answer.found(answer.line().rstrip()) == answer
    assert Answer.found(b"warning: flexfem") is None
