# SPDX-License-Identifier: LGPL-3.0-or-later
"""The beam on a moving base by its theories: one picture, one command line."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexfem as ff
from flexfem.analyses.dynamics import DYNAMICS
from flexfem.cli import load_case
from flexfem.io import read_history

pytestmark = pytest.mark.serial

ROOT = Path(__file__).parents[2]


def start(case: str, folder: Path, **given: Any) -> Any:
    """Run a case in this process, with --smoke."""
    declared = load_case(case)
    values = declared.values(given, smoke=True)
    source = declared.build(**{option.name: values[option.name] for option in declared.options})
    source.validate()
    numbers = {option.name: values[option.name] for option in DYNAMICS.settings.OPTIONS}
    options = ff.RunOptions(**numbers, output=folder, quiet=True)
    return DYNAMICS.run(source, options, case=case, results=declared.results_with(values))


@pytest.mark.parametrize("case", ["spin_up", "manipulator_deployment"])
def test_theories_begin_alike_and_make_one_picture(case: str, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    theories = ("consistent", "conventional", "beam", "floating")
    for theory in theories:
        out = start(case, tmp_path / theory, theory=theory, dt=0.02, t_end=0.4)
        assert out.status == "ok"
    tables = [read_history(tmp_path / theory / "history.csv") for theory in theories]
    assert [list(table) for table in tables] == [["t", "u2", "u3", "theta1", "s"]] * 4
    lag = [table["u2"] for table in tables]
    assert np.abs(lag[2]).max() > 1e-4
    for other in (*lag[:2], lag[3]):
        # before there is anything to stiffen; six elements and four modes are coarse
        assert np.abs(other - lag[2]).max() < 0.1 * np.abs(lag[2]).max()
    program = [sys.executable, ROOT / "postprocess" / "plot_theories.py"]
    picture = tmp_path / "all.png"
    folders = [tmp_path / theory for theory in theories]
    # what a diverging run looks like
    table = (folders[1] / "history.csv").read_text().splitlines()
    table[-1] = table[-1].split(",")[0] + ",1e9,1e9,nan,1e9"
    (folders[1] / "history.csv").write_text("\n".join(table) + "\n")
    subprocess.run([*program, *folders, "--output", picture], check=True)
    assert picture.read_bytes()[:4] == b"\x89PNG"
    ended = subprocess.run(
        [*program, folders[0], "--columns", "u7"], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 2
    assert "no column 'u7'" in ended.stderr


def test_series_of_an_earlier_model_are_removed(tmp_path: Path) -> None:
    (tmp_path / "joints").mkdir()
    (tmp_path / "joints" / "joints_000000_0.vtu").write_text("")
    (tmp_path / "joints.pvd").write_text("")
    start("spin_up", tmp_path, t_end=0.02)
    assert [path.name for path in tmp_path.glob("*.pvd")] == ["beams.pvd"]
    assert not list((tmp_path / "joints").glob("*"))


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--bodies", "0"], "argument --bodies: must be"),
        (["--theory", "beam", "--eccentricity", "nan"], "must be a finite number"),
        (["--analysis", "modes"], "MovingBaseBeam: there is no analysis 'modes' of it"),
        (["--assumed-modes", "500", "--elements", "3"], "modes 500: 3 elements have no more than"),
        (["--integrator", "energy_momentum"], "integrator 'energy_momentum': equations"),
    ],
)
def test_mistakes_leave_nothing(
    more: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "results"
    code = ff.main(load_case("spin_up"), [*more, "--output", str(output)])
    told = capsys.readouterr().err
    assert (code, told.count("\n")) == (2, 1)
    assert message in told
    assert not output.exists()


def test_building_needs_no_compiled_code(run: Callable[..., Any], tmp_path: Path) -> None:
    script = tmp_path / "build.py"
    script.write_text(
        "import sys\n"
        "from flexfem.cli import load_case\n"
        "case = load_case('spin_up')\n"
        "values = {option.name: option.default for option in case.options}\n"
        "for theory in ('consistent', 'beam'):\n"
        "    case.build(**{**values, 'theory': theory}).validate()\n"
        "print({'dolfinx', 'petsc4py', 'slepc4py', 'numba', 'mpi4py'} & set(sys.modules))\n"
    )
    ended = run(1, script)
    assert (ended.stdout, ended.stderr) == ("set()\n", "")
