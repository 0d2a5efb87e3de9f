# SPDX-License-Identifier: LGPL-3.0-or-later
"""Policies of the iteration matrix: the same answers, the promised counts, failures survived."""

import importlib.util
from functools import cache
from itertools import pairwise
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.analyses.dynamics import RunOptions
from flexfem.core.status import Status
from flexfem.mesh.line_mesh import LineMesh
from flexfem.simulation.dynamics import simulate
from flexfem.simulation.motion.stepping import Simulation
from flexfem.solvers.frozen.solver import FrozenSolver
from flexfem.system.mechanics import EndPoint
from flexfem.system.system import System

POLICIES = ("updated", "material", "frozen", "auto")
STEEL = ff.Material(2.1e9, 0.3, 7850.0)


def _case(name: str):
    path = Path(__file__).parents[2] / "cases" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _mechanism() -> ff.Model:
    """Two damped beams, two rigid bodies, all kinds of couplings between them and the ground."""
    x = np.linspace(0.0, 1.0, 5)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    points = np.concatenate([x, x + np.array([1.0, 0.0, 0.0])])
    cells = np.array([[i, i + 1] for i in range(9) if i != 4])
    mesh = LineMesh(points, cells, {"one": np.arange(4), "two": np.arange(4, 8)})
    section = ff.Section.rectangle(0.03, 0.02, STEEL)
    model = ff.Model("mechanism", mesh=mesh)
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Beam("one", section, damping=1e-4),
        ff.Beam("two", section),
        ff.RigidBody("hub", 2.0, (0.02, 0.03, 0.04), position=(2.0, 0.1, 0.0)),
        ff.RigidBody("ball", 1.0, (0.01, 0.01, 0.01), position=(2.5, 0.1, 0.3)),
        ff.Revolute("root", ff.Ground(), ff.Marker("one", "start"), axis=(0, 1, 0)),
        ff.Spherical("knee", ff.Marker("one", "end"), ff.Marker("two", "start")),
        ff.Rigid("flange", ff.Marker("two", "end"), ff.Marker("hub", offset=(0, -0.1, 0))),
        ff.Spherical("arm", ff.Marker("hub"), ff.Marker("ball", offset=(-0.5, 0, -0.3))),
        ff.SpringDamper(
            "spring", ff.Marker("one", 0.5, offset=(0, 0, 0.05)), ff.Marker("ball"),
            stiffness=400.0, damping=3.0, rest_length=1.0,
        ),
        ff.TorsionalSpringDamper(
            "twist", ff.Ground(), ff.Marker("one", "start"), axis=(0, 1, 0),
            stiffness=20.0, damping=0.1, rest_angle=0.2,
        ),
        ff.PointForce("push", ff.Marker("hub", offset=(0.1, 0, 0)), (0, 40.0, 0), follower=True),
        ff.PositionProbe("tip", ff.Marker("ball")),
    )  # fmt: skip
    return model


@pytest.fixture(scope="module")
def runs():
    """Runs the mechanism under a policy, each once, converged tightly."""
    given = {"dt": 2e-3, "t_end": 0.2, "tolerance": 1e-9}
    return cache(lambda name: simulate(_mechanism(), RunOptions(iteration_matrix=name, **given)))


@pytest.mark.parametrize(
    "policy", ["auto", *(pytest.param(p, marks=pytest.mark.serial) for p in ("material", "frozen"))]
)
def test_policies_agree(runs, policy):
    """Elastic rows, dampers and followers included: the matrix must not change the answer."""
    reference, outcome = runs("updated"), runs(policy)
    assert outcome.status == reference.status == "ok"
    for name, column in outcome.history.items():
        # both stop at steps below 1e-9; a force missing from one of the residuals is 1e-3 and more
        np.testing.assert_allclose(column, reference.history[name], atol=2e-8)


@pytest.mark.serial
def test_frozen_factorises_once(runs):
    summary = runs("frozen").summary
    assert summary["factorizations"] == 1
    assert summary["fallbacks"] == summary["rejected_steps"] == 0
    # a fresh matrix takes one factorisation per iteration
    updated = runs("updated").summary
    assert updated["factorizations"] == updated["newton_iterations"]
    # quadratic convergence of the exact tangent: a term missing in it costs an iteration a step
    assert updated["newton_iterations"] <= 4.0 * updated["steps"]


def test_exact_tangent_converges_quadratically(monkeypatch):
    simulation = Simulation(
        _mechanism(), RunOptions(dt=5e-3, t_end=1.0, iteration_matrix="updated", tolerance=1e-11)
    )
    sizes: list[list[float]] = []
    move = EndPoint.move

    def observed(mechanics: EndPoint, system: System, sign: float) -> float:
        largest = system.comm.allreduce(move(mechanics, system, sign), op=MPI.MAX)
        sizes[-1].append(largest)
        return largest

    monkeypatch.setattr(EndPoint, "move", observed)
    for _ in range(6):
        sizes.append([])
        assert simulation.advance(5e-3) is Status.OK
    for steps in sizes[2:]:
        # linear convergence at 0.01 would leave 1e-2 of the step before
        for previous, step in pairwise(steps):
            assert step <= max(20.0 * previous**2, 1e-11)


def test_singular_matrix_is_a_status_and_can_be_left(monkeypatch):
    """Constraints that become redundant: every attempt reports it, and none spoils the next."""
    for policy in POLICIES:
        options = RunOptions(dt=1e-3, t_end=1.0, iteration_matrix=policy)
        simulation = Simulation(_mechanism(), options)
        assert simulation.advance(1e-3) is Status.OK
        rows = simulation.system.constraints
        kept = rows.directions.copy()
        rows.directions[:] = 0.0
        before = simulation.time
        for _ in range(2):  # the direct solver must survive its first failure
            assert simulation.advance(1e-3) in (Status.SINGULAR, Status.DIVERGED)
        assert simulation.time == before
        rows.directions[:] = kept
        assert simulation.advance(1e-3) is Status.OK


def test_factors_are_renewed_after_a_step_that_failed_with_them(monkeypatch):
    """The next step begins with new ones, and the one after it keeps these."""
    simulation = Simulation(_mechanism(), RunOptions(dt=1e-3, t_end=1.0))
    counters, computed = simulation.system.counters, []
    factor = FrozenSolver.factor

    def counted(solver: FrozenSolver, *arguments) -> None:
        computed.append(counters.fallbacks)
        factor(solver, *arguments)

    monkeypatch.setattr(FrozenSolver, "factor", counted)
    assert simulation.advance(1e-3) is Status.OK
    with monkeypatch.context() as broken:
        size = simulation.system.constraints.size
        broken.setattr(FrozenSolver, "step", lambda *_, **__: (False, np.zeros(size), None))
        assert simulation.advance(1e-3) is Status.OK
    for _ in range(3):
        assert simulation.advance(1e-3) is Status.OK
    # with those before the failure every later step might fail, too
    assert computed == [0, 1]


@pytest.mark.serial
def test_frozen_slider_crank_keeps_close_to_the_iterations_of_a_fresh_matrix():
    """50 turns a second, one factorisation in the whole run."""
    case, summaries = _case("slider_crank"), {}
    for policy in ("updated", "frozen"):
        options = RunOptions(dt=5e-4, t_end=0.2, iteration_matrix=policy)
        summaries[policy] = simulate(case.CASE.model(elements=6), options).summary
    frozen, updated = summaries["frozen"], summaries["updated"]
    assert frozen["factorizations"] == 1
    assert frozen["fallbacks"] == frozen["rejected_steps"] == 0
    # unrefined frozen steps take about 1.4 times as many
    assert frozen["newton_iterations"] <= 1.15 * updated["newton_iterations"]


@pytest.mark.slow
def test_swinging_bar_of_stiff_modes_keeps_its_factors():
    """Its second steps are as large as the first, some tolerances, and the third are nothing."""
    from dolfinx import mesh

    box = mesh.create_box(
        MPI.COMM_SELF, [(0.0, -0.005, -0.005), (0.5, 0.005, 0.005)], (8, 1, 1),
        mesh.CellType.hexahedron,
    )  # fmt: skip
    faces = {"near": lambda x: np.isclose(x[0], 0.0), "far": lambda x: np.isclose(x[0], 0.5)}
    body = ff.solid_body(box, ff.Material(7e10, 0.3, 2700.0), name="bar")
    reduced = ff.reduce_body(body, faces, modes=6, recovery=False)
    model = ff.Model("pendulum")
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.FloatingBody("bar", reduced),
        ff.Spherical("pin", ff.Ground(), ff.Marker("bar", "near")),
    )
    simulation = Simulation(model, RunOptions(dt=1e-3, t_end=0.3, rho_inf=0.9))
    for _ in range(300):
        assert simulation.advance(1e-3) is Status.OK
    counters = simulation.system.counters
    # 10 where the second step counts as a measure of the contraction
    assert counters.factorizations == 1
    assert counters.newton_iterations < 2.3 * 300
