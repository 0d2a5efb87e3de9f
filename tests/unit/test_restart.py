# SPDX-License-Identifier: LGPL-3.0-or-later
"""Going on from a checkpoint gives the history that an uninterrupted run gives."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.cli import load_case
from flexfem.io import read_history
from flexfem.mesh.line_mesh import LineMesh
from flexfem.simulation.motion.stepping import Simulation
from tests.unit.forged import each_kind

COMM = MPI.COMM_WORLD


def driven() -> ff.Model:
    """A beam on a turning hinge drags a body; springs, dampers, a follower and an angle probe.

    The probe's angle has jumped once by 2 pi at half of the time, a wheel has turned twice.
    """
    points = np.linspace(0.0, 1.0, 6)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    cells = np.stack([np.arange(5), np.arange(1, 6)], axis=1)
    model = ff.Model("driven", mesh=LineMesh(points, cells, {"arm": np.arange(5)}))
    steel = ff.Material(2.1e9, 0.3, 7850.0)
    root, tip = ff.Marker("arm", "start"), ff.Marker("arm", "end")
    hub = ff.Marker("hub", offset=(-0.2, 0.0, 0.0))
    axis = (0.0, 0.0, 1.0)
    model.add(
        ff.Gravity((0.0, -9.81, 0.0)),
        ff.Beam("arm", ff.Section.rectangle(0.03, 0.02, steel), damping=1e-4),
        ff.RigidBody("hub", 2.0, (0.02, 0.03, 0.04), position=(1.2, 0.0, 0.0)),
        ff.Revolute("hinge", ff.Ground(), root, axis=axis),
        ff.PrescribedAngle("motor", ff.Ground(), root, axis, lambda t: 60.0 * t * t / (0.1 + t)),
        ff.Revolute("knee", tip, hub, axis=axis),
        ff.TorsionalSpringDamper("twist", tip, hub, axis=axis, stiffness=30.0, damping=0.05),
        ff.SpringDamper(
            "spring", ff.Ground((0.5, 0.5, 0.0)), ff.Marker("hub"), stiffness=300.0, damping=2.0
        ),
        ff.PointForce("push", ff.Marker("hub"), (0.0, 5.0, 0.0), follower=True),
        ff.RigidBody("wheel", 1.0, (0.1, 0.1, 0.2)),
        ff.Revolute("bearing", ff.Ground(), ff.Marker("wheel"), axis=axis),
        ff.PrescribedAngle("spin", ff.Ground(), ff.Marker("wheel"), axis, lambda t: 300.0 * t),
        ff.PositionProbe("rim_path", ff.Marker("wheel", offset=(1.0, 0.0, 0.0))),
        ff.PositionProbe("hub_path", ff.Marker("hub")),
        ff.Probe(
            "turn", (root,), ("angle",),
            lambda t, s: (_six_times(s.rotation),), unwrap=("angle",),
        ),
    )  # fmt: skip
    return model


def loaded_late() -> ff.Model:
    """A damped rod that a force pulls from the checkpoint on: accelerations of its jump have ended.

    Their work counts in the next step.
    """
    rod = ff.LineMesh.straight({"rod": np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0]])}, 6)
    model, rubber = ff.Model("loaded_late", mesh=rod), ff.Material(1e6, 0.3, 1000.0)
    late = ff.TimeFunction(lambda t: float(t >= 0.01), breakpoints=[0.01])
    model.add(
        ff.Beam("rod", ff.Section.circle(0.02, rubber), damping=1e-2),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("rod", "start")),
        ff.PointForce("pull", ff.Marker("rod", "end"), (0.01, 0.0, 0.0), amplitude=late),
        ff.EnergyProbe("energy"),
    )
    return model


def _six_times(rotation: np.ndarray) -> float:
    """Six times the angle about the third axis, in [-pi, pi]."""
    return float(np.angle(complex(rotation[0, 0], rotation[1, 0]) ** 6))


def bouncing() -> ff.Model:
    """A ball on a plane, a pendulum caught by a hook, a beam that is locked; energies, reactions.

    Events change which rows hold: before, at and after the checkpoint.
    """
    x = np.linspace(0.0, 0.6, 4)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    cells = np.stack([np.arange(3), np.arange(1, 4)], axis=1)
    model = ff.Model("bouncing", mesh=LineMesh(x, cells, {"rod": np.arange(3)}))
    steel = ff.Material(2.1e9, 0.3, 7850.0)
    ball, bob = ff.Marker("ball"), ff.Marker("bob")
    plane = ff.Ground((3.0, 0.0, -0.02))
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody("ball", 1.0, (0.1, 0.1, 0.1), position=(3.0, 0.0, 0.05)),
        ff.PointOnPlane("floor", plane, ball, axis=(0.0, 0.0, 1.0)),
        ff.RigidBody("bob", 0.5, (0.01, 0.01, 0.01), position=(-0.5, 0.0, 0.0)),
        ff.Spherical("pin", ff.Ground(), ff.Marker("bob", offset=(0.5, 0.0, 0.0))),
        ff.Distance("hook", ff.Ground((-1.0, 0.0, -0.5)), bob),
        ff.Beam("rod", ff.Section.circle(0.01, steel), damping=1e-3),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("rod", "start")),
        ff.Event(
            "bounce",
            ball,
            lambda t, s: s.position[2] + 0.02,
            ff.Rebound("floor", 0.7),
            direction=-1,
            once=False,
        ),
        ff.Event("catch", bob, lambda t, s: s.position[2] + 0.1, ff.LockJoint("hook")),
        ff.RigidBody("reel", 1.0, (0.1, 0.1, 0.1), position=(0.0, 1.0, 0.0)),
        ff.Revolute("axle", ff.Ground((0, 1, 0)), ff.Marker("reel"), axis=(1, 0, 0)),
        ff.PrescribedAngle("motor", ff.Ground(), ff.Marker("reel"), (1, 0, 0), lambda t: 9.0 * t),
        ff.Event("brake", bob, lambda t, s: t - 0.155, ff.LockJoint("motor")),
        ff.EnergyProbe("energy"),
        ff.ReactionProbe("held", "clamp"),
        ff.PositionProbe("ball_path", ball),
        ff.PositionProbe("bob_path", bob),
        ff.PositionProbe("reel_rim", ff.Marker("reel", offset=(0, 1, 0))),
        ff.PositionProbe("tip", ff.Marker("rod", "end")),
    )
    model.release("floor", "hook")
    return model


def curved() -> ff.Model:
    """An arc of NURBS elements carries a NURBS beam of another degree and an SE(3) beam."""
    x = np.linspace(0.5, 0.9, 4)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    cells = np.stack([np.arange(3), np.arange(1, 4)], axis=1)
    model = ff.Model("curved", mesh=LineMesh(x, cells, {"rod": np.arange(3)}))
    section = ff.Section.rectangle(0.03, 0.02, ff.Material(2.1e9, 0.3, 7850.0))
    arc = ff.NurbsCurve.arc((0, 0, 0), (0, -1, 0), (0, 0, 1), np.pi / 2, degree=3, elements=4)
    line = ff.NurbsCurve.line((1, 0, 0), (0.9, 0, 0), degree=2, elements=2)
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Beam("arc", section, curve=arc, damping=1e-4),
        ff.Beam("line", section, curve=line),
        ff.Beam("rod", section),
        ff.Rigid("clamp", ff.Ground((0, -1, 0)), ff.Marker("arc", "start")),
        ff.Revolute("hinge", ff.Marker("arc", "end"), ff.Marker("line", "start"), axis=(0, 1, 0)),
        ff.Spherical("ball", ff.Marker("line", "end"), ff.Marker("rod", "end")),
        ff.PointForce("push", ff.Marker("arc", 0.3), (0.0, 5.0, 9.0), follower=True),
        ff.PositionProbe("tip", ff.Marker("rod", "start")),
        ff.PositionProbe("inside", ff.Marker("arc", 0.7)),
        ff.EnergyProbe("energy"),
        ff.StrainProbe("strain", "arc", 0.5),
    )
    return model


def sliding() -> ff.Model:
    """A body that rubs along a soft beam, from element to element, until an event holds it.

    Another one slides on a beam of its own, which may be on another rank.
    """
    line = ff.NurbsCurve.line((0, 0, 0), (1, 0, 0), degree=2, elements=6)
    section = ff.Section.rectangle(0.02, 0.02, ff.Material(2e8, 0.3, 800.0))
    slide = ff.Sliding("slide", ff.Carrier("rail"), ff.Marker("shoe"), tied=True)
    slider, inertia = ff.SlidingMarker("slide"), (1e-3, 2e-3, 2e-3)
    other = ff.NurbsCurve.line((0, 1, 0), (1, 1, 0), degree=3, elements=5)
    model = ff.Model("sliding")
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Beam("rail", section, curve=line),
        ff.RigidBody("shoe", 0.4, inertia, position=(0.2, 0, 0), velocity=(8, 0, 0)),
        ff.Spherical("left", ff.Ground(), ff.Marker("rail", "start")),
        ff.Revolute("right", ff.Ground((1, 0, 0)), ff.Marker("rail", "end"), axis=(0, 1, 0)),
        slide,
        ff.JointFriction("rub", slide, coefficient=0.1, velocity=0.1),
        ff.SlideStop("stop", slide, upper=0.6, stiffness=1e3, damping=3.0),
        ff.Lock("lock", slide),
        ff.Event("back", slider, lambda t, s: s.arc - 0.59, ff.LockJoint("lock"), direction=-1),
        ff.Probe("path", slider, ("zeta", "rate"), lambda t, s: (s.arc, s.arc_rate)),
        ff.PositionProbe("shoe_path", ff.Marker("shoe")),
        ff.ReactionProbe("force", "slide"),
        ff.EnergyProbe("energy"),
        ff.Beam("other", section, curve=other),
        ff.Rigid("clamp", ff.Ground((0, 1, 0)), ff.Marker("other", "start")),
        ff.RigidBody("bead", 0.1, inertia, position=(0.3, 1, 0), velocity=(3, 0, 0)),
        ff.Sliding("run", ff.Carrier("other"), ff.Marker("bead")),
        ff.PositionProbe("bead_path", ff.Marker("bead")),
    )
    return model


def sheet() -> ff.Model:
    """A hinged sheet that swings down, under pressure and heat, with damping and energies."""
    sun = ff.ThermalStrain(1e-5, lambda x, t: 300.0 * t * x[:, 0], gradient_z=1e4)
    mesh = ff.SurfaceMesh.rectangle("sheet", (1.0, 0.4), (5, 2))
    section = ff.ShellSection.isotropic(2e-3, ff.Material(2e9, 0.3, 7800.0))
    model = ff.Model("sheet", surface=mesh)
    model.add(
        ff.Shell("sheet", section, edges={"sheet_left": "hinged"}, damping=1e-4, prestrain=sun),
        ff.ModalDamping("modes", 0.02, modes=4),
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Pressure("wind", "sheet", 20.0, amplitude=lambda t: np.sin(40.0 * t)),
        ff.PositionProbe("tip", ff.Marker("sheet", "sheet_top_right")),
        ff.EnergyProbe(),
    )
    return model


def heated() -> ff.Model:
    """A twisted cone with a damping for each strain, that the sun warms on one side as it turns."""
    steel = ff.Material(2.1e9, 0.3, 7850.0)
    sun = ff.ThermalStrain(1e-5, lambda s, t: 300.0 * t * s, lambda s, t: 1e4 * np.sin(60.0 * t))
    model = ff.Model("heated", mesh=LineMesh.straight({"mast": [(0, 0, 0), (0, 0, 1)]}, 6))
    model.add(
        ff.Gravity((0.0, 1.0, -9.81)),
        ff.Beam(
            "mast", lambda s: ff.Section.circle(0.03 - 0.01 * s, steel), twist=lambda s: 0.5 * s,
            rest_curvature=(0.5, 0.1, 0.2), prestrain=sun, damping=1e-4 * np.arange(6.0),
        ),
        ff.Rigid("foot", ff.Ground(), ff.Marker("mast", "start")),
        ff.PositionProbe("top", ff.Marker("mast", "end")),
        ff.StrainProbe("strain", "mast", 0.4),
        ff.EnergyProbe("energy"),
    )  # fmt: skip
    return model


MODELS: dict[str, tuple[Any, dict[str, Any]]] = {
    "slider_crank": (
        lambda: load_case("slider_crank").model(elements=3),
        {"dt": 1e-3, "t_end": 0.054, "rho_inf": 0.8},
    ),
    "flying_spaghetti": (
        lambda: load_case("flying_spaghetti").model(elements=6),
        {"dt": 0.1, "t_end": 3.6, "split_above": 1},
    ),
    "driven": (driven, {"dt": 2e-3, "t_end": 0.072}),
    "bouncing": (bouncing, {"dt": 0.01, "t_end": 0.36, "adaptive": True, "error_tolerance": 1e-4}),
    "curved": (curved, {"dt": 2e-3, "t_end": 0.036, "split_above": 1, "tolerance": 1e-9}),
    "sliding": (sliding, {"dt": 4e-3, "t_end": 0.144, "split_above": 2, "tolerance": 1e-9}),
    "sheet": (sheet, {"dt": 2e-3, "t_end": 0.072, "split_above": 1, "tolerance": 1e-9}),
    "energy": (driven, {"dt": 2e-3, "t_end": 0.072, "integrator": "energy_momentum"}),
    "heated": (heated, {"dt": 2e-3, "t_end": 0.072, "split_above": 1, "tolerance": 1e-10}),
    "loaded_late": (loaded_late, {"dt": 2e-3, "t_end": 0.018, "split_above": 1}),
    "index2": (driven, {"dt": 2e-3, "t_end": 0.072, "integrator": "stabilized_index2"}),
}
#: Not restarted on ranks here: three of them are in ``tests/cases/test_restart_runs.py``.
ON_ONE = ("sliding", "sheet", "heated", "energy", "index2", "flying_spaghetti", "curved")
#: What is kept of the iteration matrix, "auto" as "frozen", is the same for all models but that of
#: steps of other sizes and of rows that come and go.
RUNS = [
    *((name, "auto") for name in MODELS if name not in ON_ONE),
    *(pytest.param(name, "auto", marks=pytest.mark.serial) for name in ON_ONE),
    # each policy; the whole product is slow
    pytest.param("slider_crank", "frozen", marks=pytest.mark.serial),
    pytest.param("bouncing", "updated", marks=pytest.mark.serial),
    pytest.param("slider_crank", "updated", marks=(pytest.mark.serial, pytest.mark.slow)),
    pytest.param("bouncing", "frozen", marks=(pytest.mark.serial, pytest.mark.slow)),
]


def close(one: dict[str, np.ndarray], other: dict[str, np.ndarray], tolerance: float) -> None:
    """Histories agree relative to the largest value of a vector's components."""
    assert list(one) == list(other)
    for column, values in one.items():
        family = [v for k, v in one.items() if k.rpartition("_")[0] == column.rpartition("_")[0]]
        assert values.shape == other[column].shape
        error = np.abs(values - other[column]).max(initial=0.0)
        assert error <= tolerance * max(np.abs(v).max(initial=0.0) for v in family), column


def options(name: str, output: Path | None = None, **more: Any) -> ff.RunOptions:
    return ff.RunOptions(**{**MODELS[name][1], "quiet": True, "every": 7, "output": output} | more)


@pytest.fixture(scope="module")
def full() -> Callable[[str, str], ff.Outcome]:
    """Makes uninterrupted runs of models with a policy, each once."""
    return cache(
        lambda name, policy: ff.simulate(MODELS[name][0](), options(name, iteration_matrix=policy))
    )


@pytest.mark.parametrize(("name", "policy"), RUNS)
def test_restarted_run_repeats_the_history(
    name: str, policy: str, full: Callable[[str, str], ff.Outcome], shared_tmp_path: Path
) -> None:
    """Into another folder: the history starts at the checkpoint."""
    reference = full(name, policy)
    steps = round(MODELS[name][1]["t_end"] / MODELS[name][1]["dt"])
    stop = 5 * steps // 9
    run = options(name, shared_tmp_path / "a", iteration_matrix=policy)
    early = replace(run, t_end=stop * run.dt, checkpoint_every=1000)
    assert ff.simulate(MODELS[name][0](), early).status == "ok"
    file = shared_tmp_path / "a" / f"checkpoint_{stop:06d}.h5"
    again = replace(run, restart=file, output=shared_tmp_path / "b")
    outcome = ff.simulate(MODELS[name][0](), again)
    assert outcome.status == "ok"
    if COMM.rank == 0:
        # at least 1e-7 with factors of the checkpoint's state instead of the old ones, 3e-3 without
        # the auxiliary accelerations, 3e-8 with the other predictor
        first = np.searchsorted(reference.history["t"], stop * run.dt * (1.0 - 1e-9))
        close({k: v[first:] for k, v in reference.history.items()}, outcome.history, 1e-9)
    counts = ("steps", "newton_iterations", "factorizations", "fallbacks", "residual_evaluations")
    # another order of the tangent's pivots may end an iteration one step earlier or later
    for key in counts:
        assert abs(outcome.summary[key] - reference.summary[key]) <= 2, key
    # one more if the size of steps were forgotten
    assert outcome.summary["rejected_steps"] == reference.summary["rejected_steps"]
    assert outcome.summary["restarted_at_step"] == stop
    assert reference.summary["restarted_at_step"] is None


@pytest.mark.slow_on_ranks
def test_same_folder_goes_on(full: Callable[[str, str], ff.Outcome], shared_tmp_path: Path) -> None:
    """History and fields are cut at the checkpoint and continued, the two last files are kept."""
    reference = full("driven", "auto")
    run = options("driven", shared_tmp_path, checkpoint_every=10)
    ff.simulate(driven(), replace(run, t_end=0.046))  # 23 steps
    COMM.barrier()
    names = sorted(p.name for p in shared_tmp_path.glob("checkpoint*"))
    assert names == ["checkpoint_000020.h5", "checkpoint_000023.h5"]
    COMM.barrier()
    again = replace(run, restart=shared_tmp_path / names[0])
    outcome = ff.simulate(driven(), again)
    COMM.barrier()
    names = sorted(p.name for p in shared_tmp_path.glob("checkpoint*"))
    assert names == ["checkpoint_000030.h5", "checkpoint_000036.h5"]
    table = read_history(shared_tmp_path / "history.csv")
    if COMM.rank == 0:
        close(dict(reference.history), table, 1e-9)
        # headline results are computed from all rows
        close(table, dict(outcome.history), 0.0)
    text = (shared_tmp_path / "beams.pvd").read_text()
    times = [float(part.split('"')[1]) for part in text.split("timestep=")[1:]]
    steps = [*range(0, 36, 7), 36]
    np.testing.assert_allclose(times, 2e-3 * np.array(steps), rtol=1e-12)
    summary = json.loads((shared_tmp_path / "summary.json").read_text())
    assert (summary["steps"], summary["restarted_at_step"]) == (36, 20)


def test_later_end_keeps_the_instants(shared_tmp_path: Path) -> None:
    """7 steps of 1/70 s, then 5 more; a run to 0.17 s would take steps of another size."""
    run = ff.RunOptions(dt=0.015, t_end=0.1, output=shared_tmp_path, checkpoint_every=7)
    build = MODELS["flying_spaghetti"][0]
    ff.simulate(build(), run)
    more = replace(run, t_end=0.17, restart=shared_tmp_path / "checkpoint_000007.h5")
    ff.simulate(build(), more)
    COMM.barrier()
    times = read_history(shared_tmp_path / "history.csv")["t"]
    np.testing.assert_array_equal(times, [0.1 * k / 7 for k in range(13)])


@pytest.mark.slow_on_ranks
def test_restart_of_a_restart(
    full: Callable[[str, str], ff.Outcome], shared_tmp_path: Path
) -> None:
    """From checkpoint to checkpoint, one step at a time where the iteration matrix changes."""
    reference = full("slider_crank", "auto")
    build, run = MODELS["slider_crank"][0], options("slider_crank", shared_tmp_path)
    stops = [1, 2, 24, 25, 54]
    for before, stop in zip([None, *stops], stops, strict=False):
        file = None if before is None else shared_tmp_path / f"checkpoint_{before:06d}.h5"
        outcome = ff.simulate(
            build(), replace(run, t_end=stop * run.dt, checkpoint_every=1000, restart=file)
        )
    if COMM.rank == 0:
        close(dict(reference.history), dict(outcome.history), 1e-9)


def test_without_a_folder_nothing_is_written(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    ff.simulate(driven(), options("driven", checkpoint_every=1, t_end=4e-3))
    assert not list(tmp_path.iterdir())


def test_failed_run_keeps_a_checkpoint_of_its_last_good_state(shared_tmp_path: Path) -> None:
    """The motor's angle jumps out of reach of any step; with a smooth motor the run continues."""

    def build(jump: float | None) -> ff.Model:
        model = ff.Model("jump")
        model.add(
            ff.RigidBody("bob", 1.0, (0.1, 0.1, 0.1), position=(0.6, 0.0, -0.8)),
            ff.Spherical("pin", ff.Ground(), ff.Marker("bob", offset=(-0.6, 0.0, 0.8))),
            ff.PrescribedTranslation(
                "drive", ff.Ground((0.6, 0.0, -0.8)), ff.Marker("bob"),
                lambda t: 2.0 * t if jump is None or t < 5.4e-3 else jump, axis=(1.0, 0.0, 0.0),
            ),
            ff.PositionProbe("path", ff.Marker("bob")),
        )  # fmt: skip
        return model

    run = ff.RunOptions(dt=1e-3, t_end=0.02, output=shared_tmp_path)
    outcome = ff.simulate(build(50.0), run)
    assert outcome.status != "ok"
    file = shared_tmp_path / "checkpoint_000005.h5"
    assert [p.name for p in shared_tmp_path.glob("checkpoint*")] == [file.name]
    COMM.barrier()
    # the state lies within step 6, whose rest is made first
    again = ff.simulate(build(None), replace(run, restart=file))
    assert again.status == "ok"
    COMM.barrier()
    times = read_history(shared_tmp_path / "history.csv")["t"]
    assert 5.0e-3 < times[6] < 5.4e-3
    np.testing.assert_allclose(np.delete(times, 6), 1e-3 * np.arange(21), rtol=1e-12)


def test_stopped_run_goes_on(shared_tmp_path: Path) -> None:
    """From the instant of the event, which lies within a step; once it has stopped it is over."""

    def build() -> ff.Model:
        model = pendulum()
        model.add(ff.Event("halt", ff.Marker("bob"), lambda t, s: t - 0.054, ff.Stop()))
        return model

    run = ff.RunOptions(dt=1e-2, t_end=0.1, output=shared_tmp_path, checkpoint_every=100)
    assert ff.simulate(build(), run).summary["stopped_by"] == "halt"
    file = shared_tmp_path / "checkpoint_000005.h5"
    COMM.barrier()
    outcome = ff.simulate(build(), replace(run, restart=file))
    assert outcome.status == "ok"
    reference = ff.simulate(pendulum(), replace(run, output=None))
    if COMM.rank == 0:
        times = outcome.history["t"]
        np.testing.assert_allclose(times[6], 0.054, atol=2e-9)
        np.testing.assert_allclose(np.delete(times, 6), reference.history["t"], rtol=1e-12)
        # two partial steps instead of one; without the rest of the step a tenth is missing
        path = [h["path_y"][-1] for h in (outcome.history, reference.history)]
        np.testing.assert_allclose(*path, rtol=0.01)


@pytest.mark.slow_on_ranks
@pytest.mark.serial
def test_other_table_in_the_folder_is_left_alone(shared_tmp_path: Path) -> None:
    run = options("driven", shared_tmp_path / "a", checkpoint_every=9, t_end=0.018)
    ff.simulate(driven(), run)
    COMM.barrier()
    other = shared_tmp_path / "b"
    again = replace(run, restart=run.output / "checkpoint_000009.h5", t_end=0.03, output=other)
    header = (run.output / "history.csv").read_text().splitlines()[0]
    row = ",".join(["0.01"] * len(header.split(",")))
    texts = {
        "t,phi\n0.0,1.0\n": "other columns",
        f"{header}\n{row[:-3]}x\n": "cannot be continued",
        f"{header}\n{row[:-5]}\n": "cannot be continued",
        f"{header}\n{row}\n": "ends at t = 0.01 s, before the checkpoint at t = 0.018 s",
    }
    for text, reason in texts.items():
        if COMM.rank == 0:
            shutil.rmtree(other, ignore_errors=True)
            other.mkdir()
            (other / "history.csv").write_text(text)
            (other / "summary.json").write_text("{}")
        COMM.barrier()
        with pytest.raises(ValueError, match=reason):
            ff.simulate(driven(), again)
        COMM.barrier()
        assert {p.name for p in other.iterdir()} == {"history.csv", "summary.json"}
        assert (other / "history.csv").read_text() == text
        COMM.barrier()
    if COMM.rank == 0:
        (other / "history.csv").unlink()
        (other / "beams.pvd").write_text("no index")
    COMM.barrier()
    with pytest.raises(ValueError, match=r"beams\.pvd.*cannot be continued"):
        ff.simulate(driven(), again)
    assert (other / "beams.pvd").read_text() == "no index"


def pendulum(length: float = 1.0, joint: Any = ff.Spherical, name: str = "bob") -> ff.Model:
    model = ff.Model("pendulum")
    hook = ff.Marker(name, offset=(-length, 0.0, 0.0))
    model.add(
        ff.RigidBody(name, 1.0, (0.1, 0.1, 0.1), position=(length, 0.0, 0.0)),
        joint("pin", ff.Ground(), hook),
        ff.PointForce("pull", ff.Marker(name), (0.0, 1.0, 0.0), amplitude=ff.SmoothStep(0.0, 0.1)),
        ff.PositionProbe("path", ff.Marker(name)),
    )
    return model


OTHERS: dict[str, tuple[Any, dict[str, Any], str]] = {
    "length": (lambda: pendulum(1.0 + 1e-7), {}, "other joints, rigid bodies; "),
    "kind": (lambda: pendulum(joint=ff.Rigid), {}, "another model, other joints; continue"),
    "name": (
        lambda: pendulum(name="bib"),
        {},
        "other joints, loads, rigid bodies; ",
    ),
    "bodies": (driven, {}, "another model, other beams, gravity, joints, loads, mesh"),
    "step": (pendulum, {"dt": 2e-3}, "was written with dt = 0.001, not 0.002$"),
    "redundancy": (
        pendulum,
        {"redundant_constraints": "least_norm"},
        "with redundant_constraints = refuse, not",
    ),
    "start": (pendulum, {"start": "equilibrium"}, "was written with start = given, not equilibr"),
    "scheme": (pendulum, {"rho_inf": 0.5}, "was written with rho_inf = 0.9, not 0.5$"),
    "end": (pendulum, {"t_end": 5e-3}, "at t = 0.005 s already, t_end = 0.005 s leaves nothing"),
    "version": (pendulum, {}, "was written by flexfem 0.0.7, this is "),
}


@pytest.mark.parametrize("what", each_kind(OTHERS, "length", "step", "version"))
def test_checkpoint_of_something_else_is_refused(
    what: str, shared_tmp_path: Path, monkeypatch: Any
) -> None:
    run = ff.RunOptions(dt=1e-3, t_end=5e-3, output=shared_tmp_path, checkpoint_every=5)
    if what == "version":
        monkeypatch.setattr(ff, "__version__", "0.0.7")
    ff.simulate(pendulum(), run)
    monkeypatch.undo()
    build, changes, reason = OTHERS[what]
    file = shared_tmp_path / "checkpoint_000005.h5"
    COMM.barrier()  # the first rank writes the summary alone
    before = {p: p.stat().st_mtime_ns for p in shared_tmp_path.rglob("*")}
    COMM.barrier()
    again = replace(run, **{"t_end": 0.01, "restart": file} | changes)
    with pytest.raises(ValueError, match=reason) as caught:
        ff.simulate(build(), again)
    assert str(caught.value).startswith(f"checkpoint '{file}': ")
    COMM.barrier()
    assert {p: p.stat().st_mtime_ns for p in shared_tmp_path.rglob("*")} == before


def test_last_digits_of_a_model_do_not_count(shared_tmp_path: Path) -> None:
    """Another machine may round otherwise."""
    run = ff.RunOptions(dt=1e-3, t_end=5e-3, output=shared_tmp_path, checkpoint_every=5)
    ff.simulate(pendulum(), run)
    again = replace(run, t_end=0.01, restart=shared_tmp_path / "checkpoint_000005.h5")
    assert ff.simulate(pendulum(np.nextafter(1.0, 0.0)), again).status == "ok"


@pytest.mark.slow_on_ranks
@pytest.mark.serial
def test_iteration_matrix_and_tolerance_may_change(shared_tmp_path: Path) -> None:
    run = options("driven", shared_tmp_path, checkpoint_every=9, t_end=0.018, tolerance=1e-9)
    ff.simulate(driven(), run)
    for policy in ("auto", "frozen", "updated"):
        COMM.barrier()
        file = max(shared_tmp_path.glob("checkpoint*"))
        COMM.barrier()
        again = replace(run, t_end=run.t_end + 0.006, iteration_matrix=policy, restart=file)
        run = replace(again, restart=None)
        assert ff.simulate(driven(), again).status == "ok"
    COMM.barrier()
    assert read_history(shared_tmp_path / "history.csv")["t"][-1] == pytest.approx(0.036)


@pytest.mark.parametrize(("name", "steps"), [("bouncing", 16), ("driven", 8), ("sliding", 3)])
def test_a_state_that_is_put_back_is_the_same(name: str, steps: int) -> None:
    """Of all that steps depend on: events that have happened, step sizes, kept factors, rows."""
    first = Simulation(MODELS[name][0](), options(name))
    for _ in range(steps):
        assert first.advance(MODELS[name][1]["dt"]).value == "ok"
    state = first.state()
    other = Simulation(MODELS[name][0](), options(name))
    other.restore(state)
    found = other.state()
    if name == "bouncing":  # the catch, which happens once
        assert not state.values["events"][2].all()
    assert found.values.keys() == state.values.keys()
    for key, values in state.values.items():
        # what is forgotten is at its start: another number, not one that is rounded differently
        np.testing.assert_allclose(found.values[key], values, rtol=1e-12, err_msg=key)
    assert found.rows.keys() == state.rows.keys()
    for group, arrays in state.rows.items():
        for key, values in arrays.items():
            np.testing.assert_allclose(
                found.rows[group][key], values, rtol=1e-12, atol=1e-15, err_msg=f"{group}/{key}"
            )
