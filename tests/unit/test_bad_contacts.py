# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mistakes in contacts, their surfaces and files: each is refused in one line with its name."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import ufl

import flexfem as ff
from flexfem.contact.initial_overlaps import check_start
from flexfem.contact.pairs import contact_surfaces
from flexfem.contact.penalty_contact import penalty_contacts
from flexfem.contact.points import contact_points
from flexfem.contact.surfaces.surfaces import collision_surfaces
from flexfem.layout.numbered_model import NumberedModel
from flexfem.mesh.triangles import solids
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

STEEL = ff.Material(2e11, 0.3, 7800.0)
SHEET = ff.ShellSection.isotropic(2e-3, STEEL)
ROUND = ff.Section.circle(0.02, STEEL)
FLOOR = ff.RigidPlane(ff.Ground((0, 0, -1)))
BOX, FACES = solids.box((0.2, 0.2, 0.2))
Z = (0.0, 0.0, 1.0)
CUBE = np.array([[-0.4, -0.4, -0.4], [0.4, 0.4, 0.4]])


def mesh(triangles: np.ndarray = FACES, scale: float = 1.0) -> ff.SurfaceMesh:
    return ff.SurfaceMesh(scale * BOX, triangles, {"box": np.arange(len(triangles))})


def refused(make: Callable[[], object], message: str) -> None:
    with pytest.raises((ValueError, TypeError), match=message) as raised:
        make()
    text = str(raised.value)
    assert "\n" not in text
    if text.startswith(('Contact "', "RigidObstacle on")):
        assert_on_page(text)


def contact(*given: object, **named: object) -> Callable[[], object]:
    return lambda: ff.Contact("c", *given, **named)


def ball(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points, axis=1) - 0.3


def obstacle(distance: object, box: object = CUBE) -> Callable[[], object]:
    return lambda: ff.RigidObstacle(ff.Ground(), distance, box)  # type: ignore[arg-type]


DECLARED = [
    (contact(()), 'Contact "c": it needs bodies, and others or surfaces'),
    (contact("a", ()), 'Contact "c": it needs bodies, and others or surfaces'),
    (contact(("a", "a")), 'Contact "c": bodies must be different'),
    (contact("a", ("b", "b")), 'Contact "c": against must be different'),
    (contact(3), 'Contact "c": bodies must be a list or tuple'),
    (contact(["a", 1]), 'Contact "c": bodies must be a string, got 1'),
    (contact(""), 'Contact "c": bodies must'),
    (lambda: ff.Contact(""), "Contact: name must"),
    (contact(surfaces="floor"), 'Contact "c": surfaces must be a list or tuple'),
    (contact(surfaces=[ff.Ground()]), 'Contact "c": surfaces must be a RigidSurface'),
    (contact(surfaces=[FLOOR, FLOOR]), 'Contact "c": surfaces must be different'),
    (contact(exclude="a"), 'Contact "c": exclude must be a list or tuple'),
    (contact(exclude=["ab"]), 'Contact "c": exclude must be pairs of names of bodies, got .ab.'),
    (contact(exclude=[("a", "b", "c")]), 'Contact "c": exclude must be pairs of names'),
    (contact(exclude=[("a", 1)]), 'Contact "c": exclude must be a string, got 1'),
    (contact(friction=-0.1), 'Contact "c": friction must not be negative, got -0.1'),
    (contact(friction=np.nan), 'Contact "c": friction must be finite, got nan'),
    (contact(friction="0.1"), 'Contact "c": friction must be a number'),
    (contact(damping=-1.0), 'Contact "c": damping must not be negative'),
    (contact(stiffness=0.0), 'Contact "c": stiffness must be positive'),
    (contact(stiffness=np.inf), 'Contact "c": stiffness must be finite'),
    (contact(skin=0.0), 'Contact "c": skin must be positive'),
    (contact(radius=0.0), 'Contact "c": radius must be positive'),
    (contact(radius=np.nan), 'Contact "c": radius must be finite'),
    (contact(static_friction=0.2, friction=0.3),
     'Contact "c": static_friction must not be less than friction 0.3, got 0.2'),
    (contact(restitution=-0.1), 'Contact "c": restitution must not be negative, got -0.1'),
    (contact(restitution=1.1), r'Contact "c": restitution must lie in \[0, 1\], got 1.1'),
    (contact(restitution=np.nan), 'Contact "c": restitution must be finite, got nan'),
    (contact(reach=-1e-3), 'Contact "c": reach must be positive, got -0.001'),
    (contact(friction=0.1, slip_speed=0), 'Contact "c": slip_speed must be positive, got 0'),
    (contact(law="ipc"), 'Contact "c": law must be "barrier" or "penalty", got \'ipc\''),
    (contact(law="penalty", reach=1e-3), 'reach belongs to law="barrier", got law="penalty"'),
    (contact(law="penalty", restitution=0.5), 'restitution belongs to law="barrier", got law='),
    (contact(law="barrier", skin=0.1), 'skin belongs to law="penalty", got law="barrier"'),
    (contact(slip_speed=0.1, two_pass=False), 'two_pass belongs to law="penalty", got slip_speed'),
    (contact(two_pass=1), 'Contact "c": two_pass must be a bool'),
    (contact("a", slaves="b"), "bodies"),
    (contact(bodies="a", slaves="b"), "Contact: slaves is bodies now, give it once"),
    (lambda: ff.Sphere(0.0), "Sphere: radius must be positive"),
    (lambda: ff.Sphere(np.nan), "Sphere: radius must be finite"),
    (lambda: ff.Capsule(0.1, 0.0), "Capsule: length must be positive"),
    (lambda: ff.Capsule(-0.1, 1.0), "Capsule: radius must be positive"),
    (lambda: ff.Capsule(0.1, 1.0, (0, 0, 0)), "Capsule: axis must not be zero"),
    (lambda: ff.Box((1.0, 0.0, 1.0)), "Box: sizes must be positive"),
    (lambda: ff.RigidSphere(ff.Ground()), "RigidSphere: radius must be positive, got 0"),
    (lambda: ff.RigidCylinder(ff.Ground(), 0.1, 0.0), "RigidCylinder: length must be positive"),
    (obstacle(lambda x: 3.0 * ball(x)), "ground: distance changes by 3 m per metre at .* surface"),
    (obstacle(lambda x: ball(x) ** 3), "ground: distance leads to no surface from .*, where it is"),
    (obstacle(lambda x: ball(x) + 9.0), "distance has no surface in the box from .*: it is 8.* m"),
    (obstacle(lambda x: ball(x)[:, None]), "must return 1728 numbers, got shape .1728, 1."),
    (obstacle(lambda x: 0.0), "ground: distance must return 1728 numbers, got shape ..,"),
    (obstacle(lambda x: np.where(x[:, 0] < 0.2, 1.0, np.inf)), "ground: distance is inf at .0.2"),
    (obstacle(lambda x: x[:, 3]), "ground: distance: lambda .test_bad.*: IndexError: "),
    (obstacle(lambda x: ufl.as_vector([x[0], x[1]])), "return a UFL scalar, got shape .2,."),
    (obstacle(lambda x: (ufl, "text")[1]), "must return a UFL scalar, got 'text'"),
    (obstacle(3.0), "RigidObstacle: distance must be a function of points .k, 3., got 3.0"),
    (obstacle(ball, [(0, 0, 0), (1, 0, 1)]), "box must be its lowest and its highest corner"),
    (obstacle(ball, (1, 2, 3)), "RigidObstacle: box must"),
    (lambda: ff.RigidPlane(ff.Carrier("a")), "RigidPlane: place must be a Ground or a plain"),
    (lambda: ff.RigidMesh(ff.Ground(), mesh=mesh(FACES[1:])), "RigidMesh: the surface is open at"),
    (lambda: ff.RigidMesh(ff.Ground(), mesh=mesh(FACES[:, ::-1])), "RigidMesh: the normals at"),
    (lambda: ff.SurfaceMesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]], {"a": [0]}),
     "SurfaceMesh: triangle 0 .* has no area"),
    (lambda: ff.ShellSection.isotropic(0.0, STEEL), "thickness must be positive, got 0"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "message"), DECLARED)
@pytest.mark.filterwarnings("ignore:Contact")
def test_declarations_are_refused(make: Callable[[], object], message: str) -> None:
    refused(make, message)


def workshop(*things: object) -> ff.Model:
    """Two sheets, two rods, a curve, three rigid bodies, and what is to be wrong."""
    sheets = [ff.SurfaceMesh.rectangle(name, (1.0, 1.0), (2, 2)) for name in ("low", "high")]
    high = ff.SurfaceMesh(
        sheets[1].points + np.array([0, 0, 0.5]), sheets[1].triangles, sheets[1].bodies
    )
    lines = {"rod": [(0, 0, 3), (1, 0, 3)], "bar": [(0, 0, 4), (1, 0, 4)]}
    both = [ff.LineMesh.straight({name: ends}, 2) for name, ends in lines.items()]
    model = ff.Model(
        "m", mesh=ff.LineMesh.join(both), surface=ff.SurfaceMesh.join([sheets[0], high])
    )
    square = ff.Section.rectangle(0.02, 0.01, STEEL)
    curve = ff.NurbsCurve.line((0, 0, 6), (1, 0, 6))
    model.add(
        ff.Shell("low", SHEET), ff.Shell("high", SHEET), ff.Beam("rod", ROUND),
        ff.Beam("bar", square), ff.Beam("bow", ROUND, curve=curve),
        ff.RigidBody("ball", 1.0, (1, 1, 1), position=(0, 0, 8), shape=ff.Sphere(0.1)),
        ff.RigidBody("cube", 1.0, (1, 1, 1), position=(0, 0, 9), shape=ff.Box((0.1, 0.1, 0.1))),
        ff.RigidBody("bare", 1.0, (1, 1, 1), position=(0, 0, 10)),
        *things,
    )  # fmt: skip
    return model


HINGE = ff.Rigid("hold", ff.Marker("ball"), ff.Marker("rod", "start", offset=(0, 0, 5.0)))
RING = ff.SurfaceShape(BOX, np.concatenate([FACES, FACES[:1, ::-1], [[0, 1, 7]]]))

CHECKED = [
    (ff.Contact("c", "none", "low"), 'Contact "c": Model "m" has no body that touches "none"'),
    (ff.Contact("c", "low", "none"), 'Contact "c": against: Model "m" has no body .* "none"'),
    (ff.Contact("c", "low", "high", exclude=[("low", "x")]), "exclude: .* has no body .x."),
    (ff.Contact("c", "bare", "low"), '"bare", which is a RigidBody without shape: give it one'),
    (ff.Contact("c", "low", "c"), 'against: .* no body that touches "c", which is a Contact'),
    (ff.Contact("c", "bar", "low"), '"bar": its section is not round, give Contact.radius'),
    (ff.Contact("all"), 'Contact "all": Beam "bar": its section is not round'),
    (ff.Contact("c", "low", surfaces=ff.RigidSphere(ff.Marker("high", (0, 0, 0)), 1.0)),
     'Contact "c": RigidSphere must be on the ground, .* got "high", a Shell'),
    (ff.Contact("c", "low", surfaces=ff.RigidSphere(ff.Marker("x"), 1.0)),
     'Contact "c": RigidSphere must be on the ground, .* got "x", nothing of that name'),
]  # fmt: skip


@pytest.mark.parametrize(("wrong", "message"), CHECKED)
def test_models_are_refused(wrong: ff.Contact, message: str) -> None:
    refused(workshop(wrong).validate, message)


def test_models_without_anything_that_touches_are_refused() -> None:
    model = ff.Model("m")
    model.add(ff.RigidBody("bare", 1.0, (1, 1, 1)), ff.Contact("all"))
    refused(model.validate, 'Contact "all": Model "m" has nothing that touches: no shells, no')


BUILT = [
    ([ff.Contact("c", "rod", "bar", radius=0.01)],
     'Contact "c": Beam "rod" cannot touch Beam "bar" yet.*exclude='),
    ([ff.Contact("c", "rod", radius=0.01)], 'Contact "c": Beam "rod" cannot touch'),
    ([ff.Contact("c", "ball", "cube")], 'RigidBody "ball" cannot touch RigidBody "cube" yet'),
    ([ff.Contact("c", ("low", "ball"), (), FLOOR)], '"ball" cannot touch a RigidPlane yet'),
    ([ff.Contact("c", "low", (), ff.RigidObstacle(ff.Marker("ball"), ball, CUBE))],
     'Contact "c": bodies cannot touch a RigidObstacle by the penalty, which has planes'),
    ([ff.Contact("c", "ball", "low")], '"low" this way round yet: rigid bodies belong to against'),
    ([ff.Contact("c", "low", "rod")], '"rod" this way round yet: beams belong to bodies'),
    ([ff.Contact("c", "bow", "low")], 'Beam "bow": contact needs the formulation se3, got nurbs'),
    ([ff.Contact("c", ("low", "high"), "low")], "against must be others than the bodies or just"),
    ([ff.Contact("c", ("low", "rod"), ("high", "low"), exclude=[("rod", "low")])],
     'Beam "rod" and Shell "low" .exclude. cannot be left out yet'),
    ([ff.Contact("c", ("low", "rod"), "ball", exclude=[("ball", "rod")])],
     'Beam "rod" and RigidBody "ball" .exclude. cannot be left out yet'),
    ([ff.Contact("c", "low", "ball", exclude=[("ball", "low")])], "nothing is left that touches"),
    ([ff.RigidBody("odd", 1.0, (1, 1, 1), shape=RING), ff.Contact("c", "low", "odd")],
     'RigidBody "odd": its shape: SurfaceMesh: '),
]  # fmt: skip


@pytest.mark.parametrize(("things", "message"), BUILT)
def test_what_the_penalty_cannot_do_is_refused_by_name(things: list[object], message: str) -> None:
    model = workshop(*things)
    model.validate()
    refused(lambda: penalty_contacts(NumberedModel(model)), message)


DESCRIBED = [
    ([ff.Contact("c", "low", "ball", exclude=[("ball", "low")])], "nothing is left that touches"),
    ([ff.Contact("c", "ball", "ball")], 'Contact "c": nothing is left that touches'),
    ([ff.RigidBody("odd", 1.0, (1, 1, 1), shape=RING), ff.Contact("c", "low", "odd")],
     'RigidBody "odd": its shape: SurfaceMesh: '),
]  # fmt: skip


@pytest.mark.parametrize(("things", "message"), DESCRIBED)
def test_collision_surfaces_are_refused(things: list[object], message: str) -> None:
    model = workshop(*things)
    model.validate()
    refused(lambda: collision_surfaces(NumberedModel(model)), message)


def test_overlaps_at_the_start_are_refused_with_name_place_and_depth() -> None:
    shape = ff.Sphere(0.3)
    model = workshop(ff.RigidBody("bob", 1.0, (1, 1, 1), position=(0.5, 0.5, 0.29), shape=shape))
    model.add(ff.Contact("c", "low", "bob"))
    model.validate()
    serial = NumberedModel(model)
    contacts = penalty_contacts(serial)
    points = contact_points(serial, contacts, np.zeros((0, 2), np.int64))
    described = contact_surfaces(serial, points, contacts)
    message = r'Contact "c": at the start Shell "low" penetrates a rigid sphere by 0.01\d* m at '
    refused(lambda: check_start(points, described), message + r"node 4 at \(0.5, 0.5, 0\) m")


def test_meshes_in_millimetres_are_found() -> None:
    big = ff.SurfaceMesh(1e3 * BOX + [0, 0, 500], FACES, {"box": np.arange(12)})
    model = ff.Model("m", surface=ff.SurfaceMesh.rectangle("low", (0.3, 0.2), (2, 2)))
    model.add(ff.Shell("low", SHEET))
    model.add(ff.Contact("c", "low", surfaces=ff.RigidMesh(ff.Ground(), mesh=big)))
    (found,) = [one for one in ff.check(model) if one.check == "units"]
    assert 'RigidMesh 0 of Contact "c"' in str(found)
    assert "scale=1e-3" in found.hint
    rigid = ff.Model("m")
    rigid.add(ff.RigidBody("ball", 1.0, (1, 1, 1), shape=ff.Sphere(0.1)))
    shape = ff.SurfaceShape(1e3 * BOX, FACES)
    rigid.add(ff.RigidBody("box", 1.0, (1, 1, 1), position=(0, 0, -300), shape=shape))
    assert 'the shape of RigidBody "box"' in "".join(map(str, ff.check(rigid)))


TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
FILES = [
    ("a.stl", b"", "neither a binary nor an ASCII STL"),
    ("a.stl", b"\0" * 80 + (10**9).to_bytes(4, "little"), "is to have 1000000000 triangles"),
    ("a.stl", b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0\n", "line 4: vertex must have"),
    ("a.stl", b"solid a\nfacet normal 0 0 1\n", "line 2: the file ends before its solid does"),
    ("a.obj", (TRIANGLE + "f 1 2 9\n").encode(), "line 4: there is no point 9 among the 3"),
    ("a.obj", (TRIANGLE + "f 1 2\n").encode(), "line 4: a face needs three corners, got 2"),
    ("a.obj", b"v 0 0 nan\nf 1 1 1\n", "line 1: coordinates"),
    ("a.obj", TRIANGLE.encode(), "it has no triangles"),
    ("a.obj", (TRIANGLE + "f 1 1 2\n").encode(), "none of its triangles has an area"),
    ("a.obj", (TRIANGLE + "v 0 0 1\nv 1 1 1\nf 1 2 3\nf 2 1 4\nf 1 2 5\n").encode(), "edge"),
    ("a.obj", b"v 1e60 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n", "beyond 1e.50 m"),
    ("a.obj", b"\0\1\2", "line 1: it has a zero byte, it is no text"),
    ("a.ply", b"ply\n", "must end in .msh, .*.stl, .obj"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "content", "message"), FILES)
def test_files_are_refused(name: str, content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    path = tmp_path / name
    refused(lambda: ff.read_surface_mesh(path), f'mesh file ".*{name}".*{message}')
    refused(lambda: ff.read_surface_mesh(tmp_path / f"no_{name}"), "does not exist")


def test_files_of_surfaces_are_read_in_metres(tmp_path: Path) -> None:
    """Points that a program repeats for each face are one, flat triangles are left out."""
    corners = 1e3 * BOX[FACES]
    lines = ["v {} {} {}".format(*x) for x in corners.reshape(-1, 3)]
    lines += ["f {} {} {}".format(*(3 * k + np.arange(1, 4))) for k in range(12)] + ["f 1 1 2"]
    (tmp_path / "box.obj").write_text("\n".join(lines))
    found = ff.read_surface_mesh(tmp_path / "box.obj", scale=1e-3)
    assert len(found.points) == 8
    assert list(found.bodies) == ["box"]
    assert found.areas.sum() == pytest.approx(0.24, rel=1e-12)
    ff.RigidMesh(ff.Ground(), mesh=found)  # closed, normals outwards


def test_former_names_warn() -> None:
    with pytest.warns(DeprecationWarning, match=r"Contact\(") as warned:
        made = ff.Contact("c", slaves="a", masters=["b"])
    texts = [str(one.message) for one in warned]
    assert texts == [f"Contact({a}=...) is {b}=... now" for a, b in
                     (("slaves", "bodies"), ("masters", "against"))]  # fmt: skip
    assert (made.bodies, made.against) == (("a",), ("b",))
    with pytest.warns(DeprecationWarning, match=r"Contact.masters is against now"):
        assert made.masters == ("b",)
