# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of motions with contacts and stops: against the tangent and differences of motions."""

from functools import partial

import numpy as np
import pytest

import flexfem as ff
from tests.contract.test_gradient_memories import bar
from tests.contract.test_gradients import agree_on_ranks, errors

GROUND = ff.RigidPlane(ff.Ground())


def compare(build, numbers, of, options, step, sizes=0, bound=1e-6):
    """Adjoint, tangent and differences of motions that end with Newton steps of 1e-13."""
    found = ff.gradient(build, of, numbers, options, accuracy=1e-9, check=True)
    # a force that is not transposed gives 1e-3 and more; what sticks is stiff and leaves 1e-9
    assert max(found.check.values()) < 1e-7
    # steps to and from an event have sizes whose factors are not kept
    assert found.factorizations_backward <= sizes
    # the change of friction or of a barrier at the start of a step, or of the masses or a hinge
    # with an impulse, gives 1e-4 and more where it is left out
    assert errors(found.gradient, build, numbers, of, options, step).max() < bound


def balls(height, friction, speed=1.0) -> ff.Model:
    """A ball that bounces on the ground and hits another one, which spins."""
    model = ff.Model("balls")
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody(
            "first", 0.5, (1e-4, 2e-4, 1.5e-4), position=(0.0, 0.0, 0.05 + height),
            velocity=(0.3, 0.1, -speed), shape=ff.Sphere(0.05),
        ),
        ff.RigidBody(
            "second", 0.7, (2e-4, 1e-4, 1.5e-4), position=(0.106, 0.02, 0.06),
            velocity=(-0.3, 0.0, 0.1), angular_velocity=(1.0, 20.0, 3.0), shape=ff.Sphere(0.05),
        ),
        ff.Contact(
            "all", surfaces=GROUND, reach=0.005, friction=friction, damping=0.1,
        ),
        ff.PositionProbe("p", ff.Marker("first")),
        ff.PositionProbe("q", ff.Marker("second")),
    )  # fmt: skip
    return model


def rod(speed, youngs, damping, height=0.003) -> ff.Model:
    """A damped rod with a weight on a hinge at its end, which falls on the ground."""
    x = np.linspace(0.0, 0.4, 4)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    x += np.array([0.0, 0.0, 0.005 + height])
    cells = np.array([[i, i + 1] for i in range(3)])
    model = ff.Model("rod", mesh=ff.LineMesh(x, cells, {"rod": np.arange(3)}))
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Beam(
            "rod", ff.Section.circle(0.01, ff.Material(youngs, 0.3, 1100.0)),
            velocity=(0.2, 0.0, -speed), damping=damping,
        ),
        ff.RigidBody(
            "bob", 0.1, (1e-4, 1e-4, 1e-4), position=(0.43, 0.0, 0.045 + height),
            velocity=(0.2, 0.0, -speed),
        ),
        ff.Revolute(
            "hinge", ff.Marker("rod", "end"), ff.Marker("bob", offset=(-0.03, 0.0, -0.04)),
            axis=(0.0, 1.0, 0.0),
        ),
        ff.Contact("landing", "rod", surfaces=GROUND, reach=0.002, law="barrier"),
        ff.PositionProbe("p", ff.Marker("rod", "start")),
        ff.PositionProbe("q", ff.Marker("bob")),
    )  # fmt: skip
    return model


def damped(ratio, **numbers) -> ff.Model:
    """The same with dampers of modes besides."""
    model = rod(**numbers)
    model.add(ff.ModalDamping("dampers", ratio, modes=2))
    return model


def caught(push, time, stiffness) -> ff.Model:
    """A viscoelastic bar that is pushed on a stop."""
    model = bar("viscoelastic", push=push, time=time)
    tip = ff.Marker("bar", (0.5, 0.03, 0.02))
    model.add(
        ff.LimitStop(
            "stop", ff.Ground(), tip, axis=(0.0, 0.0, 1.0), lower=0.0175, stiffness=stiffness,
            damping=1.0,
        )
    )  # fmt: skip
    return model


def sliding(pull, **numbers) -> ff.Model:
    """A weight that hits a stop, with a pin to a bead on a wire that feels the impulse as well."""
    model, ends = stopped("stop", **numbers), [(0.4, 0.0, -0.05), (0.8, 0.0, -0.05)]
    wire = ff.NurbsCurve.line(*ends, degree=3, elements=4)
    model.add(
        ff.Beam("wire", ff.Section.circle(0.012, ff.Material(2e9, 0.3, 1100.0)), curve=wire),
        ff.Rigid("left", ff.Ground(ends[0]), ff.Marker("wire", "start")),
        ff.Rigid("right", ff.Ground(ends[1]), ff.Marker("wire", "end")),
        ff.RigidBody("bead", 0.1, (1e-5,) * 3, position=(0.55, 0.0, -0.05)),
        ff.Sliding("slide", ff.Carrier("wire"), ff.Marker("bead")),
        ff.PointForce("pull", ff.Marker("bead"), (pull, 0.0, 0.0)),
        ff.Spherical(
            "pin", ff.Marker("bead", offset=(-0.11, 0.0, 0.053)),
            ff.Marker("bob", offset=(0.01, 0.0, 0.0)),
        ),
    )  # fmt: skip
    return model


def sheet(law, speed, radius, thickness=0.002, slide=(0.1, 0.0), friction=0.0) -> ff.Model:
    """A sheet that falls on a cylinder, and on a ball that moves."""
    surface = ff.SurfaceMesh.rectangle("sheet", (0.2, 0.1), (3, 2))
    lying = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]
    roller = ff.RigidCylinder(ff.Ground((0.11, 0.05, -0.053), lying), radius=radius)
    rubber = ff.ShellSection.isotropic(thickness, ff.Material(5e6, 0.3, 1100.0))
    ball = ff.RigidSphere(ff.Marker("ball"), 0.03)
    model = ff.Model("sheet", surface=surface)
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Shell("sheet", rubber, velocity=(*slide, -speed)),
        ff.RigidBody(
            "ball", 0.1, (1e-4, 1e-4, 1e-4), position=(0.06, 0.055, -0.033),
            velocity=(0.1, 0.0, 0.1), angular_velocity=(1.0, 2.0, 3.0),
        ),
        ff.Contact("landing", "sheet", surfaces=[roller, ball], law=law, friction=friction),
        ff.PositionProbe("p", ff.Marker("sheet", "sheet_bottom_left")),
        ff.PositionProbe("q", ff.Marker("ball")),
    )  # fmt: skip
    return model


def rubbed(speed, thickness, friction, damping, stiffness, mass) -> ff.Model:
    """A clamped sheet on which a box slides and turns, and which it presses on a roller."""
    surface = ff.SurfaceMesh.rectangle("sheet", (0.2, 0.1), (3, 2))
    rubber = ff.ShellSection.isotropic(thickness, ff.Material(5e6, 0.3, 1100.0))
    lying = [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]
    roller = ff.RigidCylinder(ff.Ground((0.13, 0.05, -0.0505), lying), radius=0.05)
    model = ff.Model("rubbed", surface=surface)
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Shell("sheet", rubber, edges={"sheet_left": "clamped"}),
        ff.RigidBody(
            "box", mass, (1e-4, 2e-4, 1.5e-4), position=(0.117, 0.053, 0.0118),
            velocity=(0.4, 0.1, -speed), angular_velocity=(0.5, 1.0, 2.0),
            shape=ff.Box((0.06, 0.05, 0.02)),
        ),
        ff.Contact(
            "landing", "sheet", against="box", surfaces=roller, law="penalty", friction=friction,
            damping=damping, stiffness=stiffness,
        ),
        ff.PositionProbe("p", ff.Marker("sheet", "sheet_bottom_right")),
        ff.PositionProbe("q", ff.Marker("box", offset=(0.02, 0.01, 0.0))),
    )  # fmt: skip
    return model


def stopped(how, speed, stiffness=5e4, damping=5.0, loss=0.0) -> ff.Model:
    """A rod on a hinge with a weight that hits a stop, is caught by a cable, or meets a curve."""
    x = np.linspace(0.0, 0.4, 3)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    mesh = ff.LineMesh(x, np.array([[0, 1], [1, 2]]), {"rod": np.arange(2)})
    model, bob = ff.Model("stopped", mesh=mesh), ff.Marker("bob")
    rubber = ff.Material(1e9, 0.3, 1100.0)
    stops = {
        "stop": ff.LimitStop(
            "stop", ff.Ground((0.4, 0.0, 0.0)), bob, axis=(0.0, 0.0, 1.0), lower=-0.002,
            stiffness=stiffness, damping=damping,
        ),
        "angle": ff.LimitStop(
            "stop", ff.Ground(), ff.Marker("rod", "start"), motion="rotation",
            axis=(0.0, 1.0, 0.0), upper=0.01, stiffness=0.01 * stiffness, damping=damping,
        ),
        "curve": ff.LimitStop(
            "stop", ff.Ground((0.4, 0.0, 0.1)), bob, motion="distance", upper=0.103,
            force=lambda way, rate: 5e4 * way * (1.0 + 20.0 * way) + 5.0 * rate,
        ),
    }  # fmt: skip
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Beam("rod", ff.Section.circle(0.01, rubber), damping=loss),
        ff.RigidBody(
            "bob", 0.2, (1e-4, 2e-4, 3e-4), position=(0.43, 0.0, 0.003),
            velocity=(0.1, 0.0, -speed),
        ),
        ff.Revolute("hinge", ff.Ground(), ff.Marker("rod", "start"), axis=(0.0, 1.0, 0.0)),
        ff.Spherical(
            "ball", ff.Marker("rod", "end"), ff.Marker("bob", offset=(-0.03, 0.0, -0.003))
        ),
        ff.SpringDamper(
            "spring", ff.Marker("rod", "end"), ff.Marker("bob", offset=(0.1, 0.1, 0.0)),
            stiffness=300.0, damping=0.2, rest_length=0.1,
        ),
        stops[how],
        ff.PositionProbe("p", bob),
        ff.PositionProbe("q", ff.Marker("rod", "end")),
    )  # fmt: skip
    return model


def equipped(speed, stiffness, damping, loss, gain) -> ff.Model:
    """The same with damping, controllers, a joint twice, and an event after the impact."""
    model, bob = stopped("stop", speed, stiffness, damping, loss), ff.Marker("bob")
    root, turn = ff.Marker("rod", "start"), {"axis": (0.0, 1.0, 0.0)}
    law = ff.StateSpace([[0.9]], [[1.0, 0.3]], [[gain]], [[-9.0, -1.0]], initial=[0.1])
    model.add(
        ff.Revolute("again", ff.Ground(), root, **turn),
        ff.Probe("seen", bob, ("z", "rate"), lambda t, s: (s.position[2], s.velocity[2])),
        ff.PointForce("lift", bob, (0.0, 0.0, 1.0)),
        ff.Controller("sampled", ["z", "rate"], ["lift"], law, sample_time=1e-3),
        ff.Actuator("motor", ff.Ground(), root, **turn),
        ff.Controller("follower", ["z"], ["motor"], lambda t, y: -0.1 * gain * np.sin(10.0 * y[0])),
        ff.Event(
            "late", bob, lambda t, s: s.position[2] - 0.0005, ff.ReleaseJoint("spring"),
            direction=1, tolerance=1e-14,
        ),
    )  # fmt: skip
    return model


BALLS = {"height": 0.006, "friction": 0.3}
ROD = {"speed": 1.0, "youngs": 1e7, "damping": 1e-3}
STOP = {"speed": 1.0, "stiffness": 5e4, "damping": 5.0}
EQUIPPED = {**STOP, "loss": 1e-4, "gain": 2.0}
SHEET = {"speed": 1.0, "radius": 0.05}
RUBBED = {
    "speed": 1.0, "thickness": 0.002, "friction": 0.3, "damping": 2e-3, "stiffness": 2e7,
    "mass": 0.1,
}  # fmt: skip
SLIDING = {"speed": 1.0, "friction": 0.3}


@pytest.mark.slow
@pytest.mark.serial
def test_balls_that_rub_and_lose_energy():
    """They slip, then stick."""
    options = ff.RunOptions(dt=5e-4, t_end=0.009, tolerance=1e-13)
    of = ["final:p_x", "final:p_z", "final:q_y", "mean:q_z"]
    compare(balls, BALLS, of, options, step=1e-4)


@pytest.mark.slow
@pytest.mark.serial
def test_impulses_in_joints():
    options = ff.RunOptions(dt=2e-4, t_end=5e-3, tolerance=1e-13)
    numbers = {**ROD, "ratio": 0.02}
    compare(damped, numbers, ["final:p_z", "final:q_x", "mean:q_z"], options, step=1e-4)


@pytest.mark.slow
@pytest.mark.serial
def test_impulses_with_internal_variables():
    options = ff.RunOptions(dt=1e-3, t_end=0.01, tolerance=1e-13)
    numbers = {"push": 3.0, "time": 0.01, "stiffness": 5e3}
    compare(caught, numbers, ["final:tip_z", "mean:tip_z"], options, step=1e-4)


@pytest.mark.slow
@pytest.mark.serial
def test_impulses_with_sliders():
    options = ff.RunOptions(dt=5e-4, t_end=0.01, tolerance=1e-13)
    compare(sliding, {**STOP, "pull": 20.0}, ["final:p_z", "final:q_x"], options, step=1e-4)


@pytest.mark.slow
@pytest.mark.serial
def test_impulses_of_steps_that_are_taken_again():
    """What accelerations of damped bodies lack behind an impulse is found at accepted states."""
    options = ff.RunOptions(dt=2e-4, t_end=2.4e-3, tolerance=1e-13)
    whole, few = (
        ff.gradient(rod, "mean:q_z", ROD, options, memory=memory) for memory in (2e9, 2e4)
    )
    assert few.steps_repeated > 12
    for name, value in whole.gradient["mean:q_z"].items():
        # found at the end of a step before it is accepted, states are off by 1e-2 of velocities
        assert few.gradient["mean:q_z"][name] == pytest.approx(value, rel=1e-6)


@pytest.mark.serial
@pytest.mark.parametrize("law", [pytest.param("barrier", marks=pytest.mark.slow), "penalty"])
def test_shells_on_obstacles(law):
    # the ball moves little along x, and what is left of a Newton iteration in the barrier, where
    # errors grow a hundredfold, stays in its speed: with a tolerance of 1e-13 differences are off
    # by 0.8e-6, however small their steps
    options = ff.RunOptions(dt=2e-4, t_end=5e-3, tolerance=1e-14)
    compare(partial(sheet, law), SHEET, ["final:q_x", "final:q_z"], options, step=5e-5)


@pytest.mark.slow
@pytest.mark.serial
def test_penalties_that_rub_and_lose_energy():
    """They slip and stick; without what they remember derivatives are off by a tenth."""
    options = ff.RunOptions(dt=5e-4, t_end=6e-3, tolerance=1e-13)
    of = ["final:p_x", "final:q_x", "mean:q_z"]
    compare(rubbed, RUBBED, of, options, step=1e-4)


@pytest.mark.slow
@pytest.mark.serial
def test_shells_that_slide():
    """Surfaces tilt under friction: without the change of these tilts 1e-3 and more."""
    build = partial(sheet, "barrier", slide=(3.0, 0.7))
    options = ff.RunOptions(dt=5e-4, t_end=2.5e-3, tolerance=1e-13)
    compare(build, {**SHEET, **SLIDING}, ["final:q_x", "final:q_z"], options, step=1e-4)


def pressed(friction, density, height=6e-4, end=0.01) -> ff.Model:
    """A sheet that falls on the ground under a pressure with a kink within the last step."""
    u = np.linspace(-0.1, 0.1, 4)
    mesh = ff.SurfaceMesh.grid("sheet", u, u, lambda p: np.c_[p, np.full(len(p), height)])
    section = ff.ShellSection.isotropic(1e-3, ff.Material(2e8, 0.3, density))
    model = ff.Model("pressed", surface=mesh)
    model.add(
        ff.Gravity((1.0, 0.0, -9.81)),
        ff.Shell("sheet", section, velocity=(0.0, 0.0, -0.2)),
        ff.Pressure("press", "sheet", 5.0, amplitude=ff.Table((0.0, end - 3e-4), (0.0, 1.0))),
        ff.Contact("landing", "sheet", surfaces=GROUND, law="penalty", friction=friction),
        ff.PositionProbe("p", ff.Marker("sheet", (-0.1, -0.1, height))),
        ff.EnergyProbe("E"),
    )
    return model


@pytest.mark.parametrize("friction", [0.0, pytest.param(0.3, marks=pytest.mark.serial)])
def test_automatic_stiffness_is_that_of_the_first_step(friction):
    """That of the last one, 0.3 ms in place of 1 ms, made a derivative sixty times as large."""
    options = ff.RunOptions(dt=1e-3, t_end=0.01, tolerance=1e-13)
    numbers = {"density": 1000.0}
    compare(partial(pressed, friction), numbers, ["final:p_z"], options, step=1e-4, sizes=2)


@pytest.mark.parametrize(
    ("height", "of"),
    [
        (1e-3, ["final:E_strain", "mean:E_strain"]),
        pytest.param(4.9e-4, ["mean:E_strain"], marks=pytest.mark.serial),
    ],
)
def test_energies_of_automatic_stiffness(height, of):
    """The sheet touches the ground in the last step, or overlaps it at the start.

    In the last row a stiffness that is not chosen yet makes the derivative 4e-3 of its size. In the
    first row, whose energy is reported without one, that of later steps makes 1e-2 of the mean.
    """
    options = ff.RunOptions(dt=1e-3, t_end=3e-3, tolerance=1e-13)
    build = partial(pressed, 0.0, height=height, end=options.t_end)
    compare(build, {"density": 1000.0}, of, options, step=1e-4, sizes=2)


@pytest.mark.serial
def test_automatic_stiffness_of_a_first_step_that_is_taken_again():
    """It is that of the first trial; that of the step itself gives derivatives of another sign."""
    options = ff.RunOptions(
        dt=1e-3, t_end=2e-3, tolerance=1e-13, adaptive=True, error_tolerance=1e-6
    )
    build = partial(pressed, 0.0, end=options.t_end)
    of, numbers = ["mean:E_strain", "final:p_z"], {"density": 1000.0}
    compare(build, numbers, of, options, step=1e-5, sizes=9)


@pytest.mark.serial
def test_surfaces_that_do_not_meet():
    options = ff.RunOptions(dt=2e-4, t_end=4e-4, tolerance=1e-13)
    build = partial(sheet, "penalty", radius=0.05)
    compare(build, {"speed": 1.0}, ["final:p_z"], options, step=1e-4)


@pytest.mark.serial
@pytest.mark.parametrize(
    "how", ["stop", *(pytest.param(h, marks=pytest.mark.slow) for h in ("curve", "angle"))]
)
def test_stops(how):
    options = ff.RunOptions(dt=5e-4, t_end=0.016, tolerance=1e-13)
    numbers = STOP if how != "curve" else {"speed": 1.0}
    compare(partial(stopped, how), numbers, ["final:p_z", "final:q_x"], options, step=1e-4)


@pytest.mark.slow
@pytest.mark.serial
def test_taut_cables_that_are_let_go():
    """Cables that leave the accelerations of the start, in steps of five periods."""
    build, numbers = partial(struck, mass=2e-3), {"stiffness": 3e4, "lift": 0.02}
    options = ff.RunOptions(dt=5e-3, t_end=2e-2, rho_inf=0.7, tolerance=1e-13)
    compare(build, numbers, ["final:p_z"], options, step=1e-6)


def struck(stiffness, lift, mass) -> ff.Model:
    """Two masses and three taut cables, out of their line."""
    model, names = ff.Model("line"), ("left", "right")
    for i, name in enumerate(names, start=1):
        place = (0.3 * i, 0.0, lift * i)
        model.add(ff.RigidBody(name, mass, (1e-6,) * 3, position=place, velocity=(0.0, 0.3, 0.5)))
    ends = ff.Ground(), *map(ff.Marker, names), ff.Ground((0.9, 0.0, 0.0))
    for i in range(3):
        model.add(
            ff.SpringDamper(
                f"cable_{i}", ends[i], ends[i + 1], stiffness, rest_length=0.297, tension_only=True
            )
        )
    model.add(ff.PositionProbe("p", ff.Marker("left")))
    return model


@pytest.mark.slow
@pytest.mark.serial
def test_stops_among_others():
    """What damping leaves to the next step is 0.1 of each, outputs in impulses are 1e-3."""
    options = ff.RunOptions(
        dt=5e-4, t_end=0.0165, tolerance=1e-13, redundant_constraints="least_norm"
    )
    compare(equipped, EQUIPPED, ["final:p_z", "final:q_x"], options, step=1e-4, sizes=2)


@pytest.mark.several_ranks
@pytest.mark.three_ranks
@pytest.mark.parametrize(
    ("build", "numbers", "of", "dt", "steps"),
    [
        (balls, BALLS, "final:p_z", 5e-4, 12),
        pytest.param(rod, ROD, "mean:q_z", 2e-4, 15, marks=pytest.mark.slow_on_ranks),
        pytest.param(rubbed, RUBBED, "final:q_x", 5e-4, 12, marks=pytest.mark.slow_on_ranks),
        (partial(sheet, "barrier", radius=0.05, slide=(3.0, 0.7)), SLIDING, "final:q_z", 5e-4, 5),
        pytest.param(equipped, EQUIPPED, "final:p_z", 5e-4, 33, marks=pytest.mark.slow_on_ranks),
    ],
)
def test_ranks_agree(build, numbers, of, dt, steps):
    """Contacts of bodies on several ranks: a force that one of them misses is off by far more."""
    options = ff.RunOptions(
        dt=dt, t_end=steps * dt, tolerance=1e-12, redundant_constraints="least_norm"
    )
    agree_on_ranks(build, numbers, [of], options, accuracy=1e-11)


def hoisted(length, speed):
    """A weight that a cable over a pulley catches, which is slack first."""
    model, bob = ff.Model("hoisted"), ff.Marker("bob", offset=(0.05, 0.0, 0.1))
    path = [bob, ff.Eyelet(ff.Ground((0.5, 0.02, 0.0))), ff.Ground((-0.3, 0.1, 0.2))]
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody(
            "bob", 1.0, (0.1, 0.2, 0.15), position=(0.3, 0.1, -1.0), velocity=(0.2, 0.1, -speed)
        ),
        ff.Cable("rope", path, stiffness=1e4, damping=5.0, rest_length=length),
        ff.PositionProbe("p", ff.Marker("bob")),
        ff.CableProbe("pull", "rope"),
    )
    return model


@pytest.mark.serial
def test_cables_that_have_just_become_taut():
    """The first step ends with a stretch of 0.2 mm, which differences of the length are far below.

    With those of plain equations, 0.02 mm, the force bends by 4e-5 within them.
    """
    options = ff.RunOptions(dt=1e-3, t_end=0.016, tolerance=1e-13)
    numbers, of = {"length": 1.7564, "speed": 1.0}, ["final:p_z", "final:pull_stretch"]
    found = ff.gradient(hoisted, of, numbers, options, accuracy=1e-12)
    assert 1e-4 < found.history["pull_stretch"][12] < 3e-4
    assert errors(found.gradient, hoisted, numbers, of, options, 1e-6).max() < 5e-7
