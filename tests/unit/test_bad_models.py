# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mistakes in models, meshes and sections are refused in one line that names object and value."""

import re
from pathlib import Path

import numpy as np
import pytest

from flexfem.core.marker import Ground, Marker
from flexfem.core.pose import Pose
from flexfem.joints.revolute import Revolute
from flexfem.joints.spherical import Spherical
from flexfem.loads.amplitude import SmoothStep, Table
from flexfem.loads.gravity import Gravity
from flexfem.loads.line_load import LineLoad
from flexfem.loads.point_force import PointForce
from flexfem.loads.point_moment import PointMoment
from flexfem.materials.material import Material
from flexfem.materials.section import Section
from flexfem.mesh.library import build_mesh
from flexfem.mesh.line_mesh import LineMesh, read_mesh
from flexfem.mesh.nurbs.curve import NurbsCurve
from flexfem.model.bodies.basic import Beam, PointMass, RigidBody
from flexfem.model.bodies.shapes import Box, CompoundShape, Cylinder, Sphere, SurfaceShape
from flexfem.model.model import Model
from flexfem.model.probes.base import PositionProbe, Probe
from flexfem.model.rigid_surface import RigidPlane
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

NAN = float("nan")
STEEL = Material(2.1e11, 0.3, 7850.0)
SECTION = Section.rectangle(0.03, 0.03, STEEL)
ONES = np.ones(6)
LINE = NurbsCurve.line((0, 0, 0), (1, 0, 0))
END = Marker("beam", "end")
ROD = {"rod": ((0, 0, 0), (0, 0, 1))}

# --- constructors --------------------------------------------------------------------------------


def with_entry(i, j, value):
    """The identity with one entry changed."""
    matrix = np.eye(6)
    matrix[i, j] = value
    return matrix


CONSTRUCTORS = [
    # materials
    (lambda: Material(0.0, 0.3, 1.0), "Material: youngs_modulus must be positive, got 0.0"),
    (lambda: Material(-2e11, 0.3, 1.0), "Material: youngs_modulus must be positive, got -2"),
    (lambda: Material(2e11, 0.6, 1.0), r"Material: poisson_ratio must be in \(-1, 0.5\], got 0.6"),
    (lambda: Material(2e11, 0.3, -1.0), "Material: density must not be negative, got -1"),
    (lambda: Material(2e11, 0.3, NAN), "Material: density must be finite, got nan"),
    (lambda: Material("steel", 0.3, 1.0), "Material: youngs_modulus must be a number, got 'steel'"),
    # sections
    (lambda: Section.rectangle(0.0, 1.0, STEEL), "Section: width must be positive, got 0.0"),
    (lambda: Section.rectangle(1.0, -1.0, STEEL), "Section: height must be positive, got -1.0"),
    (lambda: Section.rectangle(1.0, 1.0, 2e11), "Section: material must be a Material, got 2"),
    (lambda: Section.circle(np.inf, STEEL), "Section: diameter must be finite, got inf"),
    (lambda: Section.tube(0.2, 0.1, STEEL), "inner_diameter must be less than .* 0.1, got 0.2"),
    (
        lambda: Section.hollow_rectangle(0.1, 0.2, 0.05, STEEL),
        "wall must be less than half of the shorter side 0.1, got 0.05",
    ),
    (
        lambda: Section.rectangle(1, 1, STEEL, shear_factor=(1.0, 0.0)),
        r"shear_factor must be positive, got \(1.0, 0.0\)",
    ),
    (
        lambda: Section.rectangle(1, 1, STEEL, mass_centre=(1, 2, 3)),
        r"mass_centre must hold 2 numbers, got \(1, 2, 3\)",
    ),
    (
        lambda: Section.general(np.ones(5), ONES),
        "Section: stiffness must hold 6 x 6 numbers, got array",
    ),
    (
        lambda: Section.general([[1.0], [1.0, 2.0]], ONES),
        "Section: stiffness must hold 6 x 6 numbers, got",
    ),
    (lambda: Section.general(with_entry(0, 3, NAN), ONES), "Section: stiffness must be finite"),
    (
        lambda: Section.general(with_entry(0, 3, 0.5), ONES),
        r"stiffness must be symmetric, but entries \(1, 4\) and \(4, 1\) are 0.5 and 0",
    ),
    (
        lambda: Section.general([1, 1, 1, 0, 1, 1], ONES),
        r"stiffness must be positive definite, but entry \(4, 4\) is 0",
    ),
    (
        lambda: Section.general(with_entry(0, 1, 2.0) + with_entry(1, 0, 2.0), ONES),
        "stiffness must be positive definite, but its smallest eigenvalue",
    ),
    (
        lambda: Section.general(ONES, [1, 1, 1, -1, 1, 1]),
        r"inertia must be positive semidefinite, but entry \(4, 4\) is -1",
    ),
    (
        lambda: Section.general(ONES, [1, 1, 2, 1, 1, 1]),
        r"inertia must have the form \[\[m I, -S\], \[S, J\]\]",
    ),
    (
        lambda: Section.general(ONES, ONES, [[0, 0], [1, 1]]),
        "outline must have at least three vertices, got 2",
    ),
    # frames and markers
    (lambda: Pose(rotation=2 * np.eye(3)), "Pose: rotation must be a rotation matrix, got array"),
    (lambda: Pose((1, 2)), r"Pose: position must hold 3 numbers, got \(1, 2\)"),
    (
        lambda: Ground(rotation=np.diag([1.0, 1.0, -1.0])),
        "Ground: rotation must be a rotation matrix",
    ),
    (lambda: Marker("beam", 1.5), r'Marker on "beam": point must be a fraction .* got 1.5'),
    (lambda: Marker("beam", offset=(0, 0, NAN)), 'Marker on "beam": offset must be finite'),
    (lambda: Marker(""), "Marker: body must be a non-empty printable string"),
    (lambda: Marker(Beam("b", SECTION)), "Marker: body must be a string, got"),
    # bodies
    (lambda: Beam("two\nlines", SECTION), "Beam: name must be .* got 'two"),
    (
        lambda: Beam("beam", 1.0),
        'Beam "beam": section must be a Section, a SectionTable or a function',
    ),
    (
        lambda: Beam("beam", SECTION, formulation="cubic"),
        'Beam "beam": formulation must be "se3" or "nurbs", got \'cubic\'',
    ),
    (
        lambda: Beam("beam", SECTION, formulation="se3", curve=LINE),
        'Beam "beam": formulation "se3" has no curve, got NurbsCurve',
    ),
    (
        lambda: Beam("beam", SECTION, interpolation="quaternions"),
        'Beam "beam": formulation "se3" has no interpolation, got \'quaternions\'',
    ),
    (
        lambda: Beam("beam", SECTION, curve=LINE, interpolation="vectors"),
        'Beam "beam": interpolation must be "quaternions" or "relative_rotation_vectors", got',
    ),
    (
        lambda: Beam("beam", SECTION, degree=3),
        'Beam "beam": formulation "se3" has no degree, got 3',
    ),
    (
        lambda: Beam("beam", SECTION, formulation="nurbs", degree=0),
        'Beam "beam": degree must be at least 1, got 0',
    ),
    (
        lambda: Beam("beam", SECTION, formulation="nurbs", degree=2.0),
        'Beam "beam": degree must be a whole number, got 2.0',
    ),
    (
        lambda: Beam("beam", SECTION, curve=LINE, group="beam"),
        'Beam "beam": give a curve or a group, got group "beam" as well',
    ),
    (
        lambda: Beam("beam", SECTION, curve=LINE, degree=3),
        r'Beam "beam": the degree is that of the curve \(.*\), got 3',
    ),
    (
        lambda: Beam("beam", SECTION, curve=[[0, 0, 0], [1, 0, 0]]),
        'Beam "beam": curve must be a NurbsCurve, got',
    ),
    (
        lambda: Beam("beam", SECTION, orientation=(0, 0, 0)),
        r'Beam "beam": orientation must not be zero, got \(0, 0, 0\)',
    ),
    (lambda: Beam("beam", SECTION, damping=-0.1), 'Beam "beam": damping must not be negative'),
    (lambda: Beam("beam", SECTION, velocity=3.0), 'Beam "beam": velocity must hold 3 numbers'),
    (lambda: RigidBody("b", 0.0, (1, 1, 1)), 'RigidBody "b": mass must be positive, got 0.0'),
    (
        lambda: RigidBody("b", 1.0, (1, 1, 2.5)),
        'RigidBody "b": inertia must satisfy the triangle inequality .* got .* 1, 1, 2.5',
    ),
    (
        lambda: RigidBody("b", 1.0, (0, 1, 1)),
        'RigidBody "b": inertia must be positive definite, got principal moments 0, 1, 1',
    ),
    (
        lambda: RigidBody("b", 1.0, [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]),
        'RigidBody "b": inertia must be symmetric',
    ),
    (lambda: RigidBody("b", 1.0, 5.0), 'RigidBody "b": inertia must hold 3 x 3 numbers, got 5.0'),
    (lambda: SurfaceShape([(0, 0, 0)], [(0, 0, 1)]), "SurfaceShape: triangles must lie in 0 to 0"),
    (lambda: SurfaceShape([(0, 0, 0)], []), "SurfaceShape: triangles must hold at least one"),
    (lambda: CompoundShape([]), "CompoundShape: parts must hold at least one, got none"),
    (lambda: CompoundShape([Sphere(1.0)]), "CompoundShape: parts must be pairs of a shape and a"),
    (lambda: CompoundShape([("box", Pose())]), "CompoundShape: shape must be a Box or Sphere or"),
    (lambda: RigidBody("b", 1.0, (1, 1, 1), shape="box"), 'RigidBody "b": shape must be a Box or'),
    (lambda: Box((1, 1, 0)), r"Box: sizes must be positive, got \(1, 1, 0\)"),
    (lambda: Sphere(-1), "Sphere: radius must be positive, got -1"),
    (lambda: Cylinder(1.0, 1.0, (0, 0, 0)), "Cylinder: axis must not be zero"),
    (lambda: PointMass("m", -1.0, END), 'PointMass "m": mass must be positive, got -1.0'),
    (lambda: PointMass("m", 1.0, Ground()), 'PointMass "m": marker must be a Marker, got Ground'),
    # joints
    (lambda: Revolute("r", Ground(), END, (0, 0, 0)), 'Revolute "r": axis must not be zero'),
    (lambda: Spherical("s", Ground(), "beam"), "Spherical \"s\": b must be .* got 'beam'"),
    # loads
    (lambda: Gravity(9.81), "Gravity: acceleration must hold 3 numbers, got 9.81"),
    (lambda: PointForce("f", END, (0, 0, NAN)), 'PointForce "f": force must be finite'),
    (lambda: PointForce("f", Ground(), (0, 0, 1)), 'PointForce "f": marker must be a Marker'),
    (lambda: PointForce("f", END, "down"), "PointForce \"f\": force must hold 3 .* got 'down'"),
    (
        lambda: PointMoment("m", END, (0, 0, 1), amplitude=2.0),
        'PointMoment "m": amplitude must be a function of time, got 2.0',
    ),
    (
        lambda: PointForce("f", END, (0, 0, 1), amplitude=lambda t, s: s),
        r'PointForce "f": amplitude must be a function of \(t\), got one of \(t, s\)',
    ),
    (lambda: LineLoad("q", END, (0, 0, 1)), 'LineLoad "q": body must be a string, got Marker'),
    (lambda: Table([0, 1, 1], [0, 0, 0]), r"Table: times must increase, got \[0, 1, 1\]"),
    (lambda: Table([0, 1], [0, 0, 0]), r"Table: values must hold 2 numbers, got \[0, 0, 0\]"),
    (lambda: Table([], []), "Table: times must hold"),
    (lambda: SmoothStep(1.0, 1.0), "SmoothStep: t1 must be after t0 = 1.0, got 1.0"),
    (
        lambda: SmoothStep(0.0, 1.0, profile="square"),
        "SmoothStep: profile must be one of linear, polynomial, cycloid, cosine, got 'square'",
    ),
    (lambda: LineMesh.straight({}), "LineMesh: lines must hold at least one line, got none"),
    (lambda: LineMesh.straight(ROD, 0), "LineMesh: elements must be at least 1, got 0"),
    (lambda: LineMesh.straight(ROD, 1.5), "LineMesh: elements must be a whole number, got 1.5"),
    (
        lambda: LineMesh.straight({"rod": (0, 0, 1)}),
        r'LineMesh: line "rod" must hold 2 x 3 numbers, got \(0, 0, 1\)',
    ),
    # probes
    (lambda: Probe("p", [], [], max), 'Probe "p": columns must hold at least one name, got none'),
    (lambda: Probe("p", [END], ["t"], max), 'Probe "p": column "t" is the time'),
    (lambda: Probe("p", [END], ["a", "a"], max), 'Probe "p": column "a" occurs twice'),
    (lambda: Probe("p", [END], ["a,b"], max), 'Probe "p": column "a,b" must not contain a comma'),
    (lambda: Probe("p", [END], "ab", max), "Probe \"p\": columns must be a list .* got 'ab'"),
    (lambda: Probe("p", [END], ["a"], 3.0), 'Probe "p": function must be callable, got 3.0'),
    (lambda: Probe("p", ["beam"], ["a"], max), "Probe \"p\": markers must be .* got 'beam'"),
    (
        lambda: Probe("p", [END], ["a"], max, unwrap=["b"]),
        'Probe "p": unwrap "b" is none of its columns',
    ),
    (
        lambda: Probe("p", [], ["a", "b"], lambda t: [1.0]).evaluate(0.0, []),
        r'Probe "p": function must return 2 numbers, got shape \(1,\)',
    ),
    (lambda: PositionProbe("p", None), 'PositionProbe "p": marker must be a Marker or Ground'),
]

# --- meshes --------------------------------------------------------------------------------------

POINTS = [[0, 0, 0], [1, 0, 0], [2, 0, 0]]
CELLS = [[0, 1], [1, 2]]


def mesh_file(text):
    """Read a file of the given text."""

    def read(folder):
        path = folder / "bad.msh"
        path.write_text(text)
        read_mesh(path)

    return read


def gmsh_model(*, groups=True, points=2, order=1):
    """Take the lines of a gmsh model with something missing or too much."""

    def read(_):
        import gmsh

        gmsh.initialize(interruptible=False)
        try:
            gmsh.option.setNumber("General.Terminal", 0)
            geo = gmsh.model.geo
            tags = [geo.addPoint(float(i), 0, 0, 0.5) for i in range(points)]
            line = geo.addLine(tags[0], tags[1]) if points > 1 else None
            geo.synchronize()
            if groups and line:
                gmsh.model.addPhysicalGroup(1, [line], name="bar")
            gmsh.model.mesh.generate(1)
            gmsh.model.mesh.setOrder(order)
            LineMesh.from_gmsh_model()
        finally:
            gmsh.finalize()

    return read


MESHES = [
    (lambda _: LineMesh([[0, 0], [1, 0]], [[0, 1]], {}), "LineMesh: points must hold n x 3"),
    (lambda _: LineMesh([[0, 0, 0], [1, 0, NAN]], [[0, 1]], {}), "LineMesh: points must be finite"),
    (lambda _: LineMesh(POINTS, [], {}), "LineMesh: cells must hold at least one cell, got none"),
    (lambda _: LineMesh(POINTS, [[0, 1, 2]], {}), "LineMesh: cells must hold n x 2 indices"),
    (lambda _: LineMesh(POINTS, [[0, 1], [1, 3]], {}), "cells must lie in 0 to 2, got 3"),
    (lambda _: LineMesh(POINTS, [[0.0, 1.0]], {}), "LineMesh: cells must be whole numbers"),
    (lambda _: LineMesh(POINTS, [[0, 1]], {}), "LineMesh: node 2 belongs to no cell"),
    (lambda _: LineMesh(POINTS, [*CELLS, [1, 0]], {}), "cell 0 between .* occurs twice"),
    (
        lambda _: LineMesh([[0, 0, 0], [1, 0, 0], [1, 0, 0]], CELLS, {"bar": [0, 1]}),
        'LineMesh: cell 1 of group "bar" between nodes 1 and 2 has zero length',
    ),
    (
        lambda _: LineMesh(POINTS, CELLS, {"bar": []}),
        'line group "bar" must hold at least one cell',
    ),
    (lambda _: LineMesh(POINTS, CELLS, {"bar": [2]}), 'group "bar" must lie in 0 to 1, got 2'),
    (lambda _: LineMesh(POINTS, CELLS, {}, {"p": 9}), 'group "p" must lie in 0 to 2, got 9'),
    (lambda folder: read_mesh(folder / "none.msh"), 'mesh file ".*none.msh" does not exist'),
    (lambda _: read_mesh(Path(__file__)), 'mesh file ".*py" must end in .msh, .inp, '),
    (mesh_file("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 1 1\n"), "cannot be read: "),
    (mesh_file("this is\nno mesh"), 'mesh file ".*bad.msh" cannot be read: '),
    (mesh_file(""), 'mesh file ".*bad.msh" cannot be read: '),
    (gmsh_model(groups=False), "gmsh model: the mesh has no named physical group of lines"),
    (gmsh_model(points=1), "gmsh model: the mesh has no line elements of first order"),
    (gmsh_model(order=2), 'group "bar" has elements "Line 3", only lines of first order'),
    (lambda _: build_mesh("chains"), 'mesh "chains" is not in the library: arc, bar_on_cylinder, '),
    (lambda _: build_mesh("chain", link=3), r'"chain" has no parameter "link" \(value 3\); it has'),
    (lambda _: build_mesh("chain", links=0), 'mesh "chain": links must be positive, got 0'),
    (
        lambda _: build_mesh("chain", links=2.5),
        'mesh "chain": links must be a whole number, got 2.5',
    ),
    (lambda _: build_mesh("chain", length=NAN), 'mesh "chain": length must be finite, got nan'),
]

# --- whole models --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def mesh():
    """A straight beam, a second one that shares its end, a ring, a tee and a bar of its own."""
    ring = [[10 + np.cos(a), np.sin(a), 0] for a in np.arange(8) * np.pi / 4]
    points = [*POINTS, [3, 0, 0], *ring, [0, 5, 0], [1, 5, 0], [2, 5, 0], [1, 6, 0]]
    circle = [[4 + i, 4 + (i + 1) % 8] for i in range(8)]
    tee = [[12, 13], [13, 14], [13, 15]]
    return LineMesh(
        points,
        [[0, 1], [1, 2], [2, 3], *circle, *tee],
        {"beam": [0, 1], "next": [2], "both": [0, 1, 2], "ring": range(3, 11), "tee": [11, 12, 13]},
        {"root": 0, "tip": 2, "foot": 15},
    )


def beam(name="both", **options):
    return Beam(name, SECTION, **options)


def curved():
    return Beam("line", SECTION, curve=LINE)


def others():
    """The beams that make the model of the whole mesh complete."""
    return [beam("ring"), beam("tee")]


def joint(a, b):
    return Spherical("joint", a, b)


BODY = RigidBody("body", 1.0, (1, 1, 1))
MODELS = [
    (lambda: [], 'Model "bad": it has no bodies'),
    (
        lambda: [beam(), beam("ring"), beam("tee", formulation="nurbs")],
        'Beam "tee": group "tee" branches or falls apart, formulation "nurbs" needs one line',
    ),
    (
        lambda: [*others(), beam(formulation="nurbs", orientation=(1, 0, 0))],
        r'Beam "both": orientation .* is parallel to the tangent',
    ),
    (
        lambda: [*others(), beam(), curved(), PointForce("f", Marker("line", "root"), (0, 0, 1))],
        'PointForce "f": Marker on "line": a beam along a curve has "start", "end" and fractions, '
        'got point "root"',
    ),
    (
        lambda: [*others(), beam(), curved(), PointForce("f", Marker("line"), (0, 0, 1))],
        'PointForce "f": Marker on "line": a beam needs a point',
    ),
    (
        lambda: [
            *others(),
            beam(),
            curved(),
            joint(Marker("line", 0.3), Marker("line", 0.3, (0, 1, 0))),
        ],
        'Spherical "joint": both markers are fixed to place 0.3 in element 0 of "line"',
    ),
    (lambda: [beam(), beam()], 'Beam "both": the name is used already by a Beam'),
    (lambda: [BODY, PointForce("body", END, (0, 0, 1))], 'PointForce "body": the name is used'),
    (
        lambda: [3.0],
        'Model "bad": only bodies, joints, loads, contacts, probes, events, controllers .* got 3.0',
    ),
    (lambda: [RigidPlane(Ground())], "only bodies, .*, which is part of a Contact$"),
    (lambda: [Gravity((0, 0, 1)), Gravity((0, 0, 2))], r"gravity is there already.*\[0.0, 0.0, 2"),
    (lambda: [beam("bar")], 'Beam "bar": LineMesh: group "bar" is not in the mesh; its lines are'),
    (lambda: [beam("a", group="tip")], 'Beam "a": LineMesh: group "tip" is a point, not a line'),
    (
        lambda: [beam(), beam("copy", group="both")],
        'Beam "copy": group "both" is used already by Beam "both"',
    ),
    (lambda: [beam("beam"), beam("both")], 'Beam "both": cell 0 belongs to Beam "beam" as well'),
    (
        lambda: [beam("beam"), beam("next"), *others()],
        r'Beam "next": node 2 at \[2.0, 0.0, 0.0\] is shared with Beam "beam"',
    ),
    (
        lambda: [beam()],
        r"11 cells of the mesh belong to no beam, the first is cell 3 of \['ring'\]",
    ),
    (
        lambda: [beam(orientation=(1, 0, 0)), *others()],
        r'Beam "both": orientation \[1.0, 0.0, 0.0\] is parallel to the tangent at \[0.0, 0.0',
    ),
    (
        lambda: [beam(orientation=lambda x: x[:2]), *others()],
        r'Beam "both": orientation: result of the function must hold 4 x 3 numbers, got',
    ),
    (
        lambda: [beam(orientation=lambda x: np.full_like(x, NAN)), *others()],
        'Beam "both": orientation: result of the function must be finite',
    ),
    (
        lambda: [beam(orientation=lambda x: ["up"] * 4), *others()],
        'Beam "both": orientation: result of the function must hold 4 x 3 numbers, got',
    ),
    (lambda: [BODY, joint(Ground(), Ground((1, 0, 0)))], 'Spherical "joint": both markers are on'),
    (
        lambda: [BODY, joint(Ground(), Marker("boddy"))],
        'Spherical "joint": Marker on "boddy": Model "bad" has no such body',
    ),
    (
        lambda: [BODY, joint(Ground(), Marker("body", "tip"))],
        'Spherical "joint": Marker on "body": a rigid body has no point "tip"',
    ),
    (
        lambda: [BODY, joint(Marker("body"), Marker("body", offset=(1, 0, 0)))],
        'Spherical "joint": both markers are fixed to "body"',
    ),
    (
        lambda: [beam(), *others(), joint(Marker("both", "end"), Marker("both", 0.99999))],
        'Spherical "joint": both markers are fixed to node 3 of "both"',
    ),
    (
        lambda: [beam(), *others(), joint(Ground(), Marker("both"))],
        'Marker on "both": a beam needs a point: .* got None',
    ),
    (
        lambda: [beam(), *others(), joint(Ground(), Marker("both", "tipp"))],
        r'Marker on "both": point group "tipp" is not in the mesh; the beam has .root, tip, start',
    ),
    (
        lambda: [beam(), *others(), joint(Ground(), Marker("both", "foot"))],
        r'Marker on "both": point group "foot" \(node 15\) is not on this beam',
    ),
    (
        lambda: [beam(), *others(), joint(Ground(), Marker("ring", "start"))],
        'Marker on "ring": point "start": the line is closed and has no ends',
    ),
    (
        lambda: [beam(), *others(), joint(Ground(), Marker("tee", "end"))],
        'Marker on "tee": point "end": group "tee" branches or falls apart; name a point group',
    ),
    (
        lambda: [beam(), *others(), joint(Ground(), Marker("tee", 0.5))],
        'Marker on "tee": point 0.5: group "tee" branches or falls apart',
    ),
    (
        lambda: [BODY, PointMass("mass", 1.0, Marker("nobody"))],
        'PointMass "mass": Marker on "nobody": Model "bad" has no such body',
    ),
    (
        lambda: [BODY, PointForce("force", Marker("nobody"), (0, 0, 1))],
        'PointForce "force": Marker on "nobody"',
    ),
    (lambda: [BODY, PositionProbe("p", Marker("nobody"))], 'PositionProbe "p": Marker on "nobody"'),
    (
        lambda: [BODY, LineLoad("load", "body", (0, 0, 1))],
        'LineLoad "load": Model "bad" has no beam "body"',
    ),
    (
        lambda: [
            BODY,
            PositionProbe("p", Marker("body")),
            Probe("q", [Marker("body")], ["p_x"], lambda t, a: [0.0]),
        ],
        'Probe "q": column "p_x" is used already by PositionProbe "p"',
    ),
]


def expect(message, function, *arguments):
    """Call and check the error: its kind, its words, and that it is one line."""
    with pytest.raises((ValueError, TypeError, RuntimeError)) as caught:
        function(*arguments)
    text = str(caught.value)
    assert re.match(rf".*{message}", text), text
    assert "\n" not in text
    assert len(text) < 400
    assert_on_page(text)


@pytest.mark.parametrize(("make", "message"), CONSTRUCTORS, ids=[m for _, m in CONSTRUCTORS])
def test_constructors(make, message):
    expect(message, make)


@pytest.mark.parametrize(("make", "message"), MESHES, ids=[m for _, m in MESHES])
def test_meshes(make, message, tmp_path):
    expect(message, make, tmp_path)


@pytest.mark.parametrize(("make", "message"), MODELS, ids=[m for _, m in MODELS])
def test_models(make, message, mesh):
    def build():
        model = Model("bad", mesh=mesh)
        model.add(*make())
        model.validate()

    expect(message, build)


def test_beams_need_a_mesh():
    model = Model("bare")
    model.add(beam())
    expect('Beam "both": Model "bare" has beams but no mesh', model.validate)
    expect('Model "bare": it has beams but no mesh', model.weights)
    expect('Model "bare": there is no "rod"; it has .both', model.__getitem__, "rod")
    expect('Model "bare": mesh must be a LineMesh, got 5', lambda: Model("bare", mesh=5))


def test_the_complete_model_is_accepted(mesh):
    model = Model("good", mesh=mesh)
    model.add(beam(), *others(), BODY, joint(Marker("both", "end"), Marker("body")))
    model.validate()
