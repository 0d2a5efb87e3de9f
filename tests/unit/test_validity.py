# SPDX-License-Identifier: LGPL-3.0-or-later
"""Warnings of states beyond what a model is made for: large bending, bodies far away."""

from functools import cache
from typing import Any

import pytest

import flexfem as ff
from tests.unit.refusals import assert_on_page

LENGTH, SIDE, MODULUS = 0.5, 0.01, 7e10
#: Bending stiffness of the bar, N m^2.
BENDING = MODULUS * SIDE**4 / 12.0


@cache
def bar() -> ff.ReducedBody:
    """A slender bar along x of Euler-Bernoulli elements, with an interface at each end."""
    section = ff.Section.rectangle(SIDE, SIDE, ff.Material(MODULUS, 0.3, 2700.0))
    nodes = [(LENGTH * i / 4.0, 0.0, 0.0) for i in range(5)]
    ends = {"near": 0, "far": 4}
    return ff.euler_bernoulli_body(nodes, section, ends, orientation=(0.0, 1.0, 0.0))


def cantilever(deflection: float, frame: str) -> ff.Model:
    """The bar, clamped at one end, with the force that displaces the other by so many lengths."""
    model = ff.Model("cantilever")
    force = deflection * LENGTH * 3.0 * BENDING / LENGTH**3
    model.add(
        ff.FloatingBody("bar", bar(), frame=frame),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("bar", "near")),
        ff.PointForce("force", ff.Marker("bar", "far"), (0.0, 0.0, force)),
    )
    return model


def warned(outcome: Any) -> list[str]:
    """The warnings that are tried here, of a run that ends well."""
    assert outcome.status == "ok"
    lines = outcome.summary["warnings"]
    return [line for line in lines if "it bends by" in line or "away from where" in line]


@pytest.mark.parametrize("frame", ["near", "mean_axes"])
def test_a_linear_body_that_bends_far(frame: str) -> None:
    options = ff.StaticOptions(quiet=True)
    assert warned(ff.solve_static(cantilever(0.05, frame), options)) == []
    (line,) = warned(ff.solve_static(cantilever(0.25, frame), options))
    assert line.startswith('FloatingBody "bar": it bends by ')
    assert "half a turn" not in line
    if frame == "near":  # the slope of the end; a rotation in another frame is another one
        bent = float(line.split(" rad")[0].split()[-1])
        assert bent == pytest.approx(1.5 * 0.25, rel=0.02)


@pytest.mark.serial
def test_a_linear_body_near_half_a_turn() -> None:
    """A moment turns its end by 2.4 rad."""
    model, far = ff.Model("rolled"), ff.Marker("bar", "far")
    model.add(
        ff.FloatingBody("bar", bar()),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("bar", "near")),
        ff.PointMoment("roll", far, (0.0, 0.0, 2.4 * BENDING / LENGTH)),
    )
    (line,) = warned(ff.solve_static(model, ff.StaticOptions(quiet=True, load_steps=4)))
    assert "at half a turn of an interface its energy jumps, whatever the steps; divide" in line
    assert_on_page(line)


def test_motions_say_so_too() -> None:
    """A force that acts at once bends twice as far; it is seen in the steps that are looked at."""
    motion = ff.RunOptions(dt=1e-3, t_end=0.03, quiet=True)
    assert warned(ff.simulate(cantilever(0.04, "near"), motion)) == []
    (line,) = warned(ff.simulate(cantilever(0.2, "near"), motion))
    assert line.startswith('FloatingBody "bar": it bends by ')


@pytest.mark.parametrize("speed", [900.0, pytest.param(1100.0, marks=pytest.mark.three_ranks)])
def test_a_body_far_away(speed: float) -> None:
    """Two bodies one metre apart are a model of one metre, and one of them flies off."""
    model = ff.Model("flight")
    inertia = (1.0, 1.0, 1.0)
    model.add(
        ff.RigidBody("still", 1.0, inertia),
        ff.RigidBody("fast", 1.0, inertia, position=(1.0, 0.0, 0.0), velocity=(speed, 0.0, 0.0)),
    )
    lines = warned(ff.simulate(model, ff.RunOptions(dt=0.1, t_end=1.0, quiet=True)))
    if speed < 1000.0:
        assert lines == []
    else:
        assert [line.split(";")[0] for line in lines] == [
            'RigidBody "fast": it is 1.1e+03 m away from where the model was, 1.1e+03 times its '
            "size of 1 m, at t = 1"
        ]


@pytest.mark.serial
def test_a_model_far_from_the_origin_is_not_far_away() -> None:
    """Amplitudes of a reduced body are no places: they are zero, however far away it is."""
    model = ff.Model("site")
    place = (5000.0, 0.0, 0.0)
    model.add(
        ff.FloatingBody("bar", bar(), position=place),
        ff.Rigid("clamp", ff.Ground(place), ff.Marker("bar", "near")),
    )
    assert warned(ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=3e-3, quiet=True))) == []
