# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of equilibria, frequencies and buckling loads: differences, closed forms, ranks."""

import math
from collections.abc import Callable
from functools import cache, partial

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.cli import load_case
from flexfem.gradients.motion.parameters import model_with

COMM, SELF = MPI.COMM_WORLD, MPI.COMM_SELF
STATICS = ff.StaticOptions(load_steps=2, tolerance=1e-10, split_above=1, quiet=True)
COLUMNS = ["final:tip_z", "rms:tip_z", "final:tip_x"]


def beam(youngs=5e6, length=0.5, width=0.03, force=0.03, density=1100.0) -> ff.Model:
    """A cantilever that bends by a fifth of its length."""
    mesh = ff.LineMesh.straight({"rod": [(0.0, 0.0, 0.0), (length, 0.0, 0.0)]}, elements=4)
    root, end = ff.Marker("rod", "start"), ff.Marker("rod", "end")
    section = ff.Section.rectangle(width, 0.02, ff.Material(youngs, 0.3, density))
    model = ff.Model("beam", mesh=mesh)
    model.add(
        ff.Beam("rod", section, orientation=(0.0, 1.0, 0.0)),
        ff.Rigid("clamp", ff.Ground(), root),
        ff.PointForce("push", end, (0.0, 0.0, -10.0 * force)),
        ff.PositionProbe("tip", end),
    )
    return model


def shell(
    youngs=2e9, length=1.0, thickness=0.02, force=30.0, density=1000.0, element="rotation_free"
) -> ff.Model:
    """A strip whose clamped nodes move with nothing, the others with its length."""
    surface = ff.SurfaceMesh.grid("strip", np.linspace(0.0, length, 4), [0.0, 0.15, 0.3])
    section = ff.ShellSection.isotropic(thickness, ff.Material(youngs, 0.3, density))
    corner = ff.Marker("strip", "strip_top_right")
    model = ff.Model("shell", surface=surface)
    model.add(
        ff.Shell("strip", section, element=element, edges={"strip_left": "clamped"}),
        ff.PointForce("lift", corner, (0.0, 0.0, force)),
        ff.PositionProbe("tip", corner),
    )
    return model


def solid(youngs=1e6, poisson=0.3, length=1.0, force=200.0, density=1000.0) -> ff.Model:
    """A bar held at the far side, whose fixed nodes move with its length, with a plate."""
    mesh = ff.SolidMesh.box((length, 0.1, 0.08), (4, 1, 1), "tetrahedron")
    law = ff.laws.NeoHookean.from_young(youngs, poisson)
    bar = ff.Solid("bar", law, mesh, density=density, degree=1, fixed={"x1": "xyz"})
    plate = ff.Marker("plate")
    model = ff.Model("solid")
    model.add(
        bar,
        ff.RigidBody("plate", 0.1, 0.01 * np.eye(3), position=(0.0, 0.05, 0.04)),
        ff.RigidPoints("bond", plate, nodes=bar.node_markers("x0")),
        ff.SurfaceTraction("lift", "bar", "x0", (0.0, 0.0, force)),
        ff.PositionProbe("tip", plate),
    )
    return model


def rigid(stiffness=100.0, damping=0.3, mass=2.0, gravity=9.81, rest=0.4, arm=0.5) -> ff.Model:
    """A pendulum held up by a spring with a damper."""
    bob = ff.Marker("bob")
    model = ff.Model("rigid")
    model.add(
        ff.Gravity((0.0, 0.0, -gravity)),
        ff.RigidBody("bob", mass, (0.1, 0.2, 0.15), position=(arm, 0.0, 0.0)),
        ff.Revolute("pin", ff.Ground(), ff.Marker("bob", offset=(-arm, 0.0, 0.0)), axis=(0, 1, 0)),
        ff.SpringDamper(
            "spring", ff.Ground((arm, 0.0, 0.5)), bob, stiffness, damping, rest_length=rest
        ),
        ff.PositionProbe("tip", bob),
    )
    return model


def slider(youngs=2e9, stiffness=200.0, load=5.0) -> ff.Model:
    """A bead that a spring holds on an inclined wire; it goes over several elements."""
    mesh = ff.LineMesh.straight({"wire": [(0.0, 0.0, 0.0), (1.0, 0.0, -0.2)]}, elements=6)
    section = ff.Section.rectangle(0.02, 0.01, ff.Material(youngs, 0.3, 1000.0))
    wire, bead = ff.Carrier("wire"), ff.Marker("bead")
    model = ff.Model("slider", mesh=mesh)
    model.add(
        ff.Beam("wire", section, orientation=(0.0, 1.0, 0.0)),
        ff.Rigid("first", ff.Ground(), ff.Marker("wire", "start")),
        ff.Rigid("last", ff.Ground((1.0, 0.0, -0.2)), ff.Marker("wire", "end")),
        ff.RigidBody("bead", 1.0, 1e-3 * np.eye(3), position=(0.45, 0.0, -0.09)),
        ff.Sliding("slide", wire, bead, tied=True),
        ff.SpringDamper("spring", ff.Ground((0.0, 0.0, 0.1)), bead, stiffness, rest_length=0.4),
        ff.PointForce("push", bead, (0.0, 0.0, -3.0 * load)),
        ff.PositionProbe("tip", bead),
    )
    return model


#: Parameters of each kind: stiffness, shape, load.
MODELS: dict[str, tuple[Callable[..., ff.Model], dict[str, float]]] = {
    "beam": (beam, {"youngs": 5e6, "length": 0.5, "force": 0.03}),
    "shell": (shell, {"thickness": 0.02, "length": 1.0, "force": 30.0}),
    "director": (partial(shell, element="director"), {"thickness": 0.02, "force": 30.0}),
    "solid": (solid, {"poisson": 0.3, "length": 1.0}),
    "slider": (slider, {"youngs": 2e9, "stiffness": 200.0}),
    "rigid": (rigid, {"stiffness": 100.0, "damping": 0.3, "rest": 0.4, "arm": 0.5}),
}


def _modes(kind: str, start: str) -> tuple[ff.ModeOptions, list[str]]:
    count = 1 if kind == "rigid" else 2
    options = ff.ModeOptions(modes=count, start=start, split_above=1, frames=0, quiet=True)
    more = ["damping:1"] if kind == "rigid" else []
    return options, [*(f"frequency:{k + 1}" for k in range(count)), *more]


@cache
def found(kind: str, analysis: str, *, shared: bool = False) -> ff.Gradient:
    """The gradient, by each rank alone or by all together."""
    (build, values), comm = MODELS[kind], COMM if shared else SELF
    if analysis == "statics":
        return ff.gradient(build, COLUMNS, values, STATICS, comm=comm)
    options, of = _modes(kind, analysis)
    return ff.gradient(build, of, values, options, comm=comm)


def numbers(kind: str, analysis: str, values: dict[str, float]) -> list[float]:
    """The same numbers by an ordinary run."""
    model = MODELS[kind][0](**values)
    if analysis == "statics":
        history = ff.solve_static(model, STATICS, comm=SELF).history
        t, z = history["t"], history["tip_z"]
        rms = math.sqrt(np.trapezoid(z**2, t) / (t[-1] - t[0]))
        return [z[-1], rms, history["tip_x"][-1]]
    modes = ff.find_modes(model, _modes(kind, analysis)[0], comm=SELF).modes
    return [*modes.frequencies, *(modes.damping if kind == "rigid" else ())]


ANALYSES = [(kind, "statics") for kind in MODELS]
ANALYSES += [
    ("beam", "equilibrium"),
    ("shell", "equilibrium"),
    ("director", "equilibrium"),
    ("solid", "rest"),
    ("rigid", "equilibrium"),
]


@pytest.mark.serial
@pytest.mark.parametrize(("kind", "analysis"), ANALYSES)
def test_gradient_is_that_of_differences(kind, analysis):
    """Of fourth order, over two runs on each side.

    The statics of the solid lacks its fixed nodes, and modes about equilibria the change of these,
    if parameters are taken for those of a fixed state: errors of 1e-3 to 1.
    """
    gradient, values, step = found(kind, analysis), MODELS[kind][1], 3e-3
    for name, value in values.items():
        runs = [
            np.array(numbers(kind, analysis, {**values, name: value * (1.0 + k * step)}))
            for k in (-2, -1, 1, 2)
        ]
        expected = (runs[0] - 8.0 * runs[1] + 8.0 * runs[2] - runs[3]) / (12.0 * step * value)
        scale = np.abs(np.array(list(gradient.value.values()))) / value + np.abs(expected)
        own = np.array([by[name] for by in gradient.gradient.values()])
        errors = np.abs(own - expected) / np.where(scale == 0.0, 1.0, scale)
        assert errors.max() < 1e-7, (name, errors)


@pytest.mark.several_ranks
@pytest.mark.parametrize(
    ("kind", "analysis"),
    [
        ("solid", "statics"),
        ("rigid", "statics"),
        ("beam", "equilibrium"),
        pytest.param("shell", "equilibrium", marks=pytest.mark.slow_on_ranks),
        pytest.param("shell", "statics", marks=pytest.mark.slow_on_ranks),
        pytest.param("rigid", "equilibrium", marks=pytest.mark.slow_on_ranks),
        pytest.param("director", "equilibrium", marks=pytest.mark.three_ranks),
        pytest.param("column", "buckling", marks=pytest.mark.three_ranks),
    ],
)
def test_gradient_is_the_same_on_ranks(kind, analysis):
    """Of bodies that are split; a sum that a rank lacks or counts twice changes the first digit.

    Matrices at a distance of 2e-3 leave 5e-9 of rounding in frequencies and buckling loads.
    """
    if kind == "column":
        values = {"youngs": 2.1e11, "length": 1.0}
        alone, shared = (
            ff.gradient(
                lambda **own: column(np.full(2, 2e-4), **own), ["buckling:1", "final:shortening"],
                values,
                ff.StaticOptions(load_steps=1, buckling_modes=1, split_above=1, quiet=True),
                comm=comm,
            )
            for comm in (SELF, COMM)
        )  # fmt: skip
    else:
        alone, shared = found(kind, analysis), found(kind, analysis, shared=True)
        values = MODELS[kind][1]
    for name, own in shared.gradient.items():
        assert shared.value[name] == pytest.approx(alone.value[name], rel=1e-9, abs=1e-12)
        for parameter, value in values.items():
            size, scale = abs(alone.gradient[name][parameter]), abs(alone.value[name] / value)
            error = abs(own[parameter] - alone.gradient[name][parameter])
            # by parameters without influence rounding of the columns is left
            limit = 1e-9 * size + 1e-13 * scale if analysis == "statics" else 1e-9 * (size + scale)
            assert error <= limit


def relative(gradient: ff.Gradient, name: str, values: dict[str, float]) -> dict[str, float]:
    """Logarithmic derivatives."""
    by = gradient.gradient[name]
    return {p: by[p] * value / gradient.value[name] for p, value in values.items()}


@pytest.mark.serial
def test_deflection_and_frequency_of_a_cantilever():
    """``P L^3/(3 E I)`` and ``sqrt(E I/(rho A))/L^2``, up to shear and large deflections.

    Both scale with E and P, or with E and rho, alone, whatever the mesh: exact sums.
    """
    values = {
        "youngs": 5e6, "length": 0.5, "width": 0.03, "force": 3e-5, "density": 1100.0,
    }  # fmt: skip
    tip = relative(
        ff.gradient(beam, "final:tip_z", values, STATICS, comm=SELF), "final:tip_z", values
    )
    assert tip["youngs"] == pytest.approx(-1.0, abs=1e-4)
    assert tip["force"] + tip["youngs"] == pytest.approx(0.0, abs=1e-9)
    assert tip["length"] == pytest.approx(3.0, abs=0.01)
    assert tip["width"] == pytest.approx(-1.0, abs=1e-4)
    assert tip["density"] == pytest.approx(0.0, abs=1e-12)
    options, of = _modes("beam", "rest")
    values["force"] = 1e-12
    gradient = ff.gradient(beam, of, values, options, comm=SELF)
    first = relative(gradient, "frequency:1", values)
    assert first["youngs"] == pytest.approx(0.5, abs=1e-8)
    assert first["density"] == pytest.approx(-0.5, abs=1e-8)
    assert first["length"] == pytest.approx(-2.0, abs=0.01)
    assert first["width"] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.slow_on_ranks
@pytest.mark.three_ranks
def test_means_of_equal_frequencies_and_buckling_loads():
    """A square cantilever: the width acts on one of each pair, by ``b`` and by ``b^3``."""

    def build(width, youngs, force=1.0):
        mesh = ff.LineMesh.straight({"rod": [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0)]}, elements=8)
        model, steel = ff.Model("rod", mesh=mesh), ff.Material(youngs, 0.3, 7850.0)
        model.add(
            ff.Beam("rod", ff.Section.rectangle(width, 0.005, steel)),
            ff.Rigid("clamp", ff.Ground(), ff.Marker("rod", "start")),
            ff.PointForce("push", ff.Marker("rod", "end"), (-force, 0.0, 0.0)),
        )
        return model

    values = {"width": 0.005, "youngs": 2.1e11}
    options, mean = ff.ModeOptions(modes=2, frames=0, quiet=True), "frequency:1-2"
    free = partial(build, force=1e-9)
    sung = relative(ff.gradient(free, mean, values, options), mean, values)
    # a single vector of a pair gives any number from 0 to 1, and from 1 to 3
    assert sung["width"] == pytest.approx(0.5, abs=1e-3)
    assert sung["youngs"] == pytest.approx(0.5, abs=1e-6)
    load = ff.gradient(build, "buckling:1-2", values, BUCKLING)
    pressed = relative(load, "buckling:1-2", values)
    assert pressed["width"] == pytest.approx(0.5 * (1.0 + 3.0), abs=1e-3)
    assert pressed["youngs"] == pytest.approx(1.0, abs=1e-3)
    alone = relative(ff.gradient(free, mean, values, options, comm=SELF), mean, values)
    # vectors of which a rank misses a part are off by their size
    assert alone == pytest.approx(sung, abs=1e-6)


@pytest.mark.serial
def test_frequency_and_damping_of_a_spring():
    """One degree of freedom: ``w0 = a sqrt(k/J)`` and ``D = c a/(2 sqrt(k J))`` about its pin."""

    def build(stiffness, damping, mass):
        bob = ff.Marker("bob")
        model = ff.Model("rail")
        model.add(
            ff.RigidBody("bob", mass, np.eye(3), position=(1.0, 0.0, 0.0)),
            ff.Prismatic("rail", ff.Ground(), bob, axis=(1.0, 0.0, 0.0)),
            ff.SpringDamper("spring", ff.Ground(), bob, stiffness, damping),
        )
        return model

    k, c, m = 100.0, 6.0, 2.0
    options = ff.ModeOptions(modes=1, frames=0, quiet=True)
    of = ["frequency:1", "damping:1"]
    values = {"stiffness": k, "damping": c, "mass": m}
    gradient = ff.gradient(build, of, values, options, comm=SELF)
    size, ratio = math.sqrt(k / m), 0.5 * c / math.sqrt(k * m)
    damped = size * math.sqrt(1.0 - ratio**2) / (2.0 * math.pi)
    by_ratio = -ratio / (1.0 - ratio**2)  # of the logarithm of the frequency
    assert gradient.value["damping:1"] == pytest.approx(ratio, rel=1e-12)
    assert gradient.value["frequency:1"] == pytest.approx(damped, rel=1e-12)
    frequency, damping = (relative(gradient, name, values) for name in of)
    assert damping == pytest.approx({"stiffness": -0.5, "damping": 1.0, "mass": -0.5}, rel=1e-9)
    expected = {
        "stiffness": 0.5 - 0.5 * ratio * by_ratio, "damping": ratio * by_ratio,
        "mass": -0.5 - 0.5 * ratio * by_ratio,
    }  # fmt: skip
    assert frequency == pytest.approx(expected, rel=1e-9)


def blade(youngs, density, length) -> ff.Model:
    """A blade on a hub that a motor turns."""
    mesh = ff.LineMesh.straight({"blade": [(0.1, 0.0, 0.0), (0.1 + length, 0.0, 0.0)]}, elements=4)
    section = ff.Section.rectangle(0.03, 0.004, ff.Material(youngs, 0.3, density))
    hub = ff.Marker("hub")
    model = ff.Model("blade", mesh=mesh)
    model.add(
        ff.RigidBody("hub", 1.0, (1.0, 1.0, 1.0)),
        ff.Beam("blade", section, orientation=(0.0, 1.0, 0.0)),
        ff.Revolute("bearing", ff.Ground(), hub, axis=(0, 0, 1)),
        ff.PrescribedAngle("motor", ff.Ground(), hub, axis=(0, 0, 1)),
        ff.Rigid("root", ff.Marker("hub", offset=(0.1, 0.0, 0.0)), ff.Marker("blade", "start")),
    )
    return model


@pytest.mark.serial
def test_frequency_of_a_blade_in_steady_rotation():
    """Complex modes with gyroscopic forces about a stretched state; they depend on E/rho alone.

    Centrifugal forces stiffen the blade: without the change of the state, or with a left vector
    that is not the conjugate, it would be 1/2 or off by tenths.
    """
    options = ff.ModeOptions(modes=2, spin=30.0, frames=0, quiet=True)
    values = {"youngs": 1e9, "density": 1500.0, "length": 0.5}
    gradient = ff.gradient(blade, "frequency:1", values, options, comm=SELF)
    own = relative(gradient, "frequency:1", values)
    assert own["youngs"] + own["density"] == pytest.approx(0.0, abs=1e-8)
    assert 0.05 < own["youngs"] < 0.4
    for name in ("youngs", "length"):
        logarithms = [
            math.log(
                ff.find_modes(
                    blade(**{**values, name: values[name] * math.exp(2e-3 * k)}), options, comm=SELF
                ).modes.frequencies[0]
            )
            for k in (-2, -1, 1, 2)
        ]
        a, b, c, d = logarithms
        assert own[name] == pytest.approx((a - 8.0 * b + 8.0 * c - d) / (12.0 * 2e-3), abs=1e-7)


def column(areas, youngs=2.1e11, force=1000.0, length=1.0) -> ff.Model:
    """A pinned column of elements of the same length, twice as wide as high, under a load."""
    given = {"elements": 2 * len(areas), "grading": 1.0, "youngs_modulus": youngs, "length": length}
    options, _ = COLUMN.prepare(given)
    return model_with(COLUMN.build(**options).build(areas), **{"push.force[2]": -force})


COLUMN = load_case("optimal_column")
BUCKLING = ff.StaticOptions(load_steps=1, buckling_modes=2, quiet=True)


@pytest.mark.serial
def test_buckling_load_scales_with_stiffness_over_load():
    """The load factor depends on ``E/P`` alone, whatever the mesh.

    Matrices of a slender column at a distance of 2e-3 leave 2.6e-9 of rounding.
    """
    values = {"youngs": 2.1e11, "force": 1e3}
    build = partial(column, np.full(4, 2e-4))
    found = ff.gradient(build, ["buckling:1", "buckling:2"], values, BUCKLING, comm=SELF)
    for name in found.value:
        assert sum(relative(found, name, values).values()) == pytest.approx(0.0, abs=5e-10)


@pytest.mark.parametrize("beside", [10.0, pytest.param(1e5, marks=pytest.mark.serial)])
def test_buckling_load_of_springs_that_soften_is_linear_in_their_stiffness(beside: float):
    """k = dF/dx falls from k_0 to k_1: t = k_0/(k_0 - k_1), whatever springs another body has."""

    def build(k: float) -> ff.Model:
        axis, model = (0.0, 0.0, 1.0), ff.Model("softening")
        for name, x in (("body", 0.0), ("other", 1.0)):
            place, foot = ff.Ground((x, 0.0, 0.0)), ff.Ground((x, 0.0, -1.0))
            model.add(
                ff.RigidBody(name, 1.0, np.eye(3), position=place.position),
                ff.Prismatic(f"{name}_guide", place, ff.Marker(name), axis=axis),
                ff.SpringDamper(f"{name}_spring", foot, ff.Marker(name), k if x == 0.0 else beside),
            )
        body = ff.Marker("body")
        soft = ff.SpringDamper(
            "soft", ff.Ground((0.0, 0.0, -1.0)), body, force=lambda x: 1e3 * x - 4e3 * x**3
        )
        model.add(soft, ff.PointForce("pull", body, (0.0, 0.0, 100.0)))
        return model

    k = 500.0
    x = min(z.real for z in np.roots([-4e3, 0.0, 1e3 + k, -100.0]) if z.real > 0.0)
    fall = 12e3 * x**2
    load = (1e3 + k) / fall
    by_x = -2.0 * load / x
    expected = 1.0 / fall - by_x * x / (1e3 + k - fall)
    options = ff.StaticOptions(load_steps=2, buckling_modes=1, quiet=True)
    found = ff.gradient(build, "buckling:1", {"k": k}, options)
    # with equations of springs scaled by their stiffness and the largest: none, and 27.84
    assert found.value["buckling:1"] == pytest.approx(load, rel=1e-9)
    assert found.gradient["buckling:1"]["k"] == pytest.approx(expected, rel=1e-6)


@pytest.mark.serial
def test_buckling_load_of_a_column():
    """Euler's ``pi^2 E I/L^2 = pi^2 E A^2/(24 L^2)``; a half of each element's share of the energy.

    Shares of elements are those of ``sin^2(pi x/L)``, the squared bending moment.
    """
    count, area = 8, 2e-4
    values = {"areas": np.full(count // 2, area), "youngs": 2.1e11, "force": 1e3, "length": 1.0}
    found = ff.gradient(column, ["buckling:1", "buckling:2"], values, BUCKLING, comm=SELF)
    euler = math.pi**2 * 2.1e11 * area**2 / 24.0
    assert found.value["buckling:1"] == pytest.approx(euler / 1e3, rel=0.02)
    for name in found.value:
        by, value = found.gradient[name], found.value[name]
        # the strain before buckling is 2e-5
        assert by["youngs"] * 2.1e11 / value == pytest.approx(1.0, abs=1e-4)
        assert by["force"] * 1e3 / value == pytest.approx(-1.0, abs=1e-4)
        assert by["length"] / value == pytest.approx(-2.0, abs=0.02)
        assert by["areas"].sum() * area / value == pytest.approx(2.0, abs=0.02)
    x = np.linspace(0.0, 0.5, count // 2 + 1)
    shares = 2.0 * np.diff(2.0 * x - np.sin(2.0 * math.pi * x) / math.pi)
    own = found.gradient["buckling:1"]["areas"] * area / found.value["buckling:1"]
    # elements take the bending moment of their middle
    np.testing.assert_allclose(own, shares, atol=0.02)


def arch(youngs: float, rise: float, force: float) -> ff.Model:
    """A clamped arch of 1 m that snaps through under a force a little aside of straight down."""
    x = np.linspace(0.0, 1.0, 9)
    points = np.stack([x, 0.0 * x, 4.0 * rise * x * (1.0 - x)], axis=1)
    cells = np.array([[i, i + 1] for i in range(8)])
    mesh = ff.LineMesh(points, cells, {"arch": np.arange(8)}, {"crown": 4})
    section, crown = (
        ff.Section.rectangle(0.02, 0.01, ff.Material(youngs, 0.3, 1000.0)),
        ff.Marker("arch", "crown"),
    )
    model = ff.Model("arch", mesh=mesh)
    model.add(
        ff.Beam("arch", section, orientation=(0.0, 1.0, 0.0)),
        ff.Rigid("left", ff.Ground(), ff.Marker("arch", "start")),
        ff.Rigid("right", ff.Ground((1.0, 0.0, 0.0)), ff.Marker("arch", "end")),
        ff.PointForce("push", crown, (1e-3 * force, 0.0, -force)),
        ff.PositionProbe("crown", crown),
    )
    return model


@pytest.mark.serial
def test_load_at_which_a_column_has_a_value():
    """Beyond the limit point of an arch: the load is as E, the place does not depend on E.

    With the load factor taken for given the place would change, and the load would not.
    """
    options = ff.StaticOptions(
        arc_length=0.05, tolerance=1e-11, t_end=30.0, stop_column="crown_z", stop_value=-0.01,
        quiet=True,
    )  # fmt: skip
    values = {"youngs": 2e9, "rise": 0.05, "force": 40.0}
    of = ["final:t", "final:crown_x", "final:crown_z"]
    gradient = ff.gradient(arch, of, values, options, comm=SELF)
    load = relative(gradient, "final:t", values)
    assert load["youngs"] == pytest.approx(1.0, abs=1e-9)
    assert load["force"] == pytest.approx(-1.0, abs=1e-9)
    assert gradient.gradient["final:crown_z"] == pytest.approx(dict.fromkeys(values, 0.0), abs=1e-8)
    runs = []
    for k in (-2, -1, 1, 2):
        moved = arch(**{**values, "rise": 0.05 * (1.0 + 2e-3 * k)})
        history = ff.solve_static(moved, options, comm=SELF).history
        runs.append(np.array([history["t"][-1], history["crown_x"][-1]]))
    expected = (runs[0] - 8.0 * runs[1] + 8.0 * runs[2] - runs[3]) / (12.0 * 2e-3 * 0.05)
    own = [gradient.gradient[name]["rise"] for name in of[:2]]
    # the end is found to 1e-10 of a step; at a given load the place would be off by 1e-4
    np.testing.assert_allclose(own, expected, rtol=1e-6, atol=1e-8)


@pytest.mark.serial
def test_differences_suit_what_is_curved():
    """A bob that sinks by ``m g (1 - 2 p)``; beyond a half there is no spring.

    With four models as near as 3e-4 of the parameter the derivative is wrong by 2e-7. The load
    factor at the end is given.
    """

    def build(p):
        bob = ff.Marker("bob")
        model = ff.Model("rail")
        model.add(
            ff.Gravity((0.0, 0.0, -10.0)),
            ff.RigidBody("bob", 0.3, np.eye(3)),
            ff.Prismatic("rail", ff.Ground(), bob, axis=(0.0, 0.0, 1.0)),
            ff.SpringDamper(
                "spring", ff.Ground((0.0, 0.0, 1.0)), bob, 1.0 / (1.0 - 2.0 * p), rest_length=1.0
            ),
            ff.PositionProbe("place", bob),
        )
        return model

    found = ff.gradient(build, ["final:place_z", "final:t"], {"p": 0.495}, STATICS, comm=SELF)
    assert found.value["final:place_z"] == pytest.approx(-0.03, abs=1e-9)
    assert found.gradient["final:place_z"]["p"] == pytest.approx(6.0, rel=1e-8)
    alone = ff.gradient(build, "final:t", {"p": 0.495}, STATICS, comm=SELF)
    assert found.gradient["final:t"]["p"] == alone.gradient["final:t"]["p"] == 0.0


@pytest.mark.serial
def test_markers_that_move_with_a_parameter():
    """A probe beside its node, and on the ground: its column depends on the parameter directly."""

    def build(arm, height):
        model = beam()
        model.add(
            ff.RigidBody("bob", 1e-3, 1e-4 * np.eye(3), position=(0.5, 0.0, 0.0)),
            ff.Rigid("bond", ff.Marker("rod", "end"), ff.Marker("bob")),
            ff.Probe(
                "gap", [ff.Marker("bob", offset=(arm, 0.0, 0.0)), ff.Ground((0.0, 0.0, height))],
                ("gap",), lambda t, a, b: (float(a.position[2] - b.position[2]),),
            ),
        )  # fmt: skip
        return model

    found = ff.gradient(build, "final:gap", {"arm": 0.1, "height": 0.2}, STATICS, comm=SELF)
    by = found.gradient["final:gap"]
    # the place on the bob sinks by the sine of its angle; both would be zero without direct terms
    assert by["height"] == pytest.approx(-1.0, abs=1e-10)
    more = ff.gradient(build, "final:gap", {"arm": 0.2, "height": 0.2}, STATICS, comm=SELF)
    change = (more.value["final:gap"] - found.value["final:gap"]) / 0.1
    assert change < -0.01
    assert by["arm"] == pytest.approx(change, rel=1e-8)


@pytest.mark.serial
def test_minimisation_of_a_static_number():
    """The spring that holds the bob at a height, by gradients of one equilibrium each."""

    def build(stiffness):
        model = rigid(stiffness=stiffness)
        bob = ff.Marker("bob")
        square = ff.Probe(
            "miss", bob, ("miss",), lambda t, b: (100.0 * (b.position[2] + 0.05) ** 2,)
        )
        model.add(square)
        return model

    found = ff.minimize(build, "final:miss", {"stiffness": 100.0}, STATICS, comm=SELF)
    held = ff.solve_static(build(**found.values), STATICS, comm=SELF).history
    # a gradient that is wrong by a tenth ends elsewhere, or does not end
    assert found.success
    assert held["tip_z"][-1] == pytest.approx(-0.05, abs=1e-6)
