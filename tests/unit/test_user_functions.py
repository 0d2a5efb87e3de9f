# SPDX-License-Identifier: LGPL-3.0-or-later
"""Users' functions in joints and force elements: derivatives, and what is refused how."""

import collections
import math
from collections.abc import Callable
from itertools import product

import numpy as np
import pytest
from numba import njit

import flexfem as ff
from flexfem._faults import FunctionError
from flexfem.analyses.dynamics import RunOptions
from flexfem.kernels.users.hyperdual import component, hyperdual
from flexfem.simulation.motion.stepping import Simulation
from tests.unit.refusals import assert_on_page, assert_refused

pytestmark = pytest.mark.serial

A, B = ff.Marker("one"), ff.Marker("two", offset=(0.3, 0.1, 0.2))

FUNCTIONS = {
    "polynomial": lambda x, y: 3 * x**2 * y - x / y + 2.0 - y**3,
    "trigonometric": lambda x, y: np.sin(x * y) + math.cos(y) * np.tan(x) + math.atan2(y, x),
    "inverse": lambda x, y: math.asin(x / 3) + np.arccos(y / 4) + np.arctan2(x, 2.0) + math.atan(x),
    "powers": lambda x, y: math.exp(-x * y) + np.log(y) + math.sqrt(x) + x**1.5 + x**y + 2.0**x,
    "hyperbolic": lambda x, y: math.tanh(x) * np.sinh(y) + np.cosh(x * y) + math.hypot(x, y),
    "choices": lambda x, y: (
        max(x, y) * min(x, 1.0) + abs(-x) * np.maximum(x, 0.1) + (x * y if x > 0.2 else y)
    ),
    "others": lambda x, y: np.log1p(x) * np.square(y) - np.abs(y) + math.expm1(x) * np.sign(-y),
    "constant": lambda x, y: 2,
}


@pytest.mark.parametrize("function", FUNCTIONS.values(), ids=FUNCTIONS)
def test_derivatives_of_functions(function: Callable[[float, float], float]) -> None:
    compiled, h = njit(function), 1e-3

    @njit
    def derivatives(x, y, i, j):
        first, second = hyperdual(x, i, j, 0.0), hyperdual(y, 1.0 - i, 1.0 - j, 0.0)
        found = component(compiled(first, second), 0)
        return found.value, found.first, found.mixed

    e = np.eye(2)
    for at in np.array([0.7, 1.3]), np.array([0.4, 0.6]):
        for i, j in product(range(2), repeat=2):
            value, slope, mixed = derivatives(*at, 1.0 - i, 1.0 - j)
            assert value == pytest.approx(function(*at), rel=1e-15)
            ends = [function(*(at + s * h * e[i])) for s in (1, -1, 2, -2)]
            difference = (8 * (ends[0] - ends[1]) - (ends[2] - ends[3])) / (12 * h)
            assert slope == pytest.approx(difference, rel=1e-9, abs=1e-9)
            corners = [
                a * b * function(*(at + h * (a * e[i] + b * e[j])))
                for a in (1, -1)
                for b in (1, -1)
            ]
            # of second order in h; a factor left out is of order 1
            assert mixed == pytest.approx(sum(corners) / (4 * h * h), rel=1e-4, abs=1e-5)


ALONE = {
    "no function": (lambda: ff.CustomForce("j", A, B, force=3.0), "by def or lambda, got 3.0"),
    "object": (
        lambda: ff.CustomForce("j", A, B, force=ff.Table([0, 1], [0, 1])), "by def or lambda, got"
    ),
    "arguments": (
        lambda: ff.CustomForce("j", A, B, force=lambda x: x),
        r"force must be a function of \(x, v\[, t\]\[, parameters\]\), got one of 1 arg",
    ),
    "any arguments": (lambda: ff.CustomJoint("j", A, B, function=lambda *x: x), "got one of -1"),
    "parameters": (
        lambda: ff.CustomJoint("j", A, B, function=lambda p, R: p, parameters="k"), "parameters"
    ),
    "many": (
        lambda: ff.CustomJoint("j", A, B, function=lambda p, R: p, parameters=(1.0,) * 9),
        "at most 8 numbers, got 9",
    ),
    "motion": (lambda: ff.CustomForce("j", A, B, motion="turn"), "motion must be one of .*turn"),
    "friction": (
        lambda: ff.JointFriction("j", ff.Revolute("hinge", A, B), force=lambda: 1.0),
        r"force must be a function of \(speed\), got one of 0",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("make", "message"), ALONE.values(), ids=ALONE)
def test_refused_when_made(make: Callable[[], object], message: str) -> None:
    assert_refused(make, message)


def _bad_index(p, R):
    return p[3]


def _text(p, R):
    return f"{p}"


def _bent(x, v):
    return 1e6 * v * abs(v) + 0.1 * max(x - math.sqrt(0.14), 0.0)


def _not_compiled(p, R):
    import fractions

    return float(fractions.Fraction(p[0])) * 0.0


IN_MODEL = {
    "raises": (ff.CustomJoint("j", A, B, function=_bad_index), "_bad_index .*line .*IndexError"),
    "text": (ff.CustomJoint("j", A, B, function=_text), "function must return a number, got"),
    "shape": (
        ff.CustomForce("j", A, B, force=lambda x, v: (x, v)), "must return a number, got shape"
    ),
    "not a number": (
        ff.CustomForce("j", A, B, force=lambda x, v: x * np.nan), "finite derivatives at the start"
    ),
    "no slope": (
        ff.CustomForce("j", A, B, force=lambda x, v: math.sqrt(abs(v))), "finite derivatives at"
    ),
    "jump": (
        ff.CustomForce("j", A, B, force=lambda x, v: 1.0 if v > 0.0 else -1.0),
        "differ from differences .*is there a jump",
    ),
    "corner": (
        ff.CustomForce("j", A, B, force=lambda x, v: 40.0 * max(v, 0.0)),
        "differ from differences .*a corner",
    ),
    "corner nearby": (
        ff.CustomForce("j", A, B, force=lambda x, v: 40.0 * max(v - 1e-7, 0.0)),
        "differ from differences .*a corner",
    ),
    "corner on a parabola": (
        ff.CustomForce("j", A, B, force=lambda x, v: 1e4 * v * abs(v) + 0.1 * max(v, 0.0)),
        "differ from differences .*a corner",
    ),
    "corner beside a parabola": (
        ff.CustomForce("j", A, B, force=_bent),
        "differ from differences .*a corner",
    ),
    "not compiled": (
        ff.CustomJoint("j", A, B, function=_not_compiled),
        r"_not_compiled \(test_user_functions.py, line \d+\) cannot be compiled",
    ),
}  # fmt: skip


def _model(*things: object) -> ff.Model:
    model = ff.Model("test")
    model.add(ff.RigidBody("one", 1.0, (1, 1, 1)), ff.RigidBody("two", 1.0, (1, 1, 1)), *things)
    return model


@pytest.mark.parametrize(("joint", "message"), IN_MODEL.values(), ids=IN_MODEL)
def test_refused_in_a_model(joint: object, message: str) -> None:
    with pytest.raises(ValueError, match=message) as raised:
        Simulation(_model(joint), RunOptions(dt=1e-3, t_end=1.0))
    assert "\n" not in str(raised.value)
    assert_on_page(str(raised.value))


def _drag(x, v, t, parameters):
    return parameters[0] * v * abs(v)


def _hertz(x, v, t, parameters):
    return -parameters[0] * max(1.0 - x, 0.0) ** 1.5


@pytest.mark.parametrize("drag", [0.5, 500.0])
def test_quadratic_drag(drag: float) -> None:
    """Smooth, though its second derivative jumps at rest: ``x = m/c log(1 + c v t/m)``."""
    model, end = ff.Model("drag"), 0.02
    model.add(
        ff.RigidBody("one", 2.0, (1, 1, 1), velocity=(3.0, 0.0, 0.0)),
        ff.CustomForce("j", ff.Ground(), A, (1.0, 0.0, 0.0), "translation", _drag, (drag,)),
        ff.PositionProbe("at", A),
    )
    history = ff.simulate(model, RunOptions(dt=1e-5, t_end=end, quiet=True)).history
    way = 2.0 / drag * np.log1p(drag / 2.0 * 3.0 * end)
    # measured 3e-6 (500), of second order in the step
    assert history["at_x"][-1] == pytest.approx(way, rel=1e-5)


def test_hertz_law_that_just_touches() -> None:
    """Penetration of an impact: ``(5/4 m v^2 / k)^(2/5)``."""
    k, model = 1e8, ff.Model("hertz")
    model.add(
        ff.RigidBody("one", 2.0, (1, 1, 1), position=(1.0, 0.0, 0.0), velocity=(-3.0, 0.0, 0.0)),
        ff.CustomForce("j", ff.Ground(), A, (1.0, 0.0, 0.0), "translation", _hertz, (k,)),
        ff.PositionProbe("at", A),
    )
    history = ff.simulate(model, RunOptions(dt=2e-6, t_end=2e-3, quiet=True)).history
    deepest = 1.0 - history["at_x"].min()
    assert deepest == pytest.approx((1.25 * 2.0 * 9.0 / k) ** 0.4, rel=1e-4)


def _fails_later(x, v, t):
    return math.log(0.1 - t) - math.log(0.1)


def _vanishes_later(p, R):
    return math.sqrt(0.3 - p[2]) * 0.0 + p[0]


@pytest.mark.parametrize("joint", [
    ff.CustomForce("j", ff.Ground((1.0, 0.0, 0.0)), B, force=_fails_later),
    ff.CustomJoint("j", ff.Ground((0.3, 0.0, 0.0)), B, function=_vanishes_later),
], ids=["force", "joint"])  # fmt: skip
def test_failures_name_the_function(joint: object) -> None:
    """A later value that is not finite ends the run, with function, file and line."""
    model = _model(ff.Gravity((0.0, 0.0, 9.81)), joint)
    simulation = Simulation(model, RunOptions(dt=0.02, t_end=1.0))
    place = r"_later \(test_user_functions.py, line \d+\)"
    with pytest.raises(FunctionError, match=place) as told:
        collections.deque(simulation.advance(0.02) for _ in range(20))
    assert "math domain error" in str(told.value)
