# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of beams with shells and rigid surfaces, on any number of ranks."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.contact.obstacles.surface_data import _INERTIA
from flexfem.layout.numbered_model import NumberedModel
from flexfem.system.build import build
from tests.unit.contact_motion import ball, check_tangents, moved, same_on_ranks, sheet

THICK, RADIUS = 1e-3, 2e-3
SECTION = ff.ShellSection.isotropic(THICK, ff.Material(2e8, 0.3, 1000.0))
ROUND = ff.Section.circle(2 * RADIUS, ff.Material(1e9, 0.3, 1000.0))


def line(count, length, height, turn=0.0):
    """Straight beam along x, its middle over the origin, from height - turn to height + turn."""
    s = np.linspace(-0.5, 0.5, count + 1)
    points = np.c_[length * s, 0.003 + 0 * s, height + 2 * turn * s]
    cells = np.c_[np.arange(count), np.arange(1, count + 1)]
    return ff.LineMesh(points, cells, {"rod": np.arange(count)})


def dropped(**options):
    """A beam that falls onto a sheet that is free as it is, one end first."""
    height = THICK / 2 + RADIUS + 4e-4
    model = ff.Model(
        "dropped", mesh=line(6, 0.15, height, 2e-4), surface=sheet("sheet", 9, 0.2, (0, 0, 0))
    )
    model.add(ff.Shell("sheet", SECTION), ff.Beam("rod", ROUND, velocity=(0.2, 0.3, -1.0)))
    model.add(ff.Contact("hit", "rod", "sheet", **{"stiffness": 3e6} | options))
    model.add(ff.MomentumProbe("momentum"), ff.EnergyProbe(), ff.ContactProbe("touch", "hit"))
    return model


def test_drop_keeps_the_momenta_and_energy():
    _, history = moved(dropped(), 40, tolerance=1e-13)
    if MPI.COMM_WORLD.rank:
        return
    assert history["touch_penetration"].max() > 0.1 * THICK
    momentum = np.stack([history[f"momentum_p{a}"] for a in "xyz"])
    kinetic = history["energy_kinetic"]
    # rounding: measured 1e-11; a sheet that feels nothing gives 1
    np.testing.assert_allclose(momentum - momentum[:, :1], 0, atol=1e-9 * abs(momentum).max())
    # the scheme damps 0.5 %; without what contact stores 10 %
    assert abs(history["energy_balance"]).max() < 0.02 * kinetic[0]


@pytest.mark.three_ranks
def test_same_motion_on_any_number_of_ranks():
    alone = same_on_ranks(dropped(friction=0.3), 12, tolerance=1e-11, split_above=3)
    if MPI.COMM_WORLD.rank == 0:
        assert alone["touch_penetration"].max() > 0.1 * THICK


def test_tangents_are_the_derivatives_of_the_forces():
    simulation, _ = moved(dropped(friction=0.3, damping=1e-4), 12, split_above=3)
    simulation.system.contacts[0].time += 1e-4
    # measured 1e-8; of beams without what their turning changes 1e-3
    largest = check_tangents(simulation.system)
    assert len(largest) == 2
    assert min(largest) > 0.0


@pytest.mark.serial
@pytest.mark.parametrize("surface", ["plane", "mesh"])
def test_beam_at_rest_on_a_surface_weighs_what_it_does(surface):
    top = 0.0 if surface == "plane" else 0.05
    at = ff.RigidPlane(ff.Ground())
    if surface == "mesh":  # a block
        mesh = ball(1.0, 2)
        points = np.clip(10 * mesh.points, -1.0, 1.0) * [0.2, 0.1, 0.05]
        at = ff.RigidMesh(ff.Ground(), mesh=ff.SurfaceMesh(points, mesh.triangles, mesh.bodies))
    model = ff.Model("rest", mesh=line(5, 0.15, top + RADIUS - 1e-6))
    model.add(ff.Beam("rod", ROUND), ff.Gravity((0, 0, -10.0)))
    model.add(ff.Contact("floor", "rod", surfaces=at, stiffness=1e6, damping=2e-3))
    model.add(ff.ContactProbe("touch", "floor"))
    _, history = moved(model, 200)
    weight = 10.0 * ROUND.mass_per_length * 0.15
    # of a vibration that has died down; pressure on length times diameter
    assert history["touch_fz"][-1] == pytest.approx(weight, rel=1e-3)
    sunk = weight / (0.15 * 2 * RADIUS) / 1e6
    assert history["touch_penetration"][-1] == pytest.approx(sunk, rel=0.02)


@pytest.mark.serial
def test_points_between_nodes_stop_what_nodes_do_not():
    # one long element across a sheet whose edges are as long as an eighth of it
    model = ff.Model(
        "across", mesh=line(2, 0.4, 0.005), surface=sheet("sheet", 9, 0.1, (0.1, 0, 0))
    )
    model.add(ff.Shell("sheet", SECTION, edges={"sheet_left": "clamped"}))
    model.add(ff.Beam("rod", ROUND, velocity=(0, 0, -1.0)))
    model.add(ff.Contact("hit", "rod", "sheet", stiffness=1e7), ff.ContactProbe("touch", "hit"))
    simulation, history = moved(model, 30)
    touched = simulation.system.contacts[0].groups[0].triangles[0]
    assert history["touch_fz"].max() > 0.0
    assert len(touched.slaves.nodes) == 3 + 2 * 9


@pytest.mark.serial
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"section": ff.Section.rectangle(0.01, 0.01, ff.Material(1e9, 0.3, 1e3))}, "not round"),
    ],
)
def test_bad_beams(change, message):
    model = ff.Model("bad", mesh=line(4, 0.1, 0.1), surface=sheet("sheet", 3, 0.1, (0, 0, 0)))
    given = {"section": ROUND} | change
    model.add(ff.Shell("sheet", SECTION), ff.Beam("rod", **given))
    model.add(ff.Contact("hit", "rod", "sheet"))
    with pytest.raises(ValueError, match=f'Contact "hit": Beam "rod": .*{message}'):
        moved(model, 0)


@pytest.mark.serial
def test_energy_momentum_refuses_contact():
    model = ff.Model("rest", mesh=line(2, 0.1, 0.1))
    model.add(ff.Beam("rod", ROUND))
    model.add(ff.Contact("floor", "rod", surfaces=ff.RigidPlane(ff.Ground())))
    with pytest.raises(ValueError, match='Contact "floor": the integrator energy_momentum'):
        moved(model, 0, integrator="energy_momentum", rho_inf=1.0)


@pytest.mark.serial
@pytest.mark.parametrize("radius", [1e-3, 4e-3])
def test_stiffness_through_a_round_beam(radius):
    """E by the diameter: the axial stiffness over the section's area and its mean thickness."""
    young, density = 3e9, 1200.0
    model = ff.Model("rest", mesh=line(2, 0.1, 0.1))
    model.add(ff.Beam("rod", ff.Section.circle(2 * radius, ff.Material(young, 0.3, density))))
    model.add(ff.Contact("floor", "rod", surfaces=ff.RigidPlane(ff.Ground())))
    model.validate()
    [contact] = build(NumberedModel(model), MPI.COMM_WORLD, split_above=20).contacts
    surfaces = contact.groups[0].surfaces
    # at rest; half of it, or one that depends on another power of the radius, is no round-off
    assert surfaces.stiffness(0.0) == pytest.approx(young / (2.0 * radius), rel=1e-12)
    # the mass by length and diameter, under a quick motion of the matrix
    quick = surfaces.stiffness(1e3) / surfaces.stiffness(2e3)
    assert quick == pytest.approx(0.5, rel=1e-12)
    assert surfaces.stiffness(1e3) / 1e3 == pytest.approx(
        density * 0.25 * np.pi * 2.0 * radius * _INERTIA, rel=1e-12
    )
