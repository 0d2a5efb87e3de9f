# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nonlinear solids in mechanisms: joints on surfaces, bonds, contact, restart."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import ufl

import flexfem as ff
from tests.histories import columns

COMM = MPI.COMM_WORLD
NEO = ff.laws.NeoHookean.from_young(1e6, 0.4)


def run(model: ff.Model, folder: Path, **options) -> dict[str, np.ndarray]:
    """History of a motion, on all ranks; bodies are split over them."""
    return columns(ff.simulate(model, ff.RunOptions(output=folder, split_above=1, **options)))


def test_bonded_surface_carries_the_load_of_a_rigid_plate(shared_tmp_path):
    """All nodes of a surface on a plate: more rows than dense checks take, one resultant."""
    mesh = ff.SolidMesh.box((1.0, 1.0, 0.1), (10, 10, 1), "tetrahedron")
    pad = ff.Solid("pad", NEO, mesh, density=1000.0, degree=1, fixed={"z0": "xyz"})
    plate = ff.Marker("plate")
    model = ff.Model("pad")
    model.add(
        pad,
        ff.RigidBody("plate", mass=1.0, inertia=np.eye(3), position=(0.5, 0.5, 0.1)),
        ff.RigidPoints("bond", plate, nodes=pad.node_markers("z1")),
        ff.PointForce("push", plate, (1e4, 0.0, -1e4)),
        ff.PositionProbe("plate_at", plate),
        ff.ReactionProbe("bond_on", "bond"),
        ff.SolidProbe("top", "pad", "z1", measures=("position", "displacement")),
        ff.SolidProbe("inside", "pad", (0.5, 0.5, 0.03), measures=("displacement",)),
    )
    options = ff.StaticOptions(output=shared_tmp_path, load_steps=2, split_above=1)
    last = {name: values[-1] for name, values in columns(ff.solve_static(model, options)).items()}
    # equilibrium to the tolerance of Newton's method
    assert last["bond_on_fx"] == pytest.approx(-1e4, rel=1e-6)
    assert last["bond_on_fz"] == pytest.approx(1e4, rel=1e-6)
    # the plate is bonded to all of the surface; at 0.3 of the height the pad moves 0.3 as far
    assert last["top_ux"] == pytest.approx(last["plate_at_x"] - 0.5, rel=1e-9)
    assert last["top_z"] == pytest.approx(last["plate_at_z"], rel=1e-9)
    assert last["inside_ux"] == pytest.approx(0.3 * last["top_ux"], rel=0.02)
    # a thin pad is sheared uniformly but at its rim, and compresses by less than a free bar
    assert last["plate_at_x"] - 0.5 == pytest.approx(1e4 * 0.1 / NEO.shear_modulus, rel=0.05)
    assert 0.1 * (1.0 - 1e4 / 1e6) < last["plate_at_z"] < 0.1


@pytest.mark.three_ranks
def test_slender_solid_bends_far_in_few_iterations(shared_tmp_path):
    """Half of its length in one load step: stresses that are continued do not stretch it."""
    mesh = ff.SolidMesh.box((1.0, 0.02, 0.02), (20, 1, 1), "tetrahedron")
    law = ff.laws.SaintVenantKirchhoff(1e6, 0.4)
    model = ff.Model("strip")
    model.add(
        ff.Solid("strip", law, mesh, density=1.0, fixed={"x0": "xyz"}),
        ff.SurfaceTraction("lift", "strip", "x1", (0.0, 0.0, 130.0)),
        ff.SolidProbe("end", "strip", "x1", measures=("displacement",)),
    )
    options = ff.StaticOptions(output=shared_tmp_path, load_steps=1, split_above=1)
    outcome = ff.solve_static(model, options)
    # a rod under 3.9 EI/L^2, by integration of its equation; cells are a twentieth of it long
    assert columns(outcome)["end_uz"][-1] == pytest.approx(0.6645, rel=0.02)
    # 8; with the stresses of the iterates 17
    iterations = COMM.bcast(outcome.summary and outcome.summary["newton_iterations"])
    assert iterations <= 11


@pytest.mark.slow_on_ranks
def test_solid_pendulum_falls_on_an_averaged_hinge(shared_tmp_path):
    """From the horizontal, with a rigid tip on its end: energy, momentum, ranks."""
    mesh = ff.SolidMesh.box((1.0, 0.1, 0.1), (4, 1, 1), "tetrahedron", origin=(0.0, -0.05, -0.05))
    bar = ff.Solid("bar", ff.laws.NeoHookean.from_young(1e7, 0.4), mesh, density=1000.0)
    tip = ff.Marker("tip", offset=(-0.05, 0.0, 0.0))
    model = ff.Model("pendulum")
    model.add(
        bar,
        ff.RigidBody("tip", mass=2.0, inertia=0.01 * np.eye(3), position=(1.05, 0.0, 0.0)),
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Revolute("pin", ff.Ground(), bar.surface_marker("x0"), axis=(0.0, 1.0, 0.0)),
        ff.Rigid("weld", bar.surface_marker("x1"), tip),
        ff.PositionProbe("end", tip),
        ff.EnergyProbe(),
        ff.MomentumProbe("all"),
        ff.ReactionProbe("pin_on", "pin"),
    )
    history = run(model, shared_tmp_path, t_end=0.3, dt=5e-3)
    # what the scheme dissipates; a wrong mass or work would show in percents
    assert np.abs(history["energy_balance"]).max() < 2e-3 * history["energy_kinetic"].max()
    # the impulse of weight and pin is the momentum, by the trapezoidal rule
    impulse = np.trapezoid(history["pin_on_fz"] - 12.0 * 9.81, history["t"])
    assert history["all_pz"][-1] == pytest.approx(impulse, rel=2e-3)
    # the bar bends by millimetres
    reach = float(np.hypot(history["end_x"][-1], history["end_z"][-1]))
    assert reach == pytest.approx(1.0, abs=0.02)
    # the same on any number of ranks
    assert history["end_z"][-1] == pytest.approx(END, abs=1e-9)


#: Height of the tip at the end on one rank, m.
END = -0.5256745317634196


@pytest.mark.slow_on_ranks
def test_solid_lands_without_penetration_and_makes_no_energy(shared_tmp_path):
    """A cube on a plane: forces of the barrier, at steps of a tenth of the time of contact."""
    mesh = ff.SolidMesh.box((0.2, 0.2, 0.2), (1, 1, 1), "tetrahedron", origin=(0.0, 0.0, 0.01))
    model = ff.Model("drop")
    model.add(
        ff.Solid("cube", NEO, mesh, density=1000.0, touching="boundary", velocity=(0, 0, -1)),
        ff.Contact("floor", "cube", surfaces=ff.RigidPlane(ff.Ground())),
        ff.ContactProbe("floor_at", "floor"),
        ff.EnergyProbe(),
        ff.MomentumProbe("all"),
    )
    history = run(model, shared_tmp_path, t_end=0.06, dt=2e-3)
    assert history["floor_at_gap"].min() > 0.0
    assert history["floor_at_normal"].max() > 100.0
    # nothing but the scheme's own dissipation
    assert history["energy_balance"].max() < 1e-9 * history["energy_kinetic"][0]
    # to the tolerance of Newton's method
    impulse = np.sum(history["floor_at_fz"][1:] * np.diff(history["t"]))
    assert history["all_pz"][-1] - history["all_pz"][0] == pytest.approx(impulse, rel=1e-6)


def viscous_energy(F, p):
    J = ufl.det(F)
    C = J ** (-2.0 / 3.0) * F.T * F
    return p.mu / 2.0 * (ufl.tr(C) - 3.0) + p.bulk / 4.0 * (J * J - 1.0 - 2.0 * ufl.ln(J))


def viscous_power(F, rate, p):
    d = (F.T * rate + rate.T * F) / 2.0
    return p.eta * ufl.inner(d, d)


def test_viscous_solid_loses_what_is_recorded_whatever_the_step(shared_tmp_path):
    """Coarse steps of the trapezoidal rule: velocities of stiff damped modes change sign."""
    mesh = ff.SolidMesh.box((0.1, 0.1, 0.05), (1, 1, 2), "hexahedron")
    numbers = {"mu": 1e6 / 2.6, "bulk": 1e6 / 1.2, "eta": 300.0}
    law = ff.laws.Hyperelastic(viscous_energy, numbers, viscous_power)
    model = ff.Model("pushed")
    model.add(
        ff.Solid("block", law, mesh, density=1000.0, fixed={"z0": "xyz"}),
        ff.SurfaceTraction("push", "block", "z1", (0.0, 0.0, 10.0), amplitude=lambda t: 100.0 * t),
        ff.EnergyProbe(),
    )  # fmt: skip
    found = run(model, shared_tmp_path, t_end=0.04, dt=2e-3, rho_inf=1.0, tolerance=1e-12)
    # 1e-6; with the mean power of both ends of the steps, which is not what they take, 2e-2
    assert abs(found["energy_balance"][-1]) < 1e-4 * found["energy_dissipation"][-1]


def test_solid_slides_on_a_plate_as_coulomb_says(shared_tmp_path):
    """Friction is that of the present normal force: both momenta together know no vibrations."""
    mesh = ff.SolidMesh.box((0.1, 0.1, 0.05), (1, 1, 1), "hexahedron", origin=(0.03, -0.05, 5.1e-3))
    u, v = np.linspace(-0.1, 0.3, 9), np.linspace(-0.1, 0.1, 5)
    section = ff.ShellSection.isotropic(0.01, ff.Material(2.1e11, 0.3, 7800.0))
    edges = {f"plate_{side}": "clamped" for side in ("left", "right", "bottom", "top")}
    angle, mu, g, speed = np.radians(20.0), 0.2, 9.81, 0.6
    law = ff.laws.NeoHookean.from_young(1e7, 0.3)
    model = ff.Model("slide", surface=ff.SurfaceMesh.grid("plate", u, v))
    model.add(
        ff.Gravity((g * np.sin(angle), 0.0, -g * np.cos(angle))),
        ff.Solid("block", law, mesh, density=1000.0, touching="boundary", velocity=(speed, 0, 0)),
        ff.Shell("plate", section, edges=edges),
        ff.Contact("touch", "block", "plate", friction=mu, reach=2e-4),
        ff.EnergyProbe(), ff.MomentumProbe("block_at", bodies=["block"]),
    )  # fmt: skip
    history = run(model, shared_tmp_path, t_end=0.05, dt=1e-3, rho_inf=1.0, tolerance=1e-10)
    px, pz = history["block_at_px"], history["block_at_pz"]
    expected = 0.5 * g * (np.sin(angle) - mu * np.cos(angle)) * history["t"][-1]
    # 5e-6, of px alone, which bounces, 1e-2; 7e-2 where the plate alone repels from the gap at the
    # start, and that only where it has been so near: the block climbs a step then
    assert (px + mu * pz)[-1] - px[0] == pytest.approx(expected, rel=1e-4)
    assert abs(history["energy_balance"][-1]) < 1e-5 * history["energy_dissipation"][-1]


@pytest.mark.slow_on_ranks
def test_plastic_motion_restarts_with_its_internal_variables(shared_tmp_path):
    """A bar that is bent beyond its yield stress: the rest of the motion from a checkpoint."""
    mesh = ff.SolidMesh.box((0.4, 0.1, 0.1), (2, 1, 1), "tetrahedron")
    law = ff.laws.J2Plasticity(4e5, 1e6, 2e4, 1e4)
    model = ff.Model("bar")
    model.add(
        ff.Solid("bar", law, mesh, density=1000.0, degree=1, fixed={"x0": "xyz"}),
        ff.SurfaceTraction("push", "bar", "x1", (0.0, 0.0, 4e3), amplitude=lambda t: min(9 * t, 1)),
        ff.PositionProbe("end", ff.Marker("bar", (0.4, 0.1, 0.1))),
        ff.EnergyProbe(),
    )
    options = {"dt": 5e-3, "checkpoint_every": 10}
    whole = run(model, shared_tmp_path / "whole", t_end=0.15, **options)
    half = shared_tmp_path / "half"
    run(model, half, t_end=0.1, **options)
    found = run(model, half, t_end=0.15, restart=sorted(half.glob("checkpoint*"))[-1], **options)
    assert whole["energy_dissipation"][-1] > 0.1 * whole["energy_work"][-1]
    # second order in the steps; without the dissipation half of the work is missing
    assert abs(whole["energy_balance"][-1]) < 0.02 * whole["energy_work"][-1]
    for name in ("end_z", "energy_dissipation", "energy_strain"):
        assert found[name][-1] == pytest.approx(whole[name][-1], rel=1e-9)


@pytest.mark.serial
def test_plastic_bar_keeps_its_strain_when_it_is_unloaded(shared_tmp_path):
    """Pulled beyond its yield stress and let go, in statics: what stays is the plastic strain."""
    mesh = ff.SolidMesh.box((1.0, 1.0, 1.0), (1, 1, 1), "tetrahedron")
    limit, hardening = 2e4, 1e5
    law = ff.laws.J2Plasticity(4e7, 1e8, limit, hardening)
    model = ff.Model("bar")
    model.add(
        ff.Solid("bar", law, mesh, density=1.0, degree=1, fixed={"x0": "x", "y0": "y", "z0": "z"}),
        ff.SurfaceTraction("pull", "bar", "x1", (2.2e4, 0, 0), amplitude=lambda t: min(t, 2 - t)),
        ff.PositionProbe("end", ff.Marker("bar", (1.0, 1.0, 1.0))),
        ff.SolidProbe("bar_at", "bar", measures=("von_mises", "J")),
    )
    options = ff.StaticOptions(load_steps=100, t_end=2.0, output=shared_tmp_path)
    history = columns(ff.solve_static(model, options))
    peak = int(np.argmax(history["bar_at_von_mises"]))
    # von Mises' stress times J is on the yield surface at the peak
    strain = (history["bar_at_von_mises"][peak] * history["bar_at_J"][peak] - limit) / hardening
    assert strain > 0.02
    # of first order in the steps; ones that forget their plastic strain would come back
    assert np.log(history["end_x"][-1]) == pytest.approx(strain, rel=5e-3)


@pytest.mark.slow_on_ranks
def test_plastic_impact_is_no_numerical_dissipation(shared_tmp_path):
    """A block that stops at a wall: what its law takes is neither an error nor a warning."""
    mesh = ff.SolidMesh.box((0.1, 0.1, 0.1), (1, 1, 1), "tetrahedron")
    law = ff.laws.J2Plasticity(4e5, 1e6, 2e4, 1e4)
    model = ff.Model("impact")
    model.add(
        ff.Solid(
            "block", law, mesh, density=1000.0, degree=1, fixed={"x0": "x"}, velocity=(-3.0, 0, 0)
        ),
        ff.EnergyProbe(),
    )
    options = ff.RunOptions(output=shared_tmp_path, split_above=1, dt=5e-4, t_end=0.02)
    outcome = ff.simulate(model, options)
    history = columns(outcome)
    start = history["energy_kinetic"][0]
    # the elastic limit is a twentieth of the energy: bounds that tell nothing at half of the loss
    assert history["energy_dissipation"][-1] > 0.8 * start
    assert abs(history["energy_balance"][-1]) < 0.02 * start
    warnings = COMM.bcast(outcome.summary and outcome.summary["warnings"])
    assert not [text for text in warnings if "numerical dissipation" in text]
