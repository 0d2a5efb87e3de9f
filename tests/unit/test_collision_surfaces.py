# SPDX-License-Identifier: LGPL-3.0-or-later
"""Collision surfaces of all kinds of bodies: points, primitives, weights and exclusions."""

from itertools import combinations
from math import pi

import numpy as np
import pytest

import flexfem as ff
from flexfem.contact.fields.obstacles import Obstacle, Obstacles
from flexfem.contact.primitives.complexes import Complex
from flexfem.contact.surfaces.primitives import Side
from flexfem.contact.surfaces.surfaces import CollisionSurfaces, collision_surfaces
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import so3
from flexfem.mesh.triangles import solids

pytestmark = pytest.mark.serial

STEEL = ff.Material(2e11, 0.3, 7800.0)
SHEET = ff.ShellSection.isotropic(2e-3, STEEL)
ROUND = ff.Section.circle(0.02, STEEL)  # its diameter
EXACT = {"rtol": 1e-12, "atol": 1e-14}
Z = (0.0, 0.0, 1.0)


def surfaces_of(model: ff.Model) -> CollisionSurfaces:
    model.validate()
    return collision_surfaces(NumberedModel(model))


def number(found: CollisionSurfaces, label: str) -> int:
    (one,) = [k for k, body in enumerate(found.bodies) if body.label == label]
    return one


def alone(found: CollisionSurfaces, label: str) -> tuple[Complex, Side]:
    """The cells of one body, and what touches others."""
    members = np.arange(len(found.bodies)) == number(found, label)
    return found.primitives.complex(members), Side.of(found.primitives, members)


def characteristic(found: CollisionSurfaces, side: Side) -> float:
    """That of Euler: 1 of a disc, 2 of a sphere, 0 of a ring."""
    return float(found.primitives.complex(side.members).coefficients.sum())


def sheet(name: str = "sheet", z: float = 0.0) -> ff.SurfaceMesh:
    points = ff.SurfaceMesh.rectangle(name, (0.6, 0.4), (3, 2))
    return ff.SurfaceMesh(points.points + np.array([0, 0, z]), points.triangles, points.bodies)


def ball(name: str, at: tuple[float, float, float], shape: object) -> ff.RigidBody:
    turned = so3.exp(np.array([0.4, 0.7, -0.2]))
    return ff.RigidBody(name, 2.0, (1.0, 1.0, 1.0), position=at, rotation=turned, shape=shape)


@pytest.mark.parametrize(
    ("element", "triangles", "points"), [("rotation_free", 12, 12), ("director", 48, 35)]
)
def test_shells(element: str, triangles: int, points: int) -> None:
    model = ff.Model("m", surface=sheet())
    model.add(ff.Shell("sheet", SHEET, element=element), ff.Contact("all"))
    found = surfaces_of(model)
    own, side = alone(found, 'Shell "sheet"')
    assert len(own.triangles) == triangles
    assert len(side.stations) == points
    assert characteristic(found, side) == 1  # of a disc; a sphere has 2, a ring 0
    assert side.areas.sum() == pytest.approx(0.24, rel=1e-12)
    np.testing.assert_allclose(found.primitives.radius, 1e-3, **EXACT)
    np.testing.assert_allclose(found.density, 7800 * 2e-3, **EXACT)
    # E / (1 - nu^2) h / h^2
    np.testing.assert_allclose(found.through, 2e11 / 0.91 / 2e-3, **EXACT)
    (sides,) = found.contacts
    assert sides.first is sides.second  # everything with itself
    assert not len(sides.excluded)


def test_shells_that_share_an_edge_count_alone_as_if_the_other_were_not_there() -> None:
    whole = sheet()
    halves = {"left": np.arange(6), "right": np.arange(6, 12)}
    model = ff.Model("m", surface=ff.SurfaceMesh(whole.points, whole.triangles, halves))
    model.add(ff.Shell("left", SHEET), ff.Shell("right", SHEET))
    model.add(ff.Contact("both"), ff.Contact("one", "left", "right"))
    found = surfaces_of(model)
    both, one = found.contacts
    assert characteristic(found, both.first) == characteristic(found, one.first) == 1
    assert characteristic(found, one.second) == 1
    assert one.first.areas.sum() == pytest.approx(0.12, rel=1e-12)
    assert one.second.areas.sum() == pytest.approx(0.12, rel=1e-12)
    assert both.first.areas.sum() == pytest.approx(0.24, rel=1e-12)


def test_membranes() -> None:
    def energy(x, X, p):
        from ufl import grad, inner

        return 0.5 * inner(grad(x), grad(x))

    mesh = ff.ElementMesh(sheet().points, sheet().triangles, "triangle")
    model = ff.Model("m")
    model.add(ff.UFLBody("skin", mesh, energy, density=0.3, thickness=4e-3))
    model.add(ff.RigidBody("punch", 1.0, (1, 1, 1), position=(0, 0, 1), shape=ff.Sphere(0.1)))
    model.add(ff.Contact("all"))
    found = surfaces_of(model)
    assert alone(found, 'UFLBody "skin"')[1].areas.sum() == pytest.approx(0.24, rel=1e-12)
    skin = found.primitives.body == number(found, 'UFLBody "skin"')
    np.testing.assert_allclose(found.primitives.radius[skin], 2e-3, **EXACT)
    np.testing.assert_allclose(found.density[skin], 0.3, **EXACT)


def test_beams_are_polylines() -> None:
    model = ff.Model("m", mesh=ff.LineMesh.straight({"rod": [(0, 0, 0), (2, 0, 0)]}, 4))
    model.add(ff.Beam("rod", ROUND), ff.Contact("all"))
    found = surfaces_of(model)
    own, side = alone(found, 'Beam "rod"')
    np.testing.assert_array_equal(found.primitives.edges, [[0, 1], [1, 2], [2, 3], [3, 4]])
    # the ends have none
    np.testing.assert_array_equal(own.coefficients, [0, -1, -1, -1, 0, 1, 1, 1, 1])
    assert characteristic(found, side) == 1
    assert side.areas.sum() == pytest.approx(2.0 * 0.02, rel=1e-12)  # length times diameter
    np.testing.assert_allclose(found.primitives.radius, 0.01, **EXACT)
    np.testing.assert_allclose(found.density, 7800 * pi * 0.01**2 / 0.02, **EXACT)


def test_stations_of_beams_are_as_near_as_what_they_touch_needs() -> None:
    model = ff.Model("m", mesh=ff.LineMesh.straight({"rod": [(0, 0, 1), (2, 0, 1)]}, 2))
    model.add(ff.Beam("rod", ROUND))
    drum = ff.RigidCylinder(ff.Ground(), 0.5)
    model.add(ff.Contact("wound", "rod", surfaces=drum))
    found = surfaces_of(model)
    (sides,) = found.contacts
    # sqrt(8 x 0.1 x 0.01 x 0.5): 0.0632 m, at most ten parts
    assert len(sides.first.stations) == 2 * 10 + 1
    assert sides.first.areas.sum() == pytest.approx(2.0 * 0.02, rel=1e-12)
    own, _ = alone(found, 'Beam "rod"')
    assert own.coefficients.tolist().count(-1.0) == 1  # further stations are no vertices
    assert not sides.fields  # a drum is a line with a radius
    drum_body = found.bodies[number(found, 'RigidCylinder 0 of Contact "wound"')]
    assert (drum_body.rigid, drum_body.carried, drum_body.owner) == (True, True, "")


def test_obstacles_have_a_distance_on_their_carrier() -> None:
    model = ff.Model("m", mesh=ff.LineMesh.straight({"rod": [(0, 0, 2), (2, 0, 2)]}, 2))
    model.add(ff.Beam("rod", ROUND), ff.RigidBody("cart", 1.0, (1, 1, 1), position=(1, 0, 0)))
    place = ff.Marker("cart", offset=(0.0, 0.0, 0.5))
    box = [(-1, -1, -0.5), (1, 1, 0.5)]
    slab = ff.RigidObstacle(place, lambda x: np.abs(x[:, 2]) - 0.25, box)
    model.add(ff.Contact("c", "rod", surfaces=slab))
    found = surfaces_of(model)
    (sides,) = found.contacts
    (field,) = sides.fields
    made = Obstacles([Obstacle.of(field)])
    at = made.placed(found.start)
    np.testing.assert_allclose(at.frames[0, :3], [1.0, 0.0, 0.5], **EXACT)
    distance, feet = made.closest(np.zeros(1, np.int64), np.array([[0.3, 0.2, 0.5]]))
    np.testing.assert_allclose(distance, 0.25, **EXACT)
    np.testing.assert_allclose(feet, [[0.3, 0.2, 0.25]], rtol=1e-9)
    assert (found.primitives.body[field.points] == -1).all()  # they only carry it
    assert len(sides.first.stations) > 3  # nearer than the ends of elements


def test_points_of_nurbs_beams_are_on_the_curve() -> None:
    turn = 1.5 * pi
    curve = ff.NurbsCurve.arc((0, 0, 0), (1, 0, 0), Z, turn, elements=3)
    model = ff.Model("m")
    model.add(ff.Beam("ring", ROUND, curve=curve), ff.Contact("all"))
    found = surfaces_of(model)
    own = np.flatnonzero(found.primitives.body >= 0)
    assert (own >= found.carried).all()  # control points only carry
    points = found.primitives.start[own]
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1.0, **EXACT)
    np.testing.assert_allclose(found.weights.sum(axis=1), 1.0, **EXACT)
    np.testing.assert_allclose(points[[0, -1]], [[1, 0, 0], [0, -1, 0]], **EXACT)
    _, side = alone(found, 'Beam "ring"')
    assert characteristic(found, side) == 1
    count = len(found.primitives.edges)
    chords = count * 2.0 * np.sin(0.5 * turn / count)
    # chords of a circle; elements of an arc of degree two are not divided quite equally
    assert side.areas.sum() == pytest.approx(0.02 * chords, rel=1e-3)
    middles = found.primitives.start[found.primitives.edges].mean(axis=1)
    assert np.linalg.norm(middles, axis=1).min() > 1.0 - 5e-3 * turn / 3


SHAPES = {
    "sphere": (ff.Sphere(0.2), 1, 0, 0, pi * 0.04),
    "capsule": (ff.Capsule(0.2, 1.0, (1.0, 1.0, 0.0)), 2, 1, 0, 0.4 + pi * 0.04),
    "box": (ff.Box((1.0, 2.0, 3.0)), 8, 18, 12, 22.0),
    "cylinder": (ff.Cylinder(0.5, 2.0, Z), 130, 384, 256, 2.5 * pi),
    "surface": (ff.SurfaceShape(*solids.box((2.0, 1.0, 1.0))), 8, 18, 12, 10.0),
    "compound": (
        ff.CompoundShape([
            (ff.Sphere(0.1), ff.Pose((0.0, 0.0, 1.0))), (ff.Box((1.0, 1.0, 1.0)), ff.Pose()),
        ]), 9, 18, 12, 6.0 + pi * 0.01,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_of_rigid_bodies(name: str) -> None:
    shape, points, edges, triangles, area = SHAPES[name]
    model = ff.Model("m")
    model.add(ball("a", (0, 0, 0), shape), ball("b", (0, 0, 9), ff.Sphere(0.1)), ff.Contact("all"))
    found = surfaces_of(model)
    own, side = alone(found, 'RigidBody "a"')
    assert (found.primitives.body == number(found, 'RigidBody "a"')).sum() == points
    assert len(found.primitives.edges) == edges
    assert len(own.triangles) == triangles
    # a solid's surface 2, a ball or rod 1 each
    assert characteristic(found, side) == {"compound": 3, "sphere": 1, "capsule": 1}.get(name, 2)
    # a prism of 64 sides is 0.1 % smaller than its cylinder, the others are exact
    share = 2e-3 if name == "cylinder" else 1e-12
    assert side.areas.sum() == pytest.approx(area, rel=share)
    assert found.bodies[0].density == pytest.approx(2.0 / side.areas.sum(), rel=1e-12)
    assert found.bodies[0].through == np.inf
    (sides,) = found.contacts
    np.testing.assert_array_equal(sides.excluded, [[0, 0], [1, 1]])  # not with themselves


@pytest.mark.parametrize("turn", [0.3, 2.5])
def test_carriers_give_the_positions_after_a_rigid_motion(turn: float) -> None:
    """Fixed points by frame and arm, means by weights: all move as one body."""
    model = ff.Model("m", mesh=ff.LineMesh.straight({"rod": [(0, 0, 3), (2, 1, 3)]}, 2),
                     surface=sheet(z=-3.0))  # fmt: skip
    curve = ff.NurbsCurve.line((0, 0, 5), (1, 1, 6), elements=2)
    model.add(
        ff.Beam("rod", ROUND), ff.Beam("bow", ROUND, curve=curve), ff.Shell("sheet", SHEET),
        *(ball(name, (4.0 * k, 0, 0), shape[0]) for k, (name, shape) in enumerate(SHAPES.items())),
    )  # fmt: skip
    tip = ff.RigidSphere(ff.Marker("rod", "end", offset=(0.1, 0, 0)), 0.05)
    model.add(ff.Contact("all"), ff.Contact("tip", "sheet", surfaces=tip))
    serial = NumberedModel(model)
    found = surfaces_of(model)
    R = so3.exp(turn * np.array([0.6, 0.0, -0.8]))
    shift = np.array([1.0, -2.0, 0.5])
    moved = np.empty((found.carried, 3))
    for k in range(found.carried):
        frame = serial.node_frames(int(found.kind[k]))[found.node[k]]
        turned = R @ frame[3:].reshape(3, 3)
        moved[k] = R @ frame[:3] + shift + turned @ found.arms[k]
    means = np.einsum("dq,dqa->da", found.weights, moved[found.parents])
    expected = found.primitives.start @ R.T + shift
    np.testing.assert_allclose(np.concatenate([moved, means]), expected, rtol=0, atol=1e-13)


def test_rigid_surfaces_on_the_ground_and_on_bodies() -> None:
    model = ff.Model("m", surface=sheet())
    box = ff.SurfaceMesh(*solids.box((1.0, 1.0, 1.0)), {"box": np.arange(12)})
    body = ff.RigidBody("cart", 3.0, (1, 1, 1), position=(0, 0, 2))
    model.add(ff.Shell("sheet", SHEET), body)
    listed = [
        ff.RigidPlane(ff.Ground((0, 0, -1))), ff.RigidSphere(ff.Ground((0, 0, -5)), 0.5),
        ff.RigidMesh(ff.Marker("cart"), mesh=box), ff.RigidSphere(ff.Ground(), 9.0, inside=True),
    ]  # fmt: skip
    model.add(ff.Contact("floor", "sheet", surfaces=listed))
    found = surfaces_of(model)
    (sides,) = found.contacts
    assert [type(one.surface) for one in sides.fields] == [ff.RigidPlane, ff.RigidSphere]
    assert characteristic(found, sides.second) == 2 + 1  # box and ball
    assert characteristic(found, sides.first) == 1
    labels = [body.label for body in found.bodies]
    assert labels[1:] == [
        f'Rigid{what} {k} of Contact "floor"'
        for k, what in enumerate(("Plane", "Sphere", "Mesh", "Sphere"))
    ]
    assert found.bodies[3].density == pytest.approx(3.0 / 6.0, rel=1e-12)
    assert found.bodies[2].density == np.inf  # the ground
    np.testing.assert_array_equal(found.side, [0] * 12 + [1] * 12)
    # those on the ground do not touch each other, nor those of the cart its own
    for pair in ((1, 2), (1, 4), (2, 4), (3, 3)):
        assert not sides.touch(*pair)
    assert sides.touch(0, 3)


def linkage(**contact: object) -> ff.Model:
    """Two rods with a hinge, one clamped to a block that slides on a third."""
    lines = {"crank": [(0, 0, 0), (1, 0, 0)], "rod": [(1, 0, 0), (2, 0, 0)],
             "rail": [(3, -1, 0), (3, 1, 0)]}  # fmt: skip
    # nodes of different beams stay apart
    mesh = ff.LineMesh.join([ff.LineMesh.straight({k: ends}, 8) for k, ends in lines.items()])
    model = ff.Model("m", mesh=mesh)
    model.add(*(ff.Beam(name, ROUND) for name in lines))
    block = ff.RigidBody("block", 1.0, (1, 1, 1), position=(3, 0, 0), shape=ff.Box((0.1,) * 3))
    free = ff.RigidBody("free", 1.0, (1, 1, 1), position=(0, 0, 9), shape=ff.Sphere(0.1))
    model.add(block, free)
    model.add(
        ff.Revolute("hinge", ff.Marker("crank", "end"), ff.Marker("rod", "start"), axis=Z),
        ff.Rigid("clamp", ff.Marker("rod", "end"), ff.Marker("block", offset=(-1.0, 0, 0))),
        ff.Sliding("guide", ff.Carrier("rail"), ff.Marker("block")),
        ff.SpringDamper("spring", ff.Marker("free"), ff.Marker("block"), stiffness=1.0),
        ff.Contact("all", **contact),
    )
    return model


def test_bodies_that_joints_connect_do_not_touch() -> None:
    found = surfaces_of(linkage())
    (sides,) = found.contacts

    def touch(a: str, b: str) -> bool:
        labels = [f'{"RigidBody" if n in ("block", "free") else "Beam"} "{n}"' for n in (a, b)]
        return sides.touch(*(number(found, label) for label in labels))

    assert not touch("rod", "block")  # clamped to a rigid body
    assert not touch("rail", "block")  # slides
    assert touch("free", "block")  # a spring is no connection
    assert touch("crank", "block")
    assert touch("crank", "rod")  # away from the hinge: both are flexible
    at = np.flatnonzero(np.linalg.norm(found.primitives.start - [1, 0, 0], axis=1) < 1e-9)
    assert len(at) == 2  # the hinge on both rods
    for point in at:
        row = found.near.values[found.near.starts[point] : found.near.starts[point + 1]]
        np.testing.assert_array_equal(row, at)


def test_pairs_may_be_left_out_or_named() -> None:
    found = surfaces_of(linkage(exclude=[("crank", "free"), ("rod", "rod")]))
    (sides,) = found.contacts
    names = [number(found, label) for label in ('Beam "crank"', 'RigidBody "free"', 'Beam "rod"')]
    assert not sides.touch(names[0], names[1])
    assert not sides.touch(names[2], names[2])
    assert sides.touch(names[0], names[0])
    # who names both means it, whatever joints there are
    found = surfaces_of(linkage(bodies="rod", against="block"))
    (sides,) = found.contacts
    assert sides.touch(*(number(found, k) for k in ('Beam "rod"', 'RigidBody "block"')))


def test_near_points_along_a_thick_rod() -> None:
    model = ff.Model("m", mesh=ff.LineMesh.straight({"rod": [(0, 0, 0), (1, 0, 0)]}, 50))
    model.add(ff.Beam("rod", ff.Section.circle(0.04, STEEL)), ff.Contact("all"))
    near = surfaces_of(model).near
    # pi/2 x (0.02 + 0.02) m is 3.14 elements of 0.02 m
    np.testing.assert_array_equal(near.values[near.starts[20] : near.starts[21]], range(17, 24))
    np.testing.assert_array_equal(near.values[: near.starts[1]], range(4))


def nearest(point: np.ndarray, corners: np.ndarray) -> float:
    """Distance to the convex hull of one to three corners, by its faces."""
    found = [np.linalg.norm(corners - point, axis=1).min()]
    for count in range(2, len(corners) + 1):
        for chosen in combinations(corners, count):
            base, *others = chosen
            sides = np.array(others) - base
            weights = np.linalg.lstsq(sides.T, point - base)[0]
            if (weights >= 0.0).all() and weights.sum() <= 1.0:
                found.append(np.linalg.norm(base + weights @ sides - point))
    return float(min(found))


def barrier_sum(found: CollisionSurfaces, own: Complex, point: np.ndarray, reach: float) -> float:
    """Sum of a function of the distances to all primitives with their coefficients."""
    x, total = found.primitives.start, 0.0
    for rows, factor in zip(own.points, own.coefficients, strict=True):
        corners = x[np.unique(rows)]
        total += factor * max(1.0 - nearest(point, corners) / reach, 0.0) ** 3
    return total


@pytest.mark.parametrize("element", ["rotation_free", "director"])
def test_a_point_sees_a_flat_sheet_and_a_straight_rod_once(element: str) -> None:
    """Over faces, edges, corners, and beyond the rim: as if they were not divided."""
    mesh = ff.LineMesh.straight({"rod": [(0, 0, 5), (0.6, 0, 5)]}, 4)
    model = ff.Model("m", mesh=mesh, surface=sheet())
    model.add(ff.Shell("sheet", SHEET, element=element), ff.Beam("rod", ROUND), ff.Contact("all"))
    found, reach = surfaces_of(model), 0.3
    for label, height, sides in (('Shell "sheet"', 0.0, (0.6, 0.4)), ('Beam "rod"', 5.0, (0.6, 0))):
        own, _ = alone(found, label)
        for at in np.random.default_rng(4).uniform((-0.1, -0.1, 0.02), (0.7, 0.5, 0.2), (12, 3)):
            flat = np.clip(at, 0.0, (*sides, 0.0))
            expected = max(1.0 - np.linalg.norm(at - flat) / reach, 0.0) ** 3
            total = barrier_sum(found, own, at + np.array([0, 0, height]), reach)
            # rounding; an edge that counts twice gives 1e-1
            assert total == pytest.approx(expected, abs=1e-12)
