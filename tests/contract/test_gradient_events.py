# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of motions with events, whose times depend on all numbers."""

from functools import partial

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from tests.contract.gradient_examples import NUMBERS, body
from tests.contract.test_gradient_steps import compare

VALUES = {"mass": 0.7, "gravity": 9.81, "stiffness": 30.0, "depth": 0.006, "spin": 1.3, "pull": 3.0}
COLUMNS = ["final:tip_x", "final:tip_z", "final:falling", "final:turning", "mean:tip_z"]
#: Time of an event is found to rounding, which differences of motions need.
EXACT = {"tolerance": 1e-14}


def arms(kind, *, mass, gravity, stiffness, depth, spin, pull):
    """Two hinged arms that fall, on a spring and under a force, until something happens."""
    model, b = ff.Model("arms"), ff.Marker("b")
    elbow = ff.Marker("a", offset=(0.5, 0.0, 0.0)), ff.Marker("b", offset=(-0.5, 0.0, 0.0))
    model.add(
        ff.Gravity((0.0, 0.3, -gravity)),
        ff.RigidBody(
            "a", 1.0, (0.02, 0.03, 0.04), position=(0.5, 0.0, 0.0),
            velocity=(0.0, 0.0, -0.5 * spin), angular_velocity=(0.0, spin, 0.0),
        ),
        ff.RigidBody(
            "b", mass, (0.01, 0.02, 0.03), position=(1.5, 0.0, 0.0),
            velocity=(0.0, 0.0, -0.5 * spin), angular_velocity=(0.0, -spin, 0.0),
        ),
        ff.Revolute(
            "root", ff.Ground(), ff.Marker("a", offset=(-0.5, 0.0, 0.0)), axis=(0.0, 1.0, 0.0)
        ),
        ff.Revolute("elbow", *elbow, axis=(0.0, 1.0, 0.0)),
        ff.SpringDamper(
            "spring", ff.Ground((1.5, 0.2, 0.9)), ff.Marker("b", offset=(0.1, 0.05, 0.0)),
            stiffness=stiffness, damping=0.4, rest_length=0.5,
        ),
        ff.PointForce(
            "push", ff.Marker("b", offset=(0.2, 0.0, 0.0)), (pull, 0.2, 1.0),
            amplitude=lambda t: np.sin(30.0 * t),
        ),
        ff.PositionProbe("tip", ff.Marker("b", offset=(0.5, 0.1, 0.0))),
        ff.Probe(
            "motion", b, ("falling", "turning"),
            lambda t, s: (s.velocity[2], s.angular_velocity[1]),
        ),
    )  # fmt: skip
    low = ff.Marker("b", offset=(0.1, 0.0, 0.002 * mass))
    angle = ff.PrescribedAngle("lock", *elbow, axis=(0.0, 1.0, 0.0), angle=lambda t: 0.0)
    if kind == "time":
        release = ff.ReleaseJoint("elbow")
        model.add(ff.Event("late", b, lambda t, s: t - 3.0 * depth, release, **EXACT))
    elif kind == "bounce":
        model.add(
            ff.PointOnPlane("floor", ff.Ground((0.0, 0.0, -depth)), low, axis=(0.0, 0.0, 1.0)),
            ff.Event(
                "touch", low, lambda t, s: s.position[2] + depth, ff.Rebound("floor", 0.3 * mass),
                direction=-1, once=False, **EXACT,
            ),
        )  # fmt: skip
        model.release("floor")
    elif kind == "lock":  # locked, released within the same step, and opened later
        for name, action, delay, rate in (
            ("first", ff.LockJoint("lock"), 0.0, 0.0),
            ("second", ff.ReleaseJoint("lock"), 0.002, 0.0),
            ("third", ff.ReleaseJoint("elbow"), 0.004, 1e-3),
        ):
            model.add(
                ff.Event(
                    name, b,
                    lambda t, s, delay=delay, rate=rate: s.position[2] + depth + delay
                    - rate * s.velocity[2],
                    action, **EXACT,
                )
            )  # fmt: skip
        model.add(angle)
        model.release("lock")
    return model


@pytest.mark.serial
@pytest.mark.parametrize("kind", ["time", "lock", "bounce"])
def test_events(kind):
    """Each time depends on all numbers: with times as given, derivatives are off by a tenth."""
    options = ff.RunOptions(dt=4e-3, t_end=0.028, tolerance=1e-13)
    found = compare(partial(arms, kind), VALUES, COLUMNS, options, 2e-7)
    assert len(found.history["t"]) == 8


def controlled(kind, **numbers):
    """The same with friction by the force in a hinge, and controllers."""
    model, b = arms(kind, **numbers), ff.Marker("b")
    (root,) = (joint for joint in model.joints if joint.name == "root")
    law = ff.StateSpace([[0.9]], [[1.0, 0.3]], [[2.0]], [[-9.0, -1.0]], initial=[0.1])
    model.add(
        ff.JointFriction("friction", root, coefficient=0.3, radius=0.1, velocity=0.5),
        ff.PointForce("lift", b, (0.0, 0.0, 1.0)),
        ff.Controller("sampled", ["tip_z", "falling"], ["lift"], law, sample_time=8e-3),
        ff.Actuator(
            "motor", ff.Ground(), ff.Marker("a", offset=(-0.5, 0.0, 0.0)), axis=(0.0, 1.0, 0.0)
        ),
        ff.Controller(
            "follower", ["tip_z"], ["motor"], lambda t, y: -4.0 * np.sin(y[0]) * (1.0 + 20.0 * t)
        ),
    )  # fmt: skip
    return model


@pytest.mark.slow
@pytest.mark.serial
def test_events_with_friction_and_controllers():
    """Without the friction by the forces behind an event derivatives are off by 1e-3."""
    options = ff.RunOptions(dt=4e-3, t_end=0.02, tolerance=1e-13)
    compare(partial(controlled, "lock"), VALUES, COLUMNS, options, 2e-7)


def loaded(kind, **numbers):
    """The same under forces with kinks and jumps in steps with events, and at the start."""
    model, a, b = arms(kind, **numbers), ff.Marker("a"), ff.Marker("b")
    kinks = ff.Table([0.0, 0.0033, 0.0247, 1.0], [0.0, 1.0, 0.2, 0.2])
    model.add(ff.PointForce("ramp", b, (1.0, 2.0, 6.0), amplitude=kinks))
    for name, time, sign in (("on", 0.0, 1.0), ("off", 0.0131, -1.0)):
        step = ff.TimeFunction(lambda t, time=time, sign=sign: float(sign * (t - time) > 0), [time])
        model.add(ff.PointForce(name, a, (1.0, 2.0, -6.0 * sign), amplitude=step))
    return model


@pytest.mark.serial
@pytest.mark.parametrize("adaptive", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_events_between_kinks(adaptive):
    """The lead of accelerations behind parts of a step is inverse to a size that an event gives."""
    options = ff.RunOptions(
        dt=4e-3, t_end=0.028, tolerance=1e-13, adaptive=adaptive, error_tolerance=1e-6
    )
    compare(partial(loaded, "lock"), VALUES, COLUMNS, options, 5e-7, step=3e-4)


def latched(kind="se3", **numbers):
    """A rod that falls until its hinge locks, which rubs."""
    model, root = body(kind, **numbers), ff.Marker("rod", "start")
    (hinge,) = (joint for joint in model.joints if joint.name == "hinge")
    model.add(
        ff.JointFriction("friction", hinge, coefficient=0.1, radius=0.02, velocity=0.05),
        ff.PrescribedAngle("latch", ff.Ground(), root, axis=(0.0, 1.0, 0.0), angle=lambda t: 0.0),
        ff.Event(
            "low", ff.Marker("rod", "end"), lambda t, s: s.velocity[2] ** 2 - 1e-4,
            ff.LockJoint("latch"), **EXACT,
        ),
    )  # fmt: skip
    model.release("latch")
    return model


@pytest.mark.slow
@pytest.mark.serial
def test_flexible_bodies():
    options = ff.RunOptions(dt=1e-3, t_end=0.012, tolerance=1e-13)
    compare(latched, NUMBERS, ["final:tip_z", "mean:speed"], options, 5e-8, step=3e-4)


@pytest.mark.serial
def test_states_around_events_are_kept():
    options = ff.RunOptions(dt=1e-3, t_end=0.012, tolerance=1e-13)
    whole, parts = (
        ff.gradient(latched, "mean:tip_z", NUMBERS, options, accuracy=1e-12, memory=most)
        for most in (2e9, 2.4e4)
    )
    for name, value in whole.gradient["mean:tip_z"].items():
        assert parts.gradient["mean:tip_z"][name] == pytest.approx(value, rel=1e-8)


def stopped(**numbers):
    """The arms until they are low, and columns that depend on time by themselves."""
    model, b = arms("none", **numbers), ff.Marker("b")
    model.add(
        ff.Event(
            "low", b, lambda t, s: s.position[2] + numbers["depth"] + 1e-3 * np.sin(200.0 * t),
            ff.Stop(), **EXACT,
        ),
        ff.Probe("late", b, ("late", "press"), lambda t, s: (t * s.position[0], s.acceleration[2])),
    )  # fmt: skip
    return model


@pytest.mark.serial
@pytest.mark.parametrize("adaptive", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_motions_that_an_event_ends(adaptive):
    """With the time of the last row as given, all are off by a hundredth at least."""
    of = [f"{kind}:tip_z" for kind in ("final", "integral", "mean", "rms", "max")]
    of += ["final:t", "integral:late", "final:late", "final:press"]
    options = ff.RunOptions(
        dt=4e-3, t_end=0.05, tolerance=1e-13, adaptive=adaptive, error_tolerance=1e-5
    )
    found = compare(stopped, VALUES, of, options, 2e-8, step=3e-4)
    assert found.history["t"][-1] == found.value["final:t"] < 0.012
    assert len(np.unique(found.history["t"])) == len(found.history["t"])


def arrived(action, **numbers):
    """A rod with a bead on it, until that is somewhere along the rod."""
    model, bead = body("slider", **numbers), ff.SlidingMarker("slide")
    model.add(
        ff.Event(
            "passed", bead, lambda t, s: s.arc - 0.1215 - 1e-3 * numbers["mass"], action, **EXACT
        )
    )
    return model


@pytest.mark.serial
@pytest.mark.parametrize("action", [ff.Stop(), ff.ReleaseJoint("spring")], ids=["stop", "release"])
def test_events_of_sliders(action):
    """Without their places in the function's derivatives, all are off by a tenth and more."""
    options = ff.RunOptions(dt=1e-3, t_end=6e-3, tolerance=1e-13)
    of = ["final:tip_z", "mean:speed"]
    compare(partial(arrived, action), NUMBERS, of, options, 1e-7, step=3e-4)


@pytest.mark.several_ranks
@pytest.mark.three_ranks
def test_ranks_agree_on_the_end():
    options = ff.RunOptions(dt=4e-3, t_end=0.05, tolerance=1e-13, split_above=1)
    of = ["final:t", "integral:late"]
    alone, together = (
        ff.gradient(stopped, of, VALUES, options, accuracy=1e-13, comm=comm, check=True)
        for comm in (MPI.COMM_SELF, MPI.COMM_WORLD)
    )
    assert max(together.check.values()) < 1e-12
    for name in of:
        for number, value in alone.gradient[name].items():
            # a rate that is counted on each rank doubles a part
            assert together.gradient[name][number] == pytest.approx(value, rel=1e-9)


@pytest.mark.several_ranks
@pytest.mark.three_ranks
def test_ranks_agree_on_events():
    """The lock of a rod on several ranks, whose time is that of a marker on one of them."""
    options = ff.RunOptions(dt=1e-3, t_end=8e-3, tolerance=1e-13, split_above=1)
    alone, together = (
        ff.gradient(
            partial(latched, "damped"),
            "final:tip_z",
            NUMBERS,
            options,
            accuracy=1e-13,
            comm=comm,
            check=True,
        )
        for comm in (MPI.COMM_SELF, MPI.COMM_WORLD)
    )
    assert together.check["final:tip_z"] < 1e-12
    for name, value in alone.gradient["final:tip_z"].items():
        # a share that is missing, or counted twice, is a tenth and more
        assert together.gradient["final:tip_z"][name] == pytest.approx(value, rel=1e-9)
