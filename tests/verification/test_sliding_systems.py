# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sliders on flexible carriers: ranks, iteration matrices, energy, knots, ends of carriers."""

import json
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.cli import load_case
from flexfem.io import read_history
from flexfem.solvers.frozen.interface import MultiplierSystem
from flexfem.solvers.frozen.solver import FrozenSolver

COMM = MPI.COMM_WORLD
RUBBER = ff.Material(2e8, 0.3, 800.0)
SECTION = ff.Section.rectangle(0.02, 0.02, RUBBER)
FORMULATIONS = pytest.mark.parametrize("formulation", ["nurbs", "se3"])


def _cable(formulation: str, elements: int = 8, degree: int = 2) -> ff.Model:
    """A soft carrier from (0, 0, 0) to (2, 0, 0) and a rod beside it, in one formulation."""
    lines = {"cable": ((0, 0, 0), (2, 0, 0), elements), "rod": ((1.4, 0, 0), (1.4, 0.8, 0), 3)}
    if formulation == "nurbs":
        model = ff.Model("cable")
        curves = {
            name: ff.NurbsCurve.line(a, b, degree=degree, elements=n)
            for name, (a, b, n) in lines.items()
        }
    else:
        points, cells, groups = [], [], {}
        for name, (a, b, n) in lines.items():
            first = sum(map(len, points)) + np.arange(n)
            groups[name] = sum(map(len, cells)) + np.arange(n)
            points.append(np.linspace(a, b, n + 1))
            cells.append(np.stack([first, first + 1], axis=1))
        mesh = ff.LineMesh(np.concatenate(points), np.concatenate(cells), groups)
        model, curves = ff.Model("cable", mesh=mesh), dict.fromkeys(lines)
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        *(ff.Beam(name, SECTION, curve=curve, orientation=(0, 0, 1))
          for name, curve in curves.items()),
        ff.Spherical("left", ff.Ground(), ff.Marker("cable", "start")),
        ff.Spherical("right", ff.Ground((2, 0, 0)), ff.Marker("cable", "end")),
    )  # fmt: skip
    return model


def _three_sliders(formulation: str) -> ff.Model:
    """A rod that hangs on the cable and two bodies on it, one tied, stopped, rubbing."""
    model, carrier, inertia = _cable(formulation), ff.Carrier("cable"), (1e-3, 2e-3, 2e-3)
    slides = (
        ff.Sliding("rod_slide", carrier, ff.Marker("rod", "start")),
        ff.Sliding("bead_slide", carrier, ff.Marker("bead", offset=(0.0, 0.05, 0.0))),
        ff.Sliding("shoe_slide", carrier, ff.Marker("shoe"), tied=True),
    )
    model.add(
        ff.RigidBody("bead", 0.3, inertia, position=(0.22, -0.05, 0), velocity=(1, 0, 0)),
        ff.RigidBody("shoe", 0.2, inertia, position=(1.8, 0, 0), velocity=(-2, 0, 0)),
        *slides,
        ff.SlideStop("stop", slides[0], lower=0.2, upper=1.5, stiffness=500.0, damping=5.0),
        ff.JointFriction("rub", slides[1], force=0.1, velocity=0.05),
        ff.Probe("path", [ff.SlidingMarker(s.name) for s in slides], ("rod", "bead", "shoe"),
                 lambda t, *s: [one.arc for one in s]),
        ff.Probe("speed", [ff.SlidingMarker(s.name) for s in slides], ("v1", "v2", "v3"),
                 lambda t, *s: [one.arc_rate for one in s]),
        ff.PositionProbe("tip", ff.Marker("rod", "end")),
        ff.PositionProbe("section", ff.SlidingMarker("bead_slide")),
        ff.ReactionProbe("force", "shoe_slide"),
        ff.EnergyProbe("energy"),
    )  # fmt: skip
    return model


def _run(model: ff.Model, comm: MPI.Intracomm = COMM, **more):
    settings = {"dt": 4e-3, "t_end": 0.06, "tolerance": 1e-10, "quiet": True}
    return ff.simulate(model, ff.RunOptions(**(settings | more)), comm=comm)


def _largest_difference(one, other) -> float:
    """Of two histories, relative to the largest value of each vector."""
    errors = []
    for column, values in one.items():
        family = [v for k, v in one.items() if k.rpartition("_")[0] == column.rpartition("_")[0]]
        error = np.abs(values - other[column]).max()
        errors.append(error / max(np.abs(v).max() for v in family))
    return float(max(errors))


@pytest.mark.three_ranks
@FORMULATIONS
def test_any_number_of_ranks_gives_the_same_motion(formulation):
    """Three sliders on a cable in pieces; sliders and carrier on different ranks."""
    found = _run(_three_sliders(formulation), split_above=2)
    alone = _run(_three_sliders(formulation), MPI.COMM_SELF)
    assert found.status == alone.status == "ok"
    if COMM.rank == 0:
        h = found.history
        # from element to element, the second one over the stop
        assert h["bead"][0] < 0.25 < h["bead"][-1]
        assert h["shoe"][0] > 1.75 > h["shoe"][-1]
        # round-off; a node that misses a force, or a place not passed on, shows in the first digits
        assert _largest_difference(alone.history, h) < 1e-9
        # second order of the step, of 0.7 J; friction takes 0.01
        assert np.abs(h["energy_balance"]).max() < 5e-4


@pytest.mark.serial
@FORMULATIONS
def test_iteration_matrices_agree(formulation):
    one, *others = (
        _run(_three_sliders(formulation), iteration_matrix=policy).history
        for policy in ("updated", "frozen", "auto")
    )
    for other in others:
        # what the iteration leaves; another equilibrium shows in the first digits
        assert _largest_difference(one, other) < 1e-6


def _pushed_bead(formulation: str, position: float) -> ff.Model:
    """A bead at rest, pushed along the cable on which the rod hangs."""
    model, carrier = _cable(formulation), ff.Carrier("cable")
    model.add(
        ff.RigidBody("bead", 0.2, (1e-3,) * 3, position=(position, 0, 0)),
        ff.PointForce("push", ff.Marker("bead"), (20.0, 0.0, 0.0)),
        ff.Sliding("slide", carrier, ff.Marker("bead")),
        ff.Sliding("rod_slide", carrier, ff.Marker("rod", "start")),
        ff.PositionProbe("tip", ff.Marker("rod", "end")),
        ff.ReactionProbe("force", "slide"),
    )
    return model


@pytest.mark.three_ranks
@pytest.mark.parametrize(("formulation", "position"), [("nurbs", 0.2433), ("se3", 0.2303)])
def test_element_passed_within_a_refined_step(formulation, position, monkeypatch):
    """The rank of bead and cable sees it, another does not; both keep the multipliers' factors."""
    passed, asked, step = [], [], FrozenSolver.step
    follow = MultiplierSystem.follow_sliders

    def seen(solver: FrozenSolver, *args, **asks: bool):
        asked.append(asks["refine"] and asks["keep_interface"])
        found = step(solver, *args, **asks)
        asked.clear()
        return found

    def followed(multipliers: MultiplierSystem) -> None:
        before = multipliers._version
        follow(multipliers)
        if multipliers._version != before:
            # only in steps, not for the masses of the forces that are reported
            passed.extend(asked)

    monkeypatch.setattr(FrozenSolver, "step", seen)
    monkeypatch.setattr(MultiplierSystem, "follow_sliders", followed)
    settings = {"t_end": 0.028, "iteration_matrix": "frozen"}
    found = _run(_pushed_bead(formulation, position), **settings)
    # the step begins before the knot at 0.25 m and ends beyond, as its second iteration finds;
    # elsewhere another speed of convergence would leave nothing to be tested
    assert sorted(COMM.allgather(passed)) == [*[[]] * (COMM.size - 1), [True]]
    alone = _run(_pushed_bead(formulation, position), MPI.COMM_SELF, **settings)
    assert found.status == alone.status == "ok"
    assert found.summary["newton_iterations"] == alone.summary["newton_iterations"]
    if COMM.rank == 0:
        # round-off; ranks of which one factorises again end in MPI, or sum numbers of two matrices
        assert _largest_difference(alone.history, found.history) < 1e-9


def _bead_on_cable(
    formulation: str, position: float, *more, speed=2.0, mass=0.5, **keywords
) -> ff.Model:  # fmt: skip
    """One body on the cable; ``more`` are functions of the joint."""
    model = _cable(formulation, **keywords)
    slide = ff.Sliding("slide", ff.Carrier("cable"), ff.Marker("bead"))
    model.add(
        ff.RigidBody("bead", mass, (1e-3,) * 3, position=(position, 0, 0), velocity=(speed, 0, 0)),
        slide,
        *(part(slide) for part in more),
        ff.Probe("path", ff.SlidingMarker("slide"), ("zeta",), lambda t, s: (s.arc,)),
        ff.ReactionProbe("force", "slide"),
    )  # fmt: skip
    return model


def _changes(degree: int, dt: float) -> tuple[float, float]:
    """Largest change of the force in a step beside a knot, and of all others near it."""
    formulation = "nurbs" if degree else "se3"
    more = {"degree": degree} if degree else {}
    model = _bead_on_cable(formulation, 0.8, elements=16, **more)
    history = _run(model, MPI.COMM_SELF, dt=dt, t_end=0.12, tolerance=1e-9, rho_inf=0.8).history
    force = np.array([history[f"force_f{axis}"] for axis in "xyz"])
    change = np.linalg.norm(np.diff(force, axis=1), axis=0)
    passed = int(np.searchsorted(history["zeta"], 1.0))
    near = slice(passed - 2, passed + 3)
    away = np.concatenate([change[passed - 15 : passed - 2], change[passed + 3 : passed + 15]])
    return float(change[near].max()), float(away.max())


@pytest.mark.serial
@pytest.mark.parametrize("degree", [2, 3])
def test_knots_are_passed_without_a_kick(degree):
    """The force on the slider changes at a knot no more than elsewhere, and less in short steps."""
    coarse, fine = _changes(degree, 1e-3), _changes(degree, 2.5e-4)
    # a jump at the knot would stand out, of a force of 20 N
    assert coarse[0] < 2.0 * coarse[1]
    assert fine[0] < 2.0 * fine[1]
    # and stay; a kick of the velocity would grow fourfold
    assert fine[0] < 0.5 * coarse[0]


@pytest.mark.serial
def test_nodes_of_linear_elements_give_a_small_kick():
    """At a node the line bends by the shear strains' difference, 1e-3 rad at most."""
    for dt in (1e-3, 2.5e-4):
        at, away = _changes(0, dt)
        # impulse on 0.5 kg at 2 m/s; slopes of straight elements differ by 1e-2
        assert max(at, away) * dt < 0.5 * 2.0 * 1e-3


@pytest.mark.serial
@FORMULATIONS
def test_slider_that_leaves_its_carrier(formulation, shared_tmp_path):
    """The run fails and says where; what was computed is kept."""
    model = _bead_on_cable(formulation, 1.9)
    found = _run(model, output=shared_tmp_path, split_above=2, t_end=0.2)
    start = 'Sliding "slide": the slider leaves Beam "cable" of 2 m at zeta = 2.00'
    assert found.status.startswith(start)
    assert found.status.endswith(" after t = 0.048 s")
    assert len(set(COMM.allgather(found.status))) == 1
    if COMM.rank == 0:
        history = read_history(shared_tmp_path / "history.csv")
        assert history["t"][-1] == pytest.approx(0.048)
        assert 1.99 < history["zeta"][-1] <= 2.0
        assert json.loads((shared_tmp_path / "summary.json").read_text())["status"] == found.status


@pytest.mark.serial
@FORMULATIONS
def test_released_slider_may_leave(formulation):
    """It flies on along the cable's direction, and the run continues."""

    def let_go(slide: ff.Sliding) -> ff.Event:
        return ff.Event("go", (), lambda t: t - 0.02, ff.ReleaseJoint(slide.name))

    found = _run(_bead_on_cable(formulation, 1.9, let_go), split_above=2, t_end=0.2)
    # watched still, it would end the run after 0.048 s
    assert found.status == "ok"


@pytest.mark.serial
def test_what_keeps_a_slider_on_its_carrier():
    """A stop that gives way at the end, or an event; not a stop on the other side."""

    def stop(**limits: float):
        return lambda slide: ff.SlideStop("stop", slide, stiffness=2e3, **limits)

    def finish(slide: ff.Sliding) -> ff.Event:
        marker = ff.SlidingMarker(slide.name)
        return ff.Event("end", marker, lambda t, s: s.arc - 2.0, ff.Stop())

    kept = _run(_bead_on_cable("nurbs", 1.9, stop(upper=2.0)), t_end=0.12)
    assert kept.status == "ok"
    assert kept.history["zeta"].max() > 2.01
    assert kept.history["zeta"][-1] < 2.0
    assert _run(_bead_on_cable("nurbs", 1.9, finish), t_end=0.12).summary["stopped_by"] == "end"
    assert "leaves" in _run(_bead_on_cable("nurbs", 1.9, stop(lower=1.0)), t_end=0.12).status
    # 300 N/m let it go 0.08 m beyond the end, 30 N/m 0.26 m: that is no stop
    for stiffness, status in ((300.0, "ok"), (30.0, "leaves")):
        weak = [lambda s, k=stiffness: ff.SlideStop("stop", s, upper=2.0, stiffness=k)]
        assert status in _run(_bead_on_cable("nurbs", 1.9, *weak), t_end=0.2).status


def test_driven_beyond_the_end():
    drive = [lambda s: ff.PrescribedSlide("drive", s, zeta=lambda t: 1.95 + 2.0 * t)]
    found = _run(_bead_on_cable("se3", 1.95, *drive), t_end=0.1)
    assert found.status.startswith('Sliding "slide": the slider leaves Beam "cable" of 2 m at zeta')


REFERENCE = Path(__file__).parents[1] / "data" / "sliding_beam.csv"


@pytest.mark.serial
@pytest.mark.parametrize(
    ("formulation", "elements", "mass", "zeta"),
    [("nurbs", 32, 2e-3, 5e-3), ("se3", 32, 2e-3, 1e-2)],
)
def test_sliding_beam_against_its_reference(formulation, elements, mass, zeta):
    model = load_case("sliding_beam").model(
        elements=elements, slider_elements=4, degree=3, formulation=formulation
    )
    history = _run(model, t_end=0.4, dt=2e-3, tolerance=1e-7, rho_inf=0.9).history
    lines = [line for line in REFERENCE.read_text().splitlines() if not line.startswith("#")]
    table = np.array([line.split(",") for line in lines[1:]], dtype=np.float64).T
    reference = dict(zip(lines[0].split(","), table, strict=True))
    at = reference["t"] < 0.401
    errors = {
        name: np.abs(np.interp(reference["t"][at], history["t"], history[name]) - values[at]).max()
        for name, values in reference.items()
    }
    # coarse mesh and steps, of 0.4 m and 0.46 m so far
    assert max(errors[f"mass_{axis}"] for axis in "xyz") < mass
    assert errors["zeta"] < zeta


@pytest.mark.serial
def test_slider_is_found_on_an_uneven_mesh():
    """In a long element whose middle is farther away than several short ones."""
    x = np.array([0.0, 1.0, 1.01, 1.02, 1.03, 1.04])[:, np.newaxis] * (1.0, 0.0, 0.0)
    mesh = ff.LineMesh(x, [[k, k + 1] for k in range(5)], {"rail": range(5)})
    model = ff.Model("uneven", mesh=mesh)
    model.add(
        ff.Beam("rail", SECTION),
        ff.RigidBody("bead", 1.0, (1, 1, 1), position=(0.95, 0, 0)),
        ff.Sliding("slide", ff.Carrier("rail"), ff.Marker("bead")),
        ff.Probe("path", ff.SlidingMarker("slide"), ("zeta",), lambda t, s: (s.arc,)),
    )
    # the short elements end 0.05 m away
    assert _run(model, t_end=4e-3).history["zeta"][0] == pytest.approx(0.95, abs=1e-12)
