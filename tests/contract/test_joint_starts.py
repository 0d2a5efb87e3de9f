# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints that cannot begin are refused, by all ranks."""

import numpy as np
import pytest

import flexfem as ff
from flexfem.analyses.dynamics import RunOptions
from flexfem.core.joint import Joint
from flexfem.simulation.motion.stepping import Simulation
from tests.contract.joint_examples import EXAMPLES


def _model(joint: Joint) -> ff.Model:
    model = ff.Model("test")
    model.add(ff.RigidBody("body", 2.0, (0.2, 0.3, 0.4), position=(0.5, -0.2, 0.3)), joint)
    return model


@pytest.mark.parametrize("name", ["Spherical", "Revolute", "Rigid", "Cylindrical", "PointOnLine",
                                  "PointOnPlane", "Prismatic"])  # fmt: skip
def test_joint_with_a_gap_at_the_start_is_refused(name):
    example = EXAMPLES[name]
    marker = ff.Marker("body", offset=(0.1, 0.2, 0.3))
    joint = example.cls("elbow", ff.Ground((0.0, 1.0, 0.0)), marker, **example.arguments)
    with pytest.raises(ValueError, match=f'^{name} "elbow": .*violate') as raised:
        Simulation(_model(joint), RunOptions(dt=1e-3, t_end=1.0))
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("name", [n for n, e in EXAMPLES.items() if e.cls.driven and not e.elastic])
def test_drive_that_starts_elsewhere_is_refused(name):
    example = EXAMPLES[name]
    late = {
        key: (lambda t, f=value: f(t + 0.5)) if callable(value) else value
        for key, value in example.arguments.items()
    }
    joint = example.cls("motor", ff.Ground((3.0, 0.0, 0.0)), ff.Marker("body"), **late)
    with pytest.raises(ValueError, match=f'^{example.cls.__name__} "motor": .*violate'):
        Simulation(_model(joint), RunOptions(dt=1e-3, t_end=1.0))


def test_redundant_joints_are_named():
    axis, arm = np.array([0.3, 0.5, -0.8]), np.array([0.1, 0.2, 0.3])
    model = ff.Model("test")
    model.add(ff.RigidBody("body", 2.0, (0.2, 0.3, 0.4), position=(0.5, -0.2, 0.3)))
    for name, shift in (("one", 0.0), ("two", 0.7)):
        place, marker = arm + shift * axis, ff.Marker("body", offset=arm + shift * axis)
        ground = ff.Ground(place + np.array([0.5, -0.2, 0.3]))
        model.add(ff.Revolute(name, ground, marker, axis=axis))
    # an answer would have arbitrary multipliers
    with pytest.raises(ValueError, match=r'"one".*"two".*redundant'):
        Simulation(model, RunOptions(dt=1e-3, t_end=1.0))
