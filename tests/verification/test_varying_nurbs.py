# SPDX-License-Identifier: LGPL-3.0-or-later
"""Isogeometric beams along which sections vary, against closed forms and two-node elements."""

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from scipy.integrate import quad

import flexfem as ff

COMM = MPI.COMM_WORLD
STEEL = ff.Material(2.1e11, 0.3, 7850.0)
STRIP = ff.Section.rectangle(0.03, 0.02, STEEL)
LENGTH = 2.0
ROOT, TIP = ff.Marker("beam", "start"), ff.Marker("beam", "end")


def cantilever(
    section: Any, elements: int, *more: Any, degree: int = 3, curve: Any = None, **given: Any
) -> ff.Model:
    """A beam along X, clamped at its start; e2 is Y."""
    model = ff.Model("beam")
    line = ff.NurbsCurve.line((0, 0, 0), (LENGTH, 0, 0), elements=elements, degree=degree)
    given = {"orientation": (0.0, 1.0, 0.0)} | given
    model.add(
        ff.Beam("beam", section, curve=line if curve is None else curve, **given),
        ff.Rigid("clamp", ff.Ground(), ROOT),
        ff.PositionProbe("tip", TIP),
        *more,
    )
    return model


def static(model: ff.Model) -> dict[str, np.ndarray]:
    return ff.solve_static(model, ff.StaticOptions(quiet=True)).history


def tip(history: dict[str, np.ndarray]) -> np.ndarray:
    return np.array([history[f"tip_{axis}"][-1] for axis in "xyz"])


def frequencies(model: ff.Model, count: int) -> np.ndarray:
    """Lowest frequencies, Hz."""
    return np.array(ff.find_modes(model, ff.ModeOptions(modes=count, quiet=True)).history[
        "frequency"
    ])  # fmt: skip


def cone(s: float) -> ff.Section:
    """A thick round bar whose diameter falls from 0.4 to 0.2 m; rotary inertia left out."""
    round_bar = ff.Section.circle(0.4 - 0.1 * s, STEEL)
    assert round_bar.stiffness is not None
    stiff, mass = np.diag(round_bar.stiffness) * (1, 1, 1, 1e3, 1, 1.3), round_bar.mass_per_length
    return ff.Section.general(stiff, (mass, mass, mass, 2e-9, 1e-9, 1e-9))


@pytest.mark.serial
def test_a_tapered_cantilever_bends_as_the_closed_form() -> None:
    """The integral of moments and shear forces times those of a unit force."""
    force = 2e3

    def bent(s: float) -> float:
        D = cone(s).stiffness
        assert D is not None
        return float(force * ((LENGTH - s) ** 2 / D[5, 5] + 1.0 / D[1, 1]))

    expected = quad(bent, 0.0, LENGTH, epsabs=0.0)[0]
    found = static(cantilever(cone, 12, ff.PointForce("f", TIP, (0.0, force, 0.0))))["tip_y"][-1]
    # the section of the middle everywhere is 56 per cent off, the mesh leaves 3e-7
    assert found == pytest.approx(expected, rel=1e-6)


@pytest.mark.serial
@pytest.mark.parametrize("degree", [2, 3])
def test_frequencies_converge_with_the_order_of_a_uniform_beam(degree: int) -> None:
    """Twice the degree, as with sections that do not vary; means over elements have order 2."""
    reference = frequencies(cantilever(cone, 24, degree=5), 4)
    coarse, fine = (
        np.abs(frequencies(cantilever(cone, n, degree=degree), 4) / reference - 1.0)
        for n in (8, 16)
    )
    assert (np.log2(coarse / fine) > 2 * degree - 0.2).all()


@pytest.mark.serial
def test_wedge_has_the_frequencies_of_kirchhoff() -> None:
    """See ``test_varying_beams``: the section vanishes at the tip."""
    E, density, area, second = 1e9, 1000.0, 1e-2, 1e-7

    def section(s: float) -> ff.Section:
        x = max(1.0 - s / LENGTH, 1e-4)
        A, I_0 = area * x, second * x**3
        stiff, mass = (E * A, E * A, E * A, E * I_0, E * I_0, 1e3 * E * I_0), density * A
        rotary = 1e-10 * density * I_0
        return ff.Section.general(stiff, (mass, mass, mass, 2.0 * rotary, rotary, rotary))

    unit = np.sqrt(E * second / (density * area)) / LENGTH**2 / (2.0 * np.pi)
    found = frequencies(cantilever(section, 30), 8) / unit
    # 80 two-node elements leave 4e-3
    for one in (5.315, 15.207, 30.020):
        assert np.abs(found / one - 1.0).min() < 1e-3


@pytest.mark.serial
def test_jumps_of_tables_are_in_series() -> None:
    """Exact at a knot without continuity, and of degree 1 wherever it is; one order else."""
    thick, thin = (ff.Section.circle(d, STEEL) for d in (0.04, 0.02))
    table = ff.SectionTable.of([0.0, 0.9, 0.9, LENGTH], [thick, thick, thin, thin])
    load = ff.PointForce("f", TIP, (1e4, 0.0, 0.0))
    assert thick.stiffness is not None
    assert thin.stiffness is not None
    expected = 1e4 * (0.9 / thick.stiffness[0, 0] + 1.1 / thin.stiffness[0, 0])
    line = ff.NurbsCurve.line((0, 0, 0), (LENGTH, 0, 0), elements=3, degree=3)
    cut = line.insert(3 * [line.knots[0] + 0.45 * (line.knots[-1] - line.knots[0])])
    for model, accuracy in (
        (cantilever(table, 3, load, curve=cut), 1e-8),
        (cantilever(table, 3, load, degree=1), 1e-8),
        (cantilever(table, 24, load), 1e-2),
    ):
        found = static(model)["tip_x"][-1] - LENGTH
        # a point's own stiffness beside the jump, or the mean there, are some per cent off
        assert found == pytest.approx(expected, rel=accuracy)


@pytest.mark.serial
def test_rest_curvature_and_heat_bend_to_arcs() -> None:
    """A ring of a straight beam, and the arc of a gradient of temperature; both without stress."""
    alpha, change, gradient = 1.2e-5, 60.0, -4e4
    heat = ff.ThermalStrain(
        alpha, lambda s, t: change * t, gradient_z=lambda s, t: gradient * t + 0.0 * s
    )
    hot = static(cantilever(STRIP, 14, ff.StrainProbe("mid", "beam", 0.5), prestrain=heat))
    ring = static(cantilever(STRIP, 20, rest_curvature=(0.0, 0.0, 2.0 * np.pi / LENGTH)))
    stretched, angle = (1.0 + alpha * change) * LENGTH, alpha * gradient * LENGTH
    expected = stretched / angle * np.array([np.sin(angle), 0.0, np.cos(angle) - 1.0])
    # smooth elements are nearly as long as thick and leave 1e-6; half the curvature is centimetres
    np.testing.assert_allclose(tip(hot), expected, atol=2e-6)
    assert hot["mid_n1"][-1] == pytest.approx(0.0, abs=1e-5 * 2.1e11 * 6e-4)
    np.testing.assert_allclose(tip(ring), 0.0, atol=2e-4)


@pytest.mark.serial
def test_held_ends_feel_heat_and_curvature() -> None:
    """N = -E A alpha dT and m = -D kappa0 of a beam between walls; work of the heat is stored."""
    alpha, change, kappa = 1.2e-5, 40.0, np.array([0.02, 0.05, -0.03])
    model = cantilever(
        STRIP, 4, ff.StrainProbe("mid", "beam", 0.3), ff.EnergyProbe("energy"),
        ff.Rigid("wall", ff.Ground((LENGTH, 0.0, 0.0)), TIP),
        prestrain=ff.ThermalStrain(alpha, lambda s, t: t * change), rest_curvature=kappa,
    )  # fmt: skip
    history = static(model)
    assert STRIP.stiffness is not None
    D = np.diag(STRIP.stiffness)
    expected = -D * [alpha * change, 0.0, 0.0, *kappa]
    found = [history[f"mid_{name}"][-1] for name in ("n1", "n2", "n3", "m1", "m2", "m3")]
    # the same in all sections: exact
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-3)
    worked = 0.5 * D[0] * (alpha * change) ** 2 * LENGTH
    assert history["energy_work"][-1] == pytest.approx(worked, rel=1e-8)
    bent = 0.5 * np.sum(D[3:] * kappa**2) * LENGTH
    assert history["energy_strain"][-1] == pytest.approx(worked + bent, rel=1e-8)


def uneven(s: float) -> ff.Section:
    """A bar that tapers, with a mass centre that moves over its section."""
    width = 0.06 - 0.015 * s
    centre = (0.006 * (1.0 + s**2) - 0.004 * s, -0.003 * s)
    return ff.Section.rectangle(width, 0.5 * width, STEEL, mass_centre=centre)


@pytest.mark.serial
def test_a_twisted_bar_with_eccentric_masses_is_that_of_two_node_elements() -> None:
    mesh = ff.LineMesh.straight({"beam": [(0, 0, 0), (LENGTH, 0, 0)]}, 160)
    other = ff.Model("other", mesh=mesh)
    given: Any = {"orientation": (0.0, 1.0, 0.0), "twist": lambda s: 0.4 * s}
    other.add(ff.Beam("beam", uneven, **given), ff.Rigid("clamp", ff.Ground(), ROOT))
    found = frequencies(cantilever(uneven, 16, twist=given["twist"]), 4)
    # two-node elements are off by 8e-5; without the twist it is 7e-2, without the centres 1e-3
    np.testing.assert_allclose(found, frequencies(other, 4), rtol=2e-4)


@pytest.mark.serial
def test_masses_of_a_table_are_exact() -> None:
    """Energy and momenta of a rigid motion, with kinks and a jump inside of elements."""
    stations = [0.0, 0.33, 0.71, 0.71, LENGTH]
    sections = [uneven(0.9 * s) for s in (0.0, 1.3, 0.2, 0.9, 1.9)]
    table = ff.SectionTable.of(stations, sections)
    spin, speed = np.array([3.0, -2.0, 5.0]), np.array([1.0, 4.0, -2.0])
    model = ff.Model("free")
    line = ff.NurbsCurve.line((0, 0, 0), (LENGTH, 0, 0), elements=4, degree=3)
    model.add(
        ff.Beam("beam", table, curve=line, orientation=(0, 1, 0), velocity=speed,
                angular_velocity=spin),
        ff.EnergyProbe("energy"), ff.MomentumProbe("whole"),
    )  # fmt: skip
    history = ff.simulate(model, ff.RunOptions(dt=1e-6, t_end=1e-6, quiet=True)).history
    momentum, moment = np.zeros(3), np.zeros(3)
    energy, (at, weights) = 0.0, np.polynomial.legendre.leggauss(6)
    for low, high in zip([0.0, 0.33, 0.71], [0.33, 0.71, LENGTH], strict=True):
        for x, w in zip(at, weights, strict=True):
            s = low + 0.5 * (1.0 + x) * (high - low)
            M, place = table.at(np.array([s]))[1][0], np.array([s, 0.0, 0.0])
            twist = np.concatenate([speed + np.cross(spin, place), spin])
            p = 0.5 * w * (high - low) * M @ twist
            energy += 0.5 * float(twist @ p)
            momentum += p[:3]
            moment += p[3:] + np.cross(place, p[:3])
    assert history["energy_kinetic"][0] == pytest.approx(energy, rel=1e-10)
    found = [history[f"whole_{name}"][0] for name in ("px", "py", "pz", "lx", "ly", "lz")]
    # a mass of the middle of each element would be per cents off
    np.testing.assert_allclose(found, [*momentum, *moment], rtol=1e-9)


def heated(**given: Any) -> ff.Model:
    """A twisted bar with all that varies, and a uniform one beside it."""
    heat = ff.ThermalStrain(1.2e-5, lambda s, t: 1e3 * t * s, gradient_y=lambda s, t: 2e4 * t)
    model = cantilever(
        uneven, 7, ff.Gravity((0.0, 0.0, -9.81)), ff.EnergyProbe("energy"),
        ff.StrainProbe("mid", "beam", 0.4), ff.MomentumProbe("whole"),
        twist=lambda s: 0.4 * s, prestrain=heat, damping=1e-6 * np.arange(6.0), **given,
    )  # fmt: skip
    line = ff.NurbsCurve.line((LENGTH, 0, 0), (LENGTH + 1, 0, 0), elements=3, degree=3)
    strained: Any = {"prestrain": (1e-6, 0, 0, 0, 0, 1e-4), "rest_curvature": (0, 1e-4, 0)}
    model.add(
        ff.Beam("arm", STRIP, curve=line, **strained),
        ff.Rigid("joint", TIP, ff.Marker("arm", "start")),
        ff.PositionProbe("end", ff.Marker("arm", "end")),
    )
    return model


@pytest.mark.three_ranks
def test_a_motion_is_the_same_on_any_number_of_ranks() -> None:
    """One factorisation, a balance of energies, and all columns."""
    options = ff.RunOptions(dt=1e-3, t_end=5e-3, quiet=True, split_above=1)
    found = [
        ff.simulate(heated(), options, comm=comm) for comm in (MPI.COMM_SELF, COMM)[: COMM.size]
    ]
    if COMM.rank > 0:
        return
    history = found[0].history
    assert found[0].summary["factorizations"] == 1
    worked = np.abs(history["energy_work"]).max() + history["energy_strain"].max()
    # of second order in the step; heat that does no work would be all of it
    assert np.abs(history["energy_balance"]).max() < 2e-2 * worked
    for column, values in found[-1].history.items():
        family = [v for k, v in history.items() if k[:6] == column[:6]]
        size = max(float(np.abs(v).max()) for v in family)
        # round-off of steel's forces, see test_same_on_ranks
        assert np.abs(values - history[column]).max() <= 1e-8 * size, column


@pytest.mark.serial
def test_restarts_and_pictures(tmp_path: Path) -> None:
    """The heat goes on where it was; a picture of each element has its sections."""

    def run(**given: Any) -> dict[str, np.ndarray]:
        options = ff.RunOptions(dt=1e-3, quiet=True, tolerance=1e-9, **given)
        return ff.simulate(heated(), options).history

    whole = run(t_end=6e-3)
    run(t_end=3e-3, checkpoint_every=3, every=3, output=tmp_path)
    again = run(t_end=6e-3, restart=next(tmp_path.glob("checkpoint*.h5")))
    for column in whole:
        size = np.abs(whole[column]).max()
        # to the tolerance of the iteration; heat that begins anew is per cents
        assert again[column][-1] == pytest.approx(whole[column][-1], abs=1e-6 * size), column
    assert list(tmp_path.glob("**/beam*.vtu"))


@pytest.mark.serial
def test_each_strain_has_its_damping() -> None:
    """Ratios mu omega / 2 of bending in two planes, as with two-node elements."""
    section = ff.Section.rectangle(0.03, 0.05, STEEL)
    mu = np.array([2e-6, 0.0, 0.0, 4e-6, 3e-5, 1e-5])
    found = ff.find_modes(
        cantilever(section, 8, damping=mu), ff.ModeOptions(modes=2, quiet=True)
    ).history
    omega = 2.0 * np.pi * found["frequency"]
    # e2 is along the shorter side: bending about e3 is the softer one
    for i, coefficient in enumerate((mu[5], mu[4])):
        assert found["damping_ratio"][i] == pytest.approx(0.5 * coefficient * omega[i], rel=0.01)
