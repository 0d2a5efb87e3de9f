# SPDX-License-Identifier: LGPL-3.0-or-later
"""Processes that compile loops beside a first run."""

import inspect
import json
import os
import signal
import subprocess
import sys
import time
from importlib import import_module
from io import BytesIO
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import pytest
from numba import types
from numba.core.dispatcher import Dispatcher

import flexfem as ff
from flexfem import _beside
from flexfem.kernels.compile_once import busy
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.system import compile_beside as beside

pytestmark = pytest.mark.serial

#: A numbered model without anything.
NOTHING: Any = SimpleNamespace(families={}, model=SimpleNamespace(contacts=[], joints=[]))
COMMAND = [sys.executable, "-P", "-m", "flexfem.system.compile_beside"]


def test_list_is_that_of_the_package():
    """A loop that was renamed, or has other arguments: write the list again."""
    entries = list(beside._listed())
    assert len(entries) > 30
    for entry in entries:
        loop = attrgetter(entry.function)(import_module(entry.module))
        assert isinstance(loop, Dispatcher)
        parameters = inspect.signature(loop.py_func).parameters
        assert len(parameters) == len(entry.kinds), entry.function
        assert [beside.text_of(beside.kind_of(kind)) for kind in entry.kinds] == entry.kinds


def test_types_of_arguments_are_kept_as_texts():
    array = types.Array(types.float64, 2, "C", readonly=True)
    strided = types.Array(types.boolean, 1, "A")
    pair = types.UniTuple(types.int32, 2)
    mixed = types.Tuple((array, types.none, pair))
    for kind in (array, strided, types.int64, types.boolean, types.none, pair, mixed):
        text = json.loads(json.dumps(beside.text_of(kind)))
        assert beside.kind_of(text) == kind


class Pair(NamedTuple):
    """No class of the package."""

    first: int
    second: int


def test_types_that_cannot_be_listed_are_refused():
    named = types.NamedUniTuple(types.int64, 2, Pair)
    for kind in (named, types.unicode_type, types.Array(types.int64, 1, "C", aligned=False)):
        with pytest.raises(ValueError, match=r"no|cannot"):
            beside.text_of(kind)


@pytest.mark.parametrize("name", ["os:system", "flexfem.launch:rank", "flexfem._beside:Path"])
def test_nothing_but_named_tuples_of_the_package_is_taken_from_a_list(name):
    with pytest.raises(ValueError, match=r"no named tuple|no class"):
        beside.kind_of({name: ["int64"]})


@pytest.fixture
def short_list(tmp_path, monkeypatch):
    """A list of two loops in a module of usual loops and one in another."""
    frames, twists = "readonly array(float64, 2d, C)", "array(float64, 2d, C)"
    entries = [
        ["flexfem.lie.se3", "_log_loop", True, [frames, twists]],
        ["flexfem.lie.se3", "_gone", True, [frames]],
        ["flexfem.lie.so3", "_log_loop", False, [frames, twists]],
        ["flexfem.lie.so3", "_exp_loop", False, [frames, twists]],
    ]
    path = tmp_path / "loops.txt"
    path.write_text("".join(json.dumps(entry) + "\n" for entry in entries))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kept"))
    return path


RUN = """
import sys
from pathlib import Path
from flexfem import _beside

_beside.LIST = Path(sys.argv.pop(1))
from flexfem.system.compile_beside import _main

_main()
"""


def made(folder: Path) -> set[str]:
    """Loops that were compiled."""
    return {file.name.split("-")[0] for file in folder.rglob("*.nbi")}


@pytest.mark.slow
@pytest.mark.parametrize("told", [b"", b"flexfem.lie.so3 flexfem.none"])
def test_usual_loops_come_first_then_those_of_the_modules_that_are_told(short_list, told):
    command = [sys.executable, "-c", RUN, str(short_list), str(os.getpid())]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as process:
        assert process.stdin is not None
        kept = short_list.parent / "kept"
        end = time.monotonic() + 60.0
        while "se3._log_loop" not in made(kept) and time.monotonic() < end:
            time.sleep(0.05)
        process.stdin.write(told)
        process.stdin.close()
    assert process.returncode == 0
    loops = {"so3._log_loop", "so3._exp_loop"}
    assert made(kept) & (loops | {"se3._log_loop"}) == {"se3._log_loop"} | (
        loops if told else set()
    )


def test_process_ends_with_its_run_however_that_ends(short_list):
    """The run is ended with no time to say so, while the other process waits for its word."""
    run = (
        "import sys, time\nfrom flexfem import _beside\n"
        "_beside.start(1)\nprint(_beside._STARTED[0].pid, flush=True)\ntime.sleep(60)"
    )
    environment = {**os.environ, _beside.SWITCH: "1"}
    with subprocess.Popen(
        [sys.executable, "-c", run], stdout=subprocess.PIPE, env=environment
    ) as process:
        assert process.stdout is not None
        other = Path(f"/proc/{int(process.stdout.readline())}")
        time.sleep(0.5)
        process.send_signal(signal.SIGKILL)
    end = time.monotonic() + 30.0
    while other.exists() and time.monotonic() < end:
        time.sleep(0.05)
    assert not other.exists()


def test_process_of_another_parent_does_nothing(short_list):
    ended = subprocess.run([*COMMAND, "1"], input=b"flexfem.lie.se3", check=False)
    assert ended.returncode == 0
    assert not made(short_list.parent / "kept")


@pytest.fixture
def started(monkeypatch):
    """Commands of processes, which are not started, on four cores with nothing compiled."""
    commands = []

    def start(command, **_):
        commands.append(command)
        return SimpleNamespace(stdin=BytesIO())

    monkeypatch.setattr(_beside, "_STARTED", [])
    monkeypatch.setattr(_beside.atexit, "register", lambda _: None)
    monkeypatch.setattr(_beside.subprocess, "Popen", start)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(4)))
    monkeypatch.setenv(_beside.SWITCH, "1")
    index = type(se3._compose_loop._cache._cache_file)
    monkeypatch.setattr(index, "_load_index", lambda _: {})
    return commands


@pytest.mark.parametrize(("ranks", "count"), [(1, 3), (2, 2), (4, 1), (9, 1)])
def test_processes_of_a_first_run_are_for_the_cores_that_are_left(started, ranks, count):
    beside.compile_beside(NOTHING, ranks)
    assert [command[-2] for command in started] == ["flexfem.system.compile_beside"] * count
    assert all(process.stdin.closed for process in _beside._STARTED)
    beside.compile_beside(NOTHING, ranks)  # another model of the same program
    assert len(started) == count


def test_nothing_is_started_on_one_core_when_switched_off_or_later(started, monkeypatch):
    monkeypatch.setenv(_beside.SWITCH, "0")
    beside.compile_beside(NOTHING, 1)
    _beside.start(1)
    monkeypatch.setenv(_beside.SWITCH, "1")
    index = type(se3._compose_loop._cache._cache_file)
    monkeypatch.setattr(index, "_load_index", lambda _: {"kept": 1})
    beside.compile_beside(NOTHING, 1)
    monkeypatch.setattr(index, "_load_index", lambda _: {})
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    beside.compile_beside(NOTHING, 1)
    _beside.start(1)
    assert not started


def numbered(*things: Any) -> NumberedModel:
    """A cantilever beam, and what else there is."""
    steel = ff.Material(youngs_modulus=2.1e11, poisson_ratio=0.3, density=7850.0)
    mesh = ff.LineMesh.straight({"beam": [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]}, elements=4)
    model = ff.Model("one", mesh=mesh)
    model.add(
        ff.Beam("beam", ff.Section.circle(0.01, steel)),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "start")), *things,
    )  # fmt: skip
    return NumberedModel(model)


def test_only_modules_of_what_a_model_has_are_told():
    """All families are loaded whatever the model: their loops would be compiled for nothing."""
    import_module("flexfem.simulation.run.setup")
    parts = "beam_nurbs", "shell_director", "shell_rotation_free", "floating", "beam_se3"
    told = beside.modules_of(numbered())
    assert "flexfem.core.places.line_points" in told
    found = [any(f"flexfem.families.{part}." in name for name in told) for part in parts]
    assert found == [False, False, False, False, True]
    assert not any(".contact." in name or ".constraints.lines." in name for name in told)
    ring = ff.RigidBody("ring", 1.0, (1.0, 1.0, 1.0), position=(0.5, 0.0, 0.0))
    slide = ff.Sliding("slide", ff.Carrier("beam"), ff.Marker("ring"))
    told = beside.modules_of(numbered(ring, slide))
    assert "flexfem.constraints.lines.hessians" in told


@pytest.mark.parametrize("variable", ["NUMBA_CACHE_DIR", "XDG_CACHE_HOME"])
def test_command_starts_them_where_nothing_was_ever_compiled(
    started, tmp_path, monkeypatch, variable
):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(_beside, "LIST", tmp_path / "flexfem" / "system" / "loops.txt")
    _beside.LIST.parent.mkdir(parents=True)
    _beside.LIST.write_text(json.dumps(["flexfem.kernels.driver", "add_forces", True, []]) + "\n")
    monkeypatch.setenv(variable, str(tmp_path / "kept"))
    _beside.start_early()
    assert len(started) == 3
    _beside._STARTED.clear()
    numba = tmp_path / "kept" / ("" if variable == "NUMBA_CACHE_DIR" else "numba")
    (numba / "kernels_0123").mkdir(parents=True)
    (numba / "kernels_0123" / "driver.add_forces-1.py312.flexfem.nbi").touch()
    _beside.start_early()
    assert len(started) == 3


def test_other_ranks_start_none(started, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("PMI_RANK", "1")
    _beside.start_early()
    assert not started


def test_processes_that_cannot_be_started_or_have_ended_are_no_fault(started, monkeypatch):
    class Ended(BytesIO):
        def write(self, _):
            raise BrokenPipeError

    monkeypatch.setattr(_beside, "_STARTED", [SimpleNamespace(stdin=Ended())])
    _beside.tell(["flexfem.lie.se3"])

    def fail(*_, **__):
        raise BlockingIOError

    monkeypatch.setattr(_beside, "_STARTED", [])
    monkeypatch.setattr(_beside.subprocess, "Popen", fail)
    _beside.start(1)
    assert not _beside.started()


HOLD = """
import sys
from flexfem.kernels.compile_once import _lock, _lock_file, _place
from flexfem.lie.se3 import _compose_loop as loop
assert _lock(_lock_file(loop._cache.cache_path), _place(loop._cache, ()))
print("held", flush=True)
sys.stdin.read()
"""


def test_loops_that_another_process_compiles_are_seen():
    loop = se3._compose_loop
    assert not busy(loop, ())
    with subprocess.Popen(
        [sys.executable, "-c", HOLD], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"held\n"
        assert busy(loop, ())
        assert not busy(loop, ("other types",))
        other.communicate()
    assert not busy(loop, ())
