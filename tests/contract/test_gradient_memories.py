# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of motions that carry more than their nodes from step to step."""

from dataclasses import replace
from functools import partial

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from tests.contract.test_gradients import compare

#: Numbers of a rope with an elastic branch behind a dashpot.
ROPE = {"stiffness": 20.0, "viscosity": 3.0, "slip": 0.1, "mass": 1.0, "kick": 1.0}


def _pull(t, ends, z, numbers):
    """A spring that stiffens, beside one in series with a dashpot, whose length is the state."""
    stiffness, viscosity = np.moveaxis(numbers, -1, 0)
    z = np.asarray(z).reshape(-1)
    x, v = (a.reshape(-1, 2, 3) for a in (ends.positions, ends.velocities))
    way = x[:, 1] - x[:, 0]
    length = np.linalg.norm(way, axis=1)
    stretch = length - 0.5
    rate = np.einsum("ei,ei->e", way, v[:, 1] - v[:, 0]) / length
    branch = 30.0 * (stretch - z)
    size = stiffness * stretch + 2.0 * stretch**3 + 0.1 * rate + branch
    force = (size / length)[:, np.newaxis] * way
    return np.stack([force, -force], axis=1).reshape(-1, 3), None, (branch / viscosity)


def rope(every, *, stiffness, viscosity, slip, mass, kick) -> ff.Model:
    """Two bodies one below the other, each on such a spring: two elements of one law."""
    first, second = ff.Marker("first", offset=(0.1, 0.0, 0.05)), ff.Marker("second")
    model = ff.Model("rope")

    def law(t, ends, z, numbers):
        forces, moments, rates = _pull(t, ends, z, numbers)
        return forces, moments, rates[:, np.newaxis]

    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody(
            "first", mass, (0.01, 0.02, 0.03), position=(0.7, 0.0, 0.0), velocity=(0.0, kick, 0.0),
            angular_velocity=(1.0, 0.3 * kick, 0.0),
        ),
        ff.RigidBody("second", 0.4, (0.01, 0.01, 0.01), position=(1.4, 0.0, 0.0)),
        ff.Force(
            "ropes", [ff.Ground(), first, first, second], law, states=1, initial=[[slip], [0.0]],
            parameters=[stiffness, viscosity], each=2, every=every,
        ),
        ff.PositionProbe("tip", ff.Marker("second", offset=(0.2, 0.1, 0.0))),
    )  # fmt: skip
    return model


#: Numbers of a controlled arm: of each law, and of what they measure.
ARM = {
    "gain": 30.0, "integral": 20.0, "setpoint": 0.3, "filter": 0.1, "spring": 4.0, "damper": 0.5,
    "inertia": 0.3, "mass": 1.0, "kick": 0.6, "offset": 0.1,
}  # fmt: skip


def arm(
    *, gain, integral, setpoint, filter, spring, damper, inertia, mass, kick, offset, at_once=True
) -> ff.Model:  # fmt: skip
    """Two arms with controllers of all kinds: sampled ones on loads, and continuous ones.

    These measure a load's motion, and ``at_once`` what actuators follow then, and accelerations.
    """
    model, hinge = ff.Model("arm"), ff.Marker("arm", offset=(-0.5, 0.0, 0.0))
    middle, end = (ff.Marker("arm", offset=(offset, 0.0, z)) for z in (0.0, 0.1))
    fore, elbow = ff.Marker("fore"), ff.Marker("arm", offset=(0.5, 0.0, 0.0))
    joint = ff.Marker("fore", offset=(-0.2, 0.0, 0.0))
    turn = {"axis": (0.0, 1.0, 0.0)}

    def seen(t, state):
        return state.position[2], state.velocity[2], state.acceleration[0]

    compensator = ff.StateSpace(
        [[0.9, 0.05], [-0.1, 0.8]], [[1.0, filter], [0.0, 1.0]], [[2.0, 1.0]], [[-9.0, -1.0]],
        y0=[0.3, 0.0], u0=[3.0], initial=[filter, 0.0],
    )  # fmt: skip
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody(
            "arm", mass, (0.1, 0.2, 0.3), position=(0.5, 0.0, 0.0),
            velocity=(0.0, 0.0, -0.5 * kick), angular_velocity=(0.0, kick, 0.0),
        ),
        ff.RigidBody("fore", 0.3, (0.01, 0.02, 0.03), position=(1.2, 0.0, 0.0)),
        ff.Revolute("shoulder", ff.Ground(), hinge, **turn),
        ff.Revolute("joint", elbow, joint, **turn),
        ff.Actuator("motor", ff.Ground(), hinge, **turn),
        ff.Actuator("drive", elbow, joint, **turn),
        ff.PointForce("lift", middle, (0.0, 0.0, 1.0)),
        ff.PointForce("push", fore, (0.0, 0.0, 1.0)),
        ff.PointMoment("twist", fore, (0.0, 1.0, 0.0)),
        ff.Probe("middle", middle, ("z", "vz", "ax"), seen),
        ff.Probe("end", end, ("ez", "evz", "eax"), seen),
        ff.PositionProbe("tip", ff.Marker("fore", offset=(0.2, 0.1, 0.0))),
        ff.Controller(
            "servo", ["z"], ["lift"],
            ff.PID(gain, integral, 2.0, setpoint=setpoint, filter_time=0.01),
        ),
        ff.Controller("damper", ["z", "evz"], ["push"], compensator, sample_time=0.008),
        ff.Controller("cosine", ["ez"], ["twist"], lambda t, y: np.cos(spring * y[0]) * (1.0 + t)),
    )  # fmt: skip
    if at_once:
        model.add(
            ff.Controller("follower", ["ez", "evz"], ["motor"],
                          lambda t, y: -spring * y[0] - damper * y[1] * abs(y[1])),
            ff.Controller("mass", ["eax"], ["drive"], lambda t, y: -inertia * y[0]),
        )  # fmt: skip
    return model


#: Numbers of a bar that creeps or yields.
BAR = {"push": 3.0, "time": 0.01}


def bar(kind, *, push, time) -> ff.Model:
    """A clamped bar pushed to and fro, of a law with ``time`` or a yield stress."""
    mesh = ff.SolidMesh.box((0.5, 0.03, 0.02), (4, 1, 1))
    mesh = mesh.with_surfaces(left=lambda x: x[:, 0] == 0.0)
    end, model = ff.Marker("bar", (0.5, 0.03, 0.02)), ff.Model("bar")
    law = ff.laws.Viscoelastic(ff.laws.NeoHookean(2e6, 4e6), [1e6, 5e5], [time, 0.003])
    if kind == "plastic":
        law = ff.laws.J2Plasticity(2e6, 4e6, 2e6 * time, 1e5)
    model.add(
        ff.Solid("bar", law, mesh, density=1100.0, degree=1, fixed={"left": "xyz"}),
        ff.PointForce("push", end, (0.3, 0.5, -push), amplitude=lambda t: np.sin(300.0 * t)),
        ff.PositionProbe("tip", end),
    )
    return model


STEPS = ff.RunOptions(dt=4e-3, t_end=0.02, tolerance=1e-13, split_above=1)


@pytest.mark.serial
@pytest.mark.parametrize("every", ["iteration", "step"])
def test_states_of_force_elements(every):
    """States that were not carried would leave out 1e-2; with derivatives of Newton's 1e-6."""
    compare(partial(rope, every), ROPE, ["final:tip_x", "mean:tip_z"], STEPS, 1e-8)


@pytest.mark.serial
def test_controllers():
    """The output of a law without its derivatives by measurements is wrong by 1e-2 and more."""
    compare(arm, ARM, ["final:tip_x", "mean:tip_z"], STEPS, 1e-7)


def kicked(build, name, time, **numbers):
    """With a force on a body that is switched off, where accelerations are computed again."""
    model, on = build(**numbers), ff.TimeFunction(lambda t: float(t < time), [time])
    model.add(ff.PointForce("kick", ff.Marker(name), (4.0, 3.0, 40.0), amplitude=on))
    return model


@pytest.mark.serial
@pytest.mark.parametrize(
    ("build", "numbers", "name", "time"),
    [
        pytest.param(partial(rope, "iteration"), ROPE, "second", 0.0133, marks=pytest.mark.slow),
        pytest.param(partial(rope, "step"), ROPE, "second", 0.0133, marks=pytest.mark.slow),
        (arm, ARM, "fore", 0.012),
    ],
    ids=["rope", "rope_every_step", "arm"],
)
def test_jumps_of_loads(build, numbers, name, time):
    """Rates of states are those behind a jump; controllers measure there again: 1e-3 and more."""
    build = partial(kicked, build, name, time)
    compare(build, numbers, ["final:tip_x", "mean:tip_z"], STEPS, 1e-8)


@pytest.mark.slow
@pytest.mark.serial
def test_controllers_with_few_states_in_memory():
    """Steps that are taken again with other held outputs cannot be recovered."""
    one = {"gain": ARM["gain"]}
    build, options = (lambda gain: arm(**{**ARM, "gain": gain})), replace(STEPS, t_end=0.08)
    full, few = (
        ff.gradient(build, "final:tip_z", one, options, memory=memory).gradient["final:tip_z"]
        for memory in (1e9, 5e4)
    )
    assert few["gain"] == pytest.approx(full["gain"], rel=1e-9)


@pytest.mark.serial
@pytest.mark.parametrize("kind", ["viscoelastic", pytest.param("plastic", marks=pytest.mark.slow)])
def test_internal_variables(kind):
    """Internal variables that were not carried would leave out 1e-2."""
    options = replace(STEPS, dt=2e-3, t_end=8e-3)
    compare(partial(bar, kind), BAR, ["final:tip_z", "mean:tip_y"], options, 1e-7)


#: Numbers of a body with dampers of modes, which follow from all of them.
DAMPED = {"ratio": 0.1, "youngs": 5e6, "height": 0.02, "push": 3.0}


def damped(element, *, ratio, youngs, height, push) -> ff.Model:
    """A rod on a hinge, or a clamped strip, pushed at its end."""
    material, end = ff.Material(youngs, 0.3, 1100.0), ff.Marker("rod", "end")
    if element in ("se3", "nurbs"):
        mesh = ff.LineMesh.straight({"rod": [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0)]}, elements=4)
        model, hinge = ff.Model("rod", mesh=mesh), ff.Marker("rod", "start")
        model.add(
            ff.Beam("rod", ff.Section.rectangle(0.03, height, material), formulation=element),
            ff.Revolute("pin", ff.Ground(), hinge, axis=(0.0, 1.0, 0.0)),
        )
    else:
        end = ff.Marker("rod", "rod_bottom_right")
        surface = ff.SurfaceMesh.rectangle("rod", (0.5, 0.1), (4, 2))
        section = ff.ShellSection.isotropic(0.5 * height, material)
        model = ff.Model("strip", surface=surface)
        model.add(ff.Shell("rod", section, element=element, edges={"rod_left": "clamped"}))
    model.add(
        ff.PointForce("push", end, (0.1, 0.2, -push)),
        ff.ModalDamping("dampers", ratio, modes=3),
        ff.PositionProbe("tip", end),
    )
    return model


@pytest.mark.serial
@pytest.mark.parametrize(
    "element",
    ["se3", *(pytest.param(one, marks=pytest.mark.slow) for one in ("nurbs", "rotation_free"))],
)
def test_dampers_of_modes(element):
    """Dampers of fixed modes would be wrong by 0.1, their stresses left out by 1e-3."""
    options = replace(STEPS, dt=1e-3, t_end=8e-3)
    compare(partial(damped, element), DAMPED, ["final:tip_z", "mean:tip_y"], options, 1e-7)


@pytest.mark.serial
def test_strains_that_change_with_time():
    """Strains of the step's start would be wrong by 0.1."""

    def build(heat, rate):
        def change(s, t):
            return np.full(len(s), heat * np.sin(rate * t))

        model = ff.Model("rod", mesh=ff.LineMesh.straight({"rod": [(0, 0, 0), (0.5, 0, 0)]}, 4))
        section = ff.Section.rectangle(0.03, 0.02, ff.Material(5e6, 0.3, 1100.0))
        model.add(
            ff.Beam("rod", section, prestrain=ff.ThermalStrain(1e-4, change, gradient_z=change)),
            ff.Rigid("clamp", ff.Ground(), ff.Marker("rod", "start")),
            ff.PositionProbe("tip", ff.Marker("rod", "end")),
        )
        return model

    compare(build, {"heat": 200.0, "rate": 80.0}, ["final:tip_x", "mean:tip_z"], STEPS, 1e-7)


@pytest.mark.several_ranks
@pytest.mark.parametrize(
    ("build", "numbers"),
    [
        pytest.param(partial(rope, "iteration"), ROPE, marks=pytest.mark.slow_on_ranks),
        pytest.param(arm, ARM, marks=pytest.mark.three_ranks),
        pytest.param(partial(bar, "viscoelastic"), BAR, marks=pytest.mark.slow_on_ranks),
        (partial(damped, "se3"), DAMPED),
    ],
    ids=["rope", "arm", "bar", "damped"],
)
def test_ranks_agree(build, numbers):
    """A state that two ranks have, counted twice, is a tenth and more."""
    alone, together = (
        ff.gradient(build, "final:tip_z", numbers, STEPS, accuracy=1e-13, comm=comm, check=True)
        for comm in (MPI.COMM_SELF, MPI.COMM_WORLD)
    )
    # adjoint and tangent are transposes of each other, to rounding
    assert together.check["final:tip_z"] < 1e-12
    by = alone.gradient["final:tip_z"]
    largest = max(abs(by[name] * value) for name, value in numbers.items())
    for name, value in numbers.items():
        apart = abs(together.gradient["final:tip_z"][name] - by[name]) * value
        assert apart < 1e-9 * largest, name
