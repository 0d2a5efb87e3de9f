# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shipped cases of eigenanalysis as a user runs them."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexfem as ff
from flexfem.cli import command
from flexfem.io import read_history
from tests.cases.conftest import RunCases

pytestmark = pytest.mark.serial

ROOT = Path(__file__).parents[2]
RUNS = {"blade": ["--frames", 4, "--amplitude", 0.1], "campbell": []}


@pytest.fixture(scope="module")
def folders(run_cases: RunCases, tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """Folders of the runs on one and two ranks."""
    made = {ranks: tmp_path_factory.mktemp(f"ranks{ranks}") for ranks in (1, 2)}
    for ranks, folder in made.items():
        common = ["--smoke", "--split-above", 1, "--output"]
        runs = [[case, *own, *common, folder / case] for case, own in RUNS.items()]
        assert run_cases(ranks, runs).stderr == ""
    return made


@pytest.mark.slow
@pytest.mark.parametrize("case", RUNS)
def test_same_table_on_two_ranks(case: str, folders: dict[int, Path]) -> None:
    tables = []
    for ranks, folder in folders.items():
        summary = json.loads((folder / case / "summary.json").read_text())
        assert (summary["case"], summary["ranks"], summary["status"]) == (case, ranks, "ok")
        assert summary["results"]
        tables.append(read_history(folder / case / "history.csv"))
    one, two = tables
    assert list(one) == list(two)
    for column, values in one.items():
        # round-off in the matrices; a missing entry at a boundary between ranks is far above.
        # Senses of whirl and damping ratios are measured by one
        bound = 1e-9 * max(np.abs(values).max(), 1.0)
        np.testing.assert_allclose(two[column], values, rtol=0, atol=bound, err_msg=column)


@pytest.mark.slow
def test_modes_are_animated_over_one_period(folders: dict[int, Path]) -> None:
    folder = folders[2] / "blade"
    table = read_history(folder / "history.csv")
    for number, frequency in zip(table["t"], table["frequency"], strict=True):
        text = (folder / f"mode_{int(number):02d}" / "beams.pvd").read_text()
        times = [float(part.split('"')[0]) for part in text.split('timestep="')[1:]]
        # quarters of the period; whole periods or Hz for rad/s would be off by factors
        np.testing.assert_allclose(times, np.arange(4) / (4 * frequency), rtol=1e-6)


def _arm() -> ff.Model:
    """A soft arm on a driven hub."""
    mesh = ff.LineMesh.straight({"arm": [(0, 0, 0), (1, 0, 0)]}, elements=4)
    hub, axis, model = ff.Marker("arm", "start"), (0, 0, 1), ff.Model("arm", mesh=mesh)
    model.add(
        ff.Beam("arm", ff.Section.circle(0.05, ff.Material(1e6, 0.3, 1e3))),
        ff.Revolute("bearing", ff.Ground(), hub, axis=axis),
        ff.PrescribedAngle("drive", ff.Ground(), hub, axis=axis),
    )
    return model


def test_speeds_before_one_without_an_equilibrium(
    command_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A linear elastic arm bears up to pi/2 sqrt(E/rho)/L = 49.7 rad/s, the third speed is 50."""
    case = ff.Case(
        name="arm", summary="a soft arm", build=_arm, analysis=ff.CAMPBELL, modes=2,
        spin_end=100.0, speeds=5,
    )  # fmt: skip
    code = ff.main(case, ["--quiet", "--output", "results"])
    status = json.loads((command_folder / "results" / "summary.json").read_text())["status"]
    assert status.startswith("the Newton iteration did not converge at the spin 50 rad/s; ")
    assert (code, capsys.readouterr().err) == (1, f"failed: {status}\n")
    # a row of what has failed would be a third one
    assert read_history(command_folder / "results" / "history.csv")["t"].tolist() == [0.0, 25.0]


def test_diagram_is_drawn_from_files_alone(folders: dict[int, Path], tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    shutil.copytree(folders[1] / "campbell", tmp_path, dirs_exist_ok=True)
    program = [sys.executable, ROOT / "postprocess" / "plot_campbell.py", tmp_path]
    for axes in ("fixed", "turning"):
        picture = tmp_path / f"{axes}.png"
        subprocess.run([*program, "--axes", axes, "--output", picture], check=True)
        assert picture.read_bytes()[:4] == b"\x89PNG"
    (tmp_path / "history.csv").write_text("t,tip_x\n0.0,1.0\n")
    ended = subprocess.run(program, capture_output=True, text=True, check=False)
    assert ended.returncode == 2
    assert "no modes over the speed" in ended.stderr


#: What every rank finds in the model; of options every rank reads the same.
SPINNING = (
    "blade", ["--axis", "y", "--smoke"], 'Revolute "bearing": prevents rotation of the model'
)  # fmt: skip
MISTAKES = [
    ("blade", ["--modes", "0"], "must be a whole number >= 1"),
    ("blade", ["--smoke", "--modes", "500"], "modes must not exceed the 24 degrees of freedom"),
    ("blade", ["--axis", "0,0,0"], "axis must not be zero"),
    SPINNING,
    ("campbell", ["--spin-end", "0"], "spin_end must differ from spin 0 rad/s"),
    ("campbell", ["--speeds", "1"], "must be a whole number >= 2"),
    ("blade", ["--dt", "1e-3"], "unrecognized arguments"),
]


@pytest.mark.parametrize(("case", "arguments", "message"), MISTAKES)
def test_mistakes_leave_nothing(
    case: str, arguments: list[str], message: str, capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
) -> None:  # fmt: skip
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    output = tmp_path / "results"
    assert command(["run", case, *arguments, "--output", str(output)]) == 2
    text = capfd.readouterr().err
    assert message in text
    assert text.count("\n") == 1
    assert not output.exists()


@pytest.mark.slow
def test_a_mistake_found_by_two_ranks_leaves_nothing(
    run: Callable[..., Any], tmp_path: Path
) -> None:
    case, arguments, message = SPINNING
    output = tmp_path / "results"
    ended = run(2, ROOT / "cases" / f"{case}.py", *arguments, "--output", output)
    assert ended.returncode == 2
    assert message in ended.stderr
    assert ended.stderr.count("\n") == 1
    assert not output.exists()
