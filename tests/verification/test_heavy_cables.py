# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cables with mass against closed forms, balances and chains of bodies."""

from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexfem as ff
from tests.histories import columns

G = 9.81
SMALL = (0.01, 0.01, 0.01)
MU = 1.5


def run(model: ff.Model, dt: float, t_end: float, **given: Any) -> dict[str, np.ndarray]:
    """History on all ranks, after it was compared with that of one process."""
    options = ff.RunOptions(dt=dt, t_end=t_end, quiet=True, **given)
    alone = ff.simulate(model, options, comm=MPI.COMM_SELF).history
    shared = columns(ff.simulate(model, options)) if MPI.COMM_WORLD.size > 1 else {}
    for name, values in shared.items():
        # round-off; mass that no rank or two ranks count is of the order of the values
        np.testing.assert_allclose(
            values, alone[name], atol=1e-9 * np.abs(values).max() + 1e-12, err_msg=name
        )
    return {name: np.asarray(values) for name, values in alone.items()}


def model_of(*things: Any) -> ff.Model:
    """A model under gravity with its energies."""
    model = ff.Model("heavy")
    model.add(ff.Gravity((0.0, 0.0, -G)), *things, ff.EnergyProbe())
    return model


def balanced(history: dict[str, np.ndarray], part: float) -> None:
    """Check that the balance of the energies is small."""
    size = np.abs(history["energy_kinetic"]).max()
    assert np.abs(history["energy_balance"]).max() < part * size


M1, M2, RADIUS, DEEP = 3.0, 2.0, 0.2, 2.0


def atwood(**cable: Any) -> ff.Model:
    """Two masses on a heavy cable over a sheave."""
    sheave = ff.Sheave(ff.Ground(), RADIUS, (0.0, 1.0, 0.0))
    path = [ff.Marker("heavy"), sheave, ff.Marker("light")]
    return model_of(
        ff.RigidBody("heavy", M1, SMALL, position=(-RADIUS, 0.0, -DEEP)),
        ff.RigidBody("light", M2, SMALL, position=(RADIUS, 0.0, -DEEP)),
        ff.Cable("cable", path, mass_per_length=MU, tension_only=False, **cable),
        ff.PositionProbe("at", ff.Marker("heavy")),
        ff.CableProbe("pull", "cable"),
    )


@pytest.mark.three_ranks
@pytest.mark.parametrize("integrator", ["generalized_alpha", "stabilized_index2"])
def test_atwoods_machine_with_a_heavy_rope(integrator: str) -> None:
    """(m1 + m2 + mu L) x'' = (m1 - m2 + 2 mu x) g, with what lies on the sheave in L."""
    history = run(atwood(), 4e-3, 0.8, integrator=integrator)
    whole = M1 + M2 + MU * (2.0 * DEEP + np.pi * RADIUS)
    rate, x0 = np.sqrt(2.0 * MU * G / whole), (M1 - M2) / (2.0 * MU)
    exact = -DEEP - x0 * (np.cosh(0.8 * rate) - 1.0)
    # second order in the step, 2e-6 m here; the sheave's share of the mass alone is 3e-2 m
    assert history["at_z"][-1] == pytest.approx(exact, abs=5e-6)
    balanced(history, 1e-6)
