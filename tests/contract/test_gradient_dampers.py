# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of motions in which loads jump at light bodies with stiff dampers."""

from functools import partial

import pytest

import flexfem as ff
from tests.contract.test_gradient_steps import compare
from tests.unit.refusals import assert_on_page

VALUES = {"damping": 0.02, "coil": 3.0, "mass": 2e-3, "pull": 0.4, "spin": 1.5}


def flap(*, damping, coil, mass, pull, spin, law="linear") -> ff.Model:
    """A light flap on a swinging arm, with dampers at its hinge and to the ground.

    In a step of 4 ms the damper of the hinge has 40 times the effect of the flap's inertia.
    """
    model, about = ff.Model("flap"), {"axis": (0.0, 1.0, 0.0)}
    tip, hinge = ff.Marker("arm", offset=(0.5, 0.0, 0.0)), ff.Marker("flap")
    end = ff.Marker("flap", offset=(0.05, 0.0, 0.01))
    moment = {"damping": damping} if law == "linear" else {"moment": _moment}
    jump = ff.TimeFunction(lambda t: float(t > 0.0131), [0.0131])
    model.add(
        ff.Gravity((0.0, 0.3, -9.81)),
        ff.RigidBody(
            "arm", 1.0, (0.02, 0.03, 0.04), position=(0.5, 0.0, 0.0),
            velocity=(0.0, 0.0, -0.5 * spin), angular_velocity=(0.0, spin, 0.0),
        ),
        ff.RigidBody(
            "flap", mass, (1e-3 * mass,) * 3, position=(1.0, 0.0, 0.0),
            velocity=(0.0, 0.0, -spin), angular_velocity=(0.0, spin, 0.0),
        ),
        ff.Revolute(
            "root", ff.Ground(), ff.Marker("arm", offset=(-0.5, 0.0, 0.0)), axis=(0.0, 1.0, 0.0)
        ),
        ff.Spherical("pin", tip, hinge),
        ff.TorsionalSpringDamper("coil", tip, hinge, stiffness=coil, **about),
        ff.TorsionalSpringDamper("damper", tip, hinge, **about, **moment),
        ff.Bushing(
            "sides", tip, hinge, stiffness=(0.0,) * 6,
            damping=(0.0, 0.0, 0.0, damping, 0.0, damping),
        ),
        ff.SpringDamper(
            "strut", ff.Ground((1.0, 0.3, 0.6)), end, stiffness=5.0, damping=300.0 * damping
        ),
        ff.PointForce("gust", end, (pull, 0.3 * pull, pull), amplitude=jump),
        ff.PositionProbe("end", end),
        ff.Probe("motion", hinge, ("turning",), lambda t, s: (s.angular_velocity[1],)),
    )  # fmt: skip
    return model


def _moment(x: float, v: float) -> float:
    return 0.02 * v + 1e-4 * v * v * v


OPTIONS = ff.RunOptions(dt=4e-3, t_end=0.024, tolerance=1e-13, rho_inf=0.6)


@pytest.mark.serial
def test_dampers_behind_a_jump_of_a_load():
    """Accelerations that go on undamped in the derivatives put these off by a tenth and more."""
    columns = ["final:end_z", "mean:end_x", "final:turning"]
    compare(partial(flap), VALUES, columns, OPTIONS, 1e-6)


@pytest.mark.serial
def test_dampers_that_are_not_linear_are_refused():
    numbers = {"pull": VALUES["pull"]}
    rest = {name: value for name, value in VALUES.items() if name not in numbers}
    with pytest.raises(ValueError, match='TorsionalSpringDamper "damper" ends acc') as found:
        ff.gradient(partial(flap, law="cubic", **rest), ["final:end_z"], numbers, OPTIONS)
    assert_on_page(str(found.value))
