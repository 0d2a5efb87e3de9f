# SPDX-License-Identifier: LGPL-3.0-or-later
"""Beams that are curved, prestrained or heated without stress, against closed forms."""

from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff

RANK = MPI.COMM_WORLD.rank
STEEL = ff.Material(2.1e11, 0.3, 7850.0)
SECTION = ff.Section.rectangle(0.03, 0.02, STEEL)
LENGTH = 2.0
TIP = ff.Marker("beam", "end")


def beam(elements: int, *more: Any, points: np.ndarray | None = None, **given: Any) -> ff.Model:
    """A beam along X, or through given points, clamped at its start; e3 is Z unless curved."""
    if points is None:
        points = np.linspace((0.0, 0.0, 0.0), (LENGTH, 0.0, 0.0), elements + 1)
    cells = np.arange(elements)[:, np.newaxis] + np.arange(2)
    model = ff.Model("beam", mesh=ff.LineMesh(points, cells, {"beam": np.arange(elements)}))
    model.add(
        ff.Beam("beam", given.pop("section", SECTION), **({"orientation": (0, 1, 0)} | given)),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "start")),
        ff.PositionProbe("tip", TIP),
        *more,
    )
    return model


def static(model: ff.Model, **given: Any) -> dict[str, np.ndarray]:
    return ff.solve_static(model, ff.StaticOptions(quiet=True, **given)).history


def tip(history: dict[str, np.ndarray]) -> np.ndarray:
    return np.array([history[f"tip_{axis}"][-1] for axis in "xyz"])


@pytest.mark.three_ranks
@pytest.mark.parametrize("heat", ["constant", "function"])
def test_a_gradient_of_temperature_bends_to_an_arc(heat: str) -> None:
    """Curvature alpha dT/dz about e2, free of stress; the axis stretches by alpha dT."""
    alpha, change, gradient = 1.2e-5, 60.0, -4e4
    given: Any = (change, gradient)
    if heat == "function":
        given = (lambda s, t: change * t, lambda s, t: gradient * t + 0.0 * s)
    strain = ff.ThermalStrain(alpha, given[0], gradient_z=given[1])
    probes = ff.StrainProbe("mid", "beam", 0.5), ff.ElongationProbe("grown", "beam")
    history = static(beam(6, *probes, prestrain=strain))
    if RANK > 0:
        return
    kappa, stretched = alpha * gradient, (1.0 + alpha * change) * LENGTH
    angle = kappa * LENGTH  # about e2 = Y: the tip goes along -Z for a positive one
    expected = stretched / angle * np.array([np.sin(angle), 0.0, np.cos(angle) - 1.0])
    # helices are exact; half a curvature or another sign is centimetres
    np.testing.assert_allclose(tip(history), expected, atol=1e-10)
    assert history["mid_n1"][-1] == pytest.approx(0.0, abs=1e-3)
    assert history["grown"][-1] == pytest.approx(alpha * change * LENGTH, rel=1e-6)
    assert history["mid_m2"][-1] == pytest.approx(0.0, abs=1e-4)


@pytest.mark.serial
def test_held_ends_feel_the_heat_as_a_force() -> None:
    """N = -E A alpha dT between fixed ends; the strain of the resultant is reported."""
    alpha, change = 1.2e-5, 40.0
    strain = ff.ThermalStrain(alpha, lambda s, t: t * change)
    model = beam(4, ff.StrainProbe("mid", "beam", 0.5), prestrain=strain)
    model.add(ff.Rigid("wall", ff.Ground((LENGTH, 0.0, 0.0)), TIP), ff.EnergyProbe("energy"))
    history = static(model, output_at="t=0.5,1")
    assert SECTION.stiffness is not None
    expected = -SECTION.stiffness[0, 0] * alpha * change
    assert history["mid_n1"][-1] == pytest.approx(expected, rel=1e-9)
    half = history["mid_n1"][np.abs(history["t"] - 0.5).argmin()]
    assert half == pytest.approx(0.5 * expected, rel=1e-9)
    assert history["mid_gamma1"][-1] == pytest.approx(-alpha * change, rel=1e-9)
    energy = 0.5 * expected**2 / SECTION.stiffness[0, 0] * LENGTH
    assert history["energy_strain"][-1] == pytest.approx(energy, rel=1e-9)
    assert history["energy_work"][-1] == pytest.approx(energy, rel=1e-9)


def _arc(elements: int, angle: float) -> np.ndarray:
    """Points of an arc of the beam's length in the plane of X and Z, tangent to X at its start."""
    turn, radius = np.linspace(0.0, angle, elements + 1), LENGTH / angle
    return radius * np.stack([np.sin(turn), 0.0 * turn, 1.0 - np.cos(turn)], axis=1)


def test_an_arc_meshed_straight_is_the_curved_mesh() -> None:
    """Without load it becomes the arc by itself, and under loads it moves as that one does."""
    angle, load = 1.3, ff.PointForce("f", TIP, (20.0, 60.0, -90.0))
    # bending about e2 = Y by a positive curvature is towards -Z
    curvature = np.array([0.0, -angle / LENGTH, 0.0])
    straight = static(beam(10, rest_curvature=curvature))
    loaded = static(beam(10, load, rest_curvature=lambda s: curvature))
    curved = static(beam(10, load, points=_arc(10, angle)))
    if RANK > 0:
        return
    np.testing.assert_allclose(tip(straight), _arc(10, angle)[-1], atol=1e-9)
    # the same elements, to the tolerance of the iteration; as if straight, it is decimetres off
    np.testing.assert_allclose(tip(loaded), tip(curved), atol=1e-8)


@pytest.mark.serial
def test_modes_and_motions_about_the_arc_are_those_of_the_curved_mesh() -> None:
    """Linearised about the equilibrium, and started in it: nothing moves but by the modes."""
    angle, found = 0.4, []
    curvature = np.array([0.0, -angle / LENGTH, 0.0])
    for given in ({"rest_curvature": curvature}, {"points": _arc(10, angle)}):
        options = ff.ModeOptions(modes=4, start="equilibrium", quiet=True)
        found.append(ff.find_modes(beam(10, **given), options).history["frequency"])
    # to the tolerance of the equilibrium; straight, they are per cents off
    np.testing.assert_allclose(found[0], found[1], rtol=1e-6)
    options = ff.RunOptions(dt=1e-3, t_end=0.01, start="equilibrium", quiet=True)
    history = ff.simulate(beam(10, rest_curvature=curvature), options).history
    for axis, value in zip("xyz", _arc(10, angle)[-1], strict=True):
        np.testing.assert_allclose(history[f"tip_{axis}"], value, atol=1e-7)


@pytest.mark.serial
def test_a_curved_beam_held_straight_has_its_moment() -> None:
    """Rest twist and curvatures of a beam between walls: m = -D kappa0, and nothing moves."""
    kappa = np.array([0.02, 0.05, -0.03])
    model = beam(4, ff.StrainProbe("mid", "beam", 0.5), rest_curvature=kappa)
    model.add(ff.Rigid("wall", ff.Ground((LENGTH, 0.0, 0.0)), TIP))
    history = static(model)
    assert SECTION.stiffness is not None
    expected = -np.diag(SECTION.stiffness)[3:] * kappa
    found = [history[f"mid_m{i}"][-1] for i in (1, 2, 3)]
    # moments that all sections share: exact
    np.testing.assert_allclose(found, expected, rtol=1e-8)


@pytest.mark.serial
def test_a_pretensioned_string_has_the_frequency_of_its_tension() -> None:
    """A slack bending stiffness and a negative prestrain: omega = pi / L sqrt(N / m)."""
    section = ff.Section.circle(1e-3, STEEL)
    assert section.stiffness is not None
    tension, found = 50.0, []
    strain = np.array([-tension / section.stiffness[0, 0], 0, 0, 0, 0, 0])
    for elements in (16, 32):
        model = beam(elements, section=section, prestrain=strain)
        model.add(ff.Rigid("wall", ff.Ground((LENGTH, 0.0, 0.0)), TIP))
        found.append(
            ff.find_modes(model, ff.ModeOptions(modes=1, quiet=True)).history["frequency"][0]
        )
    expected = 0.5 / LENGTH * np.sqrt(tension / section.mass_per_length)
    # clamped ends stiffen by 2 / L sqrt(EI / N), 1.3 per cent; without prestrain it is 1 Hz, not 23
    stiffer = 1.0 + 2.0 / LENGTH * np.sqrt(section.stiffness[4, 4] / tension)
    assert found[1] == pytest.approx(expected * stiffer, rel=2e-2)


@pytest.mark.serial
def test_work_of_heat_closes_the_balance_of_energy() -> None:
    """A beam that is heated on one side, fast and for a while: it swings, then goes on."""

    def gradient(s: np.ndarray, t: float) -> np.ndarray:
        return 5e4 * np.sin(np.pi * min(t / 0.02, 1.0)) * (1.0 + s)

    balance = []
    for dt in (1e-3, 5e-4):
        heat = ff.ThermalStrain(1.2e-5, gradient_y=gradient)
        model = beam(6, ff.EnergyProbe("energy"), prestrain=heat)
        history = ff.simulate(
            model, ff.RunOptions(dt=dt, t_end=0.04, rho_inf=1.0, quiet=True)
        ).history
        largest = history["energy_kinetic"].max()
        balance.append(np.abs(history["energy_balance"]).max() / largest)
    assert largest > 0.1
    # of second order in the step; without the work of heat it is the energy itself
    assert balance[1] < 0.02
    assert balance[1] < 0.4 * balance[0]


@pytest.mark.serial
def test_constant_prestrain_goes_with_energy_momentum() -> None:
    """The strain energy is that of both strains: nothing is gained nor lost over large motions."""
    model = beam(
        5, ff.EnergyProbe("energy"), rest_curvature=(0.1, 0.3, -0.2),
        section=lambda s: ff.Section.circle(0.03 - 0.005 * s, STEEL),
    )  # fmt: skip
    options = ff.RunOptions(
        dt=2e-3, t_end=0.1, rho_inf=1.0, quiet=True, integrator="energy_momentum",
        tolerance=1e-8,
    )  # fmt: skip
    history = ff.simulate(model, options).history
    total = history["energy_kinetic"] + history["energy_strain"]
    assert history["energy_kinetic"].max() > 0.1 * total[0]
    # conserved to the tolerance of the iteration, 5e-9; 2e-6 at the default one
    np.testing.assert_allclose(total, total[0], rtol=1e-7)


@pytest.mark.serial
def test_arc_length_follows_heat() -> None:
    """A shallow arch whose supports stay: the load parameter heats it."""
    heat = ff.ThermalStrain(1.2e-5, lambda s, t: 200.0 * t)
    points = np.linspace((0.0, 0.0, 0.0), (LENGTH, 0.0, 0.0), 13)
    points[:, 2] = 0.02 * np.sin(np.pi * points[:, 0] / LENGTH)
    found = []
    for arc_length in (0.0, 0.05):
        model = beam(12, points=points, prestrain=heat)
        model.add(ff.Rigid("wall", ff.Ground((LENGTH, 0.0, 0.0)), TIP))
        model.add(ff.PositionProbe("top", ff.Marker("beam", 0.5)))
        found.append(static(model, arc_length=arc_length)["top_z"][-1])
    # one path, to the tolerance of the iteration; heat that is left out of the step is a failure
    assert found[1] == pytest.approx(found[0], rel=1e-6)
    assert found[0] > 0.03


@pytest.mark.serial
def test_linear_statics_of_heat() -> None:
    """To first order: the tip goes by alpha dT L along the beam and by half a curvature across."""
    alpha, change, gradient = 1.2e-5, 60.0, 50.0
    strain = ff.ThermalStrain(alpha, change, gradient_y=gradient)
    history = static(beam(4, prestrain=strain), linear=True)
    assert history["tip_x"][-1] - LENGTH == pytest.approx(alpha * change * LENGTH, rel=1e-6)
    assert history["tip_y"][-1] == pytest.approx(-0.5 * alpha * gradient * LENGTH**2, rel=1e-6)


@pytest.mark.serial
def test_a_heated_column_buckles() -> None:
    """Between clamped ends at E A alpha dT = 4 pi^2 E I / L^2, the load factor heats it."""
    heat = ff.ThermalStrain(1.2e-5, lambda s, t: 100.0 * t)
    model = beam(16, prestrain=heat)
    model.add(ff.Rigid("wall", ff.Ground((LENGTH, 0.0, 0.0)), TIP))
    options = ff.StaticOptions(quiet=True, t_end=0.05, load_steps=2, buckling_modes=1)
    found = ff.solve_static(model, options).summary["buckling"]
    assert SECTION.stiffness is not None
    D = np.diag(SECTION.stiffness)
    euler = 4.0 * np.pi**2 * D[4:].min() / LENGTH**2
    # the mesh leaves 1 per cent, shear flexibility and shortening less
    assert found[0] == pytest.approx(euler / (D[0] * 1.2e-5 * 100.0), rel=0.02)
