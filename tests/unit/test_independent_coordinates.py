# SPDX-License-Identifier: LGPL-3.0-or-later
"""The integrator of independent velocities, against multipliers and the constraints themselves."""

import math
from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.cli import load_case
from flexfem.core.status import Status
from flexfem.simulation.motion.stepping import Simulation
from flexfem.system.measure.probes import ProbeRecorder
from tests.unit.particle_body import bar

Z = (0.0, 0.0, 1.0)
OPTIONS = ff.RunOptions(dt=1e-2, t_end=1.0, integrator="independent_coordinates", tolerance=1e-10)


@pytest.mark.serial
@pytest.mark.parametrize("matrix", ["frozen", "updated", "material"])
def test_its_matrix_cannot_be_chosen(matrix: str) -> None:
    with pytest.raises(ValueError, match="iteration_matrix"):
        replace(OPTIONS, iteration_matrix=matrix)


def run(model: ff.Model, end: float, comm: Any = MPI.COMM_SELF, **options: Any) -> Simulation:
    """Steps of one size to the end."""
    chosen = replace(OPTIONS, t_end=end, **options)
    simulation = Simulation(model, chosen, comm)
    assert simulation.status is Status.OK
    for _ in range(round(end / chosen.dt)):
        assert simulation.advance(chosen.dt) is Status.OK
    return simulation


def frames(simulation: Simulation) -> np.ndarray:
    """Frames of all nodes in the order of the input (collective)."""
    found = []
    for part in simulation.system.parts:
        block = part.block
        full = np.zeros((block.size_global, 12))
        full[block.node_ids[: block.owned]] = block.frames[: block.owned]
        simulation.system.comm.Allreduce(MPI.IN_PLACE, full)
        found.append(full)
    return np.concatenate(found)


def double_pendulum() -> ff.Model:
    """Two bodies that swing in space, on a spherical joint and a universal one."""
    model = ff.Model("pendulum")
    model.add(ff.Gravity((0.0, 0.0, -9.81)))
    for i, name in enumerate(("upper", "lower")):
        model.add(
            ff.RigidBody(name, 1.0 + i, (0.03, 0.02, 0.04), position=(0.3 + 0.6 * i, 0, 0)),
        )
    ends = ff.Marker("upper", offset=(0.3, 0, 0)), ff.Marker("lower", offset=(-0.3, 0, 0))
    model.add(
        ff.Spherical("pin", ff.Ground(), ff.Marker("upper", offset=(-0.3, 0, 0))),
        ff.Universal("elbow", *ends, axis=(0, 1, 0), second_axis=(0, 0, 1)),
        ff.SpringDamper(
            "spring", ff.Ground((0.0, 1.0, 0.0)), ff.Marker("lower", offset=(0.3, 0, 0)),
            stiffness=20.0, damping=0.3, rest_length=1.0,
        ),
        ff.Actuator("motor", *ends, axis=(0, 1, 0), force=lambda t: 0.5 * math.sin(5 * t)),
    )  # fmt: skip
    return model


@pytest.mark.serial
def test_second_order_and_constraints_at_all_levels():
    exact = frames(run(double_pendulum(), 0.2, dt=1.25e-3))
    errors = []
    for dt in (1e-2, 5e-3):
        simulation = run(double_pendulum(), 0.2, dt=dt)
        errors.append(np.abs(frames(simulation) - exact).max())
        system = simulation.system
        system.interface.update()
        rows = system.constraints
        rows.evaluate(np.array([1.0, 1.0]))
        # round-off; multipliers alone leave rates of the order of the squared step, 1e-4
        assert np.abs(rows.values * rows.rigid).max() < 1e-13
        assert np.abs(rows.rates() * rows.rigid).max() < 1e-11
    # (16 - 1/16) / (4 - 1/16) of the reference's own error
    assert 3.8 < errors[0] / errors[1] < 4.6


@pytest.mark.serial
def test_multipliers_come_out_as_well():
    """Joint forces of both closures approach each other with the square of the step."""
    gaps = []
    for dt in (4e-3, 2e-3):
        runs = [
            run(double_pendulum(), 0.1, dt=dt, integrator=name)
            for name in ("independent_coordinates", "generalized_alpha")
        ]
        own, other = (s.system.constraints for s in runs)
        forces = np.abs(other.forces).max()
        gaps.append(np.abs(own.forces - other.forces).max() / forces)
    # forces that are one step late would fall by 2 only
    assert gaps[0] < 3e-3
    assert gaps[0] / gaps[1] > 3.0


def rhombus(twice: bool) -> ff.Model:
    """Four-bar linkage of bars in floating frames of three kinds, driven by a moment."""
    stiff, soft = bar(modes=2, stiffening=True, cells=1), bar(modes=2, side=0.01, cells=1)
    up, along = np.array([0.5, math.sqrt(0.75), 0.0]), np.array([1.0, 0.0, 0.0])
    turned = np.array([[up[0], -up[1], 0.0], [up[1], up[0], 0.0], [0.0, 0.0, 1.0]])
    model = ff.Model("rhombus")
    model.add(
        ff.FloatingBody("crank", stiff, rotation=turned, stiffening=True),
        ff.FloatingBody("coupler", soft, position=up, frame="mean_axes"),
        ff.FloatingBody("rocker", soft, position=along, rotation=turned, frame="right"),
        ff.Revolute("A", ff.Ground(), ff.Marker("crank", "left"), axis=Z),
        ff.Revolute("B", ff.Marker("crank", "right"), ff.Marker("coupler", "left"), axis=Z),
        ff.Revolute("C", ff.Marker("coupler", "right"), ff.Marker("rocker", "right"), axis=Z),
        ff.Revolute("D", ff.Ground(along), ff.Marker("rocker", "left"), axis=Z),
        ff.PointMoment(
            "drive", ff.Marker("crank", "left"), Z, amplitude=lambda t: 40 * math.sin(20 * t)
        ),
    )
    if twice:
        model.add(ff.Revolute("again", ff.Ground(), ff.Marker("crank", "left"), axis=Z))
    return model


@pytest.mark.serial
@pytest.mark.parametrize("twice", [False, True])
def test_loop_of_floating_bodies(twice):
    """Fixed unknowns of amplitudes stay out of the independent motions."""
    more = {"redundant_constraints": "least_norm"} if twice else {}
    one, other = (
        run(rhombus(twice), 0.04, dt=1e-3, integrator=name, **more)
        for name in ("independent_coordinates", "generalized_alpha")
    )
    block = other.system.parts[0].block
    assert np.abs(block.frames - block.start_frames).max() > 0.01
    # mixed with stiffnesses of 1e12 that hold them, motions of bars are found to 1e-4 only, and a
    # step takes 25 iterations; hinges that count twice start by giving way by 1e-8
    np.testing.assert_allclose(frames(one), frames(other), atol=1e-6 if twice else 1e-7)
    assert one.system.counters.newton_iterations <= 5 * one.steps


@pytest.mark.serial
@pytest.mark.parametrize("links", ["se3", "floating"])
def test_manipulator_closed_by_multipliers_and_reduced(links):
    """Flexible links: P, angles and deflections agree far below the error of the steps."""
    case = load_case("parallel_manipulator")
    model = case.build(**_build_values(case, links=links, elements=1, duration=0.1, samples=51))
    runs = []
    for name in ("independent_coordinates", "generalized_alpha"):
        simulation = Simulation(
            model, replace(OPTIONS, dt=1e-4, t_end=0.01, integrator=name, rho_inf=0.9),
            MPI.COMM_SELF,
        )  # fmt: skip
        sampler = ProbeRecorder(simulation.system, simulation.serial, 300)
        for _ in range(100):
            assert simulation.advance(1e-4) is Status.OK
            sampler.record(simulation.time)
        runs.append(np.array([values for _, values in sampler.flush()]))
    columns = [c for probe in model.probes for c in probe.columns]
    for name in ("P_x", "P_y", "angle_1", "angle_4", "transverse_1", "rotation_5"):
        one, other = (values[:, columns.index(name)] for values in runs)
        # at this step both are off by more than 1e-6 (m, rad) themselves; a constraint that is
        # dropped or a velocity that is integrated in another way would show
        assert np.abs(one - other).max() < 2e-10, (name, np.abs(one - other).max())


@pytest.mark.parametrize("name", ["independent_coordinates", "generalized_alpha"])
def test_manipulator_of_finite_elements_on_ranks(name):
    """Loops of floating bodies that ranks share."""
    case = load_case("parallel_manipulator")
    given = {"links": "fem", "elements": 2, "stiffening": False, "duration": 0.1, "samples": 11}
    model = case.build(**_build_values(case, **given))
    more: dict[str, Any] = {"dt": 2.5e-4, "integrator": name, "rho_inf": 0.9, "tolerance": 1e-9}
    alone = frames(run(model, 5e-3, **more))
    together = frames(run(model, 5e-3, MPI.COMM_WORLD, **more))
    # sums in another order; a joint that acts on one rank's body only would leave 1e-4
    np.testing.assert_allclose(together, alone, atol=1e-10)


def _build_values(case: ff.Case, **given: Any) -> dict[str, Any]:
    """Arguments of a case's build function."""
    values = case.values(given)
    return {option.name: values[option.name] for option in case.options}


def driven(beams: bool = True) -> ff.Model:
    """A driven crank, a rod of beams or a rigid one, and a slider."""
    start, stop = np.array([0.0, 0.2, 0.0]), np.array([0.5, 0.0, 0.0])
    rod: Any = ff.Beam("rod", ff.Section.rectangle(0.02, 0.01, ff.Material(70e9, 0.3, 2700.0)))
    first, end = ff.Marker("rod", "start"), ff.Marker("rod", "end")
    if not beams:
        middle = 0.5 * (start + stop)
        rod = ff.RigidBody("rod", 0.3, (0.01, 0.01, 0.01), position=middle)
        first, end = (ff.Marker("rod", offset=x - middle) for x in (start, stop))
    mesh = ff.LineMesh.straight({"rod": [start, stop]}, 4) if beams else None
    model = ff.Model("driven", mesh=mesh)
    tip = ff.Marker("crank", offset=(0, 0.1, 0))
    root = ff.Marker("crank", offset=(0, -0.1, 0))
    model.add(
        rod,
        ff.RigidBody("crank", 0.5, (0.01, 0.01, 0.01), position=(0, 0.1, 0)),
        ff.PointMass("slider", 0.4, end),
        ff.Revolute("A", ff.Ground(), root, axis=Z),
        ff.PrescribedAngle(
            "turn", ff.Ground(), root, axis=Z, angle=lambda t: 3.0 * t**2 + 8.0 * t**4
        ),
        ff.Spherical("B", tip, first),
        ff.PointOnLine("guide", ff.Ground(), end, axis=(1.0, 0, 0)),
        ff.PositionProbe("end", end),
    )
    return model


def test_driven_mechanism_on_ranks():
    """The same on all ranks together as on one; drives and beams split over ranks included."""
    alone = frames(run(driven(), 0.05, dt=5e-3))
    together = frames(run(driven(), 0.05, MPI.COMM_WORLD, dt=5e-3, split_above=1))
    # the sums differ by rounding; a ghost without its velocity would be off by 1e-3
    np.testing.assert_allclose(together, alone, atol=1e-11)


@pytest.mark.serial
def test_driven_mechanism_against_multipliers():
    model = driven(beams=False)
    known = run(model, 0.2, dt=1.25e-3, integrator="generalized_alpha")
    forces = known.system.constraints.forces
    errors = []
    for dt in (2e-2, 1e-2):
        own = run(model, 0.2, dt=dt)
        # the drive alone says where everything is
        np.testing.assert_allclose(frames(own), frames(known), atol=1e-12)
        errors.append(np.abs(own.system.constraints.forces - forces).max() / np.abs(forces).max())
    # differences of the drive over a step are of second order; a wrong factor leaves a constant
    assert errors[0] < 3e-2
    assert errors[0] / errors[1] > 3.0


@pytest.mark.serial
def test_redundant_hinges():
    """A door on two hinges moves as one on a single hinge."""

    def door(hinges: int) -> ff.Model:
        model = ff.Model("door")
        model.add(ff.Gravity((0, -9.81, 0)), ff.RigidBody("door", 2.0, (0.1, 0.2, 0.3)))
        for i in range(hinges):
            place = (-0.5, 0.0, 0.3 * i)
            marker = ff.Marker("door", offset=place)
            model.add(ff.Revolute(f"hinge_{i}", ff.Ground(place), marker, axis=Z))
        return model

    one = frames(run(door(1), 0.2))
    two = frames(run(door(2), 0.2, redundant_constraints="least_norm"))
    # the start gives way by 1e-8; hinges that count twice would leave nothing or too much to move
    np.testing.assert_allclose(two, one, atol=1e-7)


@pytest.mark.serial
def test_adaptive_steps_keep_the_tolerance():
    exact = frames(run(double_pendulum(), 0.2, dt=2e-3))
    simulation = run(double_pendulum(), 0.2, dt=5e-2, adaptive=True, error_tolerance=1e-5)
    # four steps of 0.05 s would be off by 1e-2
    assert simulation.steps > 8
    assert np.abs(frames(simulation) - exact).max() < 2e-3


@pytest.mark.serial
def test_large_systems_are_refused(monkeypatch):
    monkeypatch.setattr("flexfem.integrators.independent_coordinates.LARGEST", 10)
    with pytest.raises(ValueError, match="12 unknowns are more than 10"):
        run(double_pendulum(), 0.1)
