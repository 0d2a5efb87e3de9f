# SPDX-License-Identifier: LGPL-3.0-or-later
"""The shipped cases as a user runs them: results, ranks, policies."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from flexfem.analyses.dynamics import DYNAMICS
from flexfem.cli import load_case
from flexfem.io import read_history
from flexfem.options import VectorOption
from tests.cases.conftest import RunCases
from tests.cases.left_results import SUMMARY_KEYS, instants

pytestmark = pytest.mark.serial

ROOT = Path(__file__).parents[2]
EVERY = sorted(path.stem for path in (ROOT / "cases").glob("[!_]*.py"))
CASES = [name for name in EVERY if load_case(name).analysis is DYNAMICS]
#: Cases that also run with another iteration matrix and on three ranks, one for each kind of bodies
#: and connections; the others have tests of their own of both.
CHOICE = (
    "connecting_rod", "deployable_truss", "flying_spaghetti", "rope_heap", "sheet_landing",
    "slider_crank", "sliding_beam", "tutorial_8_crane",
)  # fmt: skip
#: Published systems, and those that need most of ranks: they run on two as well.
SYSTEMS = (
    "mesh_reflector", "parallel_manipulator", "plectoneme", "solar_array", "tape_spring", "turbine",
)  # fmt: skip
POLICIES = ("auto", "updated")
#: Values of --split-above that leave beams and shells whole, and that split them.
WHOLE, SPLIT = "4000", "1"
#: Cases, policies and splittings on each number of ranks. A rank without a body is there on two
#: already; the policy ``updated`` on ranks has tests of its own.
RUNS = {
    1: [*((case, "auto", WHOLE) for case in CASES), *((case, "updated", WHOLE) for case in CHOICE)],
    # each of these is split on some number of ranks; the others have a slow test
    2: [*((case, "auto", WHOLE) for case in CHOICE), *((case, "auto", SPLIT) for case in SYSTEMS)],
    3: [(case, "auto", SPLIT) for case in CHOICE],
}
#: Runs with the usual iteration matrix on one and two ranks.
USUAL = [
    (ranks, case) for ranks in (1, 2) for case, policy, _ in RUNS[ranks] if policy == POLICIES[0]
]
#: Those on several ranks, with the number of these.
SHARED = [(ranks, *run) for ranks in (2, 3) for run in RUNS[ranks]]

# Enough elements for a share of each of three ranks.
MORE = {
    "slider_crank": ["--elements", "5"],
    "flying_spaghetti": ["--elements", "7"],
    "chain": ["--elements", "3"],
    "deployable_truss": ["--elements", "3"],
    "sliding_beam": ["--elements", "6", "--slider-elements", "3"],
    # one reduction for each number of ranks
    "connecting_rod": ["--elements", "3", "--reduced", "{folder}/rod.h5"],
    "tutorial_6_solid_arm": ["--reduced", "{folder}/arm.h5"],
    "tutorial_1_pendulum": ["--elements", "6"],
}
#: Justified warnings of smoke runs: few smooth elements lock, and the linear law of the truss
#: begins with a jump of the speed.
WARNING = re.compile(
    r'warning: Beam "\w+"(: smooth elements of degree \d| and 1 more: initial velocities) .*'
)


@pytest.fixture(scope="module")
def scripts(run_cases: RunCases) -> Callable[[int, list[list[str]]], str]:
    """Run cases; what they print."""

    def start(ranks: int, runs: list[list[str]]) -> str:
        ended = run_cases(ranks, runs)
        warnings = ended.stderr.splitlines()
        assert [line for line in warnings if not WARNING.fullmatch(line)] == []
        return ended.stdout

    return start


@pytest.fixture(scope="module")
def histories(
    scripts: Callable[[int, list[list[str]]], str], tmp_path_factory: pytest.TempPathFactory
) -> dict[int, Path]:
    """Folders of all runs on one, two and three ranks; one rank has nothing to split."""
    folders = {ranks: tmp_path_factory.mktemp(f"ranks{ranks}") for ranks in RUNS}
    for ranks, folder in folders.items():
        runs, outputs = [], []
        for case, policy, split in RUNS[ranks]:
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
        # one case prints two tables, but not in quiet runs
        tables = [line for line in printed if line.startswith("element ") and "formalism" in line]
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


@pytest.mark.parametrize(("ranks", "case"), USUAL)
def test_smoke_run_leaves_complete_results(
    ranks: int, case: str, histories: dict[int, Path]
) -> None:
    (split,) = (split for name, policy, split in RUNS[ranks] if (name, policy) == (case, "auto"))
    folder = histories[ranks] / f"{case}-auto-{split}"
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
        vector = isinstance(option, VectorOption)  # shown as it is typed
        shown = ",".join(map(str, option.default)) if vector else option.default
        default = f"{shown}{declared.other_defaults(option.name)}"
        described = " ".join(f"{option.help} {unit}(default: {default})".split())
        assert described in text, option.name
        assert option.flag in text
    for flag in ("--output DIR", "--quiet", "--smoke"):
        assert flag in text


@pytest.mark.parametrize(("ranks", "case", "policy", "split"), SHARED)
def test_same_history_on_any_number_of_ranks(
    ranks: int, case: str, policy: str, split: str, histories: dict[int, Path]
) -> None:
    assert_same(
        histories[1] / f"{case}-{policy}-4000", histories[ranks] / f"{case}-{policy}-{split}"
    )


@pytest.mark.slow
@pytest.mark.parametrize("case", [case for case in CASES if case not in (*CHOICE, *SYSTEMS)])
def test_others_on_two_ranks(
    case: str, histories: dict[int, Path], scripts: Callable[[int, list[list[str]]], str],
    tmp_path: Path,
) -> None:  # fmt: skip
    more = [part.format(folder=tmp_path) for part in MORE.get(case, [])]
    scripts(2, [[case, "--smoke", "--split-above", SPLIT, *more, "--output", str(tmp_path)]])
    assert_same(histories[1] / f"{case}-auto-4000", tmp_path)


def assert_same(folder: Path, on_ranks: Path) -> None:
    """Histories in two folders are the same to rounding of sums over ranks."""
    one, other = (read_history(place / "history.csv") for place in (folder, on_ranks))
    assert list(other) == list(one)
    for column, values in one.items():
        error = np.abs(other[column] - values).max()
        # what symmetry keeps at zero is measured by the other components of its vector
        family = [v for k, v in one.items() if k.rpartition("_")[0] == column.rpartition("_")[0]]
        assert error <= 1e-9 * max(np.abs(v).max() for v in family), column


@pytest.mark.parametrize("case", CHOICE)
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
    runs = (3, f"auto-{SPLIT}", 3), (2, f"auto-{WHOLE}", 1)
    for ranks, run, pieces in runs:
        file = histories[ranks] / f"flying_spaghetti-{run}" / "beams" / "beams_000000.pvtu"
        assert len(list(ET.parse(file).getroot().iter("Piece"))) == pieces
