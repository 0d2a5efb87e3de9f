# SPDX-License-Identifier: LGPL-3.0-or-later
"""Followers of eccentric circular cams against closed forms."""

from typing import Any

import numpy as np
import pytest

import flexfem as ff
from tests.histories import columns

RADIUS, OFF, ROLLER, SPEED = 0.05, 0.02, 0.015, 8.0


def eccentric(angle: float) -> float:
    """Radius of a circle by the angle about a point beside its centre."""
    return OFF * np.cos(angle) + np.sqrt(RADIUS**2 - (OFF * np.sin(angle)) ** 2)


def lift(follower: str, angle: np.ndarray) -> np.ndarray:
    """Place of the follower on the cam's first axis, which has turned by an angle."""
    along, aside = OFF * np.cos(angle), OFF * np.sin(angle)
    if follower == "flat":
        return RADIUS + along
    reach = RADIUS + (ROLLER if follower == "roller" else 0.0)
    return along + np.sqrt(reach**2 - aside**2)


def driven(follower: str, profile: Any = eccentric, **given: Any) -> ff.Model:
    """A follower on a guide along x, and a cam that turns about z."""
    own = {"roller": {"radius": ROLLER}, "flat": {"normal": (1.0, 0.0, 0.0)}}.get(follower, {})
    place = (float(lift(follower, np.zeros(1))[0]), 0.0, 0.0)
    model = ff.Model("cam")
    model.add(
        ff.RigidBody("cam", 1.0, (0.01,) * 3, angular_velocity=(0.0, 0.0, SPEED)),
        ff.Revolute("shaft", ff.Ground(), ff.Marker("cam")),
        ff.PrescribedAngle("motor", ff.Ground(), ff.Marker("cam"), angle=lambda t: SPEED * t),
        ff.RigidBody("follower", 0.2, (0.01,) * 3, position=place),
        ff.Prismatic("guide", ff.Ground(place), ff.Marker("follower"), axis=(1.0, 0.0, 0.0)),
        ff.Cam("cam_joint", ff.Marker("cam"), ff.Marker("follower"), profile=profile,
               follower=follower, **own, **given),
        ff.PositionProbe("at", ff.Marker("follower")),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


@pytest.mark.slow_on_ranks
@pytest.mark.parametrize(
    "follower",
    [
        "point",
        pytest.param("roller", marks=pytest.mark.serial),
        pytest.param("flat", marks=pytest.mark.serial),
    ],
)
def test_followers_of_an_eccentric_circle(follower: str) -> None:
    """Over more than a turn, past the place where angles begin again."""
    found = columns(ff.simulate(driven(follower), ff.RunOptions(dt=2e-3, t_end=1.0, quiet=True)))
    exact = lift(follower, SPEED * found["t"])
    # splines of 720 pieces are off by 1e-12 m; a roller taken for a point by 5e-3 m, where both are
    # at their places at the start
    np.testing.assert_allclose(found["at_x"], exact, atol=1e-10)
    assert np.ptp(found["at_x"]) == pytest.approx(2.0 * OFF, rel=1e-3)


@pytest.mark.serial
def test_a_profile_of_points() -> None:
    """72 points of the circle make a spline that is off by 1e-7 of its radius."""
    angles = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    circle = RADIUS * np.stack([np.cos(angles), np.sin(angles)], axis=1) + [OFF, 0.0]
    model = driven("roller", circle)
    found = columns(ff.simulate(model, ff.RunOptions(dt=2e-3, t_end=0.8, quiet=True)))
    np.testing.assert_allclose(found["at_x"], lift("roller", SPEED * found["t"]), atol=1e-8)


@pytest.mark.serial
def test_a_follower_that_is_pressed_by_a_spring_lifts_off() -> None:
    """Where the cam's acceleration is larger than what the spring gives to the follower."""
    lifts = []
    for force in (-0.05, -5.0):
        model = driven("flat", stiffness=1e5, damping=20.0)
        model.add(ff.PointForce("spring", ff.Marker("follower"), (force, 0.0, 0.0)))
        found = columns(ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=0.7, quiet=True)))
        lifts.append(np.max(found["at_x"] - lift("flat", SPEED * found["t"])))
    # e w^2 m = 0.26 N: less presses too little, more keeps contact to the compression
    assert lifts[0] > 1e-3
    assert lifts[1] < 1e-5


REFUSED = {
    "no profile": ({"profile": None}, "profile must"),
    "open": ({"profile": lambda t: 1.0 + 0.1 * t}, "profile must close after a turn, got 1 and"),
    "negative": ({"profile": np.cos}, "profile must be positive, got -1 at 3.14"),
    "three points": ({"profile": [(1, 0), (0, 1), (-1, -1)]}, "must have four points at least, go"),
    "beside": (
        {"profile": [(3, 0), (2, 1), (1, 0), (2, -1)]},
        "profile must surround the marker once, counter-clockwise",
    ),
    "clockwise": (
        {"profile": [(1, 0), (0, -1), (-1, 0), (0, 1)]},
        "profile must surround the marker once, counter-clockwise",
    ),
    "hollow": (
        {"profile": lambda t: 1.0 + 0.2 * np.cos(6.0 * t), "follower": "roller", "radius": 0.5},
        "radius of 0.5 m must be less than that of the hollows of the profile, 0.09999",
    ),
    "not convex": (
        {"profile": lambda t: 1.0 + 0.2 * np.cos(6.0 * t), "follower": "flat", "normal": (1, 0, 0)},
        "profile must be convex for a flat follower",
    ),
    "radius": ({"radius": 0.1}, "radius goes with a roller follower, only there"),
    "normal": ({"follower": "flat"}, "normal goes with a flat follower, only there"),
    "damping": ({"damping": 1.0}, "damping needs a stiffness, got 1 alone"),
    "zero": ({"zero": (0, 0, 2)}, "zero must be across the axis"),
    "follower": ({"follower": "knife"}, "follower must be one of point, roller, flat, got 'knife'"),
}


@pytest.mark.serial
@pytest.mark.parametrize(("given", "message"), REFUSED.values(), ids=REFUSED)
def test_a_cam_that_is_refused(given: dict[str, Any], message: str) -> None:
    from tests.unit.refusals import assert_refused

    arguments = {"profile": lambda t: 1.0} | given
    assert_refused(lambda: ff.Cam("j", ff.Ground(), ff.Marker("b"), **arguments), message)
