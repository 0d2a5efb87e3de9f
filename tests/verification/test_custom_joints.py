# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints, force elements and friction by functions of the user's against those of the package."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.analyses.dynamics import RunOptions
from flexfem.core.status import Status
from flexfem.inspection.inspection import Inspection
from flexfem.inspection.mobility import free_motions, holding
from flexfem.simulation.motion.stepping import Simulation

COMM = MPI.COMM_WORLD
STEEL = ff.Material(2.1e9, 0.3, 7800.0)
GROUND, TIP, BOB = ff.Ground(), ff.Marker("arm", "end"), ff.Marker("bob", offset=(0.1, 0.0, 0.05))
HOOK = ff.Ground((0.6, 0.3, 0.9))
AXIS = (0.0, 1.0, 0.0)


def spherical(p, R):
    return p


def revolute(p, R):
    """Common origin, and axis y of both markers."""
    return p[0], p[1], p[2], R[0][1], R[2][1]


def rod(p, R, parameters):
    return math.sqrt(p[0] ** 2 + p[1] ** 2 + p[2] ** 2) - parameters[0]


def linear(x, v, t, parameters):
    stiffness, damping, rest = parameters
    return stiffness * (x - rest) + damping * v


def driven(x, v, t):
    return -3.0 * math.sin(2.0 * t)


def stribeck(speed):
    return 0.1 + 0.2 / (1.0 + 10.0 * speed)


LENGTH = math.sqrt(0.4**2 + 0.05**2)


def joints(own: bool) -> list[object]:
    """Hinge of the arm, rod from its end to the bob, spring of the bob, motor of the hinge."""
    arm = ff.Marker("arm", "start")
    if own:
        return [
            ff.CustomJoint("hinge", GROUND, arm, function=revolute),
            ff.CustomJoint("rod", TIP, BOB, function=rod, parameters=(LENGTH,)),
            ff.CustomForce("spring", HOOK, BOB, force=linear, parameters=(80.0, 0.7, 0.5)),
            ff.CustomForce("motor", GROUND, arm, axis=AXIS, motion="rotation", force=driven),
        ]
    return [
        ff.Revolute("hinge", GROUND, arm, axis=AXIS),
        ff.Distance("rod", TIP, BOB),
        ff.SpringDamper("spring", HOOK, BOB, stiffness=80.0, damping=0.7, rest_length=0.5),
        ff.Actuator(
            "motor", GROUND, arm, axis=AXIS, motion="rotation",
            force=lambda t: 3.0 * math.sin(2.0 * t),
        ),
    ]  # fmt: skip


def model(own: bool, *more: object) -> ff.Model:
    mesh = ff.LineMesh.straight({"arm": [(0, 0, 0), (1, 0, 0)]}, 6)
    made = ff.Model("test", mesh=mesh)
    made.add(
        ff.Beam("arm", ff.Section.rectangle(0.01, 0.02, STEEL)),
        ff.RigidBody("bob", 0.8, (0.002, 0.003, 0.004), position=(1.3, 0.0, 0.0)),
        ff.Gravity((0.0, 0.0, -9.81)), *joints(own), *more,
    )  # fmt: skip
    return made


def positions(simulation: Simulation) -> np.ndarray:
    """Positions of all nodes of all blocks, in order, on all ranks."""
    own = {
        (part.block.name, int(number)): frame[:3].copy()
        for part in simulation.system.parts
        for number, frame in zip(part.block.node_ids, part.block.frames, strict=False)
        if part.block.owned
    }
    merged = {key: x for part in COMM.allgather(own) for key, x in part.items()}
    return np.array([merged[key] for key in sorted(merged)])


@pytest.mark.slow_on_ranks
@pytest.mark.parametrize(
    "policy", ["auto", *(pytest.param(p, marks=pytest.mark.serial) for p in ("updated", "frozen"))]
)
def test_functions_move_as_joints_of_the_package_do(policy: str) -> None:
    states = []
    for own in (False, True):
        options = RunOptions(dt=2e-3, t_end=1e3, tolerance=1e-11, iteration_matrix=policy)
        simulation = Simulation(model(own), options)
        for _ in range(60):
            assert simulation.advance(2e-3) is Status.OK
        states.append(positions(simulation))
    # a wrong derivative would not change the motion but the iterations, a wrong force the motion
    np.testing.assert_allclose(states[1], states[0], rtol=0.0, atol=1e-9)


@pytest.mark.slow_on_ranks
@pytest.mark.serial
def test_energy_balance_holds_the_work_of_functions() -> None:
    """The work of functions is that of forces, what other springs store is strain energy."""
    found = []
    for own in (False, True):
        simulation = Simulation(
            model(own, ff.EnergyProbe("energy")), RunOptions(dt=1e-3, t_end=1e3, tolerance=1e-11)
        )
        from flexfem.system.measure.energies import EnergyMeter

        meter = EnergyMeter(simulation.system, simulation.serial.model)
        strain = meter.total().strain
        for _ in range(100):
            assert simulation.advance(1e-3) is Status.OK
            meter.update()
        found.append((meter.total(), strain))
    (theirs, strain), (ours, _) = found
    assert ours.kinetic == pytest.approx(theirs.kinetic, rel=1e-8)
    # what the spring of the package stores and its damper takes is work of the function
    taken = theirs.strain - strain - ours.strain + theirs.dissipation - ours.dissipation
    assert ours.work == pytest.approx(theirs.work - taken, abs=1e-3 * abs(taken))
    # of second order; a force counted twice or left out is off by its work
    assert abs(ours.balance) < 3e-4 * ours.work
    assert abs(taken) > 100.0 * abs(ours.balance)


def _block(friction: ff.JointFriction | None, slide: ff.Prismatic) -> float:
    made = ff.Model("test")
    made.add(
        ff.RigidBody("block", 2.0, (0.1, 0.1, 0.1), velocity=(3.0, 0.0, 0.0)),
        ff.Gravity((0.0, 0.0, -9.81)), slide,
    )  # fmt: skip
    made.add(friction)
    simulation = Simulation(made, RunOptions(dt=1e-3, t_end=1e3, tolerance=1e-11, rho_inf=0.9))
    for _ in range(300):
        assert simulation.advance(1e-3) is Status.OK
    return float(positions(simulation)[0, 0])


@pytest.mark.serial
def test_constant_function_is_the_coefficient() -> None:
    ways = []
    for coefficient in (0.3, lambda speed: 0.3):
        slide = ff.Prismatic("slide", GROUND, ff.Marker("block"), axis=(1.0, 0.0, 0.0))
        ways.append(_block(ff.JointFriction("rub", slide, coefficient=coefficient), slide))
    assert ways[1] == pytest.approx(ways[0], rel=1e-9)


@pytest.mark.serial
def test_stribeck_curve_slows_a_block_down() -> None:
    """Against the integral of ``dv/dt = -mu(v) g`` by small steps of the fourth order."""
    slide = ff.Prismatic("slide", GROUND, ff.Marker("block"), axis=(1.0, 0.0, 0.0))
    found = _block(ff.JointFriction("rub", slide, coefficient=stribeck), slide)
    x, v, h = 0.0, 3.0, 1e-4

    def rate(v: float) -> float:
        return -9.81 * stribeck(v)

    for _ in range(3000):
        k1, k2 = rate(v), rate(v + 0.5 * h * rate(v))
        k3 = rate(v + 0.5 * h * k2)
        k4 = rate(v + h * k3)
        x += h * v + h * h / 6 * (k1 + k2 + k3)
        v += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    # the scheme is of second order: 1e-6; the coefficient at rest in its place: 0.05 m
    assert found == pytest.approx(x, rel=2e-6)


def test_static_equilibrium() -> None:
    """A hardening spring carries a weight: k x + q x^3 = m g."""
    made = ff.Model("test")
    made.add(
        ff.RigidBody("bob", 2.0, (0.1, 0.1, 0.1), position=(0.0, 0.0, -1.0)),
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Prismatic("guide", GROUND, ff.Marker("bob"), axis=(0.0, 0.0, 1.0)),
        ff.CustomForce(
            "spring", GROUND, ff.Marker("bob"),
            force=lambda x, v: 50.0 * (x - 1.0) + 400.0 * (x - 1.0) ** 3,
        ),
    )  # fmt: skip
    options = RunOptions(dt=1e-3, t_end=1e3, start="equilibrium")
    simulation = Simulation(made, options)
    stretch = -1.0 - positions(simulation)[0, 2]
    assert 50.0 * stretch + 400.0 * stretch**3 == pytest.approx(2.0 * 9.81, rel=1e-8)


def _sprung(own: bool) -> ff.Model:
    """A cantilever whose end a spring and damper pulls sideways."""
    made = ff.Model("sprung", mesh=ff.LineMesh.straight({"arm": [(0, 0, 0), (1, 0, 0)]}, 4))
    hook = ff.Ground((1.0, 1.0, 0.0))
    given = (200.0, 50.0, 0.9)
    made.add(
        ff.Beam("arm", ff.Section.circle(0.02, STEEL)),
        ff.Rigid("clamp", GROUND, ff.Marker("arm", "start")),
        ff.CustomForce("spring", hook, TIP, force=linear, parameters=given)
        if own
        else ff.SpringDamper(
            "spring", hook, TIP, stiffness=given[0], damping=given[1], rest_length=given[2]
        ),
        ff.PositionProbe("tip", TIP),
        ff.Gravity((0.0, 0.0, -9.81)),
    )
    return made


ANALYSES = {
    "static": lambda model: ff.solve_static(model, ff.StaticOptions(quiet=True)),
    "relaxation": lambda model: ff.relax(model, ff.RelaxationOptions(quiet=True)),
    "modes": lambda model: ff.find_modes(model, ff.ModeOptions(modes=3, quiet=True)),
}


@pytest.mark.slow_on_ranks
@pytest.mark.parametrize("analysis", ANALYSES.values(), ids=ANALYSES)
def test_other_analyses(analysis: Callable[[ff.Model], Any]) -> None:
    ours, theirs = analysis(_sprung(True)), analysis(_sprung(False))
    assert ours.status == theirs.status == "ok"
    for name in theirs.history or ():
        # relaxation ends within its own tolerance; a force left out moves the end by 0.1 m
        scale = np.abs(theirs.history[name]).max()
        np.testing.assert_allclose(
            ours.history[name][-1:], theirs.history[name][-1:], rtol=0.0, atol=1e-6 * scale + 1e-9
        )


@pytest.mark.slow_on_ranks
def test_restart(shared_tmp_path: Path) -> None:
    """Functions of time go on where they were."""
    more = (ff.PositionProbe("place", ff.Marker("bob")),)
    options = {"dt": 2e-3, "quiet": True, "tolerance": 1e-11}
    whole = ff.simulate(model(True, *more), ff.RunOptions(t_end=0.08, **options))
    ff.simulate(
        model(True, *more),
        ff.RunOptions(t_end=0.04, output=shared_tmp_path, checkpoint_every=20, **options),
    )
    file = shared_tmp_path / "checkpoint_000020.h5"
    rest = ff.simulate(model(True, *more), ff.RunOptions(t_end=0.08, restart=file, **options))
    if whole.history:
        for name in ("place_x", "place_y", "place_z"):
            assert rest.history[name][-1] == pytest.approx(whole.history[name][-1], abs=1e-11)


@pytest.mark.serial
def test_inspection_knows_what_functions_hold() -> None:
    """A body that a function of its position constrains is not reported as free along it."""
    for force, motions in ((lambda x, v: 3.0 * x, 0), (lambda x, v: 3.0 * v, 1)):
        made = ff.Model("held")
        made.add(
            ff.RigidBody("bob", 2.0, (0.1, 0.1, 0.1), position=(0.0, 0.0, -1.0)),
            ff.Prismatic("guide", GROUND, ff.Marker("bob"), axis=(0.0, 0.0, 1.0)),
            ff.CustomForce("spring", GROUND, ff.Marker("bob"), force=force),
        )
        inspection = Inspection(made)
        assert free_motions(inspection, holding(inspection))[0] == motions
