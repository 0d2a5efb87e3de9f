# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints that make no sense: one line that names the joint and the value."""

from collections.abc import Callable

import numpy as np
import pytest

import flexfem as ff
from flexfem.analyses.dynamics import RunOptions
from flexfem.simulation.motion.stepping import Simulation
from tests.unit.refusals import assert_refused

pytestmark = pytest.mark.serial

A, B, C = ff.Ground(), ff.Marker("one"), ff.Marker("two")
X, Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
HINGE = ff.Revolute("hinge", A, B, axis=X)
TUBE = ff.Cylindrical("tube", A, B, axis=X)
STOP = {"axis": X, "upper": 1.0, "stiffness": 1.0}
MATRIX = np.eye(6)
MATRIX[0, 1] = 0.5

ALONE = {
    "Universal zero": (lambda: ff.Universal("j", A, B, axis=(0, 0, 0)), "axis must not be zero"),
    "RevoluteSpherical zero": (
        lambda: ff.RevoluteSpherical("j", A, B, axis=(0, 0, 0)), "axis must not be zero"
    ),
    "Universal second": (
        lambda: ff.Universal("j", A, B, axis=X, second_axis=(1, 1, 0)),
        "second_axis must be perpendicular to axis, got a cosine of 0.707107",
    ),
    "ConstantVelocity": (
        lambda: ff.ConstantVelocity("j", A, B, axis=X, second_axis=(-1, 0, 0)),
        r"second_axis must not oppose axis, got \(-1, 0, 0\)",
    ),
    "SpringDamper": (
        lambda: ff.SpringDamper("j", A, B), "stiffness and damping must not both be zero"
    ),
    "SpringDamper sign": (
        lambda: ff.SpringDamper("j", A, B, stiffness=-1.0), "stiffness must not be negative, got -1"
    ),
    "Screw": (lambda: ff.Screw("j", A, B, axis=X, pitch=0.0), "pitch must not be zero, got 0.0"),
    "Screw text": (lambda: ff.Screw("j", A, B, axis=X, pitch="1"), "pitch must be a number"),
    "Planar": (lambda: ff.Planar("j", A, B, axis=(0, 0, 0)), "axis must not be zero"),
    "Gear ratio": (lambda: ff.Gear("j", A, B, A, C, ratio=0), "ratio must not be zero, got 0"),
    "Gear axis": (
        lambda: ff.Gear("j", A, B, A, C, second_axis=(0, 0, 0)), "second_axis must not be zero"
    ),
    "Gear backlash": (
        lambda: ff.Gear("j", A, B, A, C, backlash=0.1), "backlash needs a stiffness, got 0.1 alone"
    ),
    "Gear stiffness": (
        lambda: ff.Gear("j", A, B, A, C, stiffness=0.0), "stiffness must be positive, got 0.0"
    ),
    "Gear marker": (lambda: ff.Gear("j", A, B, "two", C), "c must be a Marker or Ground"),
    "Coupling motion": (
        lambda: ff.Coupling("j", A, B, A, C, motions=("rotation", "screw")),
        r"motions must be two of rotation and translation, got \('rotation', 'screw'\)",
    ),
    "Pulley ratio": (lambda: ff.Pulley("j", A, B, A, C, ratio=0), "ratio must be positive, got 0"),
    "Pulley marker": (lambda: ff.Pulley("j", A, B, A, "two"), "d must be a Marker or Ground"),
    "Generic type": (lambda: ff.Generic("j", A, B, free="rz"), "free must be a list or tuple"),
    "Generic limits type": (
        lambda: ff.Generic("j", A, B, free=["x"], limits=[1.0]), "limits must be a Mapping, got"
    ),
    "Generic name": (lambda: ff.Generic("j", A, B, free=("u",)), "free must name .*, got 'u'"),
    "Generic twice": (lambda: ff.Generic("j", A, B, free=("x", "x")), "once each, got 'x'"),
    "Generic held": (
        lambda: ff.Generic("j", A, B, free=("x",), limits={"y": (0, 1, 1, 0)}),
        'limits on "y", which is not free',
    ),
    "Generic limits": (
        lambda: ff.Generic("j", A, B, free=("x",), limits={"x": 3.0}), "must be four, got 3.0"
    ),
    "Generic order": (
        lambda: ff.Generic("j", A, B, free=("x",), limits={"x": (2, 1, 1, 0)}),
        "lower must be below upper, got 2 and 1",
    ),
    "Bushing zero": (lambda: ff.Bushing("j", A, B), "must not both be zero"),
    "Bushing shape": (lambda: ff.Bushing("j", A, B, 5.0), "stiffness must hold 6 numbers, got 5.0"),
    "Bushing empty": (lambda: ff.Bushing("j", A, B, []), r"must hold 6 numbers, got \[\]"),
    "Bushing symmetry": (lambda: ff.Bushing("j", A, B, MATRIX), "stiffness must be symmetric"),
    "Bushing sign": (
        lambda: ff.Bushing("j", A, B, np.ones(6), (0, 0, -1, 0, 0, 0)),
        "damping must be positive semidefinite",
    ),
    "Bushing indefinite": (
        lambda: ff.Bushing("j", A, B, np.eye(6) + 2.0 * np.eye(6)[::-1]), "positive semidefinite"
    ),
    "LimitStop none": (lambda: ff.LimitStop("j", A, B, axis=X, stiffness=1.0), "got neither"),
    "LimitStop order": (
        lambda: ff.LimitStop("j", A, B, **{**STOP, "lower": 1.0}),
        "lower must be below upper, got 1.0 and 1.0",
    ),
    "LimitStop stiffness": (
        lambda: ff.LimitStop("j", A, B, **{**STOP, "stiffness": -2.0}),
        "stiffness must be positive, got -2.0",
    ),
    "LimitStop damping": (
        lambda: ff.LimitStop("j", A, B, damping=-2.0, **STOP), "damping must not be negative"
    ),
    "LimitStop kind": (
        lambda: ff.LimitStop("j", A, B, motion="turn", **STOP),
        "motion must be one of translation, rotation, distance, got 'turn'",
    ),
    "LimitStop coordinate": (
        lambda: ff.LimitStop("j", A, B, coordinate="angle", **STOP),
        "coordinate='angle' is written motion=\"rotation\"",
    ),
    "LimitStop axis": (
        lambda: ff.LimitStop("j", A, B, upper=1.0, stiffness=1.0), "axis must hold 3 numbers"
    ),
    "LimitStop distance": (
        lambda: ff.LimitStop("j", A, B, motion="distance", **STOP), "a distance has no axis"
    ),
    "JointFriction joint": (
        lambda: ff.JointFriction("j", "hinge", force=1.0), "joint must be a Joint, got 'hinge'"
    ),
    "JointFriction both": (
        lambda: ff.JointFriction("j", HINGE, force=1.0, coefficient=0.1), "either .*got 1.0 and 0.1"
    ),
    "JointFriction none": (lambda: ff.JointFriction("j", HINGE), "either .*got None and None"),
    "JointFriction sign": (
        lambda: ff.JointFriction("j", HINGE, force=-1.0), "force must not be negative, got -1.0"
    ),
    "JointFriction coefficient": (
        lambda: ff.JointFriction("j", HINGE, coefficient=-0.1, radius=1.0),
        "coefficient must not be negative, got -0.1",
    ),
    "JointFriction velocity": (
        lambda: ff.JointFriction("j", HINGE, force=1.0, velocity=0.0),
        "velocity must be positive, got 0.0",
    ),
    "JointFriction viscous": (
        lambda: ff.JointFriction("j", HINGE, force=1.0, viscous=-3.0), "viscous must not be neg"
    ),
    "JointFriction radius": (
        lambda: ff.JointFriction("j", HINGE, coefficient=0.1), "radius must be a number, got None"
    ),
    "JointFriction arm": (
        lambda: ff.JointFriction("j", HINGE, force=1.0, radius=0.1), "radius goes with the coeff"
    ),
    "JointFriction motion": (
        lambda: ff.JointFriction("j", HINGE, "translation", force=1.0),
        'Revolute "hinge" has no free translation',
    ),
    "JointFriction which": (
        lambda: ff.JointFriction("j", TUBE, force=1.0), "must be translation or rotation, got None"
    ),
    "Lock joint": (lambda: ff.Lock("j", ff.Rigid("weld", A, B)), 'Rigid "weld" has no free motion'),
    "Lock flag": (lambda: ff.Lock("j", HINGE, locked=1), "locked must be a bool, got 1"),
    "RigidNodes one": (lambda: ff.RigidNodes("j", A, B), "nodes must be a list or tuple, got Mar"),
    "RigidNodes none": (lambda: ff.RigidNodes("j", A, []), "at least one marker, got none"),
    "RigidNodes twice": (lambda: ff.RigidNodes("j", A, [B, C, B]), r"nodes\[2\] is given twice"),
    "RigidNodes type": (lambda: ff.RigidNodes("j", A, [B, 3]), r"nodes\[1\] must be a Marker"),
    "PrescribedDisplacement": (
        lambda: ff.PrescribedDisplacement("j", A, B, axis=X, displacement=3.0),
        "displacement must be a function of time, got 3.0",
    ),
    "PrescribedDistance": (
        lambda: ff.PrescribedDistance("j", A, B, elongation=lambda t: (t, t)),
        r"elongation\(0\) must be a number",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("make", "message"), ALONE.values(), ids=ALONE)
def test_refused_when_made(make: Callable[[], object], message: str) -> None:
    assert_refused(make, message)


IN_MODEL = {
    "unknown joint": (
        [ff.JointFriction("j", HINGE, force=1.0)], 'JointFriction "j": .* has no joint "hinge"'
    ),
    "unknown lock": ([ff.Lock("j", TUBE)], 'Lock "j": .* has no joint "tube"'),
    "same body": ([ff.Gear("j", A, B, C, C)], 'Gear "j": c and d are fixed to "two"'),
    "ground twice": (
        [ff.Gear("j", A, ff.Ground(), B, C)], 'Gear "j": a and b are on the ground'
    ),
    "ground only": ([ff.RigidNodes("j", A, [B, ff.Ground()])], r'"j": a and nodes\[1\] are on the'),
    "unknown body": (
        [ff.Gear("j", A, B, A, ff.Marker("three"))], 'Gear "j": Marker on "three": .* no such'
    ),
    "rod without length": ([ff.Distance("j", A, B)], 'Distance "j": the markers a and b coincide'),
    "rope without length": (
        [ff.Pulley("j", ff.Ground((0, 0, 1)), B, A, C)], 'Pulley "j": the markers c and d coincide'
    ),
    "drive without length": (
        [ff.PrescribedDistance("j", A, B)], 'PrescribedDistance "j": the markers a and b coincide'
    ),
    "stop without length": (
        [ff.LimitStop("j", A, B, motion="distance", upper=1.0, stiffness=1.0)],
        'LimitStop "j": the markers a and b coincide',
    ),
    "same node twice": (
        [ff.RigidNodes("j", A, [B, ff.Marker("one")])], 'RigidNodes "j": 6 of 12 .* redundant'
    ),
}  # fmt: skip


@pytest.mark.parametrize(("joints", "message"), IN_MODEL.values(), ids=IN_MODEL)
def test_refused_in_a_model(joints: list[object], message: str) -> None:
    model = ff.Model("test")
    model.add(ff.RigidBody("one", 1.0, (1, 1, 1)), ff.RigidBody("two", 1.0, (1, 1, 1)), *joints)
    with pytest.raises(ValueError, match=message) as raised:
        Simulation(model, RunOptions(dt=1e-3, t_end=1.0))
    assert "\n" not in str(raised.value)
