# SPDX-License-Identifier: LGPL-3.0-or-later
"""Starts of stiff damped bodies make no energy."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff


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
