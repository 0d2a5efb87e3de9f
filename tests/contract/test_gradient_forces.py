# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of forces of joints, drives and springs, against differences of whole motions."""

from functools import partial

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.gradients.motion.functionals import parse
from tests.contract.gradient_examples import NUMBERS, body, jointed
from tests.contract.test_gradient_events import VALUES, arms
from tests.contract.test_gradient_steps import compare as compare_steps
from tests.contract.test_gradient_steps import switched
from tests.contract.test_gradients import compare
from tests.histories import columns

MOTOR = {"mass": 1.2, "swing": 0.7, "length": 0.4, "damping": 0.4}
THROWN = {"mass": 1.3, "gravity": 9.81, "kick": 0.4}


def motor(*, mass, swing, length, damping):
    """An arm that a drive turns about two axes, and another one that hangs on it."""
    root, elbow = (ff.Marker("arm", offset=(s * length, 0.0, 0.0)) for s in (-1.0, 1.0))
    model, fore = ff.Model("motor"), ff.Marker("fore", offset=(-0.2, 0.0, 0.0))
    model.add(
        ff.Gravity((0.5, 0.2, -9.81)),
        ff.RigidBody("arm", mass, (0.01, 0.02, 0.03), position=(length, 0.0, 0.0)),
        ff.RigidBody("fore", 0.5, (0.004, 0.005, 0.006), position=(2 * length + 0.2, 0.0, 0.0)),
        ff.Spherical("base", ff.Ground(), root),
        ff.PrescribedRotation(
            "drive", ff.Ground(), root,
            rotation=lambda t: (0.1 * swing * t, swing * (1.0 - np.cos(9.0 * t)), 0.0),
        ),
        ff.Revolute("elbow", elbow, fore, axis=(0.0, 1.0, 0.0)),
        ff.SpringDamper(
            "spring", ff.Ground((0.0, 0.0, 1.0)), ff.Marker("fore", offset=(0.1, 0.0, 0.0)),
            stiffness=20.0, damping=damping, rest_length=0.8,
        ),
        ff.ReactionProbe("torque", "drive"),
        ff.ReactionProbe("bearing", "elbow", axes="b"),
        ff.ReactionProbe("pull", "spring"),
    )  # fmt: skip
    return model


def loaded(build, *names, **numbers):
    """A model whose joints of some names have probes."""
    model = build(**numbers)
    model.add(*(ff.ReactionProbe(f"of_{name}", name) for name in names))
    return model


@pytest.mark.serial
def test_motors_bearings_and_springs():
    """Rates of drives are differences over parts of a step, whose rounding leaves 1e-7."""
    of = ["max:torque_my", "rms:torque_my", "final:bearing_fx", "mean:bearing_mz", "final:pull_fz"]
    options = ff.RunOptions(dt=2e-3, t_end=0.01, tolerance=1e-13)
    compare(motor, MOTOR, of, options, 1e-6)


HOIST = {"stiffness": 300.0, "mass": 1.2, "gain": 400.0, "damping": 3.0}


def hoist(*, stiffness, mass, gain, damping):
    """A load on a cable over a pulley, which a sampled controller moves along a rail."""
    model, pulley, bob = ff.Model("hoist"), ff.Marker("pulley"), ff.Marker("bob")
    rail = {"axis": (1.0, 0.0, 0.0)}
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody("pulley", 0.5, (0.01, 0.02, 0.015), position=(0.5, 0.0, 0.0)),
        ff.RigidBody(
            "bob", mass, (0.1, 0.2, 0.15), position=(0.6, 0.2, -1.0), velocity=(0.3, 0.1, 0.0)
        ),
        ff.Prismatic("rail", ff.Ground(), pulley, **rail),
        ff.Actuator("motor", ff.Ground(), pulley, motion="translation", **rail),
        ff.Cable(
            "rope",
            [
                ff.Marker("bob", offset=(0.05, 0.0, 0.1)),
                ff.Eyelet(ff.Marker("pulley", offset=(0.02, 0.01, 0.0))),
                ff.Ground((-0.3, 0.1, 0.2)),
            ],
            stiffness=stiffness, damping=damping, preload=9.0, tension_only=False,
        ),
        ff.Probe("ahead", bob, ("ahead", "speed"), lambda t, s: (s.position[0], s.velocity[0])),
        ff.Controller(
            "servo", ["ahead", "speed"], ["motor"],
            lambda t, y: gain * (y[0] - 0.5) + 0.1 * gain * y[1], sample_time=4e-3,
        ),
        ff.CableProbe("pull", "rope"),
        ff.ReactionProbe("of_rail", "rail"),
        ff.ReactionProbe("of_motor", "motor"),
    )  # fmt: skip
    return model


OF_HOIST = ["final:pull_tension", "mean:pull_stretch", "mean:of_rail_fz", "mean:of_motor_fx"]


@pytest.mark.serial
def test_cables_and_controllers():
    """A sampled force is that of the step, not of the sample at its end: 1e-1 and more without."""
    options = ff.RunOptions(dt=2e-3, t_end=0.014, tolerance=1e-13)
    compare(hoist, HOIST, OF_HOIST, options, 1e-7)


def linkage(*, mass, swing, gravity):
    """A crank, a coupler and a rocker on four parallel hinges, two of whose constraints agree."""
    model, across = ff.Model("linkage"), {"axis": (0.0, 1.0, 0.0)}
    model.add(ff.Gravity((0.0, 0.3, -gravity)))
    ends = {}
    for name, place, half in (
        ("crank", (0.0, 0.0, 0.5), (0.0, 0.0, 0.5)), ("coupler", (0.5, 0.0, 1.0), (0.5, 0.0, 0.0)),
        ("rocker", (1.0, 0.0, 0.5), (0.0, 0.0, 0.5)),
    ):  # fmt: skip
        model.add(ff.RigidBody(name, mass, (0.1, 0.12, 0.14), position=place))
        ends[name] = [ff.Marker(name, offset=s * np.array(half)) for s in (-1.0, 1.0)]
    foot, top = ends["crank"]
    model.add(
        ff.Revolute("first", ff.Ground(), foot, **across),
        ff.Revolute("second", top, ends["coupler"][0], **across),
        ff.Revolute("third", ends["coupler"][1], ends["rocker"][1], **across),
        ff.Revolute("fourth", ff.Ground((1.0, 0.0, 0.0)), ends["rocker"][0], **across),
        ff.PrescribedAngle(
            "motor", ff.Ground(), foot, **across, angle=lambda t: swing * (1.0 - np.cos(9.0 * t))
        ),
        *(ff.ReactionProbe(f"of_{name}", name) for name in ("motor", "second", "fourth")),
    )
    return model


@pytest.mark.serial
def test_redundant_constraints():
    """Forces across the plane are those of least norm: multipliers of the step alone 1e-4."""
    options = ff.RunOptions(
        dt=2e-3, t_end=0.01, tolerance=1e-13, redundant_constraints="least_norm"
    )
    of = ["final:of_motor_my", "mean:of_fourth_fx", "final:of_fourth_mx", "final:of_second_fy"]
    compare(linkage, {"mass": 2.0, "swing": 0.7, "gravity": 9.81}, of, options, 1e-6)


#: Some of the numbers of bodies, and the others.
SOME = {name: NUMBERS[name] for name in ("youngs", "mass")}
OTHERS = {name: value for name, value in NUMBERS.items() if name not in SOME}


@pytest.mark.slow
@pytest.mark.serial
def test_flexible_bodies_and_sliders():
    """The bead passes from an element to the next one: across it differences would be of a kink."""
    build = partial(loaded, partial(body, "slider"), "hinge", "slide", **OTHERS)
    of = ["mean:of_slide_fz", "final:of_hinge_fz", "mean:of_hinge_fx"]
    compare(build, SOME, of, ff.RunOptions(dt=1e-3, t_end=5e-3, tolerance=1e-13), 1e-7)


def slid(pull=2.0, **numbers):
    """A bead that is pulled along a rod, and the section at which it is."""
    model, section = body("slider", **numbers), ff.SlidingMarker("slide")
    model.add(
        ff.PointForce("along", ff.Marker("bead"), (pull, 0.0, 0.2 * pull)),
        ff.PositionProbe("at", section),
        ff.Probe(
            "slider", section, ("arc", "rate", "turning"),
            lambda t, s: (s.arc, s.arc_rate, s.angular_velocity[1] + s.rotation[0, 2]),
        ),
    )  # fmt: skip
    return model


@pytest.mark.serial
def test_markers_that_slide():
    """With places of another row of the history, beyond an element's end, they are off by 1e-4."""
    options = ff.RunOptions(dt=1e-3, t_end=5e-3, tolerance=1e-13)
    of = ["mean:at_z", "final:arc", "mean:rate", "mean:turning"]
    compare(partial(slid, **OTHERS), {"pull": 2.0, **SOME}, of, options, 1e-6)


@pytest.mark.serial
def test_forces_behind_jumps():
    """Forces of a state that is made consistent are those of its own equations."""
    build = partial(loaded, partial(switched, "se3", 2e-3), "pin", **OTHERS)
    options = ff.RunOptions(dt=1e-3, t_end=3e-3, tolerance=1e-13)
    compare_steps(build, SOME, ["mean:of_pin_fz"], options, 2e-7)


@pytest.mark.slow
@pytest.mark.serial
@pytest.mark.parametrize("kind", ["time", "lock", "bounce"])
def test_forces_behind_events(kind):
    """The step behind an event, to the next row, has a size that all numbers change."""
    build = partial(loaded, partial(arms, kind), "root", "spring")
    options = ff.RunOptions(dt=4e-3, t_end=0.028, tolerance=1e-13)
    compare(build, VALUES, ["final:of_root_fz", "mean:of_root_fx"], options, 2e-7)


def propped(*, youngs, push, stiffness, more=()):
    """A rod on a hinge with a spring, and on a strut."""
    model = ff.Model("propped", mesh=ff.LineMesh.straight({"rod": [(0, 0, 0), (0.5, 0, 0)]}, 4))
    root, end = ff.Marker("rod", "start"), ff.Marker("rod", "end")
    model.add(
        ff.Beam("rod", ff.Section.rectangle(0.03, 0.02, ff.Material(youngs, 0.3, 1100.0))),
        ff.Revolute("hinge", ff.Ground(), root, axis=(0.0, 1.0, 0.0)),
        ff.TorsionalSpringDamper(
            "twist", ff.Ground(), root, axis=(0.0, 1.0, 0.0), stiffness=stiffness
        ),
        ff.Distance("strut", ff.Ground((0.3, 0.0, 0.4)), end),
        ff.PointForce("push", end, (1.0, 0.2, -push)),
        ff.ReactionProbe("bearing", "hinge"),
        ff.ReactionProbe("twisting", "twist"),
        ff.ReactionProbe("propping", "strut", axes="b"),
        *more,
    )
    return model


@pytest.mark.serial
def test_equilibria():
    numbers = {"youngs": 5e6, "push": 2.0, "stiffness": 0.5}
    of = ["final:bearing_fx", "final:bearing_mz", "final:twisting_my", "final:propping_fx"]
    options = ff.StaticOptions(load_steps=2, tolerance=1e-12)
    found = ff.gradient(propped, of, numbers, options).gradient
    for name, value in numbers.items():
        expected = np.zeros(len(of))
        for part, weight in ((-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12)):
            moved = {**numbers, name: value * (1.0 + 1e-3 * part)}
            history = columns(ff.solve_static(propped(**moved), options))
            expected += weight / 1e-3 * np.array([parse(one).value(history) for one in of])
        own = np.array([found[one][name] * value for one in of])
        # without the turning of the forces with the nodes 1e-2 and more
        np.testing.assert_allclose(own, expected, rtol=1e-7, atol=1e-9)


@pytest.mark.several_ranks
@pytest.mark.three_ranks
@pytest.mark.parametrize(
    ("build", "numbers", "joint"),
    [
        (partial(jointed, "Pulley"), THROWN, "joint"), (slid, NUMBERS, "slide"),
        pytest.param(hoist, HOIST, None, marks=pytest.mark.slow_on_ranks),
    ],
)  # fmt: skip
def test_ranks_agree_on_forces(build, numbers, joint):
    """Joints of three bodies on three ranks, of a bead and a rod, a cable and a controller."""
    options = ff.RunOptions(dt=1e-3, t_end=4e-3, tolerance=1e-13, split_above=1)
    of = OF_HOIST
    if joint is not None:
        of, build = [f"mean:of_{joint}_fz"], partial(loaded, build, joint)
        of += ["mean:turning"] if joint == "slide" else [f"final:of_{joint}_fx"]
    alone, together = (
        ff.gradient(build, of, numbers, options, accuracy=1e-13, comm=comm)
        for comm in (MPI.COMM_SELF, MPI.COMM_WORLD)
    )
    for one in of:
        for name, value in alone.gradient[one].items():
            # a share that is missing, or counted twice, is a tenth and more
            assert together.gradient[one][name] == pytest.approx(value, rel=1e-9)
