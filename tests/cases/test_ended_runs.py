# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs that are killed or fail, or find results of others: what is left is whole."""

import json
import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexfem.cli import command
from flexfem.io import read_history
from tests.cases.left_results import SUMMARY_KEYS, instants

pytestmark = pytest.mark.serial

ROOT = Path(__file__).parents[2]

# A pendulum whose bob is driven along X: out of reach, or not a number, from some time on.
FAILING = """\
import sys

import flexfem as ff


def build(drive):
    model = ff.Model("failing")
    motion = {
        "far": lambda t: 50.0 * t,
        "nan": lambda t: 0.0 if t < 5.5e-3 else float("nan"),
    }[drive]
    model.add(
        ff.RigidBody("bob", 1.0, (0.1, 0.1, 0.1), position=(0.6, 0.0, -0.8)),
        ff.Spherical("pin", ff.Ground(), ff.Marker("bob", offset=(-0.6, 0.0, 0.8))),
        ff.PrescribedTranslation(
            "drive", ff.Ground((0.6, 0.0, -0.8)), ff.Marker("bob"), motion, axis=(1.0, 0.0, 0.0)
        ),
        ff.PositionProbe("path", ff.Marker("bob")),
    )
    return model


CASE = ff.Case(name="failing", summary="", build=build, dt=1e-3, t_end=2e-2,
               options=(ff.Option("drive", str, "far", "motion", choices=("far", "nan")),))

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
"""


def start_long_run(
    output: Path, environment: dict[str, str], command: list[str]
) -> "subprocess.Popen[str]":
    """Start a run that takes minutes, and wait until some of it is written."""
    long = ["--dt", "5e-5", "--every", "5", "--output", str(output)]
    process = subprocess.Popen(
        command + long, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )
    end = time.monotonic() + 60.0
    while time.monotonic() < end and process.poll() is None:
        pvd = output / "beams.pvd"
        if pvd.exists() and pvd.read_text().count("DataSet") > 10:
            return process
        time.sleep(0.02)
    process.kill()
    pytest.fail(f"nothing was written: {process.communicate()[1]}")


def test_killed_run_leaves_readable_results(
    tmp_path: Path, environment: dict[str, str], command_line: Callable[..., list[str]]
) -> None:
    (tmp_path / "summary.json").write_text("{}")  # of an earlier run
    case = ROOT / "cases" / "flying_spaghetti.py"
    process = start_long_run(tmp_path, environment, command_line(2, case))
    process.kill()
    process.wait(timeout=60)
    process.communicate()
    time.sleep(0.5)  # the ranks end after mpirun
    history = read_history(tmp_path / "history.csv")
    times = instants(tmp_path / "beams.pvd")
    assert all(np.isfinite(column).all() for column in history.values())
    np.testing.assert_allclose(np.diff(history["t"]), 5e-5)
    assert len(times) > 9
    assert history["t"][-1] >= times[-1]
    assert not (tmp_path / "summary.json").exists()


@pytest.mark.parametrize(
    ("ranks", "drive", "reason"),
    [
        pytest.param(
            2,
            "far",
            r' at t = 0.007\d* s \(.*RigidBody "bob".*; reduce dt',
            marks=pytest.mark.slow,
        ),
        (1, "nan", r'^PrescribedTranslation "drive": .*not finite'),
    ],
)
def test_failed_run_keeps_what_it_has(
    ranks: int, drive: str, reason: str, tmp_path: Path, run: Callable[..., Any]
) -> None:
    case, output = tmp_path / "failing.py", tmp_path / "results"
    case.write_text(FAILING)
    ended = run(ranks, case, "--drive", drive, "--output", output)
    assert (ended.returncode, ended.stdout) == (1, "")
    lines = [line for line in ended.stderr.splitlines() if not line.startswith("warning: ")]
    summary = json.loads((output / "summary.json").read_text())
    assert re.search(reason, summary["status"])
    assert lines == [f"failed: {summary['status']}"]
    assert summary["rejected_steps"] > 0
    assert set(summary) >= SUMMARY_KEYS
    history = read_history(output / "history.csv")
    assert all(np.isfinite(column).all() for column in history.values())
    assert history["t"][-1] > 0.0049
    assert len(list(output.glob("checkpoint_*.h5"))) == 1
    for name in ("rigid_bodies", "joints"):
        assert instants(output / f"{name}.pvd")[-1] == history["t"][-1]


def test_earlier_results_of_another_model_are_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    for case, series in (
        ("chain", {"beams", "beam_surfaces", "joints", "reactions"}),
        ("heavy_top", {"rigid_bodies", "joints", "reactions"}),
        ("flying_spaghetti", {"beams"}),
    ):
        assert command(["run", case, "--smoke", "--quiet", "--output", str(tmp_path)]) == 0
        assert {pvd.stem for pvd in tmp_path.glob("*.pvd")} == series
        assert {file.parent.name for file in tmp_path.rglob("*.vtu")} == series


@pytest.mark.slow
def test_full_disk_is_told_in_one_line(
    tmp_path: Path, environment: dict[str, str], command_line: Callable[..., list[str]]
) -> None:
    """A limit on the size of files stands for a full disk."""
    script = tmp_path / "limited.py"
    script.write_text(
        "import resource, sys\n"
        "import flexfem as ff\nfrom flexfem.cli import load_case\n"
        "case, argv = load_case('heavy_top'), ['--quiet', '--output', sys.argv[1]]\n"
        "ff.main(case, [*argv, '--smoke'])  # caches of compiled code are files, too\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))\n"
        "sys.exit(ff.main(case, [*argv, '--t-end', '0.5']))\n"
    )
    output = tmp_path / "results"
    ended = subprocess.run(
        [*command_line(1, script), str(output)], capture_output=True, text=True, check=False,
        env=environment, timeout=400,
    )  # fmt: skip
    assert ended.returncode == 1
    assert ended.stderr.count("\n") == 1
    assert ended.stderr.startswith("failed: ")
    assert len(read_history(output / "history.csv")["t"]) > 50
