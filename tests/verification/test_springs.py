# SPDX-License-Identifier: LGPL-3.0-or-later
"""Springs that are slack or preloaded, against closed forms."""

from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from tests.histories import columns

MASS, STIFFNESS, LENGTH, G = 2.0, 800.0, 0.5, 9.81
HOOK = ff.Ground((0.0, 0.0, 1.0))


def hanging(start: float, **spring: Any) -> ff.Model:
    """A mass on a vertical spring, at a distance below its hook at which it starts at rest."""
    model = ff.Model("hanging")
    model.add(
        ff.Gravity((0.0, 0.0, -G)),
        ff.RigidBody("mass", MASS, (0.1, 0.1, 0.1), position=(0.0, 0.0, 1.0 - start)),
        ff.SpringDamper("spring", HOOK, ff.Marker("mass"), **({"stiffness": STIFFNESS} | spring)),
        ff.PositionProbe("at", ff.Marker("mass")),
        ff.EnergyProbe(),
    )
    return model


@pytest.mark.three_ranks
def test_a_mass_falls_into_a_slack_cable_and_is_thrown_back() -> None:
    """It falls freely, is stretched by what its weight and fall give, and comes back to its height.

    A spring that presses, too, would hold it at the start: it is deeper by less than a third.
    """
    fall, sag = 0.1, MASS * G / STIFFNESS
    model = hanging(LENGTH - fall, rest_length=LENGTH, tension_only=True)
    options = ff.RunOptions(dt=2e-4, t_end=0.55, quiet=True)
    alone = ff.simulate(model, options, comm=MPI.COMM_SELF).history
    for name, values in columns(ff.simulate(model, options)).items():
        np.testing.assert_allclose(values, alone[name], atol=1e-9 * np.abs(values).max() + 1e-12)
    depth = 1.0 - alone["at_z"]
    # of second order in the step: 1e-7 m; a force of the wrong size by 1e-3 moves it by 3e-5 m
    lowest = LENGTH + sag + np.sqrt(sag**2 + 2.0 * sag * fall)
    assert depth.max() == pytest.approx(lowest, abs=2e-6)
    turn = int(np.argmax(depth))
    back = turn + int(np.argmin(depth[turn:]))
    assert depth[back] == pytest.approx(LENGTH - fall, abs=2e-6)
    free = np.sqrt(2.0 * fall / G)
    rate = np.sqrt(STIFFNESS / MASS)
    stretched = 2.0 * (np.pi - np.arctan(np.sqrt(2.0 * fall / sag))) / rate
    assert alone["t"][back] == pytest.approx(2.0 * free + stretched, abs=4e-4)
    largest = np.abs(alone["energy_gravity"]).max()
    assert np.abs(alone["energy_balance"]).max() < 1e-5 * largest


@pytest.mark.three_ranks
@pytest.mark.parametrize(
    ("spring", "stretch"),
    [
        ({"preload": 5.0}, (MASS * G - 5.0) / STIFFNESS),
        ({"preload": -5.0}, (MASS * G + 5.0) / STIFFNESS),
        ({"preload": 5.0, "tension_only": True}, (MASS * G - 5.0) / STIFFNESS),
        ({"backlash": 0.03}, MASS * G / STIFFNESS + 0.015),
    ],
    ids=["preload", "pressed", "cable", "backlash"],
)
def test_a_weight_at_rest(spring: dict[str, Any], stretch: float) -> None:
    start = LENGTH + 0.9 * stretch
    model = hanging(start, rest_length=LENGTH, **spring)
    model.add(ff.Prismatic("guide", ff.Ground(), ff.Marker("mass"), axis=(0.0, 0.0, 1.0)))
    # without the weight a slack spring holds nothing
    options = ff.StaticOptions(load_steps=1, gravity_load="constant", quiet=True)
    found = columns(ff.solve_static(model, options))
    assert 1.0 - found["at_z"][-1] == pytest.approx(LENGTH + stretch, abs=1e-9)
    # half of force times what it has stretched the spring from where it has none
    force = MASS * G
    assert found["energy_strain"][-1] == pytest.approx(0.5 * force**2 / STIFFNESS, rel=1e-9)


@pytest.mark.three_ranks
@pytest.mark.parametrize(
    ("spring", "angle"), [({"preload": 3.0}, (7.0 - 3.0) / 40.0), ({"backlash": 0.2}, 0.275)]
)
def test_a_moment_on_a_torsional_spring(spring: dict[str, Any], angle: float) -> None:
    wheel, axis = ff.Marker("wheel"), (0.0, 0.0, 1.0)
    model = ff.Model("coil")
    model.add(
        ff.RigidBody("wheel", 1.0, (0.1, 0.1, 0.1)),
        ff.Revolute("axle", ff.Ground(), wheel, axis=axis),
        ff.TorsionalSpringDamper(
            "coil", ff.Ground(), wheel, axis=axis, stiffness=40.0, rest_angle=-0.11, **spring
        ),
        ff.PointMoment("moment", wheel, (0.0, 0.0, 7.0), amplitude=lambda t: 1.0),
        ff.Probe("angle", wheel, ["angle"], lambda t, s: [np.arctan2(*s.rotation[1::-1, 0])]),
    )
    found = columns(ff.solve_static(model, ff.StaticOptions(load_steps=1, quiet=True)))
    assert found["angle"][-1] == pytest.approx(angle - 0.11, abs=1e-9)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("spring", "message"),
    [
        ({"stiffness": 0.0, "damping": 1.0, "preload": 2.0}, "preload needs a stiffness, got 0.0"),
        (
            {"stiffness": 0.0, "damping": 1.0, "tension_only": True},
            "tension_only needs a stiffness, got 0.0",
        ),
        ({"backlash": -0.1}, "backlash must not be negative, got -0.1"),
        ({"preload": np.nan}, "preload must be .*finite"),
        ({"backlash": 0.1, "preload": 1.0}, "backlash and preload exclude each other"),
        ({"backlash": 0.1, "tension_only": True}, "tension_only and backlash exclude each other"),
        ({"tension_only": 1}, "tension_only must be"),
    ],
)
def test_springs_that_are_refused(spring: dict[str, Any], message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=f'^SpringDamper "spring": {message}'):
        hanging(LENGTH, **spring)
