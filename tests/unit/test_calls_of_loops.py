# SPDX-License-Identifier: LGPL-3.0-or-later
"""Large functions are translated once and called, some of them not before they are needed."""

import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from flexfem.kernels.compiled import kernel, on_demand, subroutine

pytestmark = pytest.mark.serial


@subroutine
def _small(x):
    return 2.0 * x


@subroutine
def _large(values, out):
    """Long enough that no loop contains it, and with an error of its own."""
    if values.size != 6:
        raise ValueError("six values")
    for i in range(6):
        s = _small(values[i])
        for j in range(6):
            s += np.sin(values[j]) * np.cos(values[i]) / (1.0 + values[i] * values[j])
            out[i] += s * np.exp(-values[j]) + np.sqrt(abs(s)) * np.arctan2(s, values[j])
    for i in range(5):
        for j in range(4):
            out[i] += np.tan(out[j]) * np.cosh(out[i + 1]) + np.log(1.0 + abs(out[j]))
            out[j] -= np.hypot(out[i], out[j + 1]) / (2.0 + np.sinh(out[i]))


@subroutine
def _between(values, out):
    """Small, with a large part."""
    _large(values, out)


@kernel
def large_part(values, out):
    _between(values, out)
    return out[0]


@subroutine
def _larger(values, out):
    """Long as well, and calls a large one."""
    _large(values, out)
    for i in range(5):
        for j in range(4):
            out[i] -= np.tan(out[j]) * np.cosh(out[i + 1]) + np.log(2.0 + abs(out[j]))
            out[j] += np.hypot(out[i], out[j + 1]) / (3.0 + np.cosh(out[i]))
    for i in range(6):
        for j in range(6):
            out[i] += np.sin(values[j]) * np.cos(values[i]) / (1.0 + values[i] * values[j])
            out[i] *= np.exp(-values[j]) + np.arctan2(out[i], values[j])


@kernel
def one_way(values, out):
    _larger(values, out)
    return out[0]


@kernel
def another_way(values, out):
    _larger(values, out)
    return out[1]


@on_demand
def _first_kind(out):
    for i in range(out.size):
        out[i] = 1.0


@on_demand
def _second_kind(out):
    if out.size > 2:
        raise ValueError("two at most")
    for i in range(out.size):
        out[i] = 2.0


@on_demand
def _wrong_kind(out):
    out.no_such_thing()


@kernel
def by_kind(kind, out):
    if kind == 1:
        _first_kind(out)
    elif kind == 2:
        _second_kind(out)
    else:
        _wrong_kind(out)
    return out[0]


SCRIPT = """
import numpy as np
from tests.unit.test_calls_of_loops import by_kind, large_part
"""
LARGE = f"{SCRIPT}print(large_part(np.linspace(0.1, 0.7, 6), np.zeros(6)).hex())"


def run(folder: Path, script: str) -> subprocess.CompletedProcess[str]:
    """A program whose loops are kept in a folder."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder)}
    command = [sys.executable, "-c", script]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=True)


def made(folder: Path) -> set[str]:
    """Functions in the folder."""
    return {file.name.split("-")[0].split(".")[-1] for file in folder.rglob("*.nbi")}


@pytest.mark.slow
def test_file_of_a_loop_holds_large_functions_that_it_calls(tmp_path):
    values, expected = np.linspace(0.1, 0.7, 6), np.zeros(6)
    large_part(values, expected)
    first = run(tmp_path, LARGE).stdout
    assert first.strip() == float(expected[0]).hex()
    for file in [*tmp_path.rglob("*_large*"), *tmp_path.rglob("*_between*")]:
        file.unlink()
    assert run(tmp_path, LARGE).stdout == first
    assert made(tmp_path) == {"_small", "large_part"}  # nothing was compiled again
    for file in tmp_path.rglob("*large_part*"):
        file.unlink()
    assert run(tmp_path, LARGE).stdout == first
    for file in tmp_path.rglob("*large_part*"):
        file.unlink()
    assert run(tmp_path, LARGE).stdout == first  # from the files of its parts


@pytest.mark.slow
def test_files_of_all_loops_hold_what_large_functions_call(tmp_path):
    """The second loop is compiled where its parts came from the file of the first."""
    script = "from tests.unit.test_calls_of_loops import another_way, one_way\nimport numpy as np\n"
    script += "print(%s(np.linspace(0.1, 0.7, 6), np.zeros(6)).hex())"
    run(tmp_path, script % "one_way")
    both = run(tmp_path, f"{script % 'one_way'}\n{script % 'another_way'}").stdout
    assert run(tmp_path, script % "another_way").stdout == both.splitlines()[-1] + "\n"


def test_errors_of_large_functions_reach_the_caller():
    with pytest.raises(ValueError, match="six values"):
        large_part(np.zeros(5), np.zeros(6))
    with pytest.raises(ValueError, match="two at most"):
        by_kind(2, np.zeros(3))


@pytest.mark.slow
def test_functions_on_demand_are_compiled_when_they_are_called(tmp_path):
    script = f"{SCRIPT}print(by_kind(%d, np.zeros(2)))"
    assert run(tmp_path, script % 1).stdout == "1.0\n"
    assert made(tmp_path) == {"by_kind", "_first_kind"}
    assert run(tmp_path, script % 2).stdout == "2.0\n"
    assert made(tmp_path) == {"by_kind", "_first_kind", "_second_kind"}
    assert run(tmp_path, f"{script % 1};{script.splitlines()[-1] % 2}").stdout == "1.0\n2.0\n"


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_function_on_demand_that_cannot_be_compiled_ends_the_loop():
    with pytest.raises(RuntimeError, match="_wrong_kind cannot be compiled"):
        by_kind(3, np.zeros(2))


@pytest.mark.parametrize("called", [_between, _large, _first_kind])
def test_numba_keeps_no_loop_of_others_that_calls_them(called, tmp_path, monkeypatch):
    """Its file would call what is not there when it is loaded."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))

    def with_both(values, out):
        called(values, out)

    def with_one(values, out):
        called(out)

    own = numba.njit(cache=True)(with_one if called is _first_kind else with_both)
    with pytest.warns(numba.NumbaWarning, match="Cannot cache"):
        own(np.linspace(0.1, 0.7, 6), np.zeros(6))
