# SPDX-License-Identifier: LGPL-3.0-or-later
"""Actuators in runs and at rest, and splines that tell their forces."""

from typing import Any

import numpy as np
import pytest

import flexfem as ff
from flexfem.simulation.motion.stepping import Simulation
from flexfem.system.measure.energies import EnergyMeter

Z = (0.0, 0.0, 1.0)


def discs() -> ff.Model:
    """A disc on an axle, another one driven from the first by half a sine of torque."""
    model = ff.Model("discs")
    a, b = ff.Marker("first"), ff.Marker("second")
    model.add(
        ff.RigidBody("first", 1.0, (0.2, 0.2, 0.3)),
        ff.RigidBody("second", 1.0, (0.2, 0.2, 0.1)),
        ff.Revolute("axle", ff.Ground(), a, axis=Z),
        ff.Revolute("shaft", a, b, axis=Z),
        ff.Actuator("motor", a, b, axis=Z, force=lambda t: 0.6 * np.sin(2.0 * t)),
    )
    return model


@pytest.mark.parametrize(
    "integrator", ["generalized_alpha", "energy_momentum", "independent_coordinates"]
)
def test_action_and_reaction(integrator):
    """Discs rotate against each other: rates of the torque's integral, and its work as energy."""
    options: dict[str, Any] = {"integrator": integrator, "rho_inf": 1.0, "tolerance": 1e-10}
    model = discs()
    simulation = Simulation(model, ff.RunOptions(dt=0.01, t_end=0.5, **options))
    meter = EnergyMeter(simulation.system, model)
    for _ in range(50):
        simulation.advance(0.01)
        meter.update()
    impulse = 0.3 * (1.0 - np.cos(1.0))
    own = [
        (int(i), float(v[5]))
        for part in simulation.system.parts
        for i, v in zip(part.block.node_ids, part.block.velocity, strict=True)
    ]
    for body, rate in own:
        # second order in the step; without the reaction the first disc would rest
        assert rate == pytest.approx((-impulse / 0.3, impulse / 0.1)[body], rel=2e-4)
    energies = meter.total()
    kinetic = 0.5 * impulse**2 * (1 / 0.3 + 1 / 0.1)
    assert energies.kinetic == pytest.approx(kinetic, rel=5e-4)
    # counted as a damper too, the work would be twice in the balance
    assert energies.work == pytest.approx(kinetic, rel=5e-3)
    assert abs(energies.balance) < 5e-3 * kinetic


def _way_and_turn(t: float, s: ff.MarkerState) -> tuple[float, float]:
    return s.position[0] - 1.0, np.arctan2(s.rotation[2, 1], s.rotation[1, 1])


@pytest.mark.serial
def test_rest_against_a_spring():
    """Statics: a cylinder pushes against a spring, the torque of a motor twists another one."""
    model = ff.Model("press")
    model.add(
        ff.RigidBody("ram", 1.0, (0.1, 0.1, 0.1), position=(1.0, 0.0, 0.0)),
        ff.Cylindrical("guide", ff.Ground(), ff.Marker("ram"), axis=(1.0, 0.0, 0.0)),
        ff.SpringDamper("spring", ff.Ground(), ff.Marker("ram"), stiffness=200.0, rest_length=1.0),
        ff.TorsionalSpringDamper("twist", ff.Ground(), ff.Marker("ram"), axis=(1.0, 0, 0),
                                 stiffness=5.0),
        ff.Actuator("cylinder", ff.Ground(), ff.Marker("ram"), motion="distance",
                    force=lambda t: 10.0 * t),
        ff.Actuator("motor", ff.Ground(), ff.Marker("ram"), axis=(1.0, 0, 0),
                    force=lambda t: 0.5 * t),
        ff.Probe("motion", ff.Marker("ram"), ("way", "turn"), _way_and_turn),
    )  # fmt: skip
    outcome = ff.solve_static(model, ff.StaticOptions(load_steps=1, quiet=True))
    assert outcome.status == "ok"
    # linear springs; a force of the wrong sign would pull
    assert outcome.history["way"][-1] == pytest.approx(0.05, rel=1e-6)
    assert outcome.history["turn"][-1] == pytest.approx(0.1, rel=1e-6)


def test_splines():
    times = np.linspace(0.0, 2.0, 21)
    errors = {}
    for degree in (1, 3, 5):
        spline = ff.Spline(times, np.sin(3.0 * times), degree)
        at = np.linspace(0.0, 2.0, 333)
        errors[degree] = max(abs(spline(t) - np.sin(3.0 * t)) for t in at)
        assert spline(-1.0) == spline(0.0) == 0.0
        assert spline(5.0) == pytest.approx(np.sin(6.0), abs=1e-15)
    # h = 0.3 in the argument: h^2/8, h^4/100 and h^6/1000 at the ends
    assert errors[1] < 1.2e-2
    assert errors[3] < 4e-4
    assert errors[5] < 1e-5


def test_bad_arguments_are_told():
    with pytest.raises(ValueError, match="Spline: degree must be 1, 3 or 5, got 2"):
        ff.Spline([0.0, 1.0, 2.0], [0.0, 1.0, 2.0], 2)
    with pytest.raises(ValueError, match="Spline: degree 5 needs more than 5 times, got 3"):
        ff.Spline([0.0, 1.0, 2.0], [0.0, 1.0, 2.0])
    with pytest.raises(ValueError, match="times must increase"):
        ff.Spline([0.0, 0.0, 2.0], [0.0, 1.0, 2.0], 1)
    with pytest.raises(ValueError, match='Actuator "m": motion must be one of rotation'):
        ff.Actuator("m", ff.Ground(), ff.Marker("x"), motion="bending")
    with pytest.raises(TypeError, match='Actuator "m": force must be a function'):
        ff.Actuator("m", ff.Ground(), ff.Marker("x"), force=3.0)
