# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static equilibria against published values, closed forms and one another."""

import importlib
import json
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.cli import load_case
from tests.verification.benchmarks import static_beams

SECTION = (1e6, 1e6, 1e6, 80.0, 100.0, 120.0)


def cantilever(*loads: Any, elements: int = 6, turn: np.ndarray | None = None) -> ff.Model:
    """Cantilever of length 1, turned as a whole, with a probe of the tip's displacement."""
    R = np.eye(3) if turn is None else turn
    points = np.linspace(0.0, 1.0, elements + 1)[:, np.newaxis] * R[:, 0]
    cells = np.stack([np.arange(elements), np.arange(1, elements + 1)], axis=1)
    mesh = ff.LineMesh(points, cells, {"beam": np.arange(elements)})
    model = ff.Model("cantilever", mesh=mesh)
    tip = ff.Marker("beam", "end")
    model.add(
        ff.Beam("beam", ff.Section.general(SECTION, (1.0,) * 6), orientation=tuple(R[:, 1])),
        ff.Rigid("clamp", ff.Ground(rotation=R), ff.Marker("beam", "start")),
        ff.Probe("tip", tip, ("u", "v", "w"), lambda t, at: (at.position - R[:, 0]).tolist()),
        *loads,
    )
    return model


def force(vector: Any, name: str = "force", **more: Any) -> ff.PointForce:
    return ff.PointForce(name, ff.Marker("beam", "end"), tuple(vector), **more)


def solve(model: ff.Model, **options: Any) -> ff.Outcome:
    outcome = ff.solve_static(model, ff.StaticOptions(**options))
    assert outcome.status == "ok", outcome.status
    return outcome


def tips(outcome: ff.Outcome) -> np.ndarray:
    """(rows, 3), on the first rank."""
    return np.stack([outcome.history[name] for name in "uvw"], axis=1)


@pytest.mark.serial
@pytest.mark.parametrize("name", ["static_beams", "static_nurbs", "static_paths"])
def test_benchmarks(name: str) -> None:
    """The purpose of each tolerance is stated there."""
    module = importlib.import_module(f"tests.verification.benchmarks.{name}")
    for result in module.results(full=False):
        assert result.passed, result


@pytest.mark.serial
@pytest.mark.parametrize(
    ("function", "reference"),
    [
        (lambda n: static_beams.dead_force(n)[1], static_beams.DEAD_FORCE[1]),
        (lambda n: static_beams.bend(n, "polar")[2], static_beams.BEND["polar"][2]),
        (lambda n: static_beams.follower(2 * n, 100e3)[1], static_beams.FOLLOWER[1]),
    ],
)
def test_second_order(function: Any, reference: float) -> None:
    errors = [abs(function(n) - reference) for n in (8, 16)]
    # locking or a wrong strain measure would spoil the order
    assert 1.9 <= np.log2(errors[0] / errors[1]) <= 2.2


def test_path_does_not_matter_and_closed_ones_return() -> None:
    a, b = (0.0, 40.0, 10.0), (20.0, 0.0, 150.0)
    early, late, times = (0, 1, 1, 0), (0, 0, 1, 0), (0, 1, 2, 3)
    found = []
    for first, second in ((early, late), (late, early)):
        model = cantilever(
            force(a, "a", amplitude=ff.Table(times, first)),
            force(b, "b", amplitude=ff.Table(times, second)),
        )
        outcome = solve(model, load_steps=6, t_end=3.0)
        if outcome.history:
            found.append(tips(outcome)[[4, 6]])
    if found:
        assert np.abs(found[0][0]).max() > 0.3
        # interpolated or accumulated rotation vectors depend on the path by 1e-2
        np.testing.assert_allclose(found[0][0], found[1][0], atol=1e-11)
        np.testing.assert_allclose([f[1] for f in found], 0.0, atol=1e-11)


@pytest.mark.serial
def test_rotated_model_gives_the_rotated_result() -> None:
    from flexfem.lie import so3

    R = so3.exp(np.array([1.0, -0.5, 0.25]) * 3.0)
    F = np.array([-20.0, 60.0, 150.0])
    plain = solve(cantilever(force(F)), load_steps=2)
    turned = solve(cantilever(force(R @ F), turn=R), load_steps=2)
    if plain.history:
        # the strains of a frame-dependent interpolation change by 1e-2
        np.testing.assert_allclose(tips(turned)[-1], R @ tips(plain)[-1], atol=1e-11)


@pytest.mark.serial
def test_deformed_beam_turned_as_a_whole() -> None:
    """Crisfield and Jelenić's test: the base of a beam under follower load turns by 10 rad."""
    tip = ff.Marker("beam", "end")
    model = cantilever(force((0.0, 40.0, 90.0), follower=True, amplitude=lambda t: min(t, 1.0)))
    base = ff.Model("turned", mesh=model.mesh)
    pin = ff.Marker("beam", "start")
    base.add(
        model["beam"], model["force"],
        ff.Revolute("axle", ff.Ground(), pin, axis=(1.0, 2.0, 2.0)),
        ff.PrescribedAngle("turn", ff.Ground(), pin, axis=(1.0, 2.0, 2.0),
                           angle=lambda t: 5.0 * max(t - 1.0, 0.0)),
        ff.Probe("length", tip, ("distance",), lambda t, at: (float(np.linalg.norm(at.position)),)),
        ff.Probe("height", tip, ("height",), lambda t, at: (float(at.position @ (1, 2, 2)) / 3.0,)),
    )  # fmt: skip
    outcome = solve(base, load_steps=12, t_end=3.0)
    if outcome.history:
        for name in ("distance", "height"):
            kept = outcome.history[name][outcome.history["t"] >= 1.0]
            assert abs(kept[0] - (1.0 if name == "distance" else 1.0 / 3.0)) > 0.01
            # accumulated strain of incremental rotations drifts by 1e-3 and more
            np.testing.assert_allclose(kept, kept[0], atol=1e-10)


def test_both_ways_of_stepping_meet() -> None:
    """Load steps and arc length end at the same equilibrium, in one step or in many."""
    ends = []
    for options in ({"load_steps": 1}, {"load_steps": 7}, {"arc_length": 0.2}):
        outcome = solve(cantilever(force((-10.0, 120.0, 60.0))), split_above=1, **options)
        ends.append(tips(outcome)[-1] if outcome.history else np.zeros(3))
    # the tolerance is 1e-8 and convergence quadratic; arc length ends at t = 1 to 1e-10
    np.testing.assert_allclose(ends[1:], [ends[0], ends[0]], atol=1e-9)


@pytest.mark.serial
def test_few_steps_roll_a_beam_up() -> None:
    model = load_case("roll_up").model(elements=8, turns=1.0, out_of_plane_force=0.0)
    outcome = solve(model, load_steps=1)
    # tangents with the membrane stress of a step's second order take 300 iterations and more
    assert outcome.summary["newton_iterations"] <= 40
    assert outcome.summary["rejected_steps"] <= 2


def test_tip_drive_gives_the_force_of_the_load() -> None:
    """A drive at the tip by the displacement that a force causes takes that force."""
    from mpi4py import MPI

    from flexfem.launch import StopSignals
    from flexfem.simulation.run.loop import Run
    from flexfem.simulation.statics import StaticSteps

    outcome = solve(cantilever(force((0.0, 100.0, 0.0))), load_steps=2)
    end = MPI.COMM_WORLD.bcast(float(outcome.history["v"][-1]) if outcome.history else 0.0)
    drive = ff.PrescribedTranslation(
        "drive", ff.Ground((1.0, 0.0, 0.0)), ff.Marker("beam", "end"), lambda t: end * t,
        axis=(0.0, 1.0, 0.0),
    )  # fmt: skip
    options = ff.StaticOptions(load_steps=2)
    steps = StaticSteps(cantilever(drive), options, MPI.COMM_WORLD, None)
    run = Run(steps, options)
    assert run.finish(steps.reason(run.to_the_end(StopSignals()))).status == "ok"
    rows = steps.system.constraints
    mine = [
        float(rows.forces[rows.start[i]])
        for i, joint in enumerate(rows.joints)
        if joint.owned and joint.joint.name == "drive"
    ]
    (taken,) = MPI.COMM_WORLD.allgather(mine)[0] or MPI.COMM_WORLD.allgather(mine)[-1]
    # a multiplier left scaled would be off by the stiffness, 1e6
    assert abs(abs(taken) - 100.0) <= 1e-5


@pytest.mark.parametrize("gravity", ["proportional", "constant"])
def test_gravity(gravity: str) -> None:
    """Small deflections: rho A g L^4/(8 EI), at every load step or in proportion."""
    model = cantilever(elements=16)
    model.add(ff.Gravity((0.0, 0.0, -0.08)))
    outcome = solve(model, load_steps=2, gravity_load=gravity)
    if outcome.history:
        expected = -0.08 / (8.0 * SECTION[4])
        shares = (0.0, 0.5, 1.0) if gravity == "proportional" else (1.0, 1.0, 1.0)
        # the elements' error is 1/(4 n^2) = 1e-3; a mistaken share is off by half
        np.testing.assert_allclose(outcome.history["w"], expected * np.array(shares), rtol=5e-3)


@pytest.mark.serial
def test_stepping_over_a_limit_point_fails_where_it_lies() -> None:
    model = load_case("lee_frame").model(elements=4)
    outcome = ff.solve_static(model, ff.StaticOptions(load_steps=4, t_end=1.2, max_iterations=12))
    arc = solve(model, arc_length=0.1, stop_column="down", stop_value=55.0)
    limit = arc.summary["critical_points"][0]["t"]
    if outcome.status == "ok":  # it may jump to the other branch
        assert outcome.summary["rejected_steps"] > 0
    else:
        assert "t = " in outcome.status
        reached = float(outcome.status.split("t = ")[1].split()[0])
        assert limit - 0.05 <= reached <= limit


@pytest.mark.slow_on_ranks
def test_branch_of_a_buckled_column() -> None:
    """The deflection beyond Euler's load is that of the elastica."""
    model = cantilever(force((-1.0, 0.0, 0.0)), elements=16)
    critical = np.pi**2 * SECTION[4] / 4.0
    outcome = solve(
        model, arc_length=0.3, t_end=1.1 * critical, critical_points=True, branch=0.05,
    )  # fmt: skip
    first = outcome.summary["critical_points"][0]
    assert (first["kind"], first["unstable"]) == ("bifurcation", [0, 1])
    assert abs(first["t"] / critical - 1.0) <= 2e-3
    if outcome.history:
        # P/P_c = (2 K(k)/pi)^2 and w/L = 2 k/K(k), K = pi/2 (1 + k^2/4 + 9 k^4/64 + 25 k^6/256)
        t, w = outcome.history["t"][-1], abs(outcome.history["w"][-1])
        square = np.linspace(0.0, 0.5, 10001)
        K = np.pi / 2.0 * (1.0 + square / 4.0 + 9.0 * square**2 / 64.0 + 25.0 * square**3 / 256.0)
        expected = np.interp(t / first["t"], (2.0 * K / np.pi) ** 2, 2.0 * np.sqrt(square) / K)
        # of the order of the elements' error, 1e-3, while the branch of the stiffer plane differs
        # by 20 % in load and the unbuckled column has no deflection at all
        assert abs(w / expected - 1.0) <= 0.01
        assert abs(outcome.history["v"]).max() <= 1e-9


def test_mode_pictures_are_written(shared_tmp_path: Path) -> None:
    model = cantilever(force((-1.0, 0.0, 0.0)))
    outcome = solve(model, t_end=100.0, load_steps=1, buckling_modes=2, output=shared_tmp_path)
    expected = np.pi**2 / 4.0 * np.array([SECTION[4], SECTION[5]])
    # the elements' error with 6 of them is 6e-3; the order of the bending stiffnesses is 20 %
    np.testing.assert_allclose(outcome.summary["buckling"], expected, rtol=1e-2)
    if outcome.history:
        assert (shared_tmp_path / "modes" / "beams.pvd").read_text().count("<DataSet") >= 2
        written = json.loads((shared_tmp_path / "summary.json").read_text())
        assert written["buckling"] == outcome.summary["buckling"]


def test_loads_beyond_rounding_are_no_buckling_loads() -> None:
    """All modes of a column: unloaded motions would buckle at 1e13 and more, by round-off."""
    outcome = solve(cantilever(force((-1.0, 0.0, 0.0)), elements=4), load_steps=1,
                    buckling_modes=60)  # fmt: skip
    loads = outcome.summary["buckling"]
    assert len(loads) > 4
    assert max(np.abs(loads)) < 1e12


def chain() -> ff.Model:
    return load_case("chain").model(links=2, elements=3)


@pytest.mark.three_ranks
def test_start_in_equilibrium() -> None:
    """A chain that begins level hangs straight down, stretched by its weight, and stays."""
    options = ff.RunOptions(dt=1e-3, t_end=5e-3, start="equilibrium")
    outcome = ff.simulate(chain(), options)
    assert outcome.status == "ok"
    if outcome.history:
        # weight 0.981 N over EA = 1e5 N: 0.981/(2 1e5) = 4.9e-6
        low = -1.0 - 0.981 / 2e5
        # standing on end (z = +1) is an equilibrium, too
        np.testing.assert_allclose(outcome.history["tip_z"], low, atol=1e-9)
        np.testing.assert_allclose(outcome.history["tip_x"], 0.0, atol=1e-9)


def test_stabilised_search_ends_where_the_start_does() -> None:
    outcome = solve(chain(), load_steps=2, stabilise=True)
    if outcome.history:
        assert abs(outcome.history["tip_z"][-1] + 1.0 + 0.981 / 2e5) <= 1e-9


@pytest.mark.slow_on_ranks
@pytest.mark.serial
def test_advice_after_a_stabilised_failure_is_not_to_stabilise() -> None:
    model = ff.Model("falling")
    model.add(ff.Gravity((0.0, 0.0, -10.0)), ff.RigidBody("bob", 2.0, (1.0, 1.0, 1.0)))
    outcome = ff.solve_static(model, ff.StaticOptions(load_steps=1, stabilise=True))
    assert "increase load_steps" in outcome.status
    assert "stabilise" not in outcome.status


def test_stabilised_steps_factorise_again_only_where_nothing_holds_them() -> None:
    """A cantilever needs hardly any stabilisation, the start of a chain needs more and more."""
    held, hanging = (solve(model, load_steps=2, stabilise=True).summary
                     for model in (cantilever(force((0.0, 0.0, 1.0))), chain()))  # fmt: skip
    # a factorisation more or fewer would be one that is not counted, or in vain
    assert held["factorizations"] == held["newton_iterations"]
    # growing in tens from 1e-12 of the diagonal, most at first are in vain: 10 beyond the 14 steps
    assert hanging["factorizations"] >= hanging["newton_iterations"] + 5


@pytest.mark.parametrize("stiffness", [0.0, 50.0])
def test_dampers_carry_nothing(stiffness: float) -> None:
    model = ff.Model("hanging")
    bob = ff.Marker("bob")
    model.add(
        ff.Gravity((0.0, 0.0, -10.0)),
        ff.RigidBody("bob", 2.0, (1.0, 1.0, 1.0)),
        ff.Prismatic("guide", ff.Ground(), bob, axis=(0.0, 0.0, 1.0)),
        ff.SpringDamper("spring", ff.Ground((0.0, 0.0, 1.0)), bob, stiffness=100.0, damping=5.0),
        ff.SpringDamper(
            "damper", ff.Ground((0.0, 0.0, 3.0)), bob, stiffness=stiffness, damping=7.0
        ),
        ff.PositionProbe("at", bob),
    )
    static = solve(model, load_steps=1)
    moving = ff.simulate(model, ff.RunOptions(dt=1e-2, t_end=0.1, start="equilibrium"))
    if static.history:
        expected = -20.0 / (100.0 + stiffness)
        assert abs(static.history["at_z"][-1] - expected) <= 1e-9
        # springs and dampers have their constants back: nothing moves
        np.testing.assert_allclose(moving.history["at_z"], expected, atol=1e-6)


def mistake(what: str) -> tuple[ff.Model, dict[str, Any]]:
    """A model and options that do not go together."""
    if what == "mechanism":
        return chain(), {}
    if what == "free":
        model = ff.Model("free")
        model.add(ff.RigidBody("stone", 1.0, (1.0, 1.0, 1.0)))
        return model, {}
    if what == "nothing grows":
        model = cantilever(force((0.0, 1.0, 0.0), amplitude=lambda t: 1.0))
        return model, {"arc_length": 0.1}
    if what == "column":
        return cantilever(force((0.0, 1.0, 0.0))), {"stop_column": "x", "stop_value": 1.0}
    model = cantilever()
    model.add(ff.Spherical("far", ff.Ground((0.0, 1.0, 0.0)), ff.Marker("beam", "end")))
    return model, {}


@pytest.mark.parametrize(
    ("what", "parts"),
    [
        ("mechanism", ('Beam "link_1", Beam "link_2": ', "without any stiffness")),
        ("free", ('RigidBody "stone": ', "without any stiffness")),
        ("nothing grows", ("arc_length 0.1", 'Model "cantilever"', "grows")),
        ("column", ("stop_column 'x'", "u, v, w")),
        ("apart", ('Spherical "far"', "violate")),
    ],
)
def test_mistakes_are_named(what: str, parts: tuple[str, ...], shared_tmp_path: Path) -> None:
    model, options = mistake(what)
    with pytest.raises(ValueError, match=r"^[A-Z].*: ") as caught:
        ff.solve_static(model, ff.StaticOptions(output=shared_tmp_path, **options))
    message = str(caught.value)
    assert "\n" not in message
    for part in parts:
        assert part in message
    MPI.COMM_WORLD.Barrier()  # the first rank removes the mark of the run
    assert not list(shared_tmp_path.iterdir())


@pytest.mark.serial
@pytest.mark.parametrize(
    ("values", "parts"),
    [
        ({"load_steps": 0}, ("load_steps", "0")),
        ({"load_steps": 2.5}, ("load_steps", "2.5")),
        ({"t_end": 0.0}, ("t_end", "0.0")),
        ({"t_end": float("nan")}, ("t_end", "nan")),
        ({"gravity_load": "upwards"}, ("gravity_load", "'upwards'")),
        ({"tolerance": 0.0}, ("tolerance", "0.0")),
        ({"max_iterations": 0}, ("max_iterations", "0")),
        ({"arc_length": -0.1}, ("arc_length", "-0.1")),
        ({"max_steps": 0}, ("max_steps", "0")),
        ({"stop_value": 1.0}, ("stop_value", "stop_column")),
        ({"branch": 0.1}, ("branch 0.1", "arc_length")),
        ({"buckling_modes": -1}, ("buckling_modes", "-1")),
        ({"stabilise": True, "arc_length": 0.1}, ("stabilise", "arc_length")),
        ({"stabilise": 1}, ("stabilise", "1")),
        ({"every": 0}, ("every", "0")),
    ],
)
def test_options(values: dict[str, Any], parts: tuple[str, ...]) -> None:
    with pytest.raises((TypeError, ValueError)) as caught:
        ff.StaticOptions(**values)
    for part in ("StaticOptions", *parts):
        assert part in str(caught.value)


def test_drives_that_are_no_numbers() -> None:
    model = cantilever(
        ff.PrescribedTranslation(
            "drive", ff.Ground((1.0, 0.0, 0.0)), ff.Marker("beam", "end"),
            lambda t: t if t <= 0.55 else float("nan"), axis=(0.0, 1.0, 0.0),
        )
    )  # fmt: skip
    outcome = ff.solve_static(model, ff.StaticOptions(load_steps=10))
    assert outcome.status.startswith('PrescribedTranslation "drive": the motion is not finite')
    if outcome.history:
        assert 0.49 <= outcome.history["t"][-1] <= 0.55


def test_loads_that_are_no_numbers() -> None:
    """Statics asks for the whole of a load before it takes a first part of it."""
    wrong = force((0.0, 10.0, 0.0), amplitude=lambda t: t if t <= 0.55 else float("nan"))
    with pytest.raises(ValueError, match=r'PointForce "force": amplitude is nan at t = 1 s, from'):
        ff.solve_static(cantilever(wrong), ff.StaticOptions(load_steps=10))


@pytest.mark.serial
@pytest.mark.parametrize("held", [False, True])
def test_stability_beside_a_load_that_follows_counts_as_without_it(held: bool) -> None:
    """Euler's column with a follower load of no size: the determinant's sign must tell the same."""
    model = cantilever(
        force((-1.0, 0.0, 0.0)),
        force((0.0, 1.0, 0.0), "follower", follower=True, amplitude=lambda t: 0.0),
        elements=16,
    )
    if held:  # seven conditions instead of six: each changes the determinant's sign
        plane = ff.PointOnPlane("plane", ff.Ground(), ff.Marker("beam", "end"), axis=(0, 0, 1))
        model.add(plane)
    # weak axis: deflection along y by EI_z = 120, along z by EI_y = 100, which the plane forbids
    critical = np.pi**2 * (SECTION[5] if held else SECTION[4]) / 4.0
    outcome = solve(model, load_steps=6, t_end=1.1 * critical, critical_points=True)
    points = outcome.summary["critical_points"]
    # stable and unstable swapped would be [1, 0]
    assert [(p["kind"], p["unstable"]) for p in points] == [("bifurcation", [0, 1])]
    # the mesh's error; the other plane's load differs by 20 %
    assert abs(points[0]["t"] / critical - 1.0) <= 3e-3


@pytest.mark.parametrize("law", ["spring", "damper"])
def test_springs_hold_a_column_by_their_stiffness_and_dampers_do_not(law: str) -> None:
    """Euler's column with a spring across its end: c L^3/EI = u^3/(u - tan u), P = EI (u/L)^2."""
    stiffness, damping = (100.0, 0.0) if law == "spring" else (0.0, 10.0)
    side = ff.Bushing(
        "side", ff.Ground((1.0, 0.0, 0.0)), ff.Marker("beam", "end"),
        stiffness=(0.0, stiffness, stiffness, 0.0, 0.0, 0.0),
        damping=(0.0, damping, damping, 0.0, 0.0, 0.0),
    )  # fmt: skip
    model = cantilever(force((-1.0, 0.0, 0.0)), side, elements=16)
    expected = []
    for bending in SECTION[4:]:
        low, high = 0.5 * np.pi + 1e-9, np.pi
        while high - low > 1e-12:
            u = 0.5 * (low + high)
            low, high = (u, high) if u**3 / (u - np.tan(u)) < stiffness / bending else (low, u)
        expected.append(bending * low**2)
    outcome = solve(model, load_steps=6, t_end=1.1 * expected[1], critical_points=True)
    points = outcome.summary["critical_points"]
    found = [(point["kind"], point["unstable"]) for point in points]
    assert found == [("bifurcation", [0, 1]), ("bifurcation", [1, 2])]
    # the mesh's error; either spring counted as stiff misses the first point
    np.testing.assert_allclose([point["t"] for point in points], expected, rtol=3e-3)


@pytest.mark.parametrize(
    "beside", ["curve", pytest.param("stop", marks=pytest.mark.serial), "falling"]
)
def test_nonlinear_springs_hide_no_pair_of_critical_points(beside: str) -> None:
    """Both of Euler's loads of a column lie in one step: the determinant's sign stays the same."""
    place, body = (3.0, 0.0, 0.0), ff.Marker("body")
    foot, axis = ff.Ground((3.0, 0.0, -1.0)), (0.0, 0.0, 1.0)
    law = {
        "curve": ff.SpringDamper("law", foot, body, force=lambda x: 10.0 * x + x**3),
        "stop": ff.LimitStop("law", ff.Ground(place), body, upper=0.1, stiffness=10.0, axis=axis),
        "falling": ff.SpringDamper("law", foot, body, force=lambda x: -40.0 * x),
    }
    model = cantilever(
        force((-1.0, 0.0, 0.0)),
        ff.RigidBody("body", 1.0, np.eye(3), position=place),
        ff.Prismatic("guide", ff.Ground(place), body, axis=axis),
        ff.SpringDamper("spring", foot, body, 100.0),
        law[beside],
        elements=16,
    )
    critical = np.pi**2 * np.array(SECTION[4:]) / 4.0
    outcome = solve(model, load_steps=1, t_end=1.1 * critical[1], critical_points=True)
    points = outcome.summary["critical_points"]
    found = [(point["kind"], point["unstable"]) for point in points]
    assert found == [("bifurcation", [0, 1]), ("bifurcation", [1, 2])]
    np.testing.assert_allclose([point["t"] for point in points], critical, rtol=3e-3)


@pytest.mark.serial
def test_a_truss_of_springs_is_unstable_from_its_limit_point_on() -> None:
    """Von Mises' truss of span 2 and rise 1/2: F = 2 k (L0 - L) z/L with the greatest load."""
    top, rise, k = ff.Marker("top"), 0.5, 1000.0
    model = ff.Model("truss")
    model.add(
        ff.RigidBody("top", 1.0, np.eye(3), position=(0.0, 0.0, rise)),
        ff.SpringDamper("left", ff.Ground((-1.0, 0.0, 0.0)), top, k),
        ff.SpringDamper("right", ff.Ground((1.0, 0.0, 0.0)), top, k),
        ff.Prismatic("guide", ff.Ground((0.0, 0.0, rise)), top, axis=(0.0, 0.0, 1.0)),
        ff.PointForce("push", top, (0.0, 0.0, -200.0)),
        ff.PositionProbe("at", top),
    )
    outcome = solve(model, arc_length=0.02, critical_points=True)
    length = np.hypot(1.0, rise)
    z = (length ** (2.0 / 3.0) - 1.0) ** 0.5  # L^3 = L0 there
    load = 2.0 * k * (length - length ** (1.0 / 3.0)) * z / length ** (1.0 / 3.0) / 200.0
    points = outcome.summary["critical_points"]
    found = [(point["kind"], point["unstable"]) for point in points]
    assert found == [("limit point", [0, 1]), ("limit point", [1, 0])]
    np.testing.assert_allclose([point["t"] for point in points], [load, -load], rtol=1e-9)
    if outcome.history:
        np.testing.assert_allclose([point["at_z"] for point in points], [z, -z], rtol=1e-6)


def test_stability_is_counted_again_after_a_singular_start() -> None:
    """A pendulum that weighs nothing at t = 0 turns freely there, and hangs at all others."""
    model, place = ff.Model("pendulum"), (0.0, 0.0, -1.0)
    model.add(
        ff.RigidBody("bob", 1.0, 0.1 * np.eye(3), position=place),
        ff.Spherical("hook", ff.Ground(), ff.Marker("bob", offset=(0.0, 0.0, 1.0))),
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.PositionProbe("at", ff.Marker("bob")),
    )
    outcome = solve(model, load_steps=2, stabilise=True, critical_points=True)
    assert outcome.summary["critical_points"] == []
    if outcome.history:
        np.testing.assert_allclose([outcome.history[f"at_{x}"][-1] for x in "xyz"], place)


@pytest.mark.slow_on_ranks
@pytest.mark.serial
def test_a_value_that_is_not_reached_is_said() -> None:
    """The tip goes to 10/(3 EI): twice that is not on the path, half of it is."""
    model = cantilever(force((0.0, 0.0, 10.0)))
    full = 10.0 / (3.0 * SECTION[4])
    for arc_length in (0.0, 0.2):
        for share, status in ((2.0, "stop_value 0.0666667 of w not reached: 0.03"), (0.5, "ok")):
            options = ff.StaticOptions(
                load_steps=3, arc_length=arc_length, stop_column="w", stop_value=share * full
            )
            outcome = ff.solve_static(model, options)
            assert outcome.status.startswith(status)
            if outcome.history and share < 1.0:
                # ends there, not at the end of the load
                assert abs(outcome.history["w"][-1] / (share * full) - 1.0) <= 1e-6
