# SPDX-License-Identifier: LGPL-3.0-or-later
"""The beam on a moving base by its theories: one picture, one command line."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexfem as ff
from flexfem import research
from flexfem.analyses.dynamics import DYNAMICS
from flexfem.cli import command, load_case
from flexfem.cli.postprocessing import script
from flexfem.io import read_history

pytestmark = pytest.mark.serial


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
    theories = ("consistent", "conventional", "beam", "floating", "premature")
    for theory in theories:
        out = start(case, tmp_path / theory, theory=theory, dt=0.02, t_end=0.4)
        assert out.status == "ok"
    tables = [read_history(tmp_path / theory / "history.csv") for theory in theories]
    assert [list(table) for table in tables] == [["t", "u2", "u3", "theta1", "s"]] * 5
    lag = [table["u2"] for table in tables]
    assert np.abs(lag[2]).max() > 1e-4
    for other in (*lag[:2], *lag[3:]):
        # before there is anything to stiffen; six elements and four modes are coarse
        assert np.abs(other - lag[2]).max() < 0.1 * np.abs(lag[2]).max()


def diverging(scale: float, end: float) -> dict[str, Any]:
    """A column of three runs: two equal, one that is small or grows."""
    t = np.linspace(0.0, 10.0, 201)
    runs = {"one": np.sin(t), "two": 1.2 * np.sin(t), "other": scale * np.exp(end * t)}
    return {name: {"t": t, "u2": values} for name, values in runs.items()}


def test_clipped_axes_are_those_of_runs_that_do_not_diverge() -> None:
    pytest.importorskip("matplotlib")
    compare = script("compare_runs")
    low, high = compare.common_range(diverging(1e-3, 3.0), "u2")
    assert (low, high) == pytest.approx((-1.56, 1.56), abs=1e-3)  # 1e10 with all runs
    # what stays small diverges from nothing, and hides nothing
    assert compare.common_range(diverging(1e-3, -1.0), "u2") == pytest.approx((low, high))
    late = {**diverging(1e-3, 0.0), "nan": {"t": np.zeros(2), "u2": np.array([0.0, np.nan])}}
    assert compare.common_range(late, "u2") == pytest.approx((low, high))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_note_stands_where_a_run_leaves_the_axes(sign: float) -> None:
    pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure

    tables = diverging(sign * 1e-3, 3.0)
    panel = Figure().subplots()
    for table in tables.values():
        panel.plot(table["t"], table["u2"])
    script("compare_runs").clip(panel, tables, "u2")
    (note,) = panel.texts
    # 1e-3 exp(3 t) passes 1.56 between two of its rows, 0.05 s apart; at the other edge is sin t
    assert note.xy[0] == pytest.approx(np.log(1560) / 3, abs=0.05)
    assert 1.3 < sign * note.xy[1] < 1.56
    assert note.get_text() == "other leaves at 2.5 s"


def test_a_diverging_run_is_cut_off_by_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    for name, table in diverging(1e-3, 3.0).items():
        (tmp_path / name).mkdir()
        rows = "\n".join(f"{t},{u}" for t, u in zip(table["t"], table["u2"], strict=True))
        (tmp_path / name / "history.csv").write_text(f"t,u2\n{rows}\n")
    folders = [str(tmp_path / name) for name in ("one", "two", "other")]
    assert command(["plot", *folders, "--clip", "--output", str(tmp_path / "all.png")]) == 0
    assert (tmp_path / "all.png").read_bytes()[:4] == b"\x89PNG"
    assert command(["plot", folders[0], "--clip"]) == 2
    assert "argument --clip: takes several RESULTS_DIR, got 1" in capsys.readouterr().err


@pytest.mark.slow
def test_one_command_makes_runs_and_their_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    study = ["sweep", "spin_up", "--smoke", "--quiet", "--vary", "theory=consistent,conventional"]
    folder = ["--output", str(tmp_path / "study")]
    assert command([*study, *folder, "--clip"]) == 2
    assert "--clip needs --plot" in capsys.readouterr().err
    assert not (tmp_path / "study").exists()
    assert command([*study, *folder, "--plot", "u2,theta1", "--clip"]) == 0
    assert (tmp_path / "study" / "comparison.png").read_bytes()[:4] == b"\x89PNG"


def test_spin_up_of_the_published_link() -> None:
    """Coarse: 12 elements and h = 0.05 s; the exact beam's twist is 18.1, 5.7, 1.5 degrees."""
    case = load_case("spin_up")
    coarse = {"dt": 0.05, "t_end": 17.0, "elements": 12}
    history = case.run(**coarse).history
    twist = np.degrees(np.interp([8.0, 10.0, 12.0], history["t"], history["theta1"]))
    # sections rotated about the vector theta have 38.7, 27.9 and 13.1
    assert twist == pytest.approx([18.9, 7.6, 2.3], abs=0.3)
    assert history["u2"].min() == pytest.approx(-0.370, abs=2e-3)
    after = np.degrees(history["theta1"][history["t"] >= 15.0])
    assert np.ptp(after) < 0.06  # 0.51 about the vector
    vector = case.run(**coarse, rotations="vector").history
    assert np.degrees(np.interp(10.0, vector["t"], vector["theta1"])) == pytest.approx(28, abs=1)
    wrong = case.run(**coarse, theory="conventional").history
    # points on the axis do not twist while the lag is still small
    early = wrong["t"] < 4.0
    assert np.abs(wrong["theta1"][early]).max() < 0.05 * history["theta1"].max()
    assert wrong["u2"].min() < -20.0  # of a beam of 8


def test_numbers_of_the_cases_are_options() -> None:
    case = load_case("spin_up")
    values = {"density": 2000.0, "box_length": 2.0, "channel_second_moment_3": 1e-8, "t_end": 0.1}
    half = case.run(**values, speed=3.0, spin_up_time=0.05, elements=6)
    assert "u2_mean" in half.summary["results"]  # from 0.05 s on
    link = research.outboard_link(density=2000.0, box_length=2.0, channel_second_moment_3=1e-8)
    assert link.length == pytest.approx(2.0 + 16.0 / 3.0)
    at = link.at(np.array([1.0, 3.0]))
    assert at["mass_per_length"] == pytest.approx(2000.0 * np.array([3.84e-4, 7.3e-5]))
    assert at["second_moment_3"] == pytest.approx([1.5e-7, 1e-8])
    with pytest.raises(TypeError, match="unexpected keyword argument 'channel_width'"):
        research.outboard_link(channel_width=1.0)


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
        (
            ["--leave-out", "shear+sheer"],
            "names of effects joined by + (stiffening, ",
        ),
        (["--theory", "beam", "--initial-u2", "0.1"], "initial_u2 is for assumed modes, got 0.1"),
        (["--leave-out", "extension+in_plane+out_of_plane+torsion"], "Effects: no field is left"),
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
