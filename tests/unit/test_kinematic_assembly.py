# SPDX-License-Identifier: LGPL-3.0-or-later
"""Starts at which joints hold, from bodies in rough positions."""

import re

import numpy as np
import pytest

import flexfem as ff
from flexfem.kinematics.rigid_parts import RigidParts
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3, so3

pytestmark = pytest.mark.serial

Z = (0.0, 0.0, 1.0)
STEEL = ff.Material(2e11, 0.3, 7800.0)
SECTION = ff.Section.rectangle(0.02, 0.01, STEEL)


def gaps(model: ff.Model) -> float:
    """Largest gap of the joints at the start, by the rows that a run would check."""
    from flexfem.kinematics.mechanism import RigidMechanism

    serial = NumberedModel(model)
    mechanism = RigidMechanism(serial, RigidParts(serial), serial.joints)
    return float(np.abs(mechanism.rows.values[mechanism.rows.rigid]).max())


def four_bar() -> ff.Model:
    """Crank and rod of beams, rocker rigid; nothing fits."""
    lines = {"crank": [(0, 0, 0), (0.0, 0.3, 0)], "rod": [(0.05, 0.33, 0.01), (0.7, 0.5, 0)]}
    model = ff.Model("four_bar", mesh=ff.LineMesh.straight(lines, elements=2))
    model.add(
        ff.Beam("crank", SECTION, angular_velocity=(0.0, 0.0, 2.0)),
        ff.Beam("rod", SECTION),
        ff.RigidBody("rocker", 1.0, (0.02, 0.01, 0.02), position=(0.8, 0.25, 0.0)),
        ff.PointMass("ballast", 0.3, ff.Marker("rod", 0.5)),
        ff.Revolute("A", ff.Ground(), ff.Marker("crank", "start"), axis=Z),
        ff.Revolute("B", ff.Marker("crank", "end"), ff.Marker("rod", "start"), axis=Z),
        ff.PointOnLine(
            "C", ff.Marker("rod", "end"), ff.Marker("rocker", offset=(0.0, 0.25, 0.0)), axis=Z
        ),
        ff.Revolute("D", ff.Ground((0.8, 0, 0)), ff.Marker("rocker", offset=(0, -0.25, 0)), axis=Z),
        ff.PointForce("push", ff.Marker("rod", "end"), (1.0, 0.0, 0.0), follower=True),
        ff.PositionProbe("corner", ff.Marker("rod", "end")),
    )
    return model


@pytest.mark.parametrize("measure", ["inertia", "distance"])
def test_four_bar(measure):
    rough = four_bar()
    model = ff.assemble(rough, keep=["crank"], measure=measure)
    # gaps of a tenth were there; what Newton leaves is round-off
    assert gaps(rough) > 0.05
    assert gaps(model) < 1e-12
    points = model.mesh.points.reshape(2, 3, 3)
    # a body that is kept stays bit by bit; lengths are those of rigid motions
    np.testing.assert_array_equal(points[0], rough.mesh.points.reshape(2, 3, 3)[0])
    length = np.linalg.norm(np.array([0.65, 0.17, -0.01]))
    assert np.linalg.norm(points[1, 2] - points[1, 0]) == pytest.approx(length, rel=1e-12)
    rocker = model["rocker"]
    tip = rocker.position + rocker.rotation @ [0.0, 0.25, 0.0]
    np.testing.assert_allclose(tip[:2], points[1, 2, :2], atol=1e-12)
    # parts fixed to a body rotate with it: markers, their followers, the velocities
    before, after = rough.mesh.points.reshape(2, 3, 3)[1], points[1]
    turn = model["C"].a.rotation
    np.testing.assert_allclose(after[2] - after[0], turn @ (before[2] - before[0]), atol=1e-12)
    np.testing.assert_allclose(model["push"].marker.rotation, turn, atol=1e-15)
    np.testing.assert_array_equal(model["push"].force, (1.0, 0.0, 0.0))
    assert rough["C"].a.rotation is not turn
    assert [thing.name for thing in model.things] == [thing.name for thing in rough.things]


def test_the_smallest_motion_is_taken():
    """A pendulum beside its pin: mass times displacements and inertia times rotations are least."""
    model = ff.Model("pendulum")
    inertia, arm = 0.05, np.array([0.0, 0.4, 0.0])
    model.add(
        ff.RigidBody("bob", 2.0, (inertia, inertia, inertia)),
        ff.Spherical("pin", ff.Ground((0.001, 0.4, 0.0)), ff.Marker("bob", offset=arm)),
    )
    bob = ff.assemble(model)["bob"]
    # shift u and rotation w about Z with u - 0.4 w = gap: u = gap J/(J + m 0.16), by Lagrange
    share = inertia / (inertia + 2.0 * 0.16)
    # equal to second order in the gap; by plain motions the share would be 0.86
    np.testing.assert_allclose(bob.position[0], 0.001 * share, rtol=1e-3)
    angle = so3.log(bob.rotation)[2]
    np.testing.assert_allclose(-0.4 * angle, 0.001 * (1.0 - share), rtol=1e-3)


def test_spatial_linkage_with_turning_axes():
    """RSSR linkage with a universal joint, rotated and shifted: axes move with their bodies."""
    rng = np.random.default_rng(5)
    model = ff.Model("spatial")
    first, second = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
    start = {"crank": (0.1, 0.0, 0.0), "rod": (0.5, 0.15, 0.1), "arm": (0.8, 0.2, 0.0)}
    for name, place in start.items():
        model.add(
            ff.RigidBody(
                name, 1.0, (0.01, 0.02, 0.02), velocity=(0.1, 0.2, 0.3),
                position=np.array(place) + 0.02 * rng.normal(size=3),
                rotation=so3.exp(0.1 * rng.normal(size=3)),
            )
        )  # fmt: skip
    upper, lower = (ff.Marker("arm", offset=(0, y, 0)) for y in (0.1, -0.1))
    universal = ff.Universal(
        "U", ff.Marker("crank", offset=(0.1, 0, 0)), ff.Marker("rod", offset=(-0.33, 0, 0)),
        axis=first, second_axis=second,
    )  # fmt: skip
    model.add(
        ff.Revolute("A", ff.Ground(), ff.Marker("crank", offset=(-0.1, 0, 0)), axis=Z),
        universal,
        ff.Spherical("S", ff.Marker("rod", offset=(0.33, 0, 0)), upper),
        ff.Revolute("B", ff.Ground((0.8, 0.1, 0)), lower, axis=(1.0, 0.0, 0.0)),
        ff.JointFriction(
            "rub",
            guide := ff.Cylindrical("guide", ff.Marker("crank"), ff.Marker("bead"), axis=first),
            "rotation", force=0.1, velocity=0.1,
        ),
        ff.RigidBody("bead", 0.1, (1e-4, 1e-4, 1e-4), position=(0.1, 0.1, 0.02)),
    )  # fmt: skip
    model.add(guide)
    moved = ff.assemble(model)
    assert gaps(moved) < 1e-11
    for name, marker, field in (("U", 0, "axis"), ("U", 1, "second_axis"), ("guide", 0, "axis")):
        body = (moved[name].a, moved[name].b)[marker].body
        turn = moved[body].rotation @ model[body].rotation.T
        old = np.array(getattr(model[name], field))
        # axes that stayed behind would be off by the rotations, a tenth
        np.testing.assert_allclose(getattr(moved[name], field), turn @ old, atol=1e-12)
        assert np.abs(turn - np.eye(3)).max() > 0.01
    # common things stay common: friction acts on the joint that moved
    assert moved["rub"].joint is moved["guide"]
    assert moved["rub"].a is moved["guide"].a
    # initial velocities rotate with their bodies, those along body axes stay
    rod = moved["rod"]
    turn = rod.rotation @ model["rod"].rotation.T
    np.testing.assert_allclose(rod.velocity, turn @ [0.1, 0.2, 0.3], atol=1e-14)


def test_curves_and_shells_move_with_meshes():
    """A NURBS arch pinned to a shell: frames of both after the motion are those before, moved."""
    arc = ff.NurbsCurve.arc(centre=(0, 0, 0), start=(1, 0, 0), axis=(0, 0, 1), angle=1.0)
    plate = ff.SurfaceMesh.grid("plate", np.linspace(0, 1, 3), np.linspace(0, 1, 3))
    mesh = ff.LineMesh.straight({"post": [(3, 0, 0), (3, 0, 1.0)]}, 2)
    model = ff.Model("mixed", mesh=mesh, surface=plate)
    corner = ff.Marker("plate", (1.0, 1.0, 0.0))
    model.add(
        ff.Beam("arch", SECTION, curve=arc),
        ff.Beam("post", SECTION, orientation=lambda x: np.tile((1.0, 0.2, 0.0), (len(x), 1))),
        ff.Shell("plate", ff.ShellSection.isotropic(0.01, STEEL)),
        ff.Spherical("pin", ff.Marker("arch", "start"), corner),
        ff.Spherical("top", ff.Marker("arch", 0.7), ff.Marker("post", "end")),
    )
    moved = ff.assemble(model)
    assert gaps(moved) < 1e-11
    old, new = NumberedModel(model), NumberedModel(moved)
    for name in ("arch", "post"):
        before, after = (a.family_of(name).frames for a in (old, new))
        motion = se3.compose(after, se3.inverse(before))
        # one rigid motion for all nodes: newly chosen frames would differ by rotations about the
        # line
        np.testing.assert_allclose(motion, np.broadcast_to(motion[0], motion.shape), atol=1e-12)
        assert np.abs(motion[0] - se3.frame(np.zeros(3), np.eye(3))).max() > 0.01, name
    # masses and inertia about the own middle are the same bodies'
    for before, after in zip(RigidParts(old).inertia, RigidParts(new).inertia, strict=True):
        np.testing.assert_allclose(np.linalg.eigvalsh(after), np.linalg.eigvalsh(before), rtol=1e-9)


def across(points: np.ndarray) -> np.ndarray:
    """A direction of e2 that changes along x."""
    return np.column_stack([0.0 * points[:, 0], np.cos(points[:, 0]), np.sin(points[:, 0])])


@pytest.mark.parametrize("formulation", ["se3", "nurbs"])
@pytest.mark.parametrize("orientation", [None, (0.0, 1.0, 0.3), across])
def test_sections_of_beams_turn_with_their_markers(formulation, orientation):
    """Wherever e2 comes from: axes of a marker are fixed in the section that it stands on."""
    mesh = ff.LineMesh.straight({"bar": [(0, 0, 0), (1, 0, 0)]}, 4)
    model = ff.Model("bar", mesh=mesh)
    model.add(
        ff.Beam("bar", SECTION, orientation=orientation, formulation=formulation),
        ff.Spherical("start", ff.Ground(), ff.Marker("bar", "start")),
        ff.Spherical("end", ff.Ground((0.6, 0.64, 0.48)), ff.Marker("bar", "end")),
    )
    moved = ff.assemble(model)
    turn = moved["end"].b.rotation
    found = []
    for one in (model, moved):
        frames = NumberedModel(one).family_of("bar").frames
        found.append(frames[:, 3:].reshape(-1, 3, 3))
    # a bar of 0.02 by 0.01 on its other side, or one that stays, would be off by 1
    np.testing.assert_allclose(found[1], turn @ found[0], atol=1e-10)
    np.testing.assert_allclose(turn[:, 0], (0.6, 0.64, 0.48), atol=1e-10)


def test_inertia_of_bodies_as_wholes():
    """Rods, an arc and a plate against closed forms; beams with common nodes are one part."""
    mesh = ff.LineMesh([(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 1, 0)], [(0, 1), (1, 2), (2, 3)],
                       {"a": [0, 1], "b": [2]})  # fmt: skip
    radius = 0.5
    ring = ff.NurbsCurve.circle(centre=(0, 0, 0), start=(radius, 0, 0), axis=(0, 0, 1)).refine(8)
    model = ff.Model("parts", mesh=mesh,
                     surface=ff.SurfaceMesh.grid("plate", [0, 0.3, 1.0], [0.0, 2.0]))  # fmt: skip
    line = SECTION.mass_per_length
    model.add(
        ff.Beam("a", SECTION), ff.Beam("b", SECTION), ff.Beam("ring", SECTION, curve=ring),
        ff.Shell("plate", ff.ShellSection.isotropic(0.01, STEEL)),
        ff.PointMass("tip", 0.7, ff.Marker("b", "end")),
    )  # fmt: skip
    parts = RigidParts(NumberedModel(model))
    assert parts.names == [("a", "b"), ("ring",), ("plate",)]
    corner, round_, plate = parts.inertia
    middle = se3.position(parts.frames[0])
    # two rods and a mass about the mean of the nodes; the section's own inertia is 1e-4 of it
    about = line * (2 / 12 * 4 + 2 * ((1 - middle[0]) ** 2 + middle[1] ** 2))
    about += line * (1 / 12 + (2 - middle[0]) ** 2 + (0.5 - middle[1]) ** 2)
    about += 0.7 * ((2 - middle[0]) ** 2 + (1 - middle[1]) ** 2)
    assert corner[0, 0] == pytest.approx(3.0 * line + 0.7, rel=1e-12)
    assert corner[5, 5] == pytest.approx(about, rel=1e-3)
    off = se3.position(parts.frames[1])
    assert np.abs(off[2]) < 1e-15
    around = np.pi * radius**3 * line + 2 * np.pi * radius * line * np.array([off[1], off[0]]) ** 2
    assert round_[5, 5] == pytest.approx(around.sum(), rel=1e-3)
    assert round_[3, 3] == pytest.approx(around[0], rel=1e-3)
    area = 2.0 * 0.01 * 7800.0
    about = plate[5, 5] - plate[0, 0] * np.sum((se3.position(parts.frames[2])[:2] - [0.5, 1]) ** 2)
    # the rule is exact: a mass at the corners would give three times as much
    assert plate[0, 0] == pytest.approx(area, rel=1e-12)
    assert about == pytest.approx(area * 5 / 12, rel=1e-12)


def test_what_cannot_be_closed_is_named():
    with pytest.raises(
        ValueError, match=r'^\w+ "[A-D]": it cannot be closed, a gap of 0\.0\d+ remains'
    ):
        ff.assemble(four_bar(), keep=["crank", "rocker"])
    with pytest.raises(
        ValueError, match=r'keep: there is no body "wheel"; there are rocker, crank'
    ):
        ff.assemble(four_bar(), keep=["wheel"])
    with pytest.raises(ValueError, match="measure must be one of inertia, distance, got mass"):
        ff.assemble(four_bar(), measure="mass")
    model = four_bar()
    model.add(ff.Spherical("lost", ff.Ground(), ff.Marker("nobody")))
    with pytest.raises(ValueError, match=r'Spherical "lost".*nobody'):
        ff.assemble(model)
    model = four_bar()
    late = ff.PrescribedAngle("turn", ff.Ground(), ff.Marker("rocker"), axis=Z, angle=lambda t: 0.1)
    model.add(late)
    with pytest.raises(ValueError, match=re.escape('PrescribedAngle "turn": it does not hold')):
        ff.assemble(model)


def test_joints_that_only_place_the_output():
    plane = ff.PointOnPlane(
        "there", ff.Ground((0.66, 0, 0)), ff.Marker("rod", "end"), axis=(1.0, 0.0, 0.0)
    )
    model = ff.assemble(four_bar(), also=[plane])
    assert model.mesh.points[-1, 0] == pytest.approx(0.66, abs=1e-12)
    assert gaps(model) < 1e-12
    assert model.get("there") is None


def test_shells_move_with_their_directions_and_rest_states():
    """Functions of places are asked about the same material points, velocities turn."""
    from flexfem.kinematics.moved_model import moved_model

    turn = so3.exp(np.array([0.3, -0.4, 0.5]))
    pose, sun = ff.Pose((1.0, 2.0, 3.0), turn), ff.ThermalStrain(1e-5, lambda x, t: t * x[:, 0])
    start = ff.Model("one", surface=ff.SurfaceMesh.grid("plate", [0.0, 1.0, 2.0], [0.0, 1.0]))
    bend = {"rest_curvature": lambda x: np.stack([x[:, 0], x[:, 1], 0.0 * x[:, 0]], 1)}
    given = {"direction": (1.0, 0.0, 0.0), "angular_velocity": (0.0, 2.0, 0.0), "prestrain": sun}
    start.add(ff.Shell("plate", ff.ShellSection.isotropic(0.01, STEEL), **bend, **given))
    moved = moved_model(start, {"plate": pose})
    (shell,) = moved.shells
    points = start.surface.points
    np.testing.assert_allclose(moved.surface.points, pose.apply(points), atol=1e-14)
    np.testing.assert_allclose(shell.direction, turn[:, 0])
    # the point at (1, 0, 0) goes down with 2 m/s
    at = shell.velocity + np.cross(shell.angular_velocity, pose.apply((1.0, 0.0, 0.0)))
    np.testing.assert_allclose(at, turn @ (0.0, 0.0, -2.0), atol=1e-14)
    there = moved.surface.points
    expected = bend["rest_curvature"](points)
    np.testing.assert_allclose(shell.rest_curvature(there), expected, atol=1e-14)
    np.testing.assert_allclose(
        shell.initial_strain(there, 2.0), sun.of_shell(points, 2.0), atol=1e-18
    )
