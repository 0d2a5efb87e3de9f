# SPDX-License-Identifier: LGPL-3.0-or-later
"""The shipped cases of statics as a user runs them."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexfem.analyses.statics import STATICS
from flexfem.cli import load_case
from flexfem.io import read_history

pytestmark = pytest.mark.serial

ROOT = Path(__file__).parents[2]
EVERY = sorted(path.stem for path in (ROOT / "cases").glob("[!_]*.py"))
#: Cases that search by gradients take long; ranks are compared in tests of gradients.
SEARCHES = ("design_of_a_flexure", "optimal_column", "uniform_stress_blade")
CASES = [n for n in EVERY if load_case(n).analysis is STATICS and n not in SEARCHES]

# Runs every case briefly, with split bodies, in one go; the first along its path as well.
ALL_RUNS = """\
import sys
from pathlib import Path

import flexfem as ff
from flexfem.cli import load_case

PATH = ["--elements", "6", "--arc-length", "0.1", "--critical-points", "--max-steps", "200"]
folder, names = Path(sys.argv[1]), sys.argv[2:]
runs = {name: (name, ["--smoke"]) for name in names}
runs["path"] = "lee_frame", [*PATH, "--stop-column", "down", "--stop-value", "55"]
for run, (name, argv) in runs.items():
    argv += ["--quiet", "--split-above", "1", "--output", str(folder / run)]
    code = ff.main(load_case(name), argv)
    if code:
        sys.exit(f"{argv} ended with {code}")
"""


@pytest.fixture(scope="module")
def folders(run: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """Folders of all runs on one and two ranks."""
    made = {ranks: tmp_path_factory.mktemp(f"ranks{ranks}") for ranks in (1, 2)}
    for ranks, folder in made.items():
        script = folder / "all_runs.py"
        script.write_text(ALL_RUNS)
        ended = run(ranks, script, folder, *CASES, timeout=600)
        assert (ended.returncode, ended.stderr) == (0, "")
    return made


@pytest.mark.parametrize("case", CASES)
def test_smoke_run_leaves_complete_results(case: str, folders: dict[int, Path]) -> None:
    values = load_case(case).values({}, smoke=True)
    history = read_history(folders[2] / case / "history.csv")
    summary = json.loads((folders[2] / case / "summary.json").read_text())
    assert next(iter(history)) == "t"
    grid = np.linspace(0.0, values["t_end"], values["load_steps"] + 1)
    np.testing.assert_allclose(history["t"], grid, atol=1e-12)
    assert (summary["case"], summary["ranks"], summary["status"]) == (case, 2, "ok")
    assert summary["steps"] == values["load_steps"]
    assert summary["critical_points"] == summary["buckling"] == []
    assert all(isinstance(value, float) for value in summary["results"].values())
    shown = ("beams.pvd", "shells.pvd", "solids.pvd")
    assert [name for name in shown if (folders[2] / case / name).is_file()]


@pytest.mark.parametrize("case", [*CASES, "path"])
def test_same_history_on_two_ranks(case: str, folders: dict[int, Path]) -> None:
    one, two = (read_history(folder / case / "history.csv") for folder in folders.values())
    assert list(two) == list(one)
    largest = max(np.abs(values).max() for values in one.values())
    for column, values in one.items():
        # rounding of sums over ranks; a ghost left out changes everything
        np.testing.assert_allclose(two[column], values, atol=1e-9 * largest)


def test_critical_points_are_reported(folders: dict[int, Path]) -> None:
    for folder in folders.values():
        points = json.loads((folder / "path" / "summary.json").read_text())["critical_points"]
        # out of the plane first; then the limit point, about 5 % high with six elements
        kinds = ["bifurcation", "limit point"]
        assert [point["kind"] for point in points] == kinds
        assert [point["unstable"] for point in points] == [[0, 1], [1, 2]]
        assert 0.92 < points[1]["t"] < 1.0
        assert set(points[0]) == {"kind", "t", "unstable", "down", "right", "force"}
