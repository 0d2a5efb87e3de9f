# SPDX-License-Identifier: LGPL-3.0-or-later
"""Processes that compile loops beside a first run."""

import inspect
import os
import subprocess
import sys
from importlib import import_module
from io import BytesIO
from types import SimpleNamespace

import pytest
from numba.core.dispatcher import Dispatcher

from flexfem.lie import se3
from flexfem.lie.compile_once import busy
from flexfem.system import compile_beside as beside

pytestmark = pytest.mark.serial


def test_list_is_that_of_the_package():
    """A loop that was renamed, or has other arguments: write the list anew."""
    lines = beside.LIST.read_text(encoding="ascii").splitlines()
    assert len(lines) > 30
    for line in lines:
        module, function, *kinds = line.split("\t")
        loop = getattr(import_module(module), function)
        assert isinstance(loop, Dispatcher)
        assert len(inspect.signature(loop.py_func).parameters) == len(kinds), function
        assert [str(beside._kind(kind)) for kind in kinds] == kinds


def test_process_compiles_loops_of_the_modules_that_it_is_told(tmp_path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-P", "-m", "flexfem.system.compile_beside"]
    subprocess.run(command, input=b"flexfem.lie.se3 flexfem.none", env=environment, check=True)
    made = {file.name.split("-")[0] for file in tmp_path.rglob("*.nbi")}
    assert {"se3._compose_loop", "se3._log_loop"} <= made
    assert not any("row_kernels" in name for name in made)


@pytest.fixture
def started(monkeypatch):
    """Commands of processes, which are not started, on four cores with nothing compiled."""
    commands = []

    def start(command, **_):
        commands.append(command)
        return SimpleNamespace(stdin=BytesIO())

    monkeypatch.setattr(beside, "_STARTED", [])
    monkeypatch.setattr(beside.atexit, "register", lambda _: None)
    monkeypatch.setattr(beside.subprocess, "Popen", start)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(4)))
    monkeypatch.setenv(beside.SWITCH, "1")
    index = type(se3._compose_loop._cache._cache_file)
    monkeypatch.setattr(index, "_load_index", lambda _: {})
    return commands


@pytest.mark.parametrize(("ranks", "count"), [(1, 3), (2, 2), (4, 1), (9, 1)])
def test_processes_of_a_first_run_are_for_the_cores_that_are_left(started, ranks, count):
    beside.compile_beside(ranks)
    assert [command[-1] for command in started] == ["flexfem.system.compile_beside"] * count
    beside.compile_beside(ranks)  # another model of the same program
    assert len(started) == count


def test_nothing_is_started_on_one_core_when_switched_off_or_later(started, monkeypatch):
    monkeypatch.setenv(beside.SWITCH, "0")
    beside.compile_beside(1)
    monkeypatch.setenv(beside.SWITCH, "1")
    index = type(se3._compose_loop._cache._cache_file)
    monkeypatch.setattr(index, "_load_index", lambda _: {"kept": 1})
    beside.compile_beside(1)
    monkeypatch.setattr(index, "_load_index", lambda _: {})
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    beside.compile_beside(1)
    assert not started


HOLD = """
import sys
from flexfem.lie.compile_once import _lock, _lock_file, _place
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
