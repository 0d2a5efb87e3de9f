# SPDX-License-Identifier: LGPL-3.0-or-later
"""Beams whose sections vary, with couplings, against closed forms and boundary value problems."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from scipy.integrate import solve_bvp

import flexfem as ff
from flexfem.families.beam_se3.along import cell_sections

COMM = MPI.COMM_WORLD
STEEL = ff.Material(2.1e11, 0.3, 7850.0)
LENGTH = 2.0
ROOT, TIP = ff.Marker("beam", "start"), ff.Marker("beam", "end")


def cantilever(section: Any, elements: int, *more: Any, **given: Any) -> ff.Model:
    """A beam along X, clamped at its start; e2 is Y."""
    line = {"beam": [(0.0, 0.0, 0.0), (LENGTH, 0.0, 0.0)]}
    model = ff.Model("beam", mesh=ff.LineMesh.straight(line, elements))
    model.add(
        ff.Beam("beam", section, **({"orientation": (0.0, 1.0, 0.0)} | given)),
        ff.Rigid("clamp", ff.Ground(), ROOT),
        ff.PositionProbe("tip", TIP),
        *more,
    )
    return model


def static(model: ff.Model, **given: Any) -> dict[str, np.ndarray]:
    """History of load steps, the end of one step by default."""
    return ff.solve_static(model, ff.StaticOptions(quiet=True, **given)).history


def frequencies(model: ff.Model, count: int) -> np.ndarray:
    """Lowest angular frequencies, rad/s."""
    found = ff.find_modes(model, ff.ModeOptions(modes=count, quiet=True))
    return 2.0 * np.pi * np.array(found.history["frequency"])


def cone(s: float) -> ff.Section:
    """A round bar whose diameter falls from 60 to 20 mm."""
    return ff.Section.circle(0.06 - 0.02 * s, STEEL)


@pytest.mark.slow_on_ranks
def test_a_uniform_table_is_the_constant_section() -> None:
    """Statics and a motion, with gravity and a drive; the section has all couplings."""
    rng = np.random.default_rng(4)
    plain = ff.Section.rectangle(0.03, 0.05, STEEL, mass_centre=(0.004, -0.003))
    assert plain.stiffness is not None
    scale = np.sqrt(np.diag(plain.stiffness))
    mixed = 0.05 * rng.normal(size=(6, 6))
    D = plain.stiffness + np.outer(scale, scale) * (mixed + mixed.T)
    section = ff.Section.general(D, plain.inertia)
    table = ff.SectionTable.of([0.0, 0.3, 1.0], 3 * [section], relative=True)
    found: list[list[float]] = []
    for one in (section, table, lambda s: section):
        load = ff.PointForce("f", TIP, (10.0, 800.0, 500.0))
        gravity = ff.Gravity((0.0, 0.0, -9.81))
        model = cantilever(one, 8, load, gravity, ff.StrainProbe("mid", "beam", 0.5))
        still = static(model)
        moving = ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=0.01, quiet=True)).history
        found.append([h[k][-1] for h in (still, moving) for k in h])
    if COMM.rank > 0:
        return
    # means of equal matrices by quadrature leave round-off, any other mean would leave per cents
    size = np.abs(found[0])
    assert np.max(np.abs(np.subtract(found[1], found[0])) / np.maximum(size, 1e-3)) < 1e-10
    assert np.max(np.abs(np.subtract(found[2], found[0])) / np.maximum(size, 1e-3)) < 1e-10


@pytest.mark.serial
def test_means_of_a_uniform_table_are_its_section() -> None:
    section = ff.Section.rectangle(0.03, 0.05, STEEL, shear_centre=(0.004, -0.003))
    table = ff.SectionTable.of([0.0, 0.7, LENGTH], 3 * [section])
    beam = ff.Beam("beam", table)
    for one in cell_sections(beam, np.linspace(0.0, LENGTH, 4)):
        assert one.stiffness is not None
        np.testing.assert_allclose(one.stiffness, section.stiffness, rtol=1e-12, atol=1e-3)
        np.testing.assert_allclose(one.inertia, section.inertia, rtol=1e-13, atol=1e-16)


@pytest.mark.serial
def test_steps_of_a_bar_stretch_exactly() -> None:
    """Parts in series are exact; the mean stiffness of an element is off by tens of per cent."""
    thick, thin = (ff.Section.circle(d, STEEL) for d in (0.04, 0.02))
    table = ff.SectionTable.of([0.0, 0.9, 0.9, LENGTH], [thick, thick, thin, thin])
    history = static(cantilever(table, 3, ff.PointForce("f", TIP, (1e4, 0.0, 0.0))))
    assert thick.stiffness is not None
    assert thin.stiffness is not None
    expected = 1e4 * (0.9 / thick.stiffness[0, 0] + 1.1 / thin.stiffness[0, 0])
    # a small load: of second order in the strain, 1e-4, nothing is left by a linear law
    assert history["tip_x"][-1] - LENGTH == pytest.approx(expected, rel=1e-8)


def _bent(section: Callable[[float], ff.Section], force: float) -> float:
    """Tip deflection of a Timoshenko cantilever by its boundary value problem."""

    def rates(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        D = [section(float(x)).stiffness for x in s]
        bending = np.array([d[5, 5] for d in D])  # type: ignore[index]
        shear = np.array([d[1, 1] for d in D])  # type: ignore[index]
        moment = force * (LENGTH - s)
        return np.stack([y[1] + force / shear, moment / bending])

    s = np.linspace(0.0, LENGTH, 41)
    found = solve_bvp(rates, lambda a, b: np.array([a[0], a[1]]), s, np.zeros((2, 41)), tol=1e-9)
    assert found.success
    return float(found.y[0, -1])


@pytest.mark.serial
def test_a_tapered_cantilever_bends_as_its_boundary_value_problem() -> None:
    force, errors = 2.0, []
    expected = _bent(cone, force)
    for elements in (8, 16, 32):
        model = cantilever(cone, elements, ff.PointForce("f", TIP, (0.0, force, 0.0)))
        errors.append(abs(static(model)["tip_y"][-1] / expected - 1.0))
    # one section for each element, that of its end, would be of the first order
    assert errors[-1] < 1e-3
    assert np.log2(np.array(errors[:-1]) / errors[1:]).min() > 1.8


@pytest.mark.serial
@pytest.mark.parametrize(
    ("power", "expected"), [(1, (5.315, 15.207, 30.020)), (3, (8.719, 21.146, 38.453))]
)
def test_wedge_and_cone_have_the_frequencies_of_kirchhoff(
    power: int, expected: tuple[float, ...]
) -> None:
    """Bars that end in an edge or in a point, G. Kirchhoff, Berliner Monatsberichte (1879).

    The moments of area are I0 x^3 and A0 x of the wedge, I0 x^4 and A0 x^2 of the cone, x from the
    tip; the frequencies are those of S. Timoshenko, Vibration Problems in Engineering, section 60,
    omega = number sqrt(E I0 / (rho A0)) / L^2.
    """
    E, density, area, second = 1e9, 1000.0, 1e-2, 1e-7
    falling = 1 if power == 1 else 2

    def section(s: float) -> ff.Section:
        x = max(1.0 - s / LENGTH, 1e-4)
        A, I_0 = area * x**falling, second * x ** (falling + 2)
        stiff = (E * A, E * A, E * A, E * I_0, E * I_0, 1e3 * E * I_0)
        rotary = 1e-10 * density * I_0
        mass = density * A
        return ff.Section.general(stiff, (mass, mass, mass, 2.0 * rotary, rotary, rotary))

    unit = np.sqrt(E * second / (density * area)) / LENGTH**2
    errors = []
    for elements in (40, 80):
        found = frequencies(cantilever(section, elements), 8) / unit
        errors.append([np.abs(found / one - 1.0).min() for one in expected])
    # shear flexibility lowers them by 1e-4; the mesh leaves 4e-3; other powers, tens of per cent
    assert np.max(errors[1]) < 5e-3
    assert np.max(errors[1]) < 0.5 * np.max(errors[0])


@pytest.mark.serial
def test_an_offset_section_is_a_beam_on_a_shifted_axis() -> None:
    """Extension, bending, shear and torsion are coupled by the offset; nothing else changes."""
    y, z = 0.03, -0.02
    plain = ff.Section.rectangle(0.03, 0.05, STEEL)
    shift = np.eye(6)  # strains of the axis through the centroid by those of the other one
    shift[0, 4], shift[0, 5], shift[1, 3], shift[2, 3] = z, -y, -z, y
    assert plain.stiffness is not None
    centre = np.array([0.0, y, z])
    first = plain.mass_per_length * np.array([[0, -z, y], [z, 0, 0], [-y, 0, 0]])
    inertia = plain.inertia.copy()
    inertia[:3, 3:], inertia[3:, :3] = -first, first
    squares = (centre @ centre) * np.eye(3) - np.outer(centre, centre)
    inertia[3:, 3:] += plain.mass_per_length * squares
    other = ff.Section.general(shift.T @ plain.stiffness @ shift, inertia)
    found = []
    for section, offset in ((plain, np.zeros(3)), (other, centre)):
        ends = np.array([(0.0, 0.0, 0.0), (LENGTH, 0.0, 0.0)]) - offset
        model = ff.Model("beam", mesh=ff.LineMesh.straight({"beam": ends}, 6))
        model.add(
            ff.Beam("beam", section, orientation=(0, 1, 0)),
            ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "start", offset=tuple(offset))),
            ff.PointForce("f", place := ff.Marker("beam", "end", offset=tuple(offset)),
                          (500.0, 3000.0, 2000.0)),
            ff.PositionProbe("tip", place),
        )  # fmt: skip
        history, modes = static(model), frequencies(model, 6)
        found.append([*(history[f"tip_{c}"][-1] for c in "xyz"), *modes])
    # both are the same element to round-off in its iteration; a wrong sign of one term is 1e-3
    np.testing.assert_allclose(found[1], found[0], rtol=1e-8)


@pytest.mark.serial
def test_extension_and_twist_are_coupled() -> None:
    """A rod with D14 under a normal force: strains are the inverse of two equations."""
    plain = ff.Section.circle(0.03, STEEL)
    assert plain.stiffness is not None
    D = plain.stiffness.copy()
    D[0, 3] = D[3, 0] = 0.3 * np.sqrt(D[0, 0] * D[3, 3])
    section, force = ff.Section.general(D, plain.inertia), 1e4
    angle = ff.Probe("turn", TIP, ["turn"], lambda t, m: [np.arctan2(m.turn[2, 1], m.turn[1, 1])])
    model = cantilever(
        ff.SectionTable.of([0.0, LENGTH], [section, section]), 5,
        ff.PointForce("f", TIP, (force, 0.0, 0.0)), angle,
    )  # fmt: skip
    history = static(model)
    gamma, kappa = np.linalg.solve(D[np.ix_([0, 3], [0, 3])], [force, 0.0])
    # a helix about the axis keeps strains constant: exact at any amplitude
    assert history["tip_x"][-1] - LENGTH == pytest.approx(gamma * LENGTH, rel=1e-7)
    assert history["turn"][-1] == pytest.approx(kappa * LENGTH, rel=1e-7)


@pytest.mark.serial
def test_twisted_axes_are_those_of_a_turned_orientation() -> None:
    """Half a turn along a strip: a twist of the beam, of its table, and an orientation."""
    strip = ff.Section.rectangle(0.05, 0.01, STEEL)

    def turned(x: np.ndarray) -> np.ndarray:
        angle = np.pi * x[:, 0] / LENGTH
        return np.stack([0.0 * angle, np.cos(angle), np.sin(angle)], axis=1)

    load = ff.PointForce("f", TIP, (0.0, 5.0, 3.0))
    table = ff.SectionTable.of([0.0, 1.0], [strip, strip], twist=[0.0, np.pi], relative=True)
    found = [
        static(cantilever(strip, 12, load, orientation=turned)),
        static(cantilever(strip, 12, load, twist=lambda s: np.pi * s / LENGTH)),
        static(cantilever(table, 12, load)),
        static(cantilever(replace(table, twist=lambda e: np.pi * e), 12, load)),
    ]
    straight = static(cantilever(strip, 12, load))
    for one in found[1:]:
        for axis in "xyz":
            # the other sense of the twist, or none, moves the tip by more than a third
            assert one[f"tip_{axis}"][-1] == pytest.approx(found[0][f"tip_{axis}"][-1], rel=1e-9)
    assert abs(straight["tip_y"][-1] / found[0]["tip_y"][-1] - 1.0) > 0.3


@pytest.mark.serial
def test_each_strain_has_its_damping() -> None:
    """Ratios mu omega / 2 of the modes of bending in two planes, of torsion and extension."""
    section = ff.Section.rectangle(0.03, 0.05, STEEL)
    mu = np.array([2e-6, 0.0, 0.0, 4e-6, 3e-5, 1e-5])
    line = cantilever(section, 24, damping=mu)
    found = ff.find_modes(line, ff.ModeOptions(modes=16, quiet=True)).history
    assert section.stiffness is not None
    D, M = np.diag(section.stiffness), np.diag(section.inertia)
    bending = 3.5160 * np.sqrt(D[4:] / M[0]) / LENGTH**2
    torsion, extension = 0.5 * np.pi / LENGTH * np.sqrt([D[3] / M[3], D[0] / M[0]])
    expected = [(bending[0], mu[4]), (bending[1], mu[5]), (torsion, mu[3]), (extension, mu[0])]
    omega, ratio = 2.0 * np.pi * found["frequency"], found["damping_ratio"]
    for own, coefficient in expected:
        i = np.abs(omega / own - 1.0).argmin()
        # beams of that slenderness are a per cent off Euler's; a strain's neighbour has other mu
        assert omega[i] == pytest.approx(own, rel=0.02)
        assert ratio[i] == pytest.approx(0.5 * coefficient * omega[i], rel=0.02)


@pytest.mark.serial
def test_equal_dampings_are_one_damping() -> None:
    section, found = cone, []
    for damping in (1e-4, np.full(6, 1e-4)):
        load = ff.PointForce("f", TIP, (0.0, 300.0, 100.0))
        model = cantilever(section, 8, load, ff.EnergyProbe("energy"), damping=damping)
        found.append(ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=0.03, quiet=True)).history)
    for column in found[0]:
        size = np.abs(found[0][column]).max()
        # another kernel, the same sums in another order
        assert np.abs(found[1][column] - found[0][column]).max() <= 1e-8 * max(size, 1e-3), column
    energies = {k: found[1][f"energy_{k}"] for k in ("kinetic", "strain", "work", "dissipation")}
    assert energies["dissipation"][-1] > 0.01 * energies["work"].max()
    # of second order in the step; a stress that is not that of the motion's is some per cent
    assert np.abs(found[1]["energy_balance"]).max() < 1e-2 * energies["work"].max()


@pytest.mark.three_ranks
def test_varying_beams_are_the_same_on_any_number_of_ranks() -> None:
    """All columns of a twisted cone under heat; a rank's own arc lengths would be off by 1e-1."""
    found = []
    for comm in (MPI.COMM_SELF, COMM):
        heat = ff.ThermalStrain(1.2e-5, lambda s, t: 1e3 * t * s, gradient_y=lambda s, t: 2e4 * t)
        model = cantilever(
            cone, 9, ff.Gravity((0.0, 0.0, -9.81)), ff.EnergyProbe("energy"),
            ff.StrainProbe("mid", "beam", 0.5), ff.MomentumProbe("whole"),
            twist=lambda s: 0.4 * s, prestrain=heat, damping=1e-6 * np.arange(6.0),
        )  # fmt: skip
        options = ff.RunOptions(dt=1e-3, t_end=0.02, quiet=True, split_above=1)
        found.append(ff.simulate(model, options, comm=comm).history)
    if COMM.rank > 0:
        return
    for column, values in found[0].items():
        family = [v for k, v in found[0].items() if k[:6] == column[:6]]
        size = max(float(np.abs(v).max()) for v in family)
        # round-off of steel's forces, see test_same_on_ranks
        assert np.abs(values - found[1][column]).max() <= 1e-8 * size, column
