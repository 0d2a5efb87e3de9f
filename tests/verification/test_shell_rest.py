# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shells that are curved, prestrained or heated without stress, against closed forms."""

from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff

RANK = MPI.COMM_WORLD.rank
ALPHA = 1.2e-5
SIDE = 1.0
E, NU, THICKNESS = 2.1e11, 0.3, 0.01
BENDING = E * THICKNESS**3 / 12.0 / (1.0 - NU**2)
#: Statically determinate supports at three corners.
FREE = {"plate_bottom_left": "xyz", "plate_bottom_right": "yz", "plate_top_left": "z"}
HINGED = {f"plate_{side}": "hinged" for side in ("bottom", "top", "left", "right")}
BOTH = pytest.mark.parametrize("element", ["rotation_free", "director"])


def plate(
    element: str, cells: tuple[int, int], *more: Any, size: tuple[float, float] = (SIDE, SIDE),
    poisson: float = NU, thickness: float = THICKNESS, bend: float = 0.0, **given: Any,
) -> ff.Model:  # fmt: skip
    """A rectangle in the plane of X and Y, or bent about X; e1 is along X."""

    def surface(p: np.ndarray) -> np.ndarray:
        angle = bend * (p[:, 1] - 0.5 * size[1])
        return np.stack([p[:, 0], np.sin(angle) / bend, (np.cos(angle) - 1.0) / bend], axis=1)

    ticks = [np.linspace(0.0, length, n + 1) for length, n in zip(size, cells, strict=True)]
    mesh = ff.SurfaceMesh.grid("plate", *ticks, surface if bend else None)
    section = ff.ShellSection.isotropic(thickness, ff.Material(E, poisson, 7850.0))
    model = ff.Model("plate", surface=mesh)
    model.add(ff.Shell("plate", section, element=element, direction=(1, 0, 0), **given), *more)
    return model


def static(model: ff.Model, **given: Any) -> Any:
    return ff.solve_static(model, ff.StaticOptions(quiet=True, **given))


def at(x: float, y: float) -> ff.PositionProbe:
    return ff.PositionProbe("at", ff.Marker("plate", (x, y, 0.0)))


@pytest.mark.serial
@BOTH
def test_a_gradient_of_temperature_makes_a_cap(element: str) -> None:
    """A free plate becomes a sphere of curvature alpha dT/dz, here shallow, without stress."""
    kappa = 2e-4
    heat = ff.ThermalStrain(ALPHA, lambda x, t: 20.0 * t, gradient_z=kappa / ALPHA)
    energy, strain = (
        ff.ShellEnergyProbe("energy"),
        ff.ShellStrainProbe("mid", "plate", (0.4, 0.5, 0.0)),
    )
    model = plate(
        element, (4, 4), at(0.5, 0.5), energy, strain, fixed=FREE, prestrain=heat
    )  # fmt: skip
    found = static(model).history
    grown = 1.0 + 20.0 * ALPHA
    assert found["at_x"][-1] == pytest.approx(0.5 * SIDE * grown, abs=1e-7)
    # the middle above the plane of the corners; a moment at a free edge is tens of per cents
    assert found["at_z"][-1] == pytest.approx(0.25 * kappa * SIDE**2, rel=2e-3)
    held = SIDE**2 * BENDING * (1.0 + NU) * kappa**2
    # stretched by the cap's Gaussian curvature alone
    assert found["energy_bending"][-1] + found["energy_membrane"][-1] < 1e-3 * held
    assert np.abs(found["mid_m11"][-1]) < 2e-2 * BENDING * kappa


@pytest.mark.parametrize(
    "element",
    [
        "rotation_free",
        pytest.param("director", marks=pytest.mark.serial),
    ],
)
def test_a_clamped_plate_feels_the_heat_as_forces(element: str) -> None:
    """n = -E h alpha dT / (1 - nu), m = -E h^3 alpha dT/dz / (12 (1 - nu)), of both kernels."""
    change, gradient = 10.0, 400.0
    heat = ff.ThermalStrain(ALPHA, lambda x, t: change * t, gradient_z=lambda x, t: gradient * t)
    for kernels in ("fast", "ufl"):
        model = plate(
            element, (4, 4), ff.ShellStrainProbe("mid", "plate", (0.4, 0.5, 0.0)),
            edges=dict.fromkeys(HINGED, "clamped"), prestrain=heat,
        )  # fmt: skip
        model.add(ff.EnergyProbe("energy"))
        found = static(model, kernels=kernels, output_at="t=0.5,1").history
        if RANK > 0:
            continue
        force = -E * THICKNESS * ALPHA * change / (1.0 - NU)
        moment = -(1.0 + NU) * BENDING * ALPHA * gradient
        half = np.abs(found["t"] - 0.5).argmin()
        for axes in ("11", "22"):
            # uniform states are exact
            assert found[f"mid_n{axes}"][[half, -1]] == pytest.approx([0.5 * force, force])
            assert found[f"mid_m{axes}"][-1] == pytest.approx(moment, rel=1e-9)
        energy = -(force * ALPHA * change + moment * ALPHA * gradient) * SIDE**2
        assert found["energy_strain"][-1] == pytest.approx(energy, rel=1e-9)
        assert found["energy_work"][-1] == pytest.approx(energy, rel=1e-9)


@pytest.mark.serial
@BOTH
def test_a_heated_plate_buckles(element: str) -> None:
    """Hinged all around: alpha dT E h / (1 - nu) = 2 pi^2 D / a^2; the load factor heats it."""
    model = plate(
        element, (12, 12), edges=HINGED, prestrain=ff.ThermalStrain(ALPHA, lambda x, t: 100.0 * t)
    )  # fmt: skip
    found = static(model, t_end=0.05, load_steps=1, buckling_modes=1).summary["buckling"]
    euler = 2.0 * np.pi**2 * BENDING * (1.0 - NU) / (E * THICKNESS * SIDE**2)
    # the mesh leaves a per cent; without Poisson's part of the force it is 30
    assert found[0] == pytest.approx(euler / (100.0 * ALPHA), rel=0.03)


@pytest.mark.serial
@BOTH
def test_a_clamped_strip_rolls_up(element: str) -> None:
    """To a full circle, without stress."""
    kappa, found = 2.0 * np.pi, []
    for cells in (8, 16):
        bent = {"prestrain": lambda x, t: (0.0, 0.0, 0.0, kappa * t, 0.0, 0.0)}
        model = plate(
            element, (cells, 1), ff.ShellEnergyProbe("energy"), at(SIDE, 0.0), size=(SIDE, 0.1),
            poisson=0.0, edges={"plate_left": "clamped"}, **bent,
        )  # fmt: skip
        found.append(static(model, load_steps=5).history)
    coarse, fine = found
    flat = 0.5 * BENDING * (1.0 - NU**2) * kappa**2 * SIDE * 0.1
    ends = [np.hypot(history["at_x"][-1], history["at_z"][-1]) for history in (coarse, fine)]
    # the circle is closed to second order: half the curvature is 0.6 m
    assert ends[0] < 0.15 * SIDE
    assert ends[1] < 0.3 * ends[0]
    # no stress but near the clamp: a moment at the free edge is a fortieth
    assert fine["energy_bending"][-1] < 1e-3 * flat


@pytest.mark.serial
@BOTH
def test_a_tape_meshed_flat_has_the_modes_of_the_curved_mesh(element: str) -> None:
    """A carpenter's tape: its curvature across stiffens it several times against bending."""
    kappa, found = 3.0, []
    strip = {"size": (SIDE, 0.2), "thickness": 2e-3, "fixed": FREE}
    for given in (strip, strip | {"rest_curvature": (0.0, kappa, 0.0)}, strip | {"bend": kappa}):
        model = plate(element, (4, 2), **given)
        options = ff.ModeOptions(modes=2, start="equilibrium", quiet=True)
        found.append(ff.find_modes(model, options).history["frequency"])
    flat, tape, meshed = found
    # meshes of chords and of arcs differ by a per cent
    np.testing.assert_allclose(tape, meshed, rtol=0.02)
    assert tape[1] > 1.5 * flat[1]


@pytest.mark.serial
@BOTH
def test_work_of_actuation_closes_the_balance_of_energy(element: str) -> None:
    """A strip with damping is bent by its rest strain in a motion."""
    balance = []
    for dt in (4e-3, 2e-3):
        model = plate(
            element, (4, 1), ff.EnergyProbe("energy"), at(SIDE, 0.0), size=(SIDE, 0.1),
            edges={"plate_left": "clamped"}, damping=1e-3,
            prestrain=lambda x, t: (0, 0, 0, 20.0 * min(t, 0.03), 0, 0),
        )  # fmt: skip
        options = ff.RunOptions(dt=dt, t_end=0.04, rho_inf=1.0, quiet=True, tolerance=1e-8)
        found = ff.simulate(model, options).history
        largest = found["energy_work"].max()
        balance.append(np.abs(found["energy_balance"]).max() / largest)
    assert found["energy_dissipation"][-1] > 0.05 * largest
    # of second order in the step; without the work of the strains it is one
    assert balance[1] < 0.01
    assert balance[1] < 0.4 * balance[0]
