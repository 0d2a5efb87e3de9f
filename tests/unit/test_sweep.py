# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sweeps: values and their checks, tables, failed and interrupted runs, going on."""

import csv
import json
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexfem as ff
from flexfem import cli
from flexfem.io.folder_lock import FolderLock
from flexfem.launch import environment_of_runs
from flexfem.options import Option, VectorOption, with_components
from flexfem.studies.folders import RunFolder
from flexfem.studies.plan import Plan
from flexfem.studies.reductions import Reduction
from flexfem.studies.variations import combinations, parse_variation

pytestmark = pytest.mark.serial

# A bob on a rod of 1 m, driven along X: x = 0.6 + speed t up to its reach; slow while a file is
# there.
DRIVEN = """\
import time
from pathlib import Path

import flexfem as ff

SLOW = Path(__file__).with_name("slow")


def build(speed, note, place):
    def drive(t):
        time.sleep(0.05 * SLOW.exists())
        return speed * t

    bob = ff.Marker("bob")
    model = ff.Model("driven")
    model.add(
        ff.RigidBody("bob", 1.0, (0.1, 0.1, 0.1), position=(0.6, 0.0, -0.8)),
        ff.Spherical("pin", ff.Ground(), ff.Marker("bob", offset=(-0.6, 0.0, 0.8))),
        ff.PrescribedTranslation(
            "drive", ff.Ground((0.6, 0.0, -0.8)), bob, drive, axis=(1.0, 0.0, 0.0)
        ),
        ff.PositionProbe("path", bob),
    )
    return model


CASE = ff.Case(
    name="driven", summary="", build=build, dt=1e-3, t_end=0.02,
    options=(
        ff.Option("speed", float, 1.0, "of the drive", unit="m/s"),
        ff.Option("note", bool, False, "changes nothing"),
        ff.VectorOption("place", (1.0, 2.0), "changes nothing either"),
    ),
    results=lambda history: {"reached": history["path_x"][-1], "status": 7.0},
)
"""


@pytest.fixture
def driven(command_folder: Path) -> Path:
    """The case file, in the working directory."""
    path = command_folder / "driven.py"
    path.write_text(DRIVEN)
    return path


def table(folder: Path) -> dict[str, dict[str, str]]:
    """Rows of a table by the names of the runs."""
    with (folder / "sweep.csv").open() as stream:
        return {row["run"]: row for row in csv.DictReader(stream)}


# -- values ---

OPTIONS = with_components(
    (
        Option("dt", float, 1.0, "", above=0),
        Option("elements", int, 1, "", minimum=1),
        Option("shape", str, "round", "", choices=("round", "square")),
        Option("damped", bool, False, ""),
        VectorOption("gravity", (0, 0, -9.81), ""),
    )
)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("dt=1e-3,5e-4", [1e-3, 5e-4]),
        ("dt=0.1:0.5:5", [0.1, 0.2, 0.3, 0.4, 0.5]),  # as typed: 0.3, not 0.30000000000000004
        ("dt=1e-4:1e-1:4:log", [1e-4, 1e-3, 1e-2, 1e-1]),
        ("dt=7,1:2:2", [7.0, 1.0, 2.0]),
        ("--elements=2:8:3,20", [2, 5, 8, 20]),
        ("shape=round,square", ["round", "square"]),
        ("damped=yes,no", [True, False]),
        ("gravity=0,0,-9.81;0,0,-1.62", [(0.0, 0.0, -9.81), (0.0, 0.0, -1.62)]),
        ("gravity[2]=-9:-1:3", [-9.0, -5.0, -1.0]),
    ],
)
def test_values_of_options(text: str, values: list[Any]) -> None:
    name, found = parse_variation(text, OPTIONS)
    assert name in text
    assert found == values
    assert [type(one) for one in found] == [OPTIONS[name].kind] * len(values)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("dt", "not of the form"),
        ("=1", "not of the form"),
        ("elemnts=1", "did you mean elements"),
        ("dt=1,0", "dt must be a finite number > 0, got '0'"),
        ("dt=", "got ''"),
        ("dt=1:2:1", "count > 1"),
        ("dt=1:2", "start:stop:count"),
        ("dt=1:2:x", "start:stop:count"),
        ("dt=1:2:3:lin", "with :log"),
        ("dt=-1:2:3:log", "above 0 with log"),
        ("dt=-1:1:3", "got '-1.0'"),
        ("dt=1:2:1000000", "more than"),
        ("elements=1:2:4", "has 1.33333, which must be a whole number"),
        ("damped=1", "yes or no"),
        ("shape=oval", "got 'oval'"),
        ("gravity=0,0", "gravity must be 3 numbers separated by commas, .*, got '0,0'"),
        ("gravity[3]=0", r"no option 'gravity\[3\]', did you mean gravity\[2\]"),
    ],
)
def test_values_that_are_refused(text: str, part: str) -> None:
    with pytest.raises(ValueError, match=part):
        parse_variation(text, OPTIONS)


def test_combinations() -> None:
    varied = {"a": [1, 2], "b": ["x", "y"]}
    assert [list(one.values()) for one in combinations(varied, False)] == [
        [1, "x"], [1, "y"], [2, "x"], [2, "y"],
    ]  # fmt: skip
    assert [list(one.values()) for one in combinations(varied, True)] == [[1, "x"], [2, "y"]]


def test_reductions_of_a_history_with_uneven_steps() -> None:
    """Means over time: those over rows would be 0.4 and 0.52."""
    t = np.array([0.0, 0.1, 0.2, 0.5, 1.2])
    history = {"t": t, "x": t}

    def of(text: str) -> float | None:
        return Reduction.parse(text).of(history)

    assert (of("final:x"), of("max:x"), of("min:x")) == (1.2, 1.2, 0.0)
    assert of("mean:x") == pytest.approx(0.6, rel=1e-14)  # exact for a straight line
    square = np.trapezoid(t**2, t) / 1.2
    assert of("rms:x") == pytest.approx(square**0.5, rel=1e-14)
    assert of("max:y") is None
    turning = {"t": np.array([0.0, 1.0, 0.5]), "x": np.array([3.0, 6.0, 0.0])}  # an arc-length path
    assert Reduction.parse("mean:x").of(turning) == 3.0


# -- wrong input ---


@pytest.mark.parametrize(
    ("line", "part"),
    [
        ("", "nothing to vary, give options and their values"),
        ("--vary speed=1,1", "speed=1.0 comes twice"),
        ("--vary sped=1,2", "did you mean speed"),
        ("--vary speed=1,nan", "got 'nan'"),
        ("--vary speed=1 --vary speed=2", "--vary speed is given twice"),
        ("--vary speed=1,2 --speed 3", "speed is varied"),
        ("--vary dt=1e-3,0.5", "dt=0.5: RunOptions: dt 0.5 s exceeds t_end 0.02 s"),
        ("--vary place=1,2;3,4 --place[0] 3", "place is varied"),
        ("--vary place=1,2;3,4 --vary place[1]=3,4", "place[1] is varied"),
        ("--vary speed=1,2 --place 1", "--place: must be 2 numbers separated by commas, each a"),
        ("--vary speed=1,2 --dt 0", "--dt"),
        ("--vary speed=1,2 --unknown 3", "--unknown"),
        ("--vary speed=1,2 --vary dt=1e-3 --zip", "2 of speed, 1 of dt"),
        ("--vary speed=1,2 --jobs 0", "argument --jobs: must be a whole number >= 1, got '0'"),
        ("--vary speed=1,2 --ranks x", "argument --ranks"),
        ("--vary speed=1,2 --reduce top:path_x", "not of the form"),
        ("--vary speed=1,2 --reduce max:path_x,max:tip", "speed=1.0: no column 'tip'"),
        ("--vary speed=1,2 --restart file.h5", "--restart"),
        ("--vary speed=1,2 --progress often", "--progress"),
        ("--vary speed=1,2 --output driven.py", "driven.py"),
        ("--vary speed=1,2 --output mine", "'mine' is not empty and not that of a sweep"),
        ("--vary speed=1,2 --output others", "another sweep, its case: "),
    ],
)
def test_wrong_input_is_one_line(
    line: str, part: str, driven: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mine, others = Path("mine"), Path("others")
    mine.mkdir()
    (mine / "notes.txt").touch()
    others.mkdir()
    (others / "sweep.json").write_text('{"case": "heavy_top"}')
    before = sorted(driven.parent.rglob("*"))
    assert cli.command(["sweep", str(driven), *line.split()]) == 2
    captured = capsys.readouterr()
    assert (captured.out, captured.err.count("\n")) == ("", 1)
    assert part in captured.err
    kept = [path for path in driven.parent.rglob("*") if "__pycache__" not in path.parts]
    assert sorted(kept) == before


def test_sweeps_do_not_start_under_a_launcher(
    driven: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PMI_SIZE", "2")
    monkeypatch.setenv("PMI_RANK", "0")
    monkeypatch.setenv("OMP_NUM_THREADS", "8")
    with pytest.raises(ValueError, match="one process"):
        ff.sweep(driven, {"speed": [1.0]})
    environment = environment_of_runs()
    assert not {"PMI_SIZE", "PMI_RANK"} & set(environment)
    assert environment["OMP_NUM_THREADS"] == "1"


def test_arguments_and_names_of_runs(driven: Path) -> None:
    plan = Plan(
        driven, {"note": [True, False]}, {"speed": -1}, together=False, smoke=True, analysis=None
    )
    path = str(driven)
    assert [run.name for run in plan.runs] == ["note=yes", "note=no"]
    assert [list(run.arguments) for run in plan.runs] == [
        [path, "--smoke", "--speed=-1.0", "--note"], [path, "--smoke", "--speed=-1.0", "--no-note"],
    ]  # fmt: skip


def test_vectors_and_their_components(driven: Path) -> None:
    """Components leave the others as they are; summaries and finished runs know them."""
    plan = Plan(
        driven, {"place[1]": [5, 6]}, {"place": [7, 8]}, together=False, smoke=True, analysis=None
    )
    path = str(driven)
    assert [run.name for run in plan.runs] == ["place.1=5.0", "place.1=6.0"]
    assert list(plan.runs[0].arguments) == [path, "--smoke", "--place=7.0,8.0", "--place[1]=5.0"]
    assert json.loads(json.dumps(plan.runs[0].record)) == plan.runs[0].record
    case = ff.load_case(driven)
    parameters, settings = case.prepare({"place[1]": 5, "place": np.array([7, 8])})
    assert parameters["place"] == (7.0, 5.0)
    assert settings.recorded["place"] == (7.0, 5.0)
    assert settings.recorded["dt"] == 1e-3
    for wrong in ("12", 1.0, [1.0], [1.0, 2.0, 3.0], [1.0, "x"], [1.0, np.nan]):
        with pytest.raises((TypeError, ValueError), match="place must be 2 numbers"):
            case.prepare({"place": wrong})
    for wrong in ((), "12", 1.0, ("a", "b")):
        with pytest.raises((TypeError, ValueError), match="Option 'bad'"):
            VectorOption("bad", wrong, "")
    with pytest.raises(ValueError, match="several numbers are a VectorOption"):
        Option("bad", tuple, (1.0,), "")


def test_finished_runs_are_known_by_options_and_case_file(driven: Path) -> None:
    def folder(dt: float = 1e-3) -> RunFolder:
        plan = Plan(
            driven, {"speed": [1.0]}, {"dt": dt}, together=False, smoke=False, analysis=None
        )
        return RunFolder(driven.parent, plan.runs[0])

    assert not folder().finished
    assert folder().prepare() == []
    (folder().path / "summary.json").write_text('{"status": "ok"}')
    assert folder().finished
    assert not folder(dt=2e-3).finished
    (folder().path / "summary.json").write_text('{"status": "interrupted at t = 0.01 s"}')
    (folder().path / "checkpoint_999999.h5").touch()
    (folder().path / "checkpoint_1000000.h5").touch()
    assert folder().prepare() == [f"--restart={folder().path / 'checkpoint_1000000.h5'}"]
    driven.write_text(DRIVEN + "# changed\n")
    assert folder().prepare() == []
    assert not (folder().path / "summary.json").exists()


# -- runs ---


def test_a_loaded_case_runs_in_this_process(driven: Path) -> None:
    case = ff.load_case(driven)
    outcome = case.run(speed=2, t_end=5e-3)
    assert outcome.status == "ok"
    # the drive is met to the tolerance of a step; the default speed gives 0.605
    assert outcome.summary["results"]["reached"] == pytest.approx(0.61, abs=1e-6)
    with pytest.raises(ValueError, match="no option 'sped', did you mean speed"):
        case.run(sped=2.0)
    with pytest.raises(TypeError, match="speed must be a finite number"):
        case.run(speed="2")
    with pytest.raises(ValueError, match="unknown case 'chan': did you mean chain"):
        ff.load_case("chan")
    assert not list(driven.parent.glob("results"))


@pytest.mark.slow
def test_a_failed_run_does_not_end_a_sweep(
    driven: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Successful runs are not repeated, failed ones are, and values may be added."""
    line = "--vary speed=1,50 --reduce final:path_x,mean:path_x --output study --progress lines"
    line += " --place[1] 4"
    assert cli.command(["sweep", str(driven), *line.split(), "--plot", "path_x"]) == 1
    assert Path("study", "comparison.png").is_file()  # of what ended well
    told = capsys.readouterr().err
    assert told.splitlines()[-1] == "failed: 1 of 2 runs, see study/sweep.csv"
    assert "speed=1.0: ok, " in told
    rows = table(Path("study"))
    good, bad = rows["speed=1.0"], rows["speed=50.0"]
    assert good["status"] == "ok"
    assert good["result_status"] == "7.0"  # a result with the name of a column of the table
    # the drive is met to the tolerance of a step; another row would be off by 1e-3
    assert float(good["reached"]) == pytest.approx(0.62, abs=1e-6)
    assert float(good["path_x_final"]) == float(good["reached"])
    assert float(good["path_x_mean"]) == pytest.approx(0.61, abs=1e-6)
    assert " at t = 0.007" in bad["status"]  # out of reach at t = 0.008
    summary = json.loads((Path("study") / "speed=1.0" / "summary.json").read_text())
    assert (summary["options"]["place"], summary["options"]["note"]) == ([1.0, 4.0], False)
    made = {name: (Path("study") / name / "summary.json").stat().st_mtime_ns for name in rows}

    again = ff.sweep(
        str(driven), {"speed": [1, 50.0, -1]}, reduce=["final:path_x", "mean:path_x"],
        options={"place[1]": 4}, output="study",
    )  # fmt: skip
    seen = [(parameters["speed"], results["status"] == "ok") for parameters, results in again]
    assert seen == [(1.0, True), (50.0, False), (-1.0, True)]
    assert again.failed == 1
    assert again.results[2]["path_x_final"] == pytest.approx(0.58, abs=1e-6)
    assert list(table(Path("study"))) == ["speed=1.0", "speed=50.0", "speed=-1.0"]
    now = {name: (Path("study") / name / "summary.json").stat().st_mtime_ns for name in rows}
    assert [name for name in made if made[name] != now[name]] == ["speed=50.0"]


def test_one_sweep_in_a_folder(driven: Path) -> None:
    """A second one is refused in one line and runs nothing; the folder is free afterwards."""
    study = ff.sweep(str(driven), {"speed": [1.0]}, output="study")
    other = FolderLock(Path("study"))
    other.take()
    before = sorted(Path("study").rglob("*"))
    with pytest.raises(ValueError, match="output folder 'study' is in use by another run, process"):
        study.run()
    assert sorted(Path("study").rglob("*")) == before
    other.release()
    assert [row["status"] for row in study.run()] == ["ok"]
    other.take()  # a sweep that has ended leaves the folder to others
    other.release()


@pytest.mark.slow
def test_an_interrupted_sweep_goes_on_by_the_command_it_shows(driven: Path) -> None:
    """Runs on two ranks write checkpoints when the sweep is interrupted."""
    (driven.parent / "slow").touch()
    line = "--vary speed=2 --ranks 2 --every 1 --output study --quiet"
    command = [sys.executable, "-m", "flexfem", "sweep", str(driven), *line.split()]
    environment = environment_of_runs()
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=environment)
    history = Path("study", "speed=2.0", "history.csv")
    end = time.monotonic() + 60.0
    while not (history.exists() and history.read_text().count("\n") > 3):
        assert time.monotonic() < end
        assert process.poll() is None
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGTERM)
    told = process.communicate(timeout=60)[1].splitlines()
    assert process.returncode == 128 + signal.SIGTERM
    start, _, shown = told[-1].partition(", go on with: ")
    assert (len(told), start) == (1, "interrupted after 0 of 1 runs")
    (row,) = table(Path("study")).values()
    assert row["status"].startswith("interrupted at t = ")

    (driven.parent / "slow").unlink()
    ended = subprocess.run(
        shlex.split(shown), capture_output=True, text=True, check=False, env=environment,
        timeout=120,
    )  # fmt: skip
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")
    (row,) = table(Path("study")).values()
    assert row["status"] == "ok"
    assert float(row["reached"]) == pytest.approx(0.64, abs=1e-6)
    summary = json.loads(history.with_name("summary.json").read_text())
    assert summary["ranks"] == 2
    assert 2 <= summary["restarted_at_step"] < 20
    assert len(history.read_text().splitlines()) == 22  # header and 21 instants
