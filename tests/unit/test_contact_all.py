# SPDX-License-Identifier: LGPL-3.0-or-later
"""``Contact("all")``: motions, on any number of ranks, are those of the same contact by names."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.contact.penalty_contact import penalty_contacts
from flexfem.layout.numbered_model import NumberedModel
from tests.unit.contact_motion import moved, same_on_ranks, sheet

THICK = 1e-3
SECTION = ff.ShellSection.isotropic(THICK, ff.Material(2e8, 0.3, 1000.0))
RADIUS = 0.05


def falling(*contact: ff.Contact, shape: object = None) -> ff.Model:
    """A ball that falls onto a sheet, which lies next to another one."""
    meshes = [sheet("low", 5, 0.2, (0, 0, 0)), sheet("high", 4, 0.15, (0.01, 0.02, 1.2e-3))]
    model = ff.Model("falling", surface=ff.SurfaceMesh.join(meshes))
    model.add(
        ff.Shell("low", SECTION), ff.Shell("high", SECTION, velocity=(0, 0, -1)),
        ff.RigidBody(
            "ball", 0.05, (5e-5, 5e-5, 5e-5), position=(0, 0, RADIUS + 1.9e-3),
            velocity=(0, 0, -2), shape=shape,
        ),
        *contact,
        ff.ContactProbe("touch", contact[0].name), ff.EnergyProbe(), ff.MomentumProbe("momentum"),
    )  # fmt: skip
    return model


@pytest.mark.three_ranks
def test_same_motion_on_any_number_of_ranks() -> None:
    found = same_on_ranks(falling(ff.Contact("all"), shape=ff.Sphere(RADIUS)), 2, tolerance=1e-10)
    if MPI.COMM_WORLD.rank == 0:
        assert found["touch_closed"].max() > 10


@pytest.mark.serial
def test_same_motion_as_by_names() -> None:
    everything = falling(ff.Contact("all", friction=0.1), shape=ff.Sphere(RADIUS))
    _, found = moved(everything, 6, tolerance=1e-10)
    names = ("low", "high")
    ball = ff.RigidSphere(ff.Marker("ball"), RADIUS)
    by_hand = falling(ff.Contact("all", names, names, ball, friction=0.1))
    _, other = moved(by_hand, 6, tolerance=1e-10)
    assert found["touch_closed"].max() > 20
    for name, values in other.items():
        # the same equations
        np.testing.assert_allclose(found[name], values, rtol=0, atol=1e-12, err_msg=name)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("shape", "surfaces"),
    [
        (ff.Cylinder(0.1, 0.2, (0, 1, 0)), ["RigidCylinder"]),
        (ff.Capsule(0.1, 0.2), ["RigidMesh"]),
        (ff.Box((0.1, 0.1, 0.1)), ["RigidMesh"]),
        (ff.CompoundShape([(ff.Sphere(0.1), ff.Pose((0, 0, 1.0))), (ff.Box((1, 1, 1)), ff.Pose())]),
         ["RigidSphere", "RigidMesh"]),
    ],
)  # fmt: skip
def test_shapes_are_surfaces(shape: object, surfaces: list[str]) -> None:
    serial = NumberedModel(falling(ff.Contact("all"), shape=shape))
    (made,) = penalty_contacts(serial)
    assert (made.bodies, made.against) == (("low", "high"), ("low", "high"))
    assert [type(surface).__name__ for surface in made.surfaces] == surfaces
    for surface in made.surfaces:
        pose = serial.marker_pose(surface.place)
        if isinstance(surface, ff.RigidCylinder):
            np.testing.assert_allclose(abs(pose.rotation[:, 2]), [0, 1, 0], atol=1e-15)
        if isinstance(surface, ff.RigidSphere):
            np.testing.assert_allclose(pose.position, [0, 0, RADIUS + 1.9e-3 + 1], rtol=1e-14)


@pytest.mark.serial
def test_rigid_bodies_that_all_are_joined_to_are_left_out() -> None:
    model = falling(ff.Contact("all"), shape=ff.Sphere(RADIUS))
    for name in ("low", "high"):
        marker = ff.Marker(name, (0.0, 0.0, 0.0))
        model.add(ff.Spherical(f"pin {name}", ff.Marker("ball", offset=(0, 0, -0.06)), marker))
    (made,) = penalty_contacts(NumberedModel(model))
    assert made.surfaces == ()
