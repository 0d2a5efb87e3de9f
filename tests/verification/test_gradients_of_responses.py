# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of frequency responses: closed forms, differences of linear models, ranks."""

import cmath
import math
from collections.abc import Callable

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff

COMM, SELF = MPI.COMM_WORLD, MPI.COMM_SELF
PLACES = {-2: 1 / 12, -1: -8 / 12, 1: 8 / 12, 2: -1 / 12}


def shaft(stiffness, damping, inertia) -> ff.Model:
    """A disc behind a spring on one that is turned, and pushed itself."""
    model, first, second = ff.Model("shaft"), ff.Marker("first"), ff.Marker("second")
    model.add(
        ff.RigidBody("first", 1.0, np.eye(3)),
        ff.RigidBody("second", 1.0, inertia * np.eye(3)),
        ff.Revolute("bearing", ff.Ground(), first, axis=(0, 0, 1)),
        ff.PrescribedAngle("motor", ff.Ground(), first, axis=(0, 0, 1)),
        ff.Revolute("other", ff.Ground(), second, axis=(0, 0, 1)),
        ff.TorsionalSpringDamper(
            "spring", first, second, axis=(0, 0, 1), stiffness=stiffness, damping=damping
        ),
        ff.PointMoment("torque", second, (0.0, 0.0, 2.0)),
        ff.Probe("turn", second, ("angle", "rate"), lambda t, s: (
            math.atan2(s.rotation[1, 0], s.rotation[0, 0]), s.angular_velocity[2])),
    )  # fmt: skip
    return model


def closed(values: dict[str, float], output: str, given: str, frequency: float) -> complex:
    """The transfer functions of :func:`shaft`."""
    s, (k, c, J) = 2j * math.pi * frequency, values.values()
    right = 2.0 if given == "torque" else (k + s * c) / s**2
    return right / (J * s**2 + c * s + k) * (s if output == "rate" else 1.0)


def differences(of: Callable[[dict[str, float]], complex], values, name) -> complex:
    """Change of the logarithm of a response by that of a parameter: of gain and of phase."""
    step, moved = 2e-3, []
    for place in PLACES:
        moved.append(of({**values, name: values[name] * (1.0 + place * step)}))
    return complex(np.dot(list(PLACES.values()), moved) / step / of(values))


@pytest.mark.serial
def test_responses_of_a_shaft():
    """Loads and drives, displacements and rates against the closed forms.

    Dampers that miss in P, inputs that do not change with stiffness, as that of the drive does by
    the rows of constraints, or rates measured as displacements are off by tenths.
    """
    values = {"stiffness": 40.0, "damping": 3.0, "inertia": 0.5}
    pairs = [("angle", "torque", 1.3), ("rate", "torque", 0.4), ("angle", "motor", 1.7),
             ("rate", "motor", 0.9), ("angle", "torque", 0.0)]  # fmt: skip
    names = [
        f"{kind}:{out}/{given}@{hz:g}" for out, given, hz in pairs for kind in ("gain", "phase")
    ]
    found = ff.gradient(shaft, names, values, ff.LinearOptions(), comm=SELF)
    for k, pair in enumerate(pairs):
        gain, phase = names[2 * k : 2 * k + 2]
        own = closed(values, *pair)
        assert found.value[gain] == pytest.approx(abs(own), rel=1e-12)
        assert found.value[phase] == pytest.approx(cmath.phase(own), abs=1e-12)
        for name, value in values.items():
            change = differences(lambda at, pair=pair: closed(at, *pair), values, name)
            by = found.gradient[gain][name] * value / abs(own)
            # differences of both have errors of 1e-10
            assert by == pytest.approx(change.real, abs=1e-8)
            assert found.gradient[phase][name] * value == pytest.approx(change.imag, abs=1e-8)


def arm(youngs, length, damping, stiffness, load) -> ff.Model:
    """An elastic arm on a sprung hinge with a motor, bent by a load."""
    mesh = ff.LineMesh.straight({"arm": [(0.0, 0.0, 0.0), (length, 0.0, 0.0)]}, elements=3)
    section = ff.Section.rectangle(0.004, 0.03, ff.Material(youngs, 0.3, 7850.0))
    model, root, end = (
        ff.Model("arm", mesh=mesh),
        ff.Marker("arm", "start"),
        ff.Marker("arm", "end"),
    )
    hinge = ff.Ground(), root
    model.add(
        ff.Beam("arm", section, damping=damping),
        ff.Revolute("axle", *hinge, axis=(0.0, 0.0, 1.0)),
        ff.Actuator("motor", *hinge, axis=(0.0, 0.0, 1.0)),
        ff.TorsionalSpringDamper(
            "hold", *hinge, axis=(0.0, 0.0, 1.0), stiffness=stiffness, damping=0.3
        ),
        ff.PointForce("push", end, (0.0, load, 0.0), follower=True),
        ff.PositionProbe("tip", end),
        ff.StrainProbe("gauge", "arm", 0.4 * length),
    )
    return model


ARM = {"youngs": 2.1e11, "length": 1.0, "damping": 2e-3, "stiffness": 30.0, "load": 8.0}
ABOUT = {"start": "equilibrium", "split_above": 1}
OF_ARM = [("tip_y", "motor", 1.0), ("tip_x", "push", 3.0), ("gauge_kappa3", "motor", 4.0)]
GAINS = [f"gain:{out}/{given}@{hz:g}" for out, given, hz in OF_ARM]


@pytest.mark.slow_on_ranks
def test_responses_of_an_elastic_arm_are_those_of_its_linear_models():
    """About a bent equilibrium, against differences of transfer functions of ``linearize``.

    Without the change of the equilibrium gains are off by tenths: the tip goes along x because the
    arm is bent. A rank that misses a part of a vector is off by its size.
    """
    found = ff.gradient(arm, GAINS, ARM, ff.LinearOptions(**ABOUT))
    assert all(v == pytest.approx(u, rel=1e-7) for v, u in zip(
        found.value.values(), _gains(ARM), strict=True))  # fmt: skip
    step = 2e-3
    for name in ("length", "damping", "load"):
        moved = [_gains({**ARM, name: ARM[name] * (1.0 + k * step)}) for k in PLACES]
        expected = np.array(list(PLACES.values())) @ np.array(moved) / step / _gains(ARM)
        own = [found.gradient[gain][name] * ARM[name] / found.value[gain] for gain in GAINS]
        # dense matrices of a stiff arm leave eight digits of a gain, five of its differences
        np.testing.assert_allclose(own, expected, atol=2e-5, rtol=0.0)


def _gains(values) -> list[float]:
    """Gains of the arm by state matrices of all its degrees of freedom."""
    linear = ff.linearize(arm(**values), ff.LinearOptions(**ABOUT), SELF)
    gains = []
    for out, given, hz in OF_ARM:
        shifted = 2j * np.pi * hz * np.eye(len(linear.A)) - linear.A
        column = linear.B[:, linear.inputs.index(given)]
        gains.append(abs(linear.C[linear.outputs.index(out)] @ np.linalg.solve(shifted, column)))
    return gains


@pytest.mark.slow
@pytest.mark.serial
def test_functional_of_responses():
    """Half the sum of squares of gains at three frequencies."""
    values = {"stiffness": 40.0, "damping": 3.0, "inertia": 0.5}
    names = tuple(f"gain:angle/torque@{hz:g}" for hz in (0.8, 1.2, 1.6))

    def square(history):
        return 0.5 * sum(float(history[name][0]) ** 2 for name in names)

    def slopes(history):
        return np.array([history[name] for name in names])

    squares = ff.Functional("squares", names, square, slopes)
    found = ff.gradient(shaft, [squares, *names], values, ff.LinearOptions(), comm=SELF)
    for name in values:
        expected = sum(found.value[one] * found.gradient[one][name] for one in names)
        # one gain left out, or taken twice, is off by a third
        assert found.gradient["squares"][name] == pytest.approx(expected, rel=1e-12)
    assert found.value["squares"] == pytest.approx(square(found.history), rel=1e-12)
