# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients over what the package has: a load or a scheme that is new is tested, or fails here.

Joints and drives are those of ``joint_examples``, which has an example of each.
"""

import inspect
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
import pytest

import flexfem as ff
from flexfem._checks import InputError
from flexfem.analyses.dynamics import INTEGRATORS
from flexfem.core.load import Load
from tests.contract.gradient_examples import KINDS, LENGTH, NUMBERS, PARTS, body, mechanism
from tests.contract.test_gradients import moved_values

pytestmark = pytest.mark.serial

Build = Callable[..., ff.Model]
RUBBER = ff.Material(5e6, 0.3, 1100.0)
#: Relative steps of Taylor's formula: less are lost in rounding, more have terms of third order.
STEPS = (1e-5, 1e-3, 1e-1)
#: Sizes of loads by class: of the points and the line of a rod, on a shell and on a solid.
LOADS: Mapping[str, Mapping[str, float]] = {
    "rod": {"PointForce": 0.5, "PointMoment": 0.05, "LineLoad": 2.0},
    "shell": {"EdgeLoad": 5.0, "SurfaceLoad": 30.0, "Pressure": 40.0},
    "solid": {"SurfaceTraction": 200.0, "SurfacePressure": 300.0},
}


def loaded(kind: str, **sizes: float) -> ff.Model:
    """A body with all loads of its kind, which turn it, so that followers are seen."""
    model, tip = _thing(kind)
    random = np.random.default_rng(3)
    for name, size in sizes.items():
        given = size * random.uniform(0.5, 1.0, 3)
        model.add(
            {
                "PointForce": lambda v: ff.PointForce("force", tip, v, follower=True),
                "PointMoment": lambda v: ff.PointMoment("moment", tip, v, follower=True),
                "LineLoad": lambda v: ff.LineLoad(
                    "line", "body", v, moment_per_length=0.01 * v, follower=True
                ),
                "EdgeLoad": lambda v: ff.EdgeLoad(
                    "edge", "body", "body_right", v, moment_per_length=0.01 * v[0]
                ),
                "SurfaceLoad": lambda v: ff.SurfaceLoad("area", "body", v),
                "Pressure": lambda v: ff.Pressure("gas", "body", float(v[0])),
                "SurfaceTraction": lambda v: ff.SurfaceTraction("pull", "body", "x1", v),
                "SurfacePressure": lambda v: ff.SurfacePressure("water", "body", "x1", v[0]),
            }[name](given)
        )
    model.add(ff.Probe("speed", tip, ("speed",), lambda t, end: (end.velocity @ end.velocity,)))
    return model


def _thing(kind: str) -> tuple[ff.Model, ff.Marker]:
    """A clamped body, and a marker at its other end."""
    if kind == "solid":
        mesh = ff.SolidMesh.box((LENGTH, 0.03, 0.02), (4, 1, 1))
        solid = ff.Solid(
            "body", ff.laws.NeoHookean(2e6, 4e6), mesh, density=1100.0, degree=1,
            fixed={"x0": "xyz"},
        )  # fmt: skip
        model = ff.Model("solid")
        model.add(solid)
        return model, ff.Marker("body", (LENGTH, 0.03, 0.02))
    if kind == "shell":
        surface = ff.SurfaceMesh.rectangle("body", (LENGTH, 0.1), (4, 2))
        model = ff.Model("shell", surface=surface)
        section = ff.ShellSection.isotropic(0.01, RUBBER)
        model.add(ff.Shell("body", section, edges={"body_left": "clamped"}))
        return model, ff.Marker("body", "body_bottom_right")
    mesh = ff.LineMesh.straight({"body": [(0.0, 0.0, 0.0), (LENGTH, 0.0, 0.0)]}, elements=4)
    model = ff.Model("rod", mesh=mesh)
    model.add(
        ff.Beam("body", ff.Section.rectangle(0.03, 0.02, RUBBER)),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("body", "start")),
    )
    return model, ff.Marker("body", "end")


def check(
    build: Build, numbers: Mapping[str, float], of: str, options: ff.RunOptions,
    steps: tuple[float, ...] = STEPS,
) -> None:  # fmt: skip
    """Tangent and adjoint agree, and the remainder of Taylor's formula is of second order."""
    found = ff.gradient(build, of, numbers, options, accuracy=1e-13, check=True)
    # what only one of both has, or has without its transposed, gives 1e-8 and more
    assert found.check[of] < 1e-12
    slope = sum(found.gradient[of][name] * value for name, value in numbers.items())
    remainders = []
    for step in steps:
        moved = {name: value * (1.0 + step) for name, value in numbers.items()}
        (value,) = moved_values(build, moved, [of], options)
        remainders.append(abs(value - found.value[of] - step * slope))
    # a gradient that is wrong by 1e-6 leaves a remainder of first order that is a tenth of that of
    # second order after a step of 1e-5: a slope of 1.98
    slopes = np.diff(np.log(remainders)) / np.diff(np.log(steps))
    assert slopes == pytest.approx(2.0, abs=0.02)


def test_each_load_has_sizes() -> None:
    """One of the package without them would have gradients that nothing compares."""
    public = [getattr(ff, name) for name in ff.__all__]
    classes = {
        one.__name__
        for one in public
        if inspect.isclass(one) and issubclass(one, Load) and not inspect.isabstract(one)
    }
    assert classes - {"Load"} == {name for sizes in LOADS.values() for name in sizes}


@pytest.mark.parametrize("kind", LOADS)
def test_loads(kind: str) -> None:
    """All of a kind of body act at once: the square of a speed has products of any two."""
    options = ff.RunOptions(dt=2e-3, t_end=8e-3, tolerance=1e-13)
    check(partial(loaded, kind), LOADS[kind], "mean:speed", options)


def schemes(
    build: Build, numbers: Mapping[str, float], of: str, name: str,
    steps: tuple[float, ...] = STEPS,
) -> None:  # fmt: skip
    """A scheme has right gradients, or says that it has none."""
    options = ff.RunOptions(dt=1e-3, t_end=4e-3, tolerance=1e-13, integrator=name)
    try:
        ff.gradient(build, of, numbers, options)
    except InputError as error:
        if "integrator" not in str(error):
            raise
        assert name != "generalized_alpha"
        return
    check(build, numbers, of, options, steps)


@pytest.mark.parametrize("name", INTEGRATORS)
def test_integrators(name: str) -> None:
    """With springs, drives, loads and masses."""
    schemes(mechanism, PARTS, "mean:p_z", name)


@pytest.mark.slow
@pytest.mark.parametrize("name", INTEGRATORS)
@pytest.mark.parametrize("kind", KINDS)
def test_integrators_of_all_families(name: str, kind: str) -> None:
    # some of these numbers are nearly linear, and in solids with more rounding
    steps = (1e-4, 2e-3, 3e-2) if kind == "solid" else (1e-5, 1e-3, 3e-2)
    schemes(partial(body, kind), NUMBERS, "mean:speed", name, steps)
