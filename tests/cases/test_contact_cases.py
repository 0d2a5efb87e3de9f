# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cases of contact against closed forms: landing sheet, bar on a wall, billiards, capstan."""

import math

import numpy as np
import pytest

import flexfem as ff
from flexfem.cli import load_case

pytestmark = pytest.mark.serial


def results(name: str, **options: object) -> dict[str, float]:
    """Headline results of a run."""
    found: dict[str, float] = load_case(name).run(**options).summary["results"]
    return found


@pytest.mark.parametrize("step", [1e-3, 5e-3])
def test_sheet_leaves_as_it_came(step: float) -> None:
    """Whatever the step: a penalty made three times the energy of motion with 1 ms."""
    found = results("sheet_landing", mesh="5x5", gravity=0.0, dt=step, t_end=8 * step)
    assert found["least_gap"] > 0.0
    assert found["energy_made"] < 1e-6
    # flat, nothing of the motion goes into vibrations; forces of the step's end would change it
    assert found["rebound"] == pytest.approx(1.0, abs=1e-9)


def test_bar_on_a_wall() -> None:
    """Force, times, impulse and speed; with a quarter of the elements the front is less steep."""
    found = results("bar_impact", elements=50, dt=4e-7)
    assert found["expected_force"] == pytest.approx(1.85638e6, rel=1e-5)
    # waves of E instead of that of uniaxial strain would give 0.862 of the force
    assert found["force"] == pytest.approx(found["expected_force"], rel=1e-3)
    assert found["impulse"] == pytest.approx(found["expected_impulse"], rel=2e-3)
    assert found["last_com_velocity"] == pytest.approx(found["expected_com_velocity"], rel=3e-3)
    # within a step and what the reach takes
    for when in ("first_contact", "last_contact"):
        assert found[when] == pytest.approx(found[f"expected_{when}"], abs=3e-6)
    assert found["least_gap"] > 0.0
    assert found["energy_made"] < 1e-6


def test_one_ball_hits_another() -> None:
    """Frictionless balls: the line of centres takes all of the speed along it."""
    radius, offset, speed = 0.028575, 0.02, 8.0
    found = results(
        "billiards", rows=1, boxes=0, radius=radius, offset=offset, speed=speed, run_up=1e-3,
        dt=5e-5, t_end=2e-3,
    )  # fmt: skip
    sine = offset / (2.0 * radius)
    # balls repel 0.05 mm before they touch, and the line turns by a degree in a step
    assert found["last_cue_vx"] == pytest.approx(speed * sine**2, rel=0.01)
    across = speed * sine * math.sqrt(1.0 - sine**2)
    assert found["last_cue_vy"] == pytest.approx(across, rel=0.01)
    assert abs(found["momentum_error"]) + abs(found["angular_momentum_error"]) < 1e-9
    assert max(found["energy_made"], abs(found["energy_lost"])) < 1e-8
    assert found["least_gap"] > 0.0


def test_balls_and_boxes() -> None:
    """Large steps: nothing overlaps, and all that is kept without friction is kept."""
    found = results("billiards", rows=2, boxes=2, run_up=1e-3, dt=1e-3, t_end=0.02)
    assert found["least_gap"] > 0.0
    assert max(found["momentum_error"], found["angular_momentum_error"]) < 1e-9
    assert max(found["energy_made"], abs(found["energy_lost"])) < 1e-6


def test_rope_over_a_cylinder() -> None:
    """Tensions are as exp(friction angle)."""
    found = results("capstan", elements=8, angle=0.5 * math.pi, free_length=0.01, t_end=0.05)
    # the radius of the rope takes 0.1 %, chords of 11 degrees add 0.1 %
    assert found["ratio"] == pytest.approx(found["expected_ratio"], rel=0.01)
    assert found["expected_ratio"] == pytest.approx(math.exp(0.15 * math.pi))
    assert found["slip"] > 0.0
    assert found["least_gap"] > 0.0


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("billiards", {"reach": 1e-3}, "the reach must be at most the spacing, 0.0001 m"),
        ("capstan", {"elements": 2}, "elements must be at least the angle, 3.14159 rad, got 2"),
    ],
)
def test_numbers_that_do_not_go_together(name: str, given: dict[str, object], message: str) -> None:
    """Refused in one line that names the value."""
    case = load_case(name)
    with pytest.raises(ValueError, match=message):
        case.model(**case.prepare(given)[0])


def test_names_of_columns() -> None:
    """Of a contact probe may be others; those that there are not are refused."""
    probe = ff.ContactProbe("touch", "hit", names={"gap": "clearance"})
    assert probe.columns[:2] == ("clearance", "touch_penetration")
    with pytest.raises(ValueError, match=r'names must be "gap" or .*, got .depth.'):
        ff.ContactProbe("touch", "hit", names={"depth": "clearance"})
    with pytest.raises(ValueError, match='column "touch_fx" occurs twice'):
        ff.ContactProbe("touch", "hit", names={"gap": "touch_fx"})


def test_bar_counts_its_mass() -> None:
    """Velocity of the centre of mass: end nodes carry half of what the others do."""
    mean = load_case("bar_impact").build.__globals__["mean_velocity"]
    state = ff.MarkerState
    rates = [
        state(np.zeros(3), np.eye(3), np.array((0.0, 0.0, rate)), np.zeros(3))
        for rate in (4.0, 1.0, 2.0)
    ]
    assert mean(0.0, *rates) == (2.0,)
