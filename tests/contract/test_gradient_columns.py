# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of measurements: strains, stresses, their largest value, markers between nodes."""

from functools import partial

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from tests.contract.test_gradients import errors

NUMBERS = {"youngs": 5e6, "height": 0.02, "gravity": 9.81}
LENGTH, WIDTH = 0.5, 0.03


def bending(height, youngs, strains, resultants, places):
    """Square of the bending stress of a beam with a stress that grows along it."""
    del strains
    return (resultants[:, 4] / (WIDTH * height**2 / 6.0)) ** 2 / youngs + 100.0 * places[:, 0]


def beam(formulation, *, youngs, height, gravity):
    """A rod on a hinge whose strains and stresses are measured."""
    mesh = ff.LineMesh.straight({"rod": [(0.0, 0.0, 0.0), (LENGTH, 0.0, 0.0)]}, elements=4)
    model, inside = ff.Model("rod", mesh=mesh), ff.Marker("rod", 0.37)
    section = ff.Section.rectangle(WIDTH, height, ff.Material(youngs, 0.3, 1100.0))
    stress = partial(bending, height, youngs)
    model.add(
        ff.Gravity((0.0, 0.0, -gravity)),
        ff.Beam("rod", section, formulation=formulation),
        ff.Revolute("hinge", ff.Ground(), ff.Marker("rod", "start"), axis=(0.0, 1.0, 0.0)),
        ff.StrainProbe("s", "rod", 0.4),
        ff.AggregateProbe("most", "rod", stress),
        ff.AggregateProbe("smooth", "rod", stress, rho=0.1),
    )
    if formulation == "se3":
        model.add(ff.ElongationProbe("longer", "rod"))
    else:
        model.add(ff.Probe("inside", inside, ("here", "speed", "spin", "push"), _motion))
    return model


def _motion(t, marker):
    speed = marker.velocity @ marker.velocity
    return (
        marker.position[2] + marker.rotation[0, 2], speed, marker.angular_velocity[1],
        marker.acceleration[2] + 0.1 * marker.angular_acceleration[1],
    )  # fmt: skip


def shell(element, *, youngs, height, gravity):
    """A clamped strip."""
    model = ff.Model("strip", surface=ff.SurfaceMesh.rectangle("strip", (LENGTH, 0.1), (4, 2)))
    section = ff.ShellSection.isotropic(height, ff.Material(youngs, 0.3, 1100.0))
    model.add(
        ff.Gravity((0.0, 0.0, -gravity)),
        ff.Shell("strip", section, element=element, edges={"strip_left": "clamped"}),
        ff.ShellStrainProbe("s", "strip", (0.1, 0.03, 0.0)),
        ff.ShellEnergyProbe("energy"),
        ff.AggregateProbe("smooth", "strip", lambda e, n, x: n[:, 3] ** 2 * 1e4, rho=1e-2),
    )
    return model


def solid(*, youngs, height, gravity):
    """A clamped bar, whose fixed nodes move with its height."""
    mesh = ff.SolidMesh.box((LENGTH, WIDTH, height), (4, 1, 1))
    mesh = mesh.with_surfaces(left=lambda x: x[:, 0] == 0.0, right=lambda x: x[:, 0] > 0.49)
    law = ff.laws.NeoHookean(youngs / 2.6, youngs / 1.2)
    model = ff.Model("bar")
    model.add(
        ff.Gravity((0.0, 0.0, -gravity)),
        ff.Solid("bar", law, mesh, density=1100.0, degree=1, fixed={"left": "xyz"}),
        ff.SolidProbe("s", "bar", (0.1, 0.011, 0.005), measures=("stress", "von_mises", "J")),
        ff.SolidProbe("all", "bar", measures=("volume", "von_mises")),
        ff.SolidProbe("end", "bar", "right", measures="displacement"),
        ff.AggregateProbe("smooth", "bar", lambda e, n, x: n[:, 0] ** 2 * 1e-4, rho=1e-2),
    )
    return model


BUILDS = {
    "se3": partial(beam, "se3"), "nurbs": partial(beam, "nurbs"),
    "director": partial(shell, "director"), "rotation_free": partial(shell, "rotation_free"),
    "solid": solid,
}  # fmt: skip
#: Columns, and errors up to which they agree with differences of motions. Stresses are sums of
#: large parts that cancel, and differences of motions have noise.
COLUMNS = {
    "se3": (("s_kappa2", "s_m2", "most", "smooth", "longer"), 1e-6),
    "nurbs": (("s_kappa2", "s_n3", "most", "smooth", "here", "speed", "spin", "push"), 2e-7),
    "director": (("s_m11", "s_eps11", "energy_bending", "smooth"), 1e-6),
    "rotation_free": (("s_m11", "s_eps11", "energy_bending", "smooth"), 1e-6),
    "solid": (("s_von_mises", "all_volume", "all_von_mises", "end_uz", "smooth"),
              2e-5),
}  # fmt: skip


@pytest.mark.serial
@pytest.mark.parametrize(
    "kind",
    [pytest.param(k, marks=[pytest.mark.slow] * (k in ("nurbs", "director"))) for k in BUILDS],
)
def test_measurements_of_all_families(kind):
    columns, accuracy = COLUMNS[kind]
    of = [f"mean:{name}" for name in columns]
    options = ff.RunOptions(dt=2e-3, t_end=0.012, tolerance=1e-13)
    found = ff.gradient(BUILDS[kind], of, NUMBERS, options, accuracy=1e-12, check=True)
    # a derivative of a column that adjoint and tangent do not share gives 1e-3 and more; rounding
    # of what cancels is 1e-6 in the solid
    assert max(found.check.values()) < 1e-5
    # differences of strains with too long steps give 3e-4, a stress whose law is not
    # differentiated the whole derivative
    assert errors(found.gradient, BUILDS[kind], NUMBERS, of, options).max() < accuracy


@pytest.mark.several_ranks
@pytest.mark.parametrize(
    "kind",
    [
        pytest.param("se3", marks=pytest.mark.three_ranks),
        pytest.param("nurbs", marks=pytest.mark.slow_on_ranks),
        pytest.param("solid", marks=pytest.mark.slow_on_ranks),
    ],
)
def test_ranks_agree(kind):
    """All ranks together find what each finds by itself."""
    of = [f"final:{name}" for name in COLUMNS[kind][0]]
    options = ff.RunOptions(dt=2e-3, t_end=6e-3, tolerance=1e-13, split_above=1)
    alone, together = (
        ff.gradient(BUILDS[kind], of, NUMBERS, options, accuracy=1e-13, comm=comm)
        for comm in (MPI.COMM_SELF, MPI.COMM_WORLD)
    )
    for one in of:
        mine, all_of_us = alone.gradient[one], together.gradient[one]
        size = max(abs(mine[name] * NUMBERS[name]) for name in NUMBERS)
        for name, value in NUMBERS.items():
            # a share of an element that is missing, or counted twice, is a tenth and more; in the
            # solid rounding is that of stresses, in which far larger parts cancel
            limit = 1e-4 if kind == "solid" else 1e-9
            assert abs(all_of_us[name] - mine[name]) * value < limit * size


def test_stress_of_a_cantilever_at_rest():
    """The bending stress at the root is 6 P (L - x)/(b h^2), that of the steel does not count."""

    def build(youngs, height, force):
        mesh = ff.LineMesh.straight({"rod": [(0.0, 0.0, 0.0), (LENGTH, 0.0, 0.0)]}, elements=8)
        model, modulus = ff.Model("cantilever", mesh=mesh), WIDTH * height**2 / 6.0
        section = ff.Section.rectangle(WIDTH, height, ff.Material(youngs, 0.3, 7850.0))
        model.add(
            ff.Beam("rod", section),
            ff.Rigid("clamp", ff.Ground(), ff.Marker("rod", "start")),
            ff.PointForce("push", ff.Marker("rod", "end"), (0.0, 0.0, -force)),
            ff.AggregateProbe("stress", "rod", lambda e, n, x: np.abs(n[:, 4]) / modulus),
        )
        return model

    values = {"youngs": 2e11, "height": 0.02, "force": 1.0}
    found = ff.gradient(build, "final:stress", values, ff.StaticOptions(load_steps=1))
    stress = found.value["final:stress"]
    by = found.gradient["final:stress"]
    arm = LENGTH * 15.0 / 16.0  # from the middle of the first element
    # deflections of 1e-6 of the length are not seen in 1e-5
    assert stress == pytest.approx(6.0 * arm / (WIDTH * 0.02**2), rel=1e-5)
    relative = [by[name] * value / stress for name, value in values.items()]
    # a modulus of the section that is not differentiated gives 0 in place of -2
    assert relative == pytest.approx([0.0, -2.0, 1.0], abs=1e-5)


def test_smooth_maximum_lies_between_mean_and_maximum():
    """It tends to the largest value with rho, and to the mean for small ones."""
    found = []
    for rho in (1e-6, 0.1, 1e3, None):
        model = beam("se3", **NUMBERS)
        stress = partial(bending, NUMBERS["height"], NUMBERS["youngs"])
        model.add(ff.AggregateProbe("own", "rod", stress, rho=rho))
        history = ff.simulate(model, ff.RunOptions(dt=2e-3, t_end=4e-3, quiet=True)).history
        found.append(float(history["own"][-1]) if history else 0.0)
    least, middle, near, most = MPI.COMM_WORLD.bcast(found)
    # a sum in place of the mean lies above the largest value by log(4)/rho
    assert least < middle < near < most < near + 1.5e-3


def falling(gain, height):
    """A weight whose way below a height counts."""
    model = ff.Model("weight")
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody("bob", 1.0, (0.1, 0.1, 0.1)),
        ff.Probe(
            "below", ff.Marker("bob"), ("way",),
            lambda t, bob: (gain * max(0.0, -height - bob.position[2]),),
        ),
    )  # fmt: skip
    return model


@pytest.mark.serial
def test_functions_that_use_a_number_at_some_states_alone():
    options = ff.RunOptions(dt=1e-2, t_end=0.2, tolerance=1e-13)
    of, numbers = "final:way", {"gain": 2.0, "height": 0.1}
    found = ff.gradient(falling, of, numbers, options)
    # compared at one state alone, near the start, the functions are those of another gain
    way = found.value[of] / 2.0
    assert found.gradient[of] == pytest.approx({"gain": way, "height": -2.0}, rel=1e-8)
