# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies that overlap at the start, of every pair of kinds, and others that only seem to.

With barriers: each is refused in one line with its name, place and depth before a run begins.
"""

import numpy as np
import pytest

import flexfem as ff
from flexfem.contact.barrier.start import start_apart
from flexfem.contact.surfaces.bodies import check_pairs
from flexfem.contact.surfaces.surfaces import collision_surfaces
from flexfem.layout.numbered_model import NumberedModel
from flexfem.mesh.triangles import solids
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

STEEL = ff.Material(2e11, 0.3, 7800.0)
#: The thickness of sheets, and the diameter of rods, is 0.02 m.
SHEET, ROUND = ff.ShellSection.isotropic(0.02, STEEL), ff.Section.circle(0.02, STEEL)
GROUND = ff.Ground()
BOX, FACES = solids.box((2.0, 2.0, 2.0))
IN, OUT = FACES[:, ::-1], FACES
THORN = np.array([[0, 0, -0.5], [0.02, 0, 0.5], [-0.02, 0.02, 0.5], [-0.02, -0.02, 0.5]])
SIDES = np.array([[0, 1, 3], [0, 2, 1], [0, 3, 2], [1, 2, 3]])
CUBE = np.array([[-0.4, -0.4, -0.4], [0.4, 0.4, 0.4]])
Z = (0.0, 0.0, 1.0)


def sheet(name: str, points: np.ndarray | None = None) -> ff.SurfaceMesh:
    """Sheet of a mesh in the plane z = 0 between -0.5 and 0.5, or with other points."""
    made = ff.SurfaceMesh.rectangle(name, (1.0, 1.0), (2, 2))
    places = made.points - [0.5, 0.5, 0.0] if points is None else points
    return ff.SurfaceMesh(places, made.triangles, made.bodies)


FLAT = sheet("low").points
#: Stands on its corner: only its edges go through the other sheet, in the middle of triangles.
ACROSS = FLAT @ [[0.0, 0.05, 0.6], [0.6, 0.0, 0.0], [0.0, 1.0, 0.0]] + [0.13, 0.21, 0.17]


def moved(*way: float) -> np.ndarray:
    return FLAT + np.array(way)


def looped() -> ff.SurfaceMesh:
    """Strip that comes back and goes through itself."""
    made = ff.SurfaceMesh.rectangle("loop", (4.0, 1.0), (4, 1))
    path = np.array([(0, 0), (1, 0), (1, 1), (0.5, 1), (0.37, -1)])
    points = np.insert(path[made.points[:, 0].astype(int)], 1, made.points[:, 1], axis=1)
    return ff.SurfaceMesh(points, made.triangles, made.bodies)


def rods(*lines: tuple[str, tuple[float, ...], tuple[float, ...]]) -> ff.LineMesh:
    return ff.LineMesh.straight({name: [a, b] for name, a, b in lines}, 3)


def rigid(name: str, shape: object, at: tuple[float, float, float] = (0, 0, 0)) -> ff.RigidBody:
    return ff.RigidBody(name, 1.0, (0.1, 0.1, 0.1), position=at, shape=shape)  # type: ignore[arg-type]


def block(triangles: np.ndarray = OUT, scale: float = 1.0) -> ff.SurfaceMesh:
    return ff.SurfaceMesh(scale * BOX, triangles, {"block": np.arange(len(triangles))})


def distance(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points, axis=1) - 0.3


def touching(*things: object, **contact: object) -> None:
    """Check the start of a contact of all things: bodies, meshes, rigid surfaces."""
    surfaces = [one for one in things if isinstance(one, ff.SurfaceMesh)]
    lines = [one for one in things if isinstance(one, ff.LineMesh)]
    model = ff.Model("m", mesh=lines[0] if lines else None,
                     surface=ff.SurfaceMesh.join(surfaces) if surfaces else None)  # fmt: skip
    model.add(*(ff.Shell(name, SHEET) for one in surfaces for name in one.bodies))
    model.add(*(ff.Beam(name, ROUND) for one in lines for name in one.line_groups))
    model.add(*(one for one in things if isinstance(one, ff.RigidBody)))
    obstacles = [one for one in things if hasattr(one, "place")]
    model.add(ff.Contact("c", surfaces=obstacles, law="barrier", **contact))  # type: ignore[arg-type]
    model.validate()
    start_apart(collision_surfaces(NumberedModel(model)))


ROD, BALL = ("rod", (-0.5, 0, 0), (0.5, 0, 0)), rigid("ball", ff.Sphere(0.1))
CRATE = ff.Box((1.0, 1.0, 1.0))
PLATE = FLAT * 0.2
WITHIN = "is inside of"

OVERLAPPING = {
    "rod, rod": ([rods(ROD, ("bar", (0.1, -0.5, 0.015), (0.1, 0.5, 0.015)))],
                 'Beam "bar" overlaps Beam "rod" by 0.005 m at '),
    "sheet across sheet": ([sheet("low"), sheet("high", ACROSS)], 'Shell .* intersects Shell '),
    "sheet along sheet": ([sheet("low"), sheet("high", moved(0.01, 0.02, 0.015))],
                          'Shell "low" overlaps Shell "high" by 0.005 m at '),
    "sheet through itself": ([looped()], 'Shell "loop" intersects itself at .0.*, 0.*, 0. m'),
    "rod, sheet": ([rods(("rod", (0.13, 0.2, -0.4), (0.13, 0.2, 0.2))), sheet("low")],
                   '(Beam "rod" .* Shell "low"|Shell "low" .* Beam "rod")'),
    "block, block": ([rigid("a", ff.SurfaceShape(BOX, OUT)),
                      rigid("b", ff.SurfaceShape(BOX, OUT), (1.5, 0.2, 0.3))],
                     'RigidBody "a" intersects RigidBody "b" at '),
    "thorn, block": ([rigid("a", ff.SurfaceShape(BOX, OUT)),
                      rigid("b", ff.SurfaceShape(THORN, SIDES), (0.3, 0.1, 1.4))],
                     'RigidBody "b" intersects RigidBody "a" at .0.298, 0.098, 1. m'),
    "block in block": ([rigid("a", ff.SurfaceShape(BOX, OUT)), rigid("b", CRATE, (0.1, 0, 0))],
                       f'RigidBody "b" {WITHIN} RigidBody "a" at '),
    "ball in box": ([rigid("a", CRATE), BALL],
                    f'RigidBody "ball" {WITHIN} RigidBody "a" at .0, 0,'),
    "box in ball": ([rigid("a", CRATE), rigid("b", ff.Sphere(2.0))],
                    'RigidBody "b" overlaps RigidBody "a" by 1.5 m at '),
    "capsule in box": ([rigid("a", CRATE), rigid("b", ff.Capsule(0.1, 0.2))], WITHIN),
    "capsule, capsule": ([rigid("a", ff.Capsule(0.1, 1.0)),
                          rigid("b", ff.Capsule(0.1, 1.0, (0, 1, 0)), (0, 0, 0.15))],
                         'overlaps RigidBody "[ab]" by 0.05 m at '),
    "ball, ball": ([BALL, rigid("b", ff.Sphere(0.2), (0.25, 0, 0))], "overlaps .* by 0.05 m at "),
    "ball in cylinder": ([BALL, rigid("b", ff.Cylinder(0.5, 1.0))], WITHIN),
    "rod in box": ([rods(ROD), rigid("a", ff.Box((2, 1, 1)))], f'Beam "rod" {WITHIN} RigidBody'),
    "rod through box": ([rods(ROD), rigid("a", ff.Box((0.2, 1, 1)))],
                        'Beam "rod" intersects Rigid'),
    "sheet in box": ([sheet("low", PLATE), rigid("a", CRATE)],
                     f'Shell "low" {WITHIN} RigidBody'),
    "ball in mesh": ([BALL, ff.RigidMesh(GROUND, mesh=block())],
                     f'RigidBody "ball" {WITHIN} RigidMesh 0 of Contact "c" at '),
    "ball in mesh in millimetres": (
        [BALL, ff.RigidMesh(GROUND, mesh=block(scale=1000.0))], WITHIN),
    "ball outside of hollow mesh": (
        [rigid("b", ff.Sphere(0.1), (0, 0, 5)), ff.RigidMesh(GROUND, mesh=block(IN), inside=True)],
        'RigidBody "b" is outside of RigidMesh 0 of Contact "c" at .0, 0, 5. m'),
    "ball outside of hollow sphere": (
        [rigid("b", ff.Sphere(0.1), (0, 0, 5)), ff.RigidSphere(GROUND, 1.0, inside=True)],
        "by 4.1 m"),
    "ball, plane": ([BALL, ff.RigidPlane(ff.Ground((0, 0, -0.05)))],
                    'RigidBody "ball" overlaps RigidPlane 0 of Contact "c" by 0.05 m at'),
    "ball below plane": ([BALL, ff.RigidPlane(ff.Ground((0, 0, 5)))], "by 5.1 m at"),
    "rod in cylinder": ([rods(ROD), ff.RigidCylinder(GROUND, 0.2)],
                        "overlaps RigidCylinder 0 of .* by 0.19"),
    "rod across cylinder": ([rods(ROD), ff.RigidCylinder(ff.Ground((0, 0, 0.0)), 0.01)],
                            'Beam "rod" overlaps RigidCylinder 0'),
    "sheet, cylinder with ends": ([sheet("low"), ff.RigidCylinder(GROUND, 0.1, 1.0)],
                                  'Shell "low" overlaps RigidCylinder'),
    "sheet, ball between nodes": ([sheet("low"), ff.RigidSphere(ff.Ground((0.1, 0.2, 0)), 0.01)],
                                  "by 0.02 m at .0.1, 0.2, 0. m"),
    "ball in obstacle": ([BALL, ff.RigidObstacle(GROUND, distance, CUBE)], "by 0.4 m at"),
    "obstacle inside out": ([rigid("b", ff.Sphere(0.1), (0, 0, 1)),
                             ff.RigidObstacle(GROUND, lambda x: -distance(x), CUBE)],
                            "by 0.8 m at"),
}  # fmt: skip


@pytest.mark.parametrize("name", OVERLAPPING)
def test_overlaps_are_refused_with_both_names(name: str) -> None:
    things, message = OVERLAPPING[name]
    with pytest.raises(ValueError, match=f'Contact "c": at the start .*({message})') as raised:
        touching(*things)
    assert "\n" not in str(raised.value)
    assert_on_page(str(raised.value))


HOLLOW = np.concatenate([OUT, IN + len(BOX)])
APART = {
    "ball in hollow shape": [BALL, rigid("a", ff.SurfaceShape(BOX, IN))],
    "ball in the cavity of a shape": [
        BALL, rigid("a", ff.SurfaceShape(np.concatenate([1.5 * BOX, BOX]), HOLLOW))],
    "ball in hollow mesh": [BALL, ff.RigidMesh(GROUND, mesh=block(IN), inside=True)],
    "ball in mesh with two sides": [BALL, ff.RigidMesh(GROUND, mesh=block(), two_sided=True)],
    "ball in open shape": [BALL, rigid("a", ff.SurfaceShape(BOX, OUT[2:]))],
    "ball beside box": [BALL, rigid("a", CRATE, (0.7, 0, 0))],
    "rod beside sheet": [rods(("rod", (0.6, 0.2, -0.4), (0.6, 0.2, 0.4))), sheet("low")],
    "sheet over edge of sheet": [sheet("low"), sheet("high", moved(0.7, 0.0, 0.025))],
}  # fmt: skip


@pytest.mark.parametrize("name", APART)
def test_what_is_apart_is_let_through(name: str) -> None:
    touching(*APART[name])


@pytest.mark.parametrize(
    ("reach", "message"),
    [(1e3, r"0\.4 m at .*, less than a thousandth of reach 1000 m"),
     (1e-13, 'Contact "c": reach must be at least 1e-8 of the size 0.2 m of .*, got 1e-13 m')],
)  # fmt: skip
def test_reaches_of_other_sizes_than_the_model_are_refused(reach: float, message: str) -> None:
    """With the small one a ball leaves a plane with 1e18 times its energy."""
    with pytest.raises(ValueError, match=message) as raised:
        touching(BALL, ff.RigidPlane(ff.Ground((0, 0, -0.5))), reach=reach)
    assert_on_page(str(raised.value))


FLOOR = ff.RigidPlane(ff.Ground((0, 0, -3.0)))
TWICE = [
    ([ff.Contact("c", "a", "b"), ff.Contact("d", "b", "a", friction=0.1)],
     'Contact "d": "b" and "a" touch in Contact "c" already'),
    ([ff.Contact("all"), ff.Contact("d", "b", "a")], 'Contact "d": .* in Contact "all" already'),
    ([ff.Contact("c", "a", surfaces=FLOOR), ff.Contact("d", surfaces=FLOOR)],
     'Contact "d": "a" and the same surface touch in Contact "c" already'),
    ([ff.Contact("c", "a", "b"), ff.Contact("d", exclude=[("a", "b")], surfaces=FLOOR)], ""),
]  # fmt: skip


@pytest.mark.parametrize(("contacts", "message"), TWICE)
def test_pairs_in_two_contacts_are_refused(contacts: list[ff.Contact], message: str) -> None:
    """They would repel twice, with half of the friction of each."""
    model = ff.Model("m")
    model.add(rigid("a", CRATE), rigid("b", CRATE, (3, 0, 0)), *contacts)
    model.validate()
    if not message:
        check_pairs(NumberedModel(model))
        return
    with pytest.raises(ValueError, match=message) as raised:
        check_pairs(NumberedModel(model))
    assert_on_page(str(raised.value))
