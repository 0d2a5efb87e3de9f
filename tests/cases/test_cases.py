# SPDX-License-Identifier: LGPL-3.0-or-later
"""The shipped cases as a user runs them: results, ranks, kills and failure."""

import json
import re
import subprocess
import time
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from flexfem.analyses.dynamics import DYNAMICS
from flexfem.cli import load_case
from flexfem.io import read_history

pytestmark = pytest.mark.serial

ROOT = Path(__file__).parents[2]
EVERY = sorted(path.stem for path in (ROOT / "cases").glob("[!_]*.py"))
CASES = [name for name in EVERY if load_case(name).analysis is DYNAMICS]
SUMMARY_KEYS = {
    "case", "ranks", "unknowns", "multipliers", "steps", "rejected_steps", "newton_iterations",
    "factorizations", "residual_evaluations", "wall_seconds", "wall_seconds_setup", "status",
    "results",
}  # fmt: skip
POLICIES = ("auto", "frozen", "updated")
SPLITS = ("4000", "1")

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
# Enough elements for a share of each of three ranks.
MORE = {
    "slider_crank": ["--elements", "5"],
    "flying_spaghetti": ["--elements", "7"],
    "chain": ["--elements", "3"],
    "deployable_truss": ["--elements", "3"],
    "sliding_beam": ["--elements", "6", "--slider-elements", "3"],
    # one reduction for each number of ranks
    "connecting_rod": ["--elements", "3", "--reduced", "{folder}/rod.h5"],
}

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


def instants(pvd: Path) -> list[float]:
    """Times of a series all of whose files, pieces included, are there."""
    times = []
    for entry in ET.parse(pvd).getroot().iter("DataSet"):
        file = pvd.parent / entry.attrib["file"]
        assert file.is_file()
        if file.suffix == ".pvtu":
            pieces = [p.attrib["Source"] for p in ET.parse(file).getroot().iter("Piece")]
            assert pieces
            assert all((file.parent / piece).is_file() for piece in pieces)
        times.append(float(entry.attrib["timestep"]))
    return times


@pytest.fixture(scope="module")
def scripts(
    run: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory
) -> Callable[[int, list[list[str]]], str]:
    """Run cases in one process (of each rank): to start one costs more than such a run."""

    def start(ranks: int, runs: list[list[str]]) -> str:
        script = tmp_path_factory.mktemp("scripts") / "scripts.py"
        script.write_text(SCRIPTS)
        files = ("|".join([str(ROOT / "cases" / f"{case}.py"), *more]) for case, *more in runs)
        ended = run(ranks, script, *files, timeout=600)
        assert (ended.returncode, ended.stderr) == (0, "")
        return str(ended.stdout)

    return start


@pytest.fixture(scope="module")
def histories(
    scripts: Callable[[int, list[list[str]]], str], tmp_path_factory: pytest.TempPathFactory
) -> dict[int, Path]:
    """Folders of all runs on one, two and three ranks; one rank has nothing to split."""
    folders = {ranks: tmp_path_factory.mktemp(f"ranks{ranks}") for ranks in (1, 2, 3)}
    for ranks, folder in folders.items():
        runs, outputs = [], []
        for case, policy, split in product(CASES, POLICIES, SPLITS[: min(ranks, 2)]):
            output = str(folder / f"{case}-{policy}-{split}")
            runs.append([
                case, "--smoke", "--iteration-matrix", policy, "--split-above", split,
                *(part.format(folder=folder) for part in MORE.get(case, [])), "--output", output,
            ])  # fmt: skip
            if policy == "auto":
                outputs.append(output)
            else:
                runs[-1] += ["--quiet", "--every", "1000"]
        printed = scripts(ranks, runs).splitlines()
        ends = [line for line in printed if line.startswith("results are in")]
        assert ends == [f"results are in {output}" for output in outputs]
        # one case prints a table, but not in quiet runs
        tables = [line for line in printed if line.startswith("element ")]
        assert len(tables) == sum("formalisms-" in output for output in outputs)
    return folders


@pytest.fixture(scope="module")
def others(
    scripts: Callable[[int, list[list[str]]], str], tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Folder with short runs of the cases of other analyses."""
    folder = tmp_path_factory.mktemp("others")
    names = [case for case in EVERY if case not in CASES]
    scripts(1, [[case, "--smoke", "--output", str(folder / case)] for case in names])
    return folder


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("case", CASES)
def test_smoke_run_leaves_complete_results(
    case: str, ranks: int, histories: dict[int, Path]
) -> None:
    folder = histories[ranks] / f"{case}-auto-4000"
    history = read_history(folder / "history.csv")
    summary = json.loads((folder / "summary.json").read_text())
    declared = load_case(case)
    values = declared.values({}, smoke=True)
    steps = round(values["t_end"] / values["dt"])
    assert next(iter(history)) == "t"
    assert len(history) > 1
    assert all(np.isfinite(column).all() for column in history.values())
    np.testing.assert_allclose(history["t"], np.linspace(0.0, values["t_end"], steps + 1))
    assert set(summary) >= SUMMARY_KEYS
    assert (summary["case"], summary["ranks"], summary["status"]) == (case, ranks, "ok")
    assert summary["steps"] == steps
    assert summary["unknowns"] > 0
    assert summary["newton_iterations"] >= steps
    assert summary["results"]
    assert all(isinstance(value, float) for value in summary["results"].values())
    series = sorted(folder.glob("*.pvd"))
    assert series
    for pvd in series:
        assert instants(pvd)[0] == 0.0
        assert instants(pvd)[-1] == pytest.approx(values["t_end"])


@pytest.mark.parametrize("case", EVERY)
def test_docstring_names_the_columns(case: str, histories: dict[int, Path], others: Path) -> None:
    text = load_case(case).description
    folder = histories[1] / f"{case}-auto-4000" if case in CASES else others / case
    assert "History:" in text
    for name in read_history(folder / "history.csv"):
        column = re.sub(r"^(forward|backward|mode)_\d+(?=_)", "<mode>", name)
        assert column == "t" or re.search(rf"(?<!\w){column}\b", text), column


@pytest.fixture(scope="module")
def helps(scripts: Callable[[int, list[list[str]]], str]) -> dict[str, str]:
    """Help of every case."""
    texts = scripts(1, [[case, "--help"] for case in EVERY]).split("usage: ")[1:]
    return dict(zip(EVERY, texts, strict=True))


@pytest.mark.parametrize("case", EVERY)
def test_help_lists_every_option(case: str, helps: dict[str, str]) -> None:
    text = " ".join(helps[case].split())
    assert text.startswith(f"{case}.py ")
    declared = load_case(case)
    for option in declared.all_options():
        unit = f"[{option.unit}] " if option.unit else ""
        default = f"{option.default}{declared.other_defaults(option.name)}"
        described = " ".join(f"{option.help} {unit}(default: {default})".split())
        assert described in text, option.name
        assert option.flag in text
    for flag in ("--output DIR", "--quiet", "--smoke"):
        assert flag in text


@pytest.mark.parametrize("split", SPLITS)
@pytest.mark.parametrize("policy", POLICIES)
@pytest.mark.parametrize("case", CASES)
def test_same_history_on_any_number_of_ranks(
    case: str, policy: str, split: str, histories: dict[int, Path]
) -> None:
    one = read_history(histories[1] / f"{case}-{policy}-4000" / "history.csv")
    for ranks in (2, 3):
        other = read_history(histories[ranks] / f"{case}-{policy}-{split}" / "history.csv")
        assert list(other) == list(one)
        for column, values in one.items():
            error = np.abs(other[column] - values).max()
            # what symmetry keeps at zero is measured by the other components of its vector
            family = [
                v for k, v in one.items() if k.rpartition("_")[0] == column.rpartition("_")[0]
            ]
            assert error <= 1e-9 * max(np.abs(v).max() for v in family), column


@pytest.mark.parametrize("case", CASES)
def test_iteration_matrices_agree(case: str, histories: dict[int, Path]) -> None:
    """To what the tolerance of the iteration leaves open."""
    reference, *others = (
        read_history(histories[1] / f"{case}-{policy}-4000" / "history.csv") for policy in POLICIES
    )
    for other in others:
        for column, values in reference.items():
            scale = max(np.abs(values).max(), 1.0)
            assert np.abs(other[column] - values).max() <= 1e-4 * scale, column


def test_bodies_are_split_over_ranks(histories: dict[int, Path]) -> None:
    for split, pieces in (("1", 3), ("4000", 1)):
        file = histories[3] / f"flying_spaghetti-auto-{split}" / "beams" / "beams_000000.pvtu"
        assert len(list(ET.parse(file).getroot().iter("Piece"))) == pieces


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


@pytest.mark.parametrize("ranks", [1, 2])
def test_killed_run_leaves_readable_results(
    ranks: int, tmp_path: Path, environment: dict[str, str],
    command_line: Callable[..., list[str]],
) -> None:  # fmt: skip
    (tmp_path / "summary.json").write_text("{}")  # of an earlier run
    case = ROOT / "cases" / "flying_spaghetti.py"
    process = start_long_run(tmp_path, environment, command_line(ranks, case))
    process.kill()
    process.wait(timeout=60)
    process.communicate()
    time.sleep(0.0 if ranks == 1 else 0.5)  # the ranks end after mpirun
    history = read_history(tmp_path / "history.csv")
    times = instants(tmp_path / "beams.pvd")
    assert all(np.isfinite(column).all() for column in history.values())
    np.testing.assert_allclose(np.diff(history["t"]), 5e-5)
    assert len(times) > 9
    assert history["t"][-1] >= times[-1]
    assert not (tmp_path / "summary.json").exists()


@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize(
    ("drive", "reason"),
    [("far", r" at t = 0.007\d* s$"), ("nan", r'^PrescribedTranslation "drive": .*not finite')],
)
def test_failed_run_keeps_what_it_has(
    drive: str, reason: str, ranks: int, tmp_path: Path, run: Callable[..., Any]
) -> None:
    case, output = tmp_path / "failing.py", tmp_path / "results"
    case.write_text(FAILING)
    ended = run(ranks, case, "--drive", drive, "--output", output)
    assert (ended.returncode, ended.stdout) == (1, "")
    assert ended.stderr.count("\n") == 1
    assert ended.stderr.startswith("failed: ")
    summary = json.loads((output / "summary.json").read_text())
    assert re.search(reason, summary["status"])
    assert ended.stderr == f"failed: {summary['status']}\n"
    assert summary["rejected_steps"] > 0
    assert set(summary) >= SUMMARY_KEYS
    history = read_history(output / "history.csv")
    assert all(np.isfinite(column).all() for column in history.values())
    assert history["t"][-1] > 0.0049
    assert len(list(output.glob("checkpoint_*.h5"))) == 1
    for name in ("rigid_bodies", "joints"):
        assert instants(output / f"{name}.pvd")[-1] == history["t"][-1]


def test_earlier_results_of_another_model_are_removed(
    tmp_path: Path, run: Callable[..., Any]
) -> None:
    for case, series in (
        ("chain", {"beams", "beam_surfaces", "joints"}),
        ("heavy_top", {"rigid_bodies", "joints"}),
        ("flying_spaghetti", {"beams"}),
    ):
        ended = run(1, ROOT / "cases" / f"{case}.py", "--smoke", "--output", tmp_path)
        assert ended.returncode == 0
        assert {pvd.stem for pvd in tmp_path.glob("*.pvd")} == series
        assert {file.parent.name for file in tmp_path.rglob("*.vtu")} == series


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
