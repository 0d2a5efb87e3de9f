# SPDX-License-Identifier: LGPL-3.0-or-later
"""Starts of stiff damped bodies make no energy."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from tests.verification.test_solids import viscous_energy, viscous_power


def run(model: ff.Model, comm: MPI.Intracomm, **options) -> dict:
    found = ff.simulate(model, ff.RunOptions(quiet=True, **options), comm=comm)
    assert found.status == "ok"
    return found.history


def test_a_bent_beam_that_is_let_go_gains_nothing() -> None:
    """A rod, straight without stress, starts as three quarters of a circle, much damped."""
    angle = np.linspace(0.0, 1.5 * np.pi, 13)
    points = 0.05 * np.column_stack([np.sin(angle), 1.0 - np.cos(angle), 0.0 * angle])
    cells = np.column_stack([np.arange(12), np.arange(1, 13)])
    model = ff.Model("rod", mesh=ff.LineMesh(points, cells, {"rod": np.arange(12)}))
    rubber = ff.Material(1e7, 0.45, 1000.0)
    model.add(
        ff.Beam("rod", ff.Section.circle(0.01, rubber), damping=1e-2, rest_curvature=(0, 0, 0)),
        ff.Spherical("pin", ff.Ground(points[0]), ff.Marker("rod", "start")),
        ff.EnergyProbe(),
    )
    every = [run(model, comm, dt=2e-3, t_end=0.02, rho_inf=0.5, split_above=1)
             for comm in (MPI.COMM_WORLD, MPI.COMM_SELF)]  # fmt: skip
    if MPI.COMM_WORLD.rank == 0:
        found, alone = every
        total = found["energy_kinetic"] + found["energy_strain"]
        # accelerations of the start that the scheme goes on with add 15 % in the first step
        assert (np.diff(total) < 1e-3 * total[0]).all()
        np.testing.assert_allclose(total, alone["energy_kinetic"] + alone["energy_strain"], 1e-9)


def hinged(kind: str, *, speed: float = 1.0) -> tuple[ff.Model, ff.Marker]:
    """A free body of rubber that moves upwards, and a marker at its end."""
    rubber, velocity, length = ff.Material(5e6, 0.3, 1100.0), (0.0, 0.0, speed), 0.5
    if kind == "director":
        surface = ff.SurfaceMesh.rectangle("rod", (length, 0.1), (4, 2))
        section = ff.ShellSection.isotropic(0.01, rubber)
        model = ff.Model("strip", surface=surface)
        model.add(ff.Shell("rod", section, element=kind, edges={}, velocity=velocity))
        return model, ff.Marker("rod", "rod_bottom_right")
    if kind == "solid":
        model, law = ff.Model("bar"), ff.laws.NeoHookean(2e6, 4e6)
        mesh = ff.SolidMesh.box((length, 0.03, 0.02), (4, 1, 1))
        model.add(ff.Solid("rod", law, mesh, density=1100.0, degree=1, velocity=velocity))
        return model, ff.Marker("rod", (length, 0.0, 0.0))
    x = np.linspace(0.0, length, 7)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    cells = np.column_stack([np.arange(6), np.arange(1, 7)])
    model = ff.Model("rod", mesh=ff.LineMesh(x, cells, {"rod": np.arange(6)}))
    section = ff.Section.rectangle(0.01, 0.008, rubber)
    model.add(ff.Beam("rod", section, formulation=kind, velocity=velocity))
    return model, ff.Marker("rod", "end")


@pytest.mark.parametrize("kind", ["se3", "nurbs", "director", "solid"])
def test_dampers_of_joints_make_no_energy(kind: str) -> None:
    """The end of a light body that moves is held by dampers that act within a part of a step."""
    every = []
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        model, end = hinged(kind)
        turning = 0.0 if kind == "solid" else 1.0
        model.add(
            ff.Bushing(
                "damper", ff.Ground((0.5, 0.0, 0.0)), end, stiffness=(0.0,) * 6,
                damping=(1e3,) * 3 + (turning,) * 3,
            ),
            ff.EnergyProbe(),
            ff.PositionProbe("end", end),
        )  # fmt: skip
        every.append(run(model, comm, dt=2e-3, t_end=0.01, rho_inf=0.5, split_above=1))
    if MPI.COMM_WORLD.rank == 0:
        found, alone = every
        total = found["energy_kinetic"] + found["energy_strain"]
        # accelerations of the start that the scheme goes on with make the step fail, or add 1e3 %
        assert (np.diff(total) < 1e-3 * total[0]).all()
        # half a step with the velocity of the start is 1e-3 m, steps of 0.05 ms end at 2e-4 or less
        assert np.abs(found["end_z"]).max() < 3e-4
        # dampers that ranks choose differently move the end by a tenth of its path
        np.testing.assert_allclose(found["end_z"], alone["end_z"], atol=1e-12)
        np.testing.assert_allclose(total, alone["energy_kinetic"] + alone["energy_strain"], 1e-9)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9, 1.0])
def test_a_stiff_damper_of_a_hinge(rho: float) -> None:
    """A thin beam that turns on a hinge with a damper moves as with small steps.

    Those, of 2.5e-4 s with any ``rho`` and of 5e-6 s with 1, end at -0.0133 m.
    """
    n = 8
    x = np.linspace(0.0, 0.5, n + 1)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
    cells = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    model = ff.Model("hinge", mesh=ff.LineMesh(x, cells, {"rod": np.arange(n)}))
    section = ff.Section.circle(0.004, ff.Material(70e9, 0.3, 1500.0))
    ends = ff.Ground(), ff.Marker("rod", "start")
    model.add(
        ff.Beam("rod", section, angular_velocity=(0.0, 0.0, 5.0)),
        ff.Revolute("pin", *ends, axis=(0.0, 0.0, 1.0)),
        ff.TorsionalSpringDamper("damper", *ends, axis=(0.0, 0.0, 1.0), damping=1.0),
        ff.EnergyProbe(),
        ff.PositionProbe("tip", ff.Marker("rod", "end")),
    )
    found = run(model, MPI.COMM_SELF, dt=1e-3, t_end=0.04, rho_inf=rho)
    total = found["energy_kinetic"] + found["energy_strain"]
    # with the accelerations of the start there are 1e7 J in two steps and no third one; with their
    # end alone the damper would dissipate 0.006 J of 0.0098 J that are not lost
    assert total.max() < (1.0 + 1e-9) * total[0]
    assert found["energy_balance"].max() < 1e-3 * total[0]
    # a hinge that is half a step late has moved the tip by 0.00125 m more
    assert abs(found["tip_y"][-1] + 0.01331) < 7e-4


def test_a_damper_ends_velocities_and_a_run_tells() -> None:
    """A disc on a damper turns by ``J w / c``, not by half a step; a heavy one is left as it is."""
    for inertia, told in ((1e-6, True), (1.0, False)):
        model, disc = ff.Model("disc"), ff.Marker("disc")
        about = {"axis": (0.0, 0.0, 1.0)}
        model.add(
            ff.RigidBody("disc", 1.0, (inertia,) * 3, angular_velocity=(0.0, 0.0, 1.0)),
            ff.Revolute("pin", ff.Ground(), disc, **about),
            ff.TorsionalSpringDamper("damper", ff.Ground(), disc, damping=1.0, **about),
            ff.Probe("turning", disc, ("rate",), lambda t, s: (s.angular_velocity[2],)),
        )
        options = ff.RunOptions(dt=1e-2, t_end=0.05, rho_inf=0.7, quiet=True)
        found = ff.simulate(model, options, comm=MPI.COMM_SELF)
        warned = any("stiff dampers end them" in text for text in found.summary["warnings"])
        assert warned is told
        exact = np.exp(-found.history["t"] / inertia) if not told else np.zeros(6)
        # without the end of velocities the rate of the light disc begins with 1 rad/s
        np.testing.assert_allclose(found.history["rate"], exact, atol=5e-4)


#: Time of damping, s, of bodies whose steps are a fifth of it.
_SPAN = 1e-2


def pulled(kind: str) -> ff.Model:
    """A bar of rubber that is held at one end and pulled at the other at once."""
    rubber, force, end = ff.Material(1e6, 0.3, 1000.0), (0.01, 0.0, 0.0), ff.Marker("bar", "end")
    model = ff.Model("bar")
    if kind in ("director", "rotation_free"):
        surface = ff.SurfaceMesh.rectangle("bar", (0.2, 0.1), (4, 2))
        model, end = ff.Model("bar", surface=surface), ff.Marker("bar", "bar_top_right")
        section, edges = ff.ShellSection.isotropic(0.01, rubber), {"bar_left": "clamped"}
        model.add(ff.Shell("bar", section, element=kind, edges=edges, damping=_SPAN))
    elif kind == "solid":
        numbers = {"mu": 1e6 / 2.6, "bulk": 1e6 / 1.2, "eta": _SPAN * 1e6 / 2.6}
        law = ff.laws.Hyperelastic(viscous_energy, numbers, viscous_power)
        mesh = ff.SolidMesh.box((0.2, 0.05, 0.05), (4, 1, 1), "hexahedron")
        model.add(ff.Solid("bar", law, mesh, density=1000.0, fixed={"x0": "xyz"}))
        end = ff.Marker("bar", (0.2, 0.0, 0.0))
    elif kind == "cable_net":
        x = np.linspace(0.0, 0.2, 5)[:, np.newaxis] * np.array([1.0, 0.0, 0.0])
        cells = np.column_stack([np.arange(4), np.arange(1, 5)])
        mesh = ff.ElementMesh(x, cells, "interval", nodes={"wall": [0], "end": [4]})
        model.add(
            ff.CableNet(
                "bar", mesh, 100.0, mass_per_length=0.01, rest_length=0.05, damping=_SPAN,
                fixed={"wall": "xyz"}, tension_only=False,
            )
        )  # fmt: skip
    else:
        ends = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0]])
        model = ff.Model("bar", mesh=ff.LineMesh.straight({"bar": ends}, 6))
        section = ff.Section.rectangle(0.1, 0.01, rubber)
        model.add(ff.Beam("bar", section, formulation=kind, damping=_SPAN))
        model.add(ff.Rigid("clamp", ff.Ground(), ff.Marker("bar", "start")))
    model.add(ff.PointForce("pull", end, force), ff.EnergyProbe())
    return model


BODIES = ["se3", "nurbs", "director", "rotation_free", "solid", "cable_net"]


@pytest.mark.parametrize("kind", BODIES)
def test_damping_takes_the_work_of_accelerations_that_it_ends(kind: str) -> None:
    for rho, part in ((1.0, 1e-5), (0.5, 4e-3)):
        options = {"dt": 0.2 * _SPAN, "t_end": 2.0 * _SPAN, "rho_inf": rho, "tolerance": 1e-12}
        every = [run(pulled(kind), comm, split_above=1, **options)
                 for comm in (MPI.COMM_WORLD, MPI.COMM_SELF)]  # fmt: skip
        if MPI.COMM_WORLD.rank == 0:
            found, alone = every
            work = found["energy_work"].max()
            # round-off and tolerance with 1, what the scheme makes of unresolved modes with 0.5;
            # without the work of ended accelerations 0.016 to 0.05, in the first step
            assert np.abs(found["energy_balance"]).max() < part * work
            for name in ("work", "dissipation", "balance"):
                one, other = found[f"energy_{name}"], alone[f"energy_{name}"]
                np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-9 * work)


def one_bar(rate: float) -> ff.Model:
    """A mass of 1 kg on a bar of 100 N/m, damped by ``rate`` N s/m, that 1 N pulls at once."""
    mesh = ff.ElementMesh(
        [[0, 0, 0], [1.0, 0, 0]], [[0, 1]], "interval", nodes={"wall": [0], "ball": [1]}
    )
    model = ff.Model("pulled")
    model.add(
        ff.CableNet(
            "bar", mesh, 100.0, mass_per_length=0.0, rest_length=1.0, node_mass=[1.0, 1.0],
            fixed={"wall": "xyz"}, damping=0.01 * rate, tension_only=False,
        ),
        ff.PointForce("pull", ff.Marker("bar", "ball"), (1.0, 0, 0)),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


@pytest.mark.serial
@pytest.mark.parametrize("rho", [0.0, 0.5, 1.0])
def test_energies_of_an_overdamped_mass_converge_to_the_closed_form(rho: float) -> None:
    rate, stiffness, end = 50.0, 100.0, 0.2
    a, b = -0.5 * rate + np.sqrt(0.25 * rate**2 - stiffness) * np.array([1.0, -1.0])
    way = (1.0 + (b * np.exp(a * end) - a * np.exp(b * end)) / (a - b)) / stiffness
    speed = a * b * (np.exp(a * end) - np.exp(b * end)) / (a - b) / stiffness
    exact = way - 0.5 * stiffness * way**2 - 0.5 * speed**2
    errors, gaps = [], []
    for dt in (4e-3, 2e-3, 1e-3):
        found = run(one_bar(rate), MPI.COMM_SELF, dt=dt, t_end=end, rho_inf=rho, tolerance=1e-12)
        errors.append(found["energy_dissipation"][-1] / exact - 1.0)
        gaps.append(np.abs(found["energy_balance"]).max() / exact)
    assert np.abs(errors).max() < 1e-3
    assert abs(errors[-1]) < 1e-4
    # the balance is what the scheme makes, of second order: nothing with 1
    assert gaps[-1] < (1e-8 if rho == 1.0 else 2e-4)
    assert gaps[-1] < 1e-8 or gaps[-1] / gaps[-2] < 0.3


@pytest.mark.serial
@pytest.mark.parametrize("rho", [0.0, 0.9, 1.0])
def test_energies_of_a_mass_whose_steps_do_not_resolve_its_damper(rho: float) -> None:
    """In the limit of no mass the bar yields to 1 N as ``1 - exp(-t k / c)``."""
    rate, dt, end = 1e5, 20.0, 2000.0
    found = run(one_bar(rate), MPI.COMM_SELF, dt=dt, t_end=end, rho_inf=rho, tolerance=1e-12)
    work = found["energy_work"][-1]
    # 2e-2 without the work of accelerations that have ended
    assert np.abs(found["energy_balance"]).max() < (1e-8 if rho == 1.0 else 1e-4) * work
    way = (1.0 - np.exp(-end * 100.0 / rate)) / 100.0
    # it is late by half a step
    assert found["energy_dissipation"][-1] == pytest.approx(way - 50.0 * way**2, rel=1e-3)
