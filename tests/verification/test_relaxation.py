# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dynamic relaxation against Newton's method, closed forms and one another."""

import json
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.cli import load_case


def cantilever(*more: Any) -> ff.Model:
    """Cantilever of length 1 under a large oblique force at its end."""
    points = np.linspace(0.0, 1.0, 5)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    cells = np.stack([np.arange(4), np.arange(1, 5)], axis=1)
    model = ff.Model("cantilever", mesh=ff.LineMesh(points, cells, {"beam": np.arange(4)}))
    stiffness = (1e5, 1e5, 1e5, 80.0, 100.0, 120.0)
    tip = ff.Marker("beam", "end")
    model.add(
        ff.Beam("beam", ff.Section.general(stiffness, (1.0,) * 6), orientation=(0.0, 1.0, 0.0)),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "start")),
        ff.PointForce("force", tip, (20.0, 60.0, 150.0)),
        ff.PositionProbe("tip", tip),
        ff.ReactionProbe("hold", "clamp"),
        *more,
    )
    return model


def plate(load: float = -9.81, **fixed: Any) -> ff.Model:
    """Thin square plate under its weight, clamped all around, with large deflections."""
    grid = np.linspace(0.0, 1.0, 9)
    mesh = ff.SurfaceMesh.grid("plate", grid, grid)
    model = ff.Model("plate", surface=mesh)
    section = ff.ShellSection.isotropic(0.01, ff.Material(1e8, 0.3, 1000.0))
    edges = dict.fromkeys(mesh.lines, "clamped")
    model.add(
        ff.Shell("plate", section, edges=edges),
        ff.Gravity((0.0, 0.0, load)),
        ff.PositionProbe("middle", ff.Marker("plate", (0.5, 0.5, 0.0))),
    )
    return model


def relax(model: ff.Model, **options: Any) -> ff.Outcome:
    defaults = {"tolerance": 1e-8, "step_tolerance": 1e-8, "quiet": True, "record_every": 20}
    outcome = ff.relax(model, ff.RelaxationOptions(**(defaults | options)))
    assert outcome.status == "ok", outcome.status
    return outcome


def ends(outcome: ff.Outcome, *columns: str) -> np.ndarray:
    return np.array([outcome.history[name][-1] for name in columns])


TIP = ("tip_x", "tip_y", "tip_z")


@pytest.mark.slow_on_ranks
@pytest.mark.parametrize(
    "damping",
    ["accelerated", *(pytest.param(d, marks=pytest.mark.serial) for d in ("viscous", "kinetic"))],
)
def test_cantilever_is_that_of_newtons_method(damping: str) -> None:
    static = ff.solve_static(cantilever(), ff.StaticOptions(quiet=True))
    outcome = relax(cantilever(), damping=damping)
    assert outcome.summary["factorizations"] == 0
    if outcome.history:
        assert static.history["tip_z"][-1] > 0.3
        # rotations that are not moved along local twists end elsewhere by 1e-2
        np.testing.assert_allclose(ends(outcome, *TIP), ends(static, *TIP), atol=2e-7)
        names = [name for name in outcome.history if name.startswith("hold_")]
        assert len(names) == 6
        # a projection whose multipliers are not those of the rows is off by the whole force
        np.testing.assert_allclose(ends(outcome, *names), ends(static, *names), atol=2e-4)


@pytest.mark.slow_on_ranks
@pytest.mark.serial
@pytest.mark.parametrize("masses", ["stiffness", "scaled"])
def test_clamped_plate_is_that_of_newtons_method(masses: str) -> None:
    static = ff.solve_static(plate(), ff.StaticOptions(quiet=True))
    outcome = relax(plate(), masses=masses)
    if outcome.history:
        depth = -static.history["middle_z"][-1]
        assert depth > 0.005  # half the thickness: membrane forces count
        # masses that are not stable never come below the tolerance; wrong fixed nodes give 1e-3
        assert abs(outcome.history["middle_z"][-1] + depth) < 1e-8


@pytest.mark.serial
def test_springs_push_and_dampers_do_not() -> None:
    tip = ff.Marker("beam", "end")
    spring = ff.SpringDamper(
        "spring", ff.Ground((1.0, 1.0, 0.0)), tip, stiffness=200.0, damping=50.0
    )
    static = ff.solve_static(cantilever(spring), ff.StaticOptions(quiet=True))
    outcome = relax(cantilever(spring))
    free = relax(cantilever())
    assert np.abs(ends(free, *TIP) - ends(static, *TIP)).max() > 0.01
    # a force at the wrong end, or with the wrong sign, moves the tip by as much as the spring
    np.testing.assert_allclose(ends(outcome, *TIP), ends(static, *TIP), atol=2e-7)


def test_measure_is_the_part_of_the_load_out_of_balance() -> None:
    """At the start, flat and stress-free, nothing balances the weight."""
    outcome = ff.relax(plate(), ff.RelaxationOptions(quiet=True, max_iterations=20))
    assert outcome.status.startswith("not in equilibrium after 20 iterations")
    if outcome.history:
        # one that forgets fixed nodes, or counts moments as forces, is not one
        assert outcome.history["residual"][0] == pytest.approx(1.0, abs=1e-12)
        assert outcome.history["largest_step"][0] == 0.0
        assert list(outcome.history["t"]) == [0.0, 20.0]


@pytest.mark.slow_on_ranks
@pytest.mark.parametrize(
    "damping",
    ["accelerated", *(pytest.param(d, marks=pytest.mark.serial) for d in ("viscous", "kinetic"))],
)
def test_going_on_from_a_checkpoint(damping: str, shared_tmp_path: Path) -> None:
    options = {"damping": damping, "record_every": 10, "every": 1000}
    whole = relax(cantilever(), tolerance=1e-5, step_tolerance=1e-4, **options)
    part = ff.RelaxationOptions(
        **options, quiet=True, max_iterations=130, checkpoint_every=130, output=shared_tmp_path
    )
    ff.relax(cantilever(), part)
    outcome = relax(
        cantilever(), tolerance=1e-5, step_tolerance=1e-4, output=shared_tmp_path,
        restart=shared_tmp_path / "checkpoint_000130.h5", **options,
    )  # fmt: skip
    assert outcome.summary["restarted_at_step"] == 130
    # forgotten velocities, masses or multipliers change the number of iterations
    assert outcome.summary["steps"] == whole.summary["steps"]
    if whole.history:
        for name, values in whole.history.items():
            np.testing.assert_allclose(outcome.history[name], values, rtol=1e-6, atol=1e-9)
        summary = json.loads((shared_tmp_path / "summary.json").read_text())
        assert summary["status"] == "ok"


def sheet(triangles: float = 0.0, **contact: Any) -> ff.Model:
    """A small sheet on a sphere, hanging down on all sides; it cannot slide off.

    The sphere is exact, or of triangles with edges of at most a length (m).
    """
    grid = np.linspace(-0.5, 0.5, 7)
    mesh = ff.SurfaceMesh.grid("sheet", grid, grid)
    model = ff.Model("sheet", surface=mesh)
    section = ff.ShellSection.orthotropic(
        (1e3, 1e3, 300.0), (0.5, 0.5, 0.2), 0.0, mass=1.0, thickness=0.01
    )
    corners = [name for name in mesh.nodes if name.startswith("sheet_")]
    below = ff.Ground((0.0, 0.0, -0.3055))  # nearly repels at the start
    sphere: ff.RigidSurface = ff.RigidSphere(below, 0.3)
    if triangles:
        ball = load_case("draping").build.__globals__["ball"](0.3, triangles)
        sphere = ff.RigidMesh(below, mesh=ball)
    model.add(
        ff.Shell("sheet", section, fixed=dict.fromkeys(corners, "xy")),
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Contact("support", "sheet", surfaces=sphere, **({"law": "barrier"} | contact)),
        ff.ContactProbe("contact", "support"),
        ff.PositionProbe("corner", ff.Marker("sheet", "sheet_top_right")),
    )
    return model


@pytest.mark.serial
def test_contact_carries_the_weight() -> None:
    outcome = relax(sheet(), tolerance=1e-6, step_tolerance=1e-7)
    static = ff.solve_static(sheet(), ff.StaticOptions(load_steps=2, stabilise=True, quiet=True))
    assert static.status == "ok"
    if outcome.history:
        assert outcome.history["corner_z"][-1] < -0.05
        # a contact left out of the masses makes the step unstable; one without it lets it fall
        assert outcome.history["contact_fz"][-1] == pytest.approx(9.81, rel=1e-5)
        # steps that pass through the sphere end with a gap that is not positive
        assert outcome.history["contact_gap"].min() > 0.0
        for name, error in (("corner_z", 1e-6), ("contact_gap", 1e-7), ("contact_normal", 1e-4)):
            # forces of other gaps, as of a motion, end elsewhere by more than the reach, 5e-4
            assert outcome.history[name][-1] == pytest.approx(static.history[name][-1], abs=error)


@pytest.mark.slow
@pytest.mark.serial
def test_all_dampings_find_the_same_equilibrium() -> None:
    """Three paths end in one place."""
    one, *others = (
        relax(sheet(), tolerance=1e-6, step_tolerance=1e-7, damping=damping)
        for damping in ("accelerated", "viscous", "kinetic")
    )
    if one.history:
        height = one.history["corner_z"][-1]
        for other in others:
            # another fold, or a saddle left by the other damping, changes heights by 1e-3
            assert other.history["corner_z"][-1] == pytest.approx(height, abs=1e-5)
        # momentum that is never dropped, or dropped at every step, takes as long as the others
        assert one.summary["steps"] < min(other.summary["steps"] for other in others)


@pytest.mark.slow_on_ranks
def test_contacts_go_on_from_a_checkpoint(shared_tmp_path: Path) -> None:
    """Stiffness and masses of barriers are in the checkpoint, or found again."""

    def model() -> ff.Model:
        made = sheet()
        made.add(ff.Contact("folds", "sheet", "sheet", law="barrier"), ff.EnergyProbe())
        return made

    def run(until: int, **more: Any) -> dict[str, np.ndarray]:
        options = ff.RelaxationOptions(
            record_every=10, every=1000, renew_every=30, max_iterations=until, quiet=True, **more
        )
        return ff.relax(model(), options).history

    whole = run(120)
    run(70, output=shared_tmp_path, checkpoint_every=70)
    rest = run(120, output=shared_tmp_path, restart=shared_tmp_path / "checkpoint_000070.h5")
    for name, values in whole.items():
        # another stiffness of the barrier, forgotten momentum or masses change the way by 1e-3
        np.testing.assert_allclose(rest[name], values, rtol=1e-9, atol=1e-12, err_msg=name)


@pytest.mark.three_ranks
@pytest.mark.parametrize(
    ("damping", "triangles"),
    [
        pytest.param("accelerated", 0.0, marks=pytest.mark.serial),
        pytest.param("viscous", 0.0, marks=pytest.mark.serial),
        ("accelerated", 0.05),
    ],
)
def test_ranks_take_the_same_way(damping: str, triangles: float) -> None:
    """One shell over all ranks against itself on one: free fall, contact, renewed masses.

    Corners of small triangles press on the sheet from several ranks.
    """
    model = sheet(triangles)
    model.add(ff.EnergyProbe())
    options = ff.RelaxationOptions(
        damping=damping, max_iterations=160, record_every=10, every=1000, renew_every=50,
        split_above=10, quiet=True,
    )  # fmt: skip
    one = ff.relax(model, options, comm=MPI.COMM_SELF).history
    every = ff.relax(model, options).history
    if every:
        assert one["contact_fz"].max() > 1.0
        for name, values in one.items():
            # forces of ghosts counted twice, or decisions taken on a rank's own sums, give 1e-2,
            # masses of contacts that every rank counts 1e-3
            np.testing.assert_allclose(
                every[name], values, rtol=0.0, atol=1e-9 * np.abs(values).max(), err_msg=name
            )


@pytest.mark.serial
@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"tolerance": 0.0}, "tolerance must be a finite number > 0"),
        ({"step_tolerance": -1.0}, "step_tolerance must be"),
        ({"damping": "critical"}, "damping must be one of accelerated, viscous, kinetic"),
        ({"masses": "unit"}, "masses must be one of stiffness, scaled"),
        ({"least_mass": 2.0}, "least_mass must be"),
        ({"margin": 0.1}, "margin must be"),
        ({"record_every": 30}, "every 1000 is no multiple of record_every 30"),
        ({"checkpoint_every": 7}, "checkpoint_every 7 is no multiple of record_every 20"),
    ],
)
def test_bad_options(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match="RelaxationOptions: " + message):
        ff.RelaxationOptions(**values)


@pytest.mark.serial
def test_friction_of_barriers_is_refused() -> None:
    with pytest.raises(ValueError, match=r'Contact "support": friction 0.3 of barriers does not'):
        ff.relax(sheet(friction=0.3), ff.RelaxationOptions(quiet=True))


@pytest.mark.serial
def test_other_mistakes(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="relax: options"):
        ff.relax(plate(), ff.StaticOptions(quiet=True))  # type: ignore[arg-type]
    taken = cantilever(
        ff.Probe("p", ff.Marker("beam", "end"), ("residual",), lambda t, s: s.position[:1])
    )
    with pytest.raises(ValueError, match="column 'residual' of a probe"):
        ff.relax(taken, ff.RelaxationOptions(quiet=True))
    options = ff.RelaxationOptions(quiet=True, max_iterations=20, output=tmp_path)
    ff.relax(plate(), options)
    file = tmp_path / "checkpoint_000020.h5"
    again = ff.RelaxationOptions(quiet=True, max_iterations=20, output=tmp_path, restart=file)
    with pytest.raises(ValueError, match="is at iteration 20 already, max_iterations = 20"):
        ff.relax(plate(), again)
    other = ff.RelaxationOptions(quiet=True, margin=2.0, output=tmp_path, restart=file)
    with pytest.raises(ValueError, match=r"was written with margin = 1\.2, not 2"):
        ff.relax(plate(), other)


@pytest.mark.serial
def test_loads_that_are_not_finite_are_refused() -> None:
    model = plate()
    model.add(
        ff.PointForce(
            "bad", ff.Marker("plate", (0.5, 0.5, 0.0)), (0.0, 0.0, 1.0), amplitude=lambda t: np.nan
        )
    )
    with pytest.raises(ValueError, match=r'PointForce "bad": amplitude is nan at t = 0 s, from'):
        ff.relax(model, ff.RelaxationOptions(quiet=True))


@pytest.mark.serial
@pytest.mark.parametrize("length", [1.0, 10.0])
def test_moments_count_by_the_size_of_the_model(length: float) -> None:
    """Beside loads of which nothing is balanced yet the residual is one, in any unit of length."""
    points = np.linspace(0.0, length, 3)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    model = ff.Model("beam", mesh=ff.LineMesh(points, [[0, 1], [1, 2]], {"beam": [0, 1]}))
    section = ff.Section.general((1e5, 1e5, 1e5, 80.0, 100.0, 120.0), (1.0,) * 6)
    model.add(
        ff.Beam("beam", section, orientation=(0.0, 1.0, 0.0)),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "start")),
        ff.PointMoment("moment", ff.Marker("beam", "end"), (0.0, 1.0, 0.0)),
        ff.PointForce("force", ff.Marker("beam", "end"), (0.0, 0.0, 1.0)),
    )
    options = ff.RelaxationOptions(max_iterations=1, record_every=1, quiet=True)
    history = ff.relax(model, options).history
    # with moments as they are, or times the size, 10 or 100 where the length is not one
    assert history["residual"][0] == pytest.approx(1.0, rel=1e-12)
