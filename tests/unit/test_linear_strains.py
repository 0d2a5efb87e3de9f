# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear models: strains and resultants as outputs, modes that are missing."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.simulation import linear_model

COMM = MPI.COMM_WORLD
STEEL = ff.Material(2.1e11, 0.3, 7850.0)
BENDING = 2.1e11 * 0.02 * 0.01**3 / 12.0  # about z, N m^2


def cantilever(formulation: str = "se3") -> ff.Model:
    """Two metres, eight elements, a force across its end."""
    mesh = ff.LineMesh.straight({"bar": [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0)]}, elements=8)
    section = ff.Section.rectangle(0.01, 0.02, STEEL)
    end = ff.Marker("bar", "end")
    model = ff.Model("cantilever", mesh=mesh)
    model.add(
        ff.Beam("bar", section, formulation=formulation),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("bar", "start")),
        ff.PositionProbe("end", end),
        ff.StrainProbe("gauge", "bar", 0.3125),  # the middle of the third element
        ff.Probe("turned", end, ["slope"], lambda t, at: [at.rotation[1, 0]]),
        ff.PointForce("across", end, (0.0, 1.0, 0.0)),
    )
    return model


@pytest.mark.serial
@pytest.mark.parametrize("formulation", ["se3", "nurbs"])
def test_static_strains_of_a_cantilever(formulation):
    """A force of 1 N across the end bends by 1 N times the arm, and shears by 1 N."""
    linear = ff.linearize(cantilever(formulation), ff.LinearOptions(quiet=True))
    # outputs come in the order of the model
    assert linear.outputs[:4] == ("end_x", "end_y", "end_z", "gauge_gamma1")
    assert linear.outputs[-1] == "slope"
    gain = dict(zip(linear.outputs, -linear.C @ np.linalg.solve(linear.A, linear.B), strict=True))
    arm = 2.0 * (1.0 - 0.3125)
    # a neighbouring element's moment is off by 18 %, one of the wrong sign by its double
    assert gain["gauge_m3"] == pytest.approx([arm], rel=1e-3)
    assert gain["gauge_kappa3"] == pytest.approx([arm / BENDING], rel=1e-3)
    assert gain["gauge_n2"] == pytest.approx([1.0], rel=1e-3)
    assert gain["slope"] == pytest.approx([0.5 * 2.0**2 / BENDING], rel=1e-2)
    assert abs(gain["gauge_m2"][0]) < 1e-6


@pytest.mark.serial
def test_velocities_behind_strains_are_rates_of_positions():
    """Each row of C has its own derivative by the velocities, in the order of the model."""
    model, end = cantilever(), ff.Marker("bar", "end")
    names = ["end_vx", "end_vy", "end_vz"]
    model.add(ff.Probe("moving", end, names, lambda t, at: at.velocity))
    linear = ff.linearize(model, ff.LinearOptions(quiet=True))
    s = 40.0j
    response = linear.C @ np.linalg.solve(s * np.eye(len(linear.A)) - linear.A, linear.B)[:, 0]
    found = dict(zip(linear.outputs, response, strict=True))
    # zero if rows of the strains, without rates, took the place of the velocities'
    assert found["end_vy"] == pytest.approx(s * found["end_y"], rel=1e-9)
    # without damping all that is no velocity is in phase with the force; with rates it would not be
    others = [value for name, value in found.items() if name not in names]
    assert np.abs(np.imag(others)).max() < 1e-9 * np.abs(others).max()
    assert abs(found["end_vy"]) > 1e-6


def test_strains_do_not_depend_on_ranks():
    """The beam is divided among the ranks, so that elements have nodes of others."""
    found = []
    for comm in (COMM, MPI.COMM_SELF):
        options = ff.LinearOptions(quiet=True, split_above=2)
        linear = ff.linearize(cantilever(), options, comm=comm)
        response = linear.C @ np.linalg.solve(40.0j * np.eye(len(linear.A)) - linear.A, linear.B)
        found.append((linear.outputs, response[:, 0]))
    (names, spread), (expected, alone) = found
    assert names == expected
    # strains between nodes of which one stays would be off by their largest digits
    assert spread == pytest.approx(alone, rel=1e-5, abs=1e-9)
    assert abs(alone[names.index("gauge_m3")]) > 0.05


@pytest.mark.serial
def test_modes_that_are_missing_are_told(monkeypatch):
    find = linear_model.settled_modes
    monkeypatch.setattr(linear_model, "settled_modes", lambda *given: find(*given).first(2))
    with pytest.warns(RuntimeWarning, match="linearize: only 2 of 3 modes converged; request"):
        linear = ff.linearize(cantilever(), ff.LinearOptions(quiet=True, modes=3))
    assert linear.status == "only 2 of 3 modes converged; request fewer modes"
    assert len(linear.A) == 4
    assert repr(linear).startswith("LinearModel('only 2 of 3 modes")
    assert "inputs across; outputs end_x, end_y" in repr(linear)
