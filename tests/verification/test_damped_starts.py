# SPDX-License-Identifier: LGPL-3.0-or-later
"""Starts of stiff damped bodies make no energy."""

from mpi4py import MPI

import numpy as np

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
