# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arrays of parameters that act one after the other, as coefficients of splines over time."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.interpolate import BSpline

import flexfem as ff
from flexfem.gradients.gradient import Differentiation
from flexfem.gradients.motion.arrays import (
    SeparateInfluence,
    TimedInfluence,
    directions_of,
    influence_of,
)
from flexfem.gradients.motion.element_arrays import ElementInfluence
from flexfem.gradients.motion.exactness import linearized
from flexfem.gradients.motion.records import Storage
from flexfem.gradients.motion.runs import forward
from flexfem.gradients.motion.trajectory import Motion

END = 0.1
OPTIONS = ff.RunOptions(dt=5e-3, t_end=END, rho_inf=0.8, quiet=True)
NUMBERS = ["rms:z", "final:v", "mean:torque"]
ONE = pytest.mark.serial  # ranks share nothing that another array of the same test does not


def local(values: np.ndarray) -> Callable[[float], float]:
    """Cubic spline of coefficients, four of which act at a time."""
    inner = np.linspace(0.0, END, len(values) - 2)
    spline = BSpline(np.concatenate([[0.0] * 3, inner, [END] * 3]), values, 3)
    return lambda t: float(spline(min(max(t, 0.0), END)))


def symmetric(values: np.ndarray) -> Callable[[float], float]:
    """Means of three values, each at a step: at its time the middle one counts twice."""
    times = np.linspace(0.0, END, len(values))
    means = np.convolve(np.pad(values, 1, mode="edge"), [0.25, 0.5, 0.25], mode="valid")
    return ff.Spline(times, means)


def knots(values: np.ndarray) -> Callable[[float], float]:
    """Bumps at times that are the parameters: they act one after the other, but move."""
    return lambda t: float((np.maximum(1.0 - ((t - values) / 7e-3) ** 2, 0.0) ** 3).sum())


class Pendulum:
    """A pendulum with a torque of some parameters; counts its models."""

    def __init__(self, torque: Callable[[np.ndarray], Callable[[float], float]]) -> None:
        self.torque, self.models = torque, 0

    def __call__(self, values: np.ndarray) -> ff.Model:
        self.models += 1
        force, model, bob = self.torque(values), ff.Model("pendulum"), ff.Marker("bob")
        hinge = ff.Ground(), ff.Marker("bob", offset=(-1.0, 0.0, 0.0))
        model.add(
            ff.Gravity((0.0, 0.0, -9.81)),
            ff.RigidBody("bob", 2.0, (0.1, 0.1, 0.1), position=(1.0, 0.0, 0.0)),
            ff.Revolute("hinge", *hinge, axis=(0.0, 1.0, 0.0)),
            ff.Actuator("drive", *hinge, axis=(0.0, 1.0, 0.0), force=force),
            ff.Probe("path", bob, ("z", "v"), lambda t, s: (s.position[2], s.velocity[0])),
            ff.Probe("power", (), ("torque",), lambda t: (force(t),)),
        )
        return model


@pytest.mark.three_ranks
@pytest.mark.parametrize(
    ("torque", "values", "few"),
    [
        (local, 1.0 + 3.0 * np.sin(np.arange(16.0)), True),
        pytest.param(
            symmetric, 1.0 + 3.0 * np.sin(np.arange(13.0)), False, marks=[ONE, pytest.mark.slow]
        ),
        pytest.param(knots, np.linspace(0.013, 0.088, 6), False, marks=[ONE, pytest.mark.slow]),
    ],
)
def test_gradient_by_what_acts_one_after_the_other(
    torque: Callable[[np.ndarray], Callable[[float], float]], values: np.ndarray, few: bool
) -> None:
    """Agrees with the linearised motion, in which each entry has models of its own.

    An entry that is taken for its neighbour, or a column that lacks its own dependence at times
    between the start and the end, is off by a tenth and more.
    """
    build = Pendulum(torque)
    differentiation = Differentiation(build, NUMBERS, OPTIONS)
    differentiation.at({"values": values})
    build.models = 0
    found = differentiation.at({"values": 0.9 * values})
    # two models for each of four groups, and the one of the motion
    assert (build.models == 9) is few
    along = np.cos(3.0 * np.arange(len(values)))
    moved = ff.tangent_motion(build, {"values": 0.9 * values}, {"values": along}, OPTIONS)
    if not moved.derivative:
        return
    history, by = moved.history, moved.derivative
    expected = {
        "rms:z": np.trapezoid(history["z"] * by["z"], dx=1.0 / (len(history["t"]) - 1))
        / found.value["rms:z"],
        "final:v": by["v"][-1],
        "mean:torque": np.trapezoid(by["torque"], dx=1.0 / (len(history["t"]) - 1)),
    }
    for name, value in expected.items():
        own = np.asarray(found.gradient[name]["values"])
        # rounding of differences of 1e-5 of the entries
        assert own @ along == pytest.approx(value, abs=1e-7 * np.abs(own).sum()), name


def rod(heights: np.ndarray) -> ff.Model:
    """A rod that swings, by the heights of its elements: mass, inertia and stiffness."""
    count = len(heights)
    x = np.linspace(0.0, 0.5, count + 1)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    cells = np.array([[i, i + 1] for i in range(count)])
    model = ff.Model("rod", mesh=ff.LineMesh(x, cells, {"rod": np.arange(count)}))
    rubber, tip = ff.Material(5e6, 0.3, 1100.0), ff.Marker("rod", "end")

    def section(s: float) -> ff.Section:
        return ff.Section.rectangle(0.03, heights[min(int(s / 0.5 * count), count - 1)], rubber)

    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Beam("rod", section),
        ff.Revolute("hinge", ff.Ground(), ff.Marker("rod", "start"), axis=(0.0, 1.0, 0.0)),
        ff.Probe("tip", tip, ("z", "v"), lambda t, s: (s.position[2], s.velocity[2])),
        ff.Probe("none", (), ("torque",), lambda t: (0.0,)),
    )
    return model


@pytest.mark.parametrize(
    ("build", "values", "kind"),
    [
        pytest.param(
            rod, np.linspace(0.02, 0.03, 8), ElementInfluence, marks=pytest.mark.slow_on_ranks
        ),
        pytest.param(
            Pendulum(local),
            1.0 + 3.0 * np.sin(np.arange(16.0)),
            TimedInfluence,
            marks=[ONE, pytest.mark.slow],
        ),
    ],
)
def test_directions_of_an_array_share_its_models(
    build: Callable[[np.ndarray], ff.Model], values: np.ndarray, kind: type
) -> None:
    """Columns along each entry are those with models of its own.

    Without the change of the accelerations of the start, or with that of another entry, they are
    off in the first digit.
    """
    motion = Motion(build(values), OPTIONS, None, Storage())
    linear, given = linearized(motion, 1e-9), {"values": values}

    def of(**own: np.ndarray) -> ff.Model:
        return build(own["values"])

    shared = influence_of(motion, of, given, "values", {})
    assert isinstance(shared, kind)
    found = []
    for influence in (shared, SeparateInfluence(motion, of, given, "values")):
        directions = [[(one, 1.0)] for one in directions_of(motion, influence)]
        found.append(forward(motion, linear, ["z", "v", "torque"], directions))
    for own, expected in zip(found[0].T, found[1].T, strict=True):
        # rounding of differences of 1e-5 of the entries
        np.testing.assert_allclose(own, expected, atol=1e-8 * np.abs(expected).max())
    assert np.abs(found[0][:, :3, 1]).max() > 1e-6 * np.abs(found[0][..., 1]).max()


@pytest.mark.serial
def test_entries_that_must_be_positive():
    """Four of them are also tried as those that act one after the other, far from their values."""

    def build(youngs: np.ndarray) -> ff.Model:
        def section(s: float) -> ff.Section:
            material = ff.Material(youngs[min(int(8.0 * s), 3)], 0.3, 1100.0)
            return ff.Section.rectangle(0.03, 0.02, material)

        mesh = ff.LineMesh.straight({"rod": [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0)]}, elements=4)
        model = ff.Model("rod", mesh=mesh)
        model.add(
            ff.Gravity((0.0, 0.0, -9.81)),
            ff.Beam("rod", section),
            ff.Revolute("hinge", ff.Ground(), ff.Marker("rod", "start"), axis=(0.0, 1.0, 0.0)),
            ff.PositionProbe("tip", ff.Marker("rod", "end")),
        )
        return model

    options, name = ff.RunOptions(dt=1e-3, t_end=5e-3, tolerance=1e-13), "final:tip_z"
    each = ff.gradient(build, name, {"youngs": np.full(4, 5e6)}, options)
    one = ff.gradient(lambda youngs: build(np.full(4, youngs)), name, {"youngs": 5e6}, options)
    # one that is left out, or counts for its neighbour, is a tenth at least
    total = each.gradient[name]["youngs"].sum()
    assert total == pytest.approx(one.gradient[name]["youngs"], rel=1e-6)


@pytest.mark.serial
def test_arrays_alone_are_not_checked() -> None:
    """No number to go along: a difference of zero would say that all digits agree."""

    def build(mass: np.ndarray) -> ff.Model:
        model = ff.Model("weight")
        model.add(
            ff.RigidBody("bob", mass[0], (0.1, 0.1, 0.1)),
            ff.PointForce("push", ff.Marker("bob"), (1.0, 0.0, 0.0)),
            ff.PositionProbe("path", ff.Marker("bob")),
        )
        return model

    options = ff.RunOptions(dt=0.01, t_end=0.02)
    found = ff.gradient(build, "final:path_x", {"mass": [2.0]}, options, check=True)
    assert found.gradient["final:path_x"]["mass"][0] < 0.0
    assert found.check == {}
