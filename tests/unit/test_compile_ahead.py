# SPDX-License-Identifier: LGPL-3.0-or-later
"""``flexfem compile`` leaves loops and forms behind for all later runs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from flexfem.resources import shipped_files
from flexfem.studies.compile_ahead import KINDS_OF_MODELS

pytestmark = pytest.mark.serial

# A loop of its own: those of the package, which other tests need as well, may be there already.
CASE = """
import flexfem as ff
from flexfem.kernels.compiled import kernel


@kernel
def weight(mass):
    return -9.81 * mass


def build():
    model = ff.Model("fall")
    model.add(
        ff.RigidBody("stone", 1.0, (1.0, 1.0, 1.0)),
        ff.PointForce("weight", ff.Marker("stone"), (0.0, 0.0, weight(1.0))),
    )
    return model


CASE = ff.Case(name="fall", summary="a stone falls", build=build, dt=0.01, t_end=100.0, smoke={})
"""


def compile_command(folder: Path, *names: str) -> subprocess.CompletedProcess[str]:
    """The command in a folder; loops are kept beside the files that they are from."""
    command = [sys.executable, "-P", "-m", "flexfem", "compile", *names]
    environment = {name: v for name, v in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


def test_loops_are_kept_and_nothing_else(tmp_path):
    (tmp_path / "fall.py").write_text(CASE.replace("smoke={}", 'smoke={"t_end": 0.02}'))
    ended = compile_command(tmp_path, "fall.py")
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.startswith("fall.py: ")
    assert [path.name.split("-")[0] for path in tmp_path.rglob("*.nbc")] == ["fall.weight"]
    assert {path.name for path in tmp_path.iterdir()} == {"fall.py", "__pycache__"}


@pytest.mark.slow
def test_faults_are_told(tmp_path):
    """A case that cannot be built, and one that is not there."""
    (tmp_path / "broken.py").write_text(CASE.replace('"stone", 1.0', '"stone", -1.0'))
    ended = compile_command(tmp_path, "broken.py")
    assert ended.returncode == 1
    assert "broken.py: exit code 2: error: " in ended.stderr
    assert "stone" in ended.stderr
    missing = compile_command(tmp_path, "no_such_case")
    assert missing.returncode == 2
    assert "unknown case 'no_such_case'" in missing.stderr
    none = compile_command(tmp_path, "--jobs", "0")
    assert none.returncode == 2


def test_default_cases_are_shipped():
    assert set(KINDS_OF_MODELS) <= set(shipped_files("cases"))
