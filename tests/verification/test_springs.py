# SPDX-License-Identifier: LGPL-3.0-or-later
"""Springs that are slack or preloaded, against closed forms."""

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from scipy.optimize import brentq

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


@pytest.mark.slow
@pytest.mark.slow_on_ranks
@pytest.mark.serial
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


def spring_columns(**spring: Any) -> Any:
    """A mass that swings for half a second on a spring 0.54 m long at the start."""
    model = hanging(0.54, stiffness=0.0, rest_length=LENGTH, **spring)
    return columns(ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=0.5, quiet=True)))


@pytest.mark.serial
@pytest.mark.parametrize("cable", [False, True])
def test_functions_are_the_springs_that_they_say(cable: bool) -> None:
    """A linear function is the linear spring, energies and dissipation included."""
    found = spring_columns(force=lambda x, v: 800.0 * x + 6.0 * v, tension_only=cable)
    model = hanging(0.54, stiffness=800.0, damping=6.0, rest_length=LENGTH)
    wanted = columns(ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=0.5, quiet=True)))
    assert (wanted["at_z"] < 0.5).all()  # it is stretched throughout, as a cable is
    lost = np.abs(wanted["energy_dissipation"]).max()
    for name, values in wanted.items():
        bound = 1e-9 * max(np.abs(values).max(), 1e-3)
        # what a cable's damper takes is measured along its way, not by rates at both ends of steps:
        # 1.2e-6; a damper that is left out is wrong by all of it
        if cable and name in ("energy_dissipation", "energy_balance"):
            bound = 1e-5 * lost
        np.testing.assert_allclose(found[name], values, rtol=0.0, atol=bound, err_msg=name)


@pytest.mark.slow_on_ranks
@pytest.mark.serial
@pytest.mark.parametrize(
    ("curve", "depth"),
    [
        # 100 N per metre up to 0.1 m, 500 beyond: the weight of 19.62 N at 0.11924 m
        (ff.Curve([-1.0, 0.1, 0.5], [-100.0, 10.0, 210.0]), 0.1 + 9.62 / 500.0),
        (ff.Curve([0.0, 0.2, 0.4], [0.0, 20.0, 40.0], "monotone"), 0.1962),
        (ff.Curve([0.0, 0.1, 0.2], [0.0, 10.0, 40.0], "spline"), 0.1400714142),
    ],
    ids=["linear", "monotone", "spline"],
)
def test_a_weight_on_a_curve(curve: ff.Curve, depth: float) -> None:
    """The spline through three points is their parabola, ``1000 x^2``."""
    model = hanging(LENGTH + 0.9 * depth, stiffness=0.0, rest_length=LENGTH, force=curve)
    model.add(ff.Prismatic("guide", ff.Ground(), ff.Marker("mass"), axis=(0.0, 0.0, 1.0)))
    options = ff.StaticOptions(load_steps=1, gravity_load="constant", quiet=True)
    found = columns(ff.solve_static(model, options))
    assert 1.0 - found["at_z"][-1] == pytest.approx(LENGTH + depth, abs=1e-8)
    s = np.linspace(0.0, depth, 20001)
    energy = np.trapezoid(curve(s), s)
    # the kink of the linear one is not at the end of a panel: 1e-4 of the energy
    assert found["energy_strain"][-1] == pytest.approx(energy, rel=2e-4)


@pytest.mark.serial
def test_a_ball_falls_onto_a_hertzian_stop() -> None:
    """Its depth by energy, ``m g (h + d) = 2/5 k d^2.5``, and its height after the rebound."""
    stiffness, fall = 4e5, 0.05
    model = ff.Model("ball")
    ball = ff.Marker("ball")
    model.add(
        ff.Gravity((0.0, 0.0, -G)),
        ff.RigidBody("ball", MASS, (0.1, 0.1, 0.1), position=(0.0, 0.0, fall)),
        ff.LimitStop(
            "floor", ff.Ground(), ball, axis=(0.0, 0.0, 1.0), lower=0.0,
            force=lambda d: stiffness * d**1.5,
        ),
        ff.PositionProbe("at", ball), ff.EnergyProbe(),
    )  # fmt: skip
    found = columns(ff.simulate(model, ff.RunOptions(dt=4e-5, t_end=0.23, quiet=True)))
    depth = brentq(lambda d: MASS * G * (fall + d) - 0.4 * stiffness * d**2.5, 1e-5, 0.1)
    assert found["at_z"].min() == pytest.approx(-depth, rel=1e-4)
    # a stop that pulled at its end would leave it lower by a tenth
    assert found["at_z"][-200:].max() == pytest.approx(fall, rel=1e-5)
    assert np.abs(found["energy_balance"]).max() < 1e-4 * MASS * G * fall


def test_a_bushing_with_a_function() -> None:
    """Along x hardening, along the others linear: the place where a force holds it."""
    model = ff.Model("mount")
    body = ff.Marker("body")
    model.add(
        ff.RigidBody("body", MASS, (0.1, 0.1, 0.1)),
        ff.Bushing(
            "mount", ff.Ground(), body, stiffness=(1e3, 2e3, 2e3, 50.0, 50.0, 50.0),
            forces={0: lambda x: 1e6 * x * x * x},
        ),
        ff.PointForce("push", body, (40.0, 40.0, 0.0)), ff.PositionProbe("at", body),
    )  # fmt: skip
    found = columns(ff.solve_static(model, ff.StaticOptions(load_steps=1, quiet=True)))
    wanted = brentq(lambda x: 1e3 * x + 1e6 * x**3 - 40.0, 0.0, 1.0)
    assert found["at_x"][-1] == pytest.approx(wanted, abs=1e-8)
    assert found["at_y"][-1] == pytest.approx(0.02, abs=1e-8)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: spring_of(force=3.0), r"force must be a function made by def or lambda, got 3"),
        (lambda: spring_of(force=lambda x, v, t: x), r"force must be a function of \(x\[, v\]\)"),
        (lambda: spring_of(force=abs_of, stiffness=2.0), r"force takes the place of stiffness"),
        (lambda: spring_of(force=abs_of, preload=2.0), r"force takes the place of preload"),
        (lambda: ff.Curve([0.0, 0.0], [1.0, 2.0]), r"^Curve: x must increase"),
        (lambda: ff.Curve([0.0], [1.0]), r"^Curve: x and y must hold the same number"),
        (lambda: ff.Curve([0.0, 1.0], [1.0, 2.0], "cubic"), r"^Curve: kind must be"),
        (
            lambda: ff.Bushing("b", HOOK, ff.Marker("m"), forces={7: abs_of}),
            r'^Bushing "b": forces must be given for coordinates 0 to 5, got 7',
        ),
        (
            lambda: ff.LimitStop("s", HOOK, ff.Marker("m"), "distance", force=abs_of),
            r'^LimitStop "s": needs lower or upper',
        ),
    ],
)
def test_mistakes_in_functions(made: Any, message: str) -> None:
    with pytest.raises((TypeError, ValueError), match=message):
        made()


def abs_of(x: float) -> float:
    return abs(x)


def spring_of(**spring: Any) -> ff.SpringDamper:
    return ff.SpringDamper("spring", HOOK, ff.Marker("mass"), **spring)


def test_a_restart_with_a_slack_cable(shared_tmp_path: Path) -> None:
    """Its law has an infinite limit, which is no part of a checkpoint of the scheme."""
    model = hanging(LENGTH - 0.01, rest_length=LENGTH, tension_only=True)
    given = {"dt": 5e-3, "integrator": "energy_momentum", "rho_inf": 0.9, "quiet": True}
    whole = columns(ff.simulate(model, ff.RunOptions(t_end=0.1, **given)))
    more = {"output": shared_tmp_path, "checkpoint_every": 10}
    ff.simulate(model, ff.RunOptions(t_end=0.05, **given, **more))
    file = shared_tmp_path / "checkpoint_000010.h5"
    again = columns(ff.simulate(model, ff.RunOptions(t_end=0.1, restart=file, **given)))
    # the last changes or the force forgotten moves it by 1e-6 m
    assert again["at_z"][-1] == pytest.approx(whole["at_z"][-1], abs=1e-12)
