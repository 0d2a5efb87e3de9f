# SPDX-License-Identifier: LGPL-3.0-or-later
"""Help on first use: near spellings, messages on slow or suspicious parts, panels."""

import argparse
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import flexfem as ff
from flexfem.case import case_file, load_case
from flexfem.cli.postprocessing import script
from flexfem.cli.usage import Parser, UsageError
from flexfem.simulation.watch.energy_drift import energy_drift

pytestmark = pytest.mark.serial


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("--elemets 9", "--elemets 9; did you mean --elements? (see x --help)"),
        ("--elemets=9", "; did you mean --elements?"),
        ("--xyz", "--xyz (see"),
        ("word", "word (see"),
    ],
)
def test_near_options_are_named(given: str, told: str) -> None:
    parser = Parser(prog="x")
    parser.add_argument("--elements")
    with pytest.raises(UsageError) as caught:
        parser.parse_args(given.split())
    assert told in str(caught.value)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("--aero no", "no; it takes no value, write --no-aero (see"),
        ("--aero=OFF", "; it takes no value, write --no-aero (see"),
        ("--speed 3 --aero true", "true; it takes no value, write --aero (see"),
        ("--speed 3 no", "no (see"),
        ("no --aero", "no (see"),
    ],
)
def test_switches_take_no_value(given: str, told: str) -> None:
    parser = Parser(prog="x")
    parser.add_argument("--aero", action=argparse.BooleanOptionalAction)
    parser.add_argument("--speed")
    with pytest.raises(UsageError) as caught:
        parser.parse_args(given.split())
    assert told in str(caught.value)


def test_a_file_without_its_ending_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match="known are"):
        case_file("my_own_thing")
    (tmp_path / "my_own_thing.py").touch()
    with pytest.raises(ValueError, match=r"did you mean the file my_own_thing\.py"):
        case_file("my_own_thing")


def test_pins_between_nodes_are_where_they_are_meant() -> None:
    """On five elements no node is in the middle, where the pin of a scissor is."""
    steel = ff.Material(2.1e11, 0.3, 7850.0)
    model = ff.Model("m", mesh=ff.LineMesh.straight({"rod": [(0, 0, 0), (1, 0, 0)]}, 5))
    model.add(
        ff.Beam("rod", ff.Section.circle(0.01, steel)),
        ff.Spherical("pin", ff.Ground((0.5, 0.0, 0.0)), ff.Marker("rod", 0.5)),
        ff.PositionProbe("held", ff.Marker("rod", 0.5)),
        ff.Gravity((0.0, 0.0, -9.81)),
    )
    out = ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=5e-3))
    # round-off of the constraint; the nearest node starts 0.1 m away
    assert np.abs(out.history["held_x"] - 0.5).max() < 1e-12
    assert np.abs(out.history["held_z"]).max() < 1e-12


def test_components_and_energies_share_panels() -> None:
    pytest.importorskip("matplotlib")
    grouped = script("plot_history").grouped
    columns = [
        "tip_x",
        "tip_y",
        "hook_fx",
        "hook_fy",
        "hook_mx",
        "hook_my",
        "root_n1",
        "root_gamma2",
        "root_gamma3",
        "spot_eps11",
        "spot_eps12",
        "force_1",
        "force_2",
        "energy_kinetic",
        "energy_work",
        "energy_balance",
        "mode_1_fixed",
    ]
    assert [names for _, names in grouped(columns)] == [
        ["tip_x", "tip_y"], ["hook_fx", "hook_fy"], ["hook_mx", "hook_my"], ["root_n1"],
        ["root_gamma2", "root_gamma3"], ["spot_eps11", "spot_eps12"], ["force_1", "force_2"],
        ["energy_kinetic", "energy_work"], ["energy_balance"], ["mode_1_fixed"],
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("series", "fields", "shown"),
    [
        ("floating_bodies", ["stress", "von_mises", "deformation"], "von_mises"),
        ("floating_lines", ["deformation"], "deformation"),
        ("beam_surfaces", ["von_mises", "bending_moment"], "bending_moment"),
        ("rigid_bodies", ["velocity"], "bending_moment"),
    ],
)
def test_colour_is_a_field_that_is_there(series: str, fields: list[str], shown: str) -> None:
    pytest.importorskip("pyvista")
    mesh = SimpleNamespace(array_names=fields)
    instant = SimpleNamespace(meshes=lambda _: {series: mesh})
    assert script("motion_scene").default_field([instant]) == shown


def sliding(*probes: ff.EnergyProbe | ff.ReactionProbe) -> ff.Model:
    model = ff.Model("m")
    model.add(ff.RigidBody("bob", 2.0, (0.1, 0.1, 0.1)), ff.Gravity((0.0, 0.0, -9.81)), *probes)
    return model


def test_energy_drift_is_told() -> None:
    """Gains of the whole model above a fiftieth of the largest energy.

    Losses are not reported unless neither the scheme nor events may take energy.
    """
    zero = np.zeros(4)
    names = ("kinetic", "strain", "gravity", "work", "dissipation")
    history = {f"energy_{name}": zero for name in names} | {"t": np.arange(4.0)}
    history["energy_gravity"] = np.array([0.0, -5.0, -10.0, -10.0])

    def told(balance: list[float], *bodies: str, lossless: bool = False) -> list[str]:
        probe = ff.EnergyProbe(bodies=bodies or None)
        found = history | {"energy_balance": np.array(balance)}
        return energy_drift(sliding(probe), found, lossless=lossless)

    (line,) = told([0.0, 0.01, 0.3, 0.31])
    assert "grown by 0.31 J (energy_balance) with energies of at most 10 J" in line
    assert "t = 2 s" in line
    assert not told([0.0, 0.0, 0.19, 0.19])
    assert not told([0.0, -1.0, -2.0, -3.0])
    (line,) = told([0.0, -1.0, -1.0, -3.0], lossless=True)
    assert "fallen by 3 J (energy_balance) with energies of at most 10 J" in line
    assert "t = 3 s" in line
    assert not told([0.0, -0.19, -0.1, -0.19], lossless=True)
    assert not told([0.0, 0.01, 0.3, 0.31], "bob")  # parts of a model exchange energy
    assert not energy_drift(sliding(ff.EnergyProbe()), {})
    tiny = {name: 1e-15 * values for name, values in history.items()}  # a model at rest
    tiny["energy_balance"] = np.array([0.0, 0.0, 1e-14, 1e-14])
    assert not energy_drift(sliding(ff.EnergyProbe()), tiny)


def test_coarse_steps_of_a_stop_are_told() -> None:
    """A mass falls onto a stiff stop for 14 ms: steps of 20 ms give a mean of its force alone."""
    warnings, pushes = {}, {}
    for dt in (2e-2, 2e-4):
        model = sliding(ff.EnergyProbe(), ff.ReactionProbe("push", "floor"))
        ends = ff.Ground(), ff.Marker("bob")
        model.add(
            ff.Prismatic("rail", *ends),
            ff.LimitStop("floor", *ends, axis=(0, 0, 1), lower=-0.1, stiffness=1e5),
        )
        outcome = ff.simulate(model, ff.RunOptions(dt=dt, t_end=0.4, rho_inf=1.0))
        assert outcome.status == "ok"
        warnings[dt] = outcome.summary["warnings"]
        pushes[dt] = outcome.history["push_fz"].max()
    largest = 2.0 * 9.81 + np.sqrt((2.0 * 9.81) ** 2 + 2.0 * 1e5 * 2.0 * 9.81 * 0.1)
    assert pushes[2e-4] == pytest.approx(largest, rel=2e-3)
    assert warnings[2e-4] == []
    assert pushes[2e-2] < 0.6 * largest
    (line,) = warnings[2e-2]
    assert 'LimitStop "floor": contacts last less than 5 steps' in line


def test_smooth_drive_of_a_damped_beam_begins_without_a_force() -> None:
    """A motion that begins with the third power of time has neither velocity nor acceleration."""
    steel = ff.Material(2.1e11, 0.3, 7850.0)
    model = ff.Model("m", mesh=ff.LineMesh.straight({"rod": [(0, 0, 0), (1, 0, 0)]}, 4))
    ends = ff.Ground(), ff.Marker("rod", "start")
    model.add(
        ff.Beam("rod", ff.Section.circle(0.01, steel), damping=1e-3),
        ff.Prismatic("rail", *ends, axis=(1.0, 0.0, 0.0)),
        ff.PrescribedDisplacement("drive", *ends, (1.0, 0.0, 0.0), ff.SmoothStep(0.0, 1.0)),
        ff.ReactionProbe("push", "drive"),
    )
    push = ff.simulate(model, ff.RunOptions(dt=2e-3, t_end=0.1)).history["push_fx"]
    # the mass of 0.617 kg takes 2.7 N at 0.1 s; with a velocity at the start it were 9 N at once
    assert abs(push[0]) < 0.01
    assert 2.0 < push.max() < 3.0


@pytest.mark.slow
def test_no_equilibrium_is_said_so() -> None:
    """A body on an upright rail has none."""
    model = sliding()
    model.add(ff.Prismatic("rail", ff.Ground(), ff.Marker("bob")))
    status = ff.simulate(model, ff.RunOptions(dt=1e-2, t_end=0.1, start="equilibrium")).status
    assert "in the search for the equilibrium" in status
    assert "reduce dt" not in status


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Seconds that the test sets."""
    from flexfem.cli import first_compilation

    now = [0.0]
    monkeypatch.setattr(first_compilation.time, "monotonic", lambda: now[0])
    return now


def test_long_compilation_is_told_once(clock: list[float]) -> None:
    """Those above one second, nested ones once; compilations after the run are not reported."""
    from numba.core import event

    from flexfem.cli.first_compilation import announcing_compilation

    told: list[str] = []
    with announcing_compilation(told.append):
        for seconds, lines in ((0.6, 0), (0.6, 0), (0.1, 1), (5.0, 1)):
            event.start_event("numba:compile")
            event.start_event("numba:compile")
            clock[0] += seconds
            event.end_event("numba:compile")
            event.end_event("numba:compile")
            assert len(told) == lines
    event.start_event("numba:compile")
    event.end_event("numba:compile")
    assert len(told) == 1


def test_what_a_case_must_import_first_is_named(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text('raise ImportError("libmpi.so.12: cannot open shared object file")\n')
    with pytest.raises(ValueError, match=r"import dolfinx_solver before dolfinx$"):
        load_case(str(file))
