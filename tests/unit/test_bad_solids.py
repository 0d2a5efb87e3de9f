# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solids that make no sense: one line that names the object and the value."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx.cpp.fem import CoordinateElement_float64
from dolfinx.cpp.mesh import create_mesh
from dolfinx.mesh import (
    CellType,
    GhostMode,
    Mesh,
    create_cell_partitioner,
    create_unit_interval,
    create_unit_square,
)

import flexfem as ff
from flexfem.families.solid.body import TAKEN
from flexfem.families.solid.family import kind_of
from flexfem.families.solid.forms import SolidForms
from flexfem.layout.numbered_model import NumberedModel
from flexfem.system.build import build
from tests.unit.mesh_texts import ABAQUS_BLOCK
from tests.unit.refusals import assert_on_page

pytestmark = pytest.mark.serial

NAN = float("nan")
NEO = ff.laws.NeoHookean(1e6, 2e6)
CUBE = ff.SolidMesh.box((1, 1, 1), (1, 1, 1))
RECTANGLE = ff.SolidMesh.box((1, 1), (1, 1), "quadrilateral")
TETRAHEDRA = ff.SolidMesh.box((1, 1, 1), (1, 1, 1), "tetrahedron")
TWO = ff.SolidMesh.box((2, 1, 1), (2, 1, 1))
#: Two cells, in a region each.
HALVES = ff.SolidMesh(
    TWO.points, TWO.cells, "hexahedron", regions={"a": [0], "b": [1], "both": [0, 1]},
    surfaces=TWO.surfaces, nodes={"corner": [0], "pair": [0, 1]},
)  # fmt: skip
WEDGE = ff.SolidMesh(
    [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)], [range(6)], "prism"
)
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
PLANE = {"mesh": RECTANGLE, "plane": "strain"}
GROUND = ff.RigidPlane(ff.Ground((0, 0, -1)))
CORNER = ff.Marker("j", "corner")


def mesh(points: Any = CUBE.points, cells: Any = CUBE.cells, **options: Any) -> ff.SolidMesh:
    """A cube of one cell, with changes."""
    return ff.SolidMesh(points, cells, **{"cell": "hexahedron"} | options)


def solid(law: Any = NEO, **options: Any) -> ff.Solid:
    """A body of two cells, with changes."""
    return ff.Solid("j", law, **{"mesh": HALVES, "density": 1.0} | options)


def halves(**places: Any) -> np.ndarray:
    """Points of the cube, some of them elsewhere."""
    points = CUBE.points.copy()
    for number, place in places.items():
        points[int(number[1:])] = place
    return points


def mixed() -> ff.SolidMesh:
    """A hexahedron and a wedge in one mesh of DOLFINx."""
    x = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1), (1, 1, 1)]
    x = np.array([*x, (2, 0, 0), (2, 0, 1)], dtype=np.float64)
    cells = [np.arange(8), np.array([1, 8, 3, 5, 9, 7])]
    kinds = [CoordinateElement_float64(kind, 1) for kind in (CellType.hexahedron, CellType.prism)]
    partitioner = create_cell_partitioner(GhostMode.none, 2)
    made = create_mesh(MPI.COMM_SELF, cells, kinds, x, partitioner, 2)
    return ff.SolidMesh.from_dolfinx(Mesh(made, None))


def tagged(**options: Any) -> ff.SolidMesh:
    """A mesh of DOLFINx with tags."""
    return ff.SolidMesh.from_dolfinx(create_unit_square(MPI.COMM_SELF, 1, 1), **options)


MESHES = {
    "shape": (lambda: mesh(cell="cube"), "cell must be one of tetrahedron, .*, got 'cube'"),
    "shape type": (lambda: mesh(cell=["hexahedron"]), r"cell must be .*, got \['hexahedron'\]"),
    "degree": (lambda: mesh(degree=4), "degree must be 1, 2 or 3, got 4"),
    "nodes of a cell": (lambda: mesh(degree=2), "cells must hold n x 27 indices"),
    "NaN": (lambda: mesh(halves(n0=NAN)), "points must be finite"),
    "plane points": (lambda: mesh(CUBE.points[:, :2]), "points must hold n x 3 numbers"),
    "index": (lambda: mesh(cells=[[0, 1, 2, 3, 4, 5, 6, 8]]), "cells must lie in 0 to 7, got 8"),
    "index type": (lambda: mesh(cells=CUBE.cells + 0.5), "cells must be whole numbers"),
    "no cell": (lambda: mesh(cells=[]), "cells must hold at least one cell, got none"),
    "unused node": (
        lambda: mesh(np.vstack([CUBE.points, (2, 2, 2)])), "node 8 belongs to no cell"
    ),
    "node twice": (
        lambda: mesh(cells=[[0, 4, 2, 6, 1, 5, 3, 3]]), r"cell 0 has a node twice: \[0, 4, 2"
    ),
    "cell twice": (
        lambda: mesh(cells=np.tile(CUBE.cells, (2, 1))), "cells 0 and 1 have the same nodes"
    ),
    "inside out": (
        lambda: mesh(cells=CUBE.cells[:, [4, 5, 6, 7, 0, 1, 2, 3]]),
        r"cell 0 at \[0.5, 0.5, 0.5\] is inside out",
    ),
    "flat": (lambda: mesh(CUBE.points * (1, 1, 0)), r"cell 0 at \[0.5, 0.5, 0.0\] has no volume"),
    "one corner pushed in": (lambda: mesh(halves(n7=(0.2, 0.2, 0.2))), "is inside out"),
    "empty region": (lambda: mesh(regions={"a": []}), r'regions\["a"\] is empty'),
    "region index": (lambda: mesh(regions={"a": [1]}), r'regions\["a"\] must lie in 0 to 0, got 1'),
    "regions type": (lambda: mesh(regions=[0]), r"regions must be a Mapping, got \[0\]"),
    "empty nodes": (lambda: mesh(nodes={"a": []}), r'nodes\["a"\] is empty'),
    "empty surface": (lambda: mesh(surfaces={"a": []}), r'surfaces\["a"\] is empty'),
    "no facet": (
        lambda: mesh(surfaces={"a": [[0, 1, 2, 7]]}),
        r'surfaces\["a"\]: \[0, 1, 2, 7\] is no facet of a cell',
    ),
    "surfaces type": (lambda: mesh(surfaces=[[0, 1, 2, 3]]), "surfaces must be a Mapping"),
    "plane off z": (
        lambda: ff.SolidMesh(RECTANGLE.points + np.ones(3), RECTANGLE.cells, "quadrilateral"),
        "plane figures lie at z = 0, node 0 is at z = 1",
    ),
    "box of wedges": (
        lambda: ff.SolidMesh.box((1, 1, 1), (1, 1, 1), "prism"), "box: cell must be .* got 'prism'"
    ),
    "box sizes": (
        lambda: ff.SolidMesh.box((1, 0, 1), (1, 1, 1)), r"sizes must be positive, got \[1.0, 0.0"
    ),
    "box counts": (lambda: ff.SolidMesh.box((1, 1, 1), 3), "counts must be 3 numbers, got 3"),
    "box of no cells": (
        lambda: ff.SolidMesh.box((1, 1, 1), (1, 1, 0)), "counts must be at least 1, got 0"
    ),
    "huge box": (
        lambda: ff.SolidMesh.box((1, 1, 1), (100000, 100000, 1000)), "nodes would need about"
    ),
    "moved": (lambda: CUBE.moved(CUBE.points[:4]), "points must hold 8 x 3 numbers"),
    "lowered": (lambda: CUBE.raised(0), "raised: degree must be 1 to 3, got 0"),
    "surface by places": (
        lambda: CUBE.with_surfaces(a=lambda x: x), "a must return 8 times True or False, got"
    ),
    "surface nowhere": (
        lambda: CUBE.with_surfaces(a=lambda x: x[:, 0] > 2.0), r'surfaces\["a"\] is empty'
    ),
    "DOLFINx shape": (
        lambda: ff.SolidMesh.from_dolfinx(create_unit_interval(MPI.COMM_SELF, 1)),
        "cannot use cells interval with a geometry of degree 1",
    ),
    "DOLFINx mixture": (mixed, r"cells of several shapes \(hexahedron, prism\)"),
    "DOLFINx tags": (lambda: tagged(cell_tags=3), "cell_tags must be a MeshTags .*, got 3"),
    "DOLFINx names": (
        lambda: tagged(names={"a": [3]}), r'names\["a"\] must be dimension and tag, got \[3\]'
    ),
}  # fmt: skip

LAWS = {
    "incompressible": (
        lambda: ff.laws.NeoHookean.from_young(1e6, 0.5),
        r"NeoHookean: poisson_ratio must lie in \(-1, 0.5\), got 0.5",
    ),
    "Poisson's ratio": (
        lambda: ff.laws.SaintVenantKirchhoff(1e6, -1.0), r"poisson_ratio must lie in .*, got -1.0"
    ),
    "Young's moduli": (
        lambda: ff.laws.SaintVenantKirchhoff([1e6, 2e6], [0.1, 0.2, 0.3]),
        "youngs_modulus has 2 values, poisson_ratio 3",
    ),
    "modulus of a cell": (
        lambda: ff.laws.NeoHookean([1.0, -1.0], 1.0), "shear_modulus must be positive, got -1.0"
    ),
    "Mooney": (lambda: ff.laws.MooneyRivlin(1.0, -2.0, 1.0), "c01 must not be negative, got -2.0"),
    "Ogden": (
        lambda: ff.laws.Ogden([1.0, 2.0], [2.0, -2.0], 1.0),
        "Ogden: the shear modulus, .*, must be positive, got -1",
    ),
    "Ogden's exponents": (
        lambda: ff.laws.Ogden([1.0, 2.0], [2.0], 1.0), r"as many exponents as moduli, got \[1.0, 2"
    ),
    "Ogden's zero": (
        lambda: ff.laws.Ogden([1.0], [0.0], 1.0), r"exponents must not be zero .*, got \[0.0\]"
    ),
    "no fibres": (
        lambda: ff.laws.HolzapfelGasserOgden(1.0, 1.0, 1.0, 1.0, []), "one or two directions, got 0"
    ),
    "fibre zero": (
        lambda: ff.laws.HolzapfelGasserOgden(1.0, 1.0, 1.0, 1.0, [(0, 0, 0)]),
        r"HolzapfelGasserOgden: fibres\[0\] must not be zero",
    ),
    "dispersion": (
        lambda: ff.laws.HolzapfelGasserOgden(1.0, 1.0, 1.0, 1.0, [(1, 0, 0)], 0.5),
        r"dispersion must lie in \[0, 1/3\], got 0.5",
    ),
    "times": (
        lambda: ff.laws.Viscoelastic(NEO, [1.0, 2.0], [1.0]),
        r"as many times as shear_moduli, got \[1.0, 2.0\] and \[1.0\]",
    ),
    "time zero": (
        lambda: ff.laws.Viscoelastic(NEO, [1.0], [0.0]), r"times must be positive, got \[0.0\]"
    ),
    "viscous of plastic": (
        lambda: ff.laws.Viscoelastic(ff.laws.J2Plasticity(1.0, 1.0, 1.0), [1.0], [1.0]),
        r"elastic must have no internal variables, got J2Plasticity\(",
    ),
    "yield stress": (
        lambda: ff.laws.J2Plasticity(1.0, 1.0, 0.0), "yield_stress must be positive, got 0.0"
    ),
    "muscle of plastic": (
        lambda: ff.laws.ActiveStress(ff.laws.J2Plasticity(1.0, 1.0, 1.0), 1.0),
        r"ActiveStress: passive must have no internal variables, got J2Plasticity\(",
    ),
    "muscle of muscle": (
        lambda: ff.laws.ActiveStress(ff.laws.ActiveStress(NEO, 1.0), 1.0, (0, 1, 0)),
        'ActiveStress: its law has a parameter "fibre", too: give it another name',
    ),
    "muscle without direction": (
        lambda: ff.laws.ActiveStress(NEO, 1.0, (0, 0, 0)), "ActiveStress: fibre must not be zero"
    ),
    "growth": (lambda: ff.laws.Growth(NEO, 0.0), "Growth: stretch must be positive, got 0.0"),
    "growth of growth": (
        lambda: ff.laws.Growth(ff.laws.Growth(NEO, 1.1), 1.1), 'Growth: its law has .* "growth"'
    ),
    "no function": (lambda: ff.laws.Hyperelastic(3), "function must be a function of F and p"),
    "values": (lambda: ff.laws.Hyperelastic(NEO.energy, [1.0]), "values must be a Mapping"),
    "value NaN": (
        lambda: ff.laws.Hyperelastic(NEO.energy, {"mu": NAN}), r'values\["mu"\] must be finite'
    ),
    "value shape": (
        lambda: ff.laws.Hyperelastic(NEO.energy, {"mu": np.ones((1, 1, 1))}),
        r'values\["mu"\] must be a number, one of each cell or vectors',
    ),
    "damping": (
        lambda: ff.laws.Hyperelastic(NEO.energy, {}, 3), "damping must be a function of F, its rate"
    ),
}  # fmt: skip

BODIES = {
    "no mesh": (
        lambda: solid(mesh="a.msh"), "mesh must be a SolidMesh, .* or a mesh of DOLFINx, got 'a.msh"
    ),
    "no law": (lambda: solid(2.1e11), "law must be a SolidLaw, got 210000000000.0"),
    "law unknown": (lambda: solid({"c": NEO}), "law: the mesh has no region 'c'; there are a, b"),
    "law missing": (lambda: solid({"a": NEO}), r"law: cell 1 has no region of \['a'\]"),
    "law twice": (
        lambda: solid({"a": NEO, "both": NEO}),
        r"law: cell 0 has more than one region of \['a', 'both'\]",
    ),
    "law of a region": (lambda: solid({"a": NEO, "b": 3}), r'law\["b"\] must be a SolidLaw, got 3'),
    "no density": (lambda: solid(density=None), "density must be a number, got None"),
    "density zero": (lambda: solid(density=0.0), "density must be positive, got 0.0"),
    "density text": (lambda: solid(density="1"), "density must be a number, got '1'"),
    "density unknown": (
        lambda: solid(density={"a": 1.0, "c": 1.0}), "density: the mesh has no region 'c'"
    ),
    "density of a region": (
        lambda: solid(density={"a": 1.0, "b": -2.0}), r'density\["b"\] must be positive, got -2.0'
    ),
    "name of a parameter": (
        lambda: solid(ff.laws.Hyperelastic(NEO.energy, {"step": 1.0})),
        'law: a parameter must have another name than "step"',
    ),
    "degree": (lambda: solid(degree=4), "degree must be 1, 2 or 3, got 4"),
    "degree type": (lambda: solid(degree=2.0), "degree must be 1, 2 or 3, got 2.0"),
    "degree of wedges": (
        lambda: solid(mesh=WEDGE, degree=3), "wedges have degree 1 or 2, got 3"
    ),
    "degree of the geometry": (
        lambda: solid(
            mesh=ff.SolidMesh(
                solid(mesh=TETRAHEDRA).points, solid(mesh=TETRAHEDRA).nodes.cells, "tetrahedron",
                degree=2,
            ),
            degree=1,
        ),
        "degree 1 is less than that of the mesh's geometry, 2",
    ),
    "formulation": (
        lambda: solid(formulation="mixed"), 'formulation must be "displacement" or "dilatation"'
    ),
    "dilatation": (
        lambda: solid(mesh=TETRAHEDRA, degree=1, formulation="dilatation"),
        'formulation "dilatation" needs degree 2 at least',
    ),
    "quadrature": (lambda: solid(quadrature=1), "quadrature must be at least 2 of cells of"),
    "no plane": (lambda: solid(mesh=RECTANGLE), "its mesh has plane cells: give plane, got None"),
    "plane of solids": (
        lambda: solid(plane="strain"), "its mesh has solid cells: no plane, got 'strain'"
    ),
    "plane state": (lambda: solid(mesh=RECTANGLE, plane="thin"), "plane must be .*, got 'thin'"),
    "beyond the axis": (
        lambda: solid(mesh=RECTANGLE.moved(RECTANGLE.points - (0.5, 0, 0)), plane="axisymmetric"),
        "node 0 of an axisymmetric body is at x = -0.5, on the other side of the axis",
    ),
    "dilatation in plane stress": (
        lambda: solid(mesh=RECTANGLE, plane="stress", formulation="dilatation"),
        'plane "stress" does not lock: no formulation "dilatation"',
    ),
    "mass": (lambda: solid(mass="light"), "mass must be .*'light'"),
    "thickness": (lambda: solid(thickness=2.0), "thickness belongs to bodies in plane"),
    "fixed": (lambda: solid(fixed={"top": "x"}), "fixed: no surface or set of nodes 'top'"),
    "fixed axes": (lambda: solid(fixed={"x0": "xw"}), 'must be some of "xyz", got \'xw\''),
    "fixed type": (lambda: solid(fixed="x0"), "fixed must be a Mapping, got 'x0'"),
    "touching": (lambda: solid(touching="top"), "touching: no surface 'top'; there are x0"),
    "touching type": (lambda: solid(touching=True), "touching must be a string, got True"),
    "touching plane": (
        lambda: solid(**PLANE, touching="boundary"), "plane bodies do not touch, got touching='bou"
    ),
    "velocities": (
        lambda: solid(start_velocities=lambda x: x[:, :2]),
        r"start_velocities\(x\) must hold 45 x 3 numbers",
    ),
    "velocities that fail": (
        lambda: solid(start_velocities=lambda x: 1 / 0), "lambda .*: ZeroDivisionError: division by"
    ),
    "rotated": (
        lambda: solid(fixed={"x0": "x"}).moved(ff.Pose((0, 0, 0), QUARTER)),
        "fixed nodes cannot be rotated",
    ),
    "lifted": (
        lambda: solid(**PLANE).moved(ff.Pose((0, 0, 1), np.eye(3))), "a plane body stays at z = 0"
    ),
    "place outside": (
        lambda: solid().point_marker((3, 0, 0)), r"the position \[3.0, 0.0, 0.0\] is outside of the"
    ),
    "marker of no surface": (
        lambda: solid().surface_marker("top"), "no surface or set of nodes 'top'; there are x0"
    ),
    "marker's weights": (
        lambda: ff.SolidMarker("j", [0, 1], [1.0]), r"needs different nodes with a weight each, got"
    ),
    "marker's sum": (
        lambda: ff.SolidMarker("j", [0, 1], [1.0, 1.0]), r"weights must add up to one, got \[1.0, 1"
    ),
    "pressure": (
        lambda: ff.SurfacePressure("j", "a", "x1", NAN), "pressure must be finite, got nan"
    ),
    "traction": (
        lambda: ff.SurfaceTraction("j", "a", "x1", (1, 2)), "force_per_area must hold 3 numbers"
    ),
    "measure": (
        lambda: ff.SolidProbe("j", "a", measures=("force",)), 'measures must be .*, got \'force\''
    ),
    "measures twice": (
        lambda: ff.SolidProbe("j", "a", measures=("J", "J")), "must be different names, got"
    ),
    "measures type": (lambda: ff.SolidProbe("j", "a", measures=3), "measures must be .*, got 3"),
}  # fmt: skip


def refused(make: Callable[[], object]) -> str:
    """The one line of a mistake, which is on the guide's page."""
    with pytest.raises((ValueError, TypeError)) as raised:
        make()
    text = str(raised.value)
    assert "\n" not in text
    assert_on_page(text)
    return text


def check(make: Callable[[], object], owner: str, message: str) -> None:
    """The line begins with the owner and says what is wrong."""
    text = refused(make)
    assert text.startswith(owner)
    assert re.search(message, text), text


@pytest.mark.parametrize(("make", "message"), MESHES.values(), ids=MESHES)
def test_meshes_are_refused(make: Callable[[], object], message: str) -> None:
    check(make, "SolidMesh", message)


@pytest.mark.parametrize(("make", "message"), LAWS.values(), ids=LAWS)
def test_laws_are_refused(make: Callable[[], object], message: str) -> None:
    text = refused(make)
    assert hasattr(ff.laws, text.split(":")[0])
    assert re.search(message, text), text


@pytest.mark.parametrize(("make", "message"), BODIES.values(), ids=BODIES)
def test_bodies_are_refused(make: Callable[[], object], message: str) -> None:
    text = refused(make)
    assert text.split(":")[0].endswith('"j"')
    assert re.search(message, text), text


FILES = {
    "set": ({"bodies": ["MIDDLE"]}, '"MIDDLE"'),
    "surface": ({"facets": ["MIDDLE"]}, 'facets "MIDDLE": there is no such set of faces'),
    "scale": ({"scale": 0.0}, "scale must be positive, got 0.0"),
}


@pytest.mark.parametrize(("options", "message"), FILES.values(), ids=FILES)
def test_files_are_refused(options: dict[str, Any], message: str, tmp_path: Path) -> None:
    path = tmp_path / "block.inp"
    path.write_text(ABAQUS_BLOCK)
    check(lambda: ff.SolidMesh.read(path, **options), "mesh file", message)


@pytest.mark.parametrize("name", ["none.msh", "cube.stp"])
def test_missing_and_other_files_are_refused(name: str, tmp_path: Path) -> None:
    check(lambda: ff.SolidMesh.read(tmp_path / name), "mesh file", f'{name}" (does not|must end)')


IN_MODEL = {
    "marker far away": (
        [ff.PositionProbe("p", ff.Marker("j", (9, 9, 9)))], "the nearest node to .* is .* m away"
    ),
    "marker of many": (
        [ff.PositionProbe("p", ff.Marker("j", "pair"))], '"pair" has 2 nodes; its mean place'
    ),
    "marker of none": ([ff.PositionProbe("p", ff.Marker("j", "top"))], "no surface or set of"),
    "marker with offset": (
        [ff.PositionProbe("p", ff.Marker("j", "corner", offset=(1, 0, 0)))],
        "a node has no axes for offsets, got",
    ),
    "marker of a beam": (
        [ff.PositionProbe("p", ff.Marker("j", 0.5))], "point must name a set of one node or be"
    ),
    "marker of a node that is none": (
        [ff.Spherical("p", ff.Ground(), ff.SolidMarker("j", [99], [1.0]))], "node 99, it has 45"
    ),
    "marker of energies": (
        [ff.Spherical("p", ff.Ground(), ff.NodeSetMarker("j", [0, 1]))],
        "a Solid takes those of its surface_marker and point_marker, got a NodeSetMarker",
    ),
    "moment": ([ff.PointMoment("f", CORNER, (0, 0, 1))], "have no axes for moments"),
    "follower": ([ff.PointForce("f", CORNER, (0, 0, 1), follower=True)], "have no axes for"),
    "force on a surface": (
        [ff.PointForce("f", solid().surface_marker("x1"), (0, 0, 1))], "is for joints only"
    ),
    "pressure on no solid": (
        [ff.SurfacePressure("f", "rigid", "x1", 1.0)], 'has no body "rigid" that takes it'
    ),
    "pressure on no surface": ([ff.SurfacePressure("f", "j", "top", 1.0)], "no surface 'top';"),
    "traction on no surface": (
        [ff.SurfaceTraction("f", "j", "top", (1, 0, 0))], "no surface 'top'; there are x0"
    ),
    "pressure of shells": ([ff.Pressure("f", "j", 1.0)], '"j" has no linear triangles'),
    "probe of no solid": ([ff.SolidProbe("f", "rigid")], 'has no Solid "rigid"'),
    "probe outside": ([ff.SolidProbe("f", "j", (9, 9, 9))], r"the position \[9.0, 9.0, 9"),
    "probe of two kinds": (
        [ff.SolidProbe("f", "j", (0.5, 0.5, 0.5), measures=("J", "position"))],
        "need two probes, one for position",
    ),
    "probe of no surface": (
        [ff.SolidProbe("f", "j", "c", measures=("position",))], "no surface 'c'; there are",
    ),
    "probe of no region": ([ff.SolidProbe("f", "j", "c")], "has no region 'c'; there are a, b"),
    "contact": ([ff.Contact("f", "j", surfaces=GROUND)], 'a Solid: name its surface, touching='),
    "carrier": (
        [ff.Sliding("f", ff.Carrier("j"), ff.Marker("rigid"))], 'has no beam or body with lines "j"'
    ),
}  # fmt: skip


def built(body: ff.Solid, *things: Any) -> Callable[[], object]:
    """The start of a computation."""
    model = ff.Model("test")
    model.add(body, ff.RigidBody("rigid", 1.0, (1, 1, 1), position=(5, 5, 5)), *things)

    def make() -> object:
        model.validate()
        return build(NumberedModel(model), MPI.COMM_SELF, split_above=1)

    return make


@pytest.mark.parametrize(("things", "message"), IN_MODEL.values(), ids=IN_MODEL)
def test_models_are_refused(things: list[Any], message: str) -> None:
    assert re.search(message, refused(built(solid(), *things)))


def test_penalty_is_refused() -> None:
    contact = ff.Contact("f", "j", surfaces=GROUND, law="penalty")
    message = 'Contact "f": Solid "j" touches by the barrier alone, leave law out'
    assert refused(built(solid(touching="boundary"), contact)) == message


def test_thin_sheets_refuse_what_needs_their_thickness() -> None:
    sheet = solid(mesh=RECTANGLE, plane="stress", degree=1)
    pressure = ff.SurfacePressure("gas", "j", "x1", 1.0)
    message = 'the edges of Solid "j" in plane stress become thinner or thicker'
    assert message in refused(built(sheet, pressure))
    law = ff.laws.Hyperelastic(
        lambda F, p: ufl.tr(F.T * F) - 2 * ufl.ln(ufl.det(F)),
        {},
        lambda F, rate, p: rate[0, 0] ** 2,
    )
    sheet = solid(law, mesh=RECTANGLE, plane="stress", degree=1)
    assert "needs the rate of the thickness" in refused(built(sheet))


def energy(F: Any, p: Any) -> Any:
    """A law that is wrong for some parameters: k spoils the invariance, the root of s the value."""
    C = F.T * F
    return p.mu * (ufl.tr(C) - 3 - ufl.ln(ufl.det(C))) + p.k * F[0, 0] ** 2 + ufl.sqrt(p.s)


RIGHT = {"mu": 1.0, "k": 0.0, "s": 0.0}
START = {
    "tensor": (lambda F: F, {}, r"energy must return a scalar, got shape \(3, 3\)"),
    "nothing": (lambda F: None, {}, "energy fails: .*None"),
    "fault": (lambda F: 1 / 0, {}, "energy fails: division by zero"),
    "constant": (lambda F, p: p.mu, {"mu": 1.0}, "the energy does not depend on F"),
    "unused": (lambda F: ufl.tr(F.T * F), {"mu": 1.0}, 'does not depend on the parameter "mu"'),
    "unknown": (lambda F, p: p.nu * F[0, 0], {"mu": 1.0}, 'needs a parameter "nu"; given are mu'),
    "soft": (energy, RIGHT | {"mu": 0.0}, "the law has no stiffness: a shear of 0.01 changes its"),
    "unstable": (energy, RIGHT | {"mu": -1.0}, "the law has no stiffness: a shear of 0.01"),
    "not finite": (energy, RIGHT | {"s": -1.0}, "energy or a derivative of it is not finite"),
    "not objective": (energy, RIGHT | {"k": 0.1}, "the energy changes by .* J as the body rotates"),
    "cells": (energy, RIGHT | {"mu": [1.0] * 3}, 'parameter "mu" has 3 values for 2 cells'),
    "NaN in time": (
        energy, RIGHT | {"mu": lambda t: NAN}, '"mu" must be a finite number at t = 0 s, got nan'
    ),
    "fault in time": (energy, RIGHT | {"mu": lambda t: 1 / 0}, '"mu": lambda .*: ZeroDiv'),
    "vector in time": (energy, RIGHT | {"mu": lambda t: (1, 2)}, "must return a number, got shape"),
}  # fmt: skip


def start(law: ff.laws.SolidLaw) -> Callable[[], object]:
    """The start of a computation, of linear cells, which compile faster."""
    return built(solid(law, degree=1))


@pytest.mark.parametrize(("function", "values", "message"), START.values(), ids=START)
def test_energies_are_refused(function: Any, values: dict[str, Any], message: str) -> None:
    check(start(ff.laws.Hyperelastic(function, values)), 'Solid "j": ', message)


@pytest.mark.parametrize("plane", [None, "strain", "stress", "axisymmetric"])
def test_poissons_ratios_are_no_bulk_moduli(plane: str | None) -> None:
    """In plane strain the shape resists as well, and about an axis no rotation shows round-off."""
    message = "the law has no stiffness against changes of volume: its bulk modulus is 0.3 Pa, "
    law = ff.laws.NeoHookean(1e4, 0.3)
    options = {"mesh": RECTANGLE, "plane": plane} if plane else {}
    check(built(solid(law, degree=1, **options)), 'Solid "j": ', message)
    built(solid(ff.laws.NeoHookean.from_young(1e4, -0.9), degree=1, **options))()


DAMPING = {
    "tensor": (lambda F, rate, p: rate, r"dissipation must return a scalar, got shape \(3, 3\)"),
    "no rate": (lambda F, rate, p: ufl.det(F), "the dissipation does not depend on the rate of F"),
    "unknown": (lambda F, rate, p: p.eta * rate[0, 0] ** 2, 'needs a parameter "eta"; given are'),
}  # fmt: skip


@pytest.mark.parametrize(("function", "message"), DAMPING.values(), ids=DAMPING)
def test_damping_is_refused(function: Any, message: str) -> None:
    check(start(ff.laws.Hyperelastic(energy, RIGHT, function)), 'Solid "j": ', message)


def test_names_of_forms_are_no_parameters() -> None:
    """All that forms of a cell have beside the parameters of a law."""
    history = ff.laws.Viscoelastic(NEO, [1.0], [1.0])
    sizes = dict.fromkeys(history.parameters, 1)
    bodies = [
        solid(mesh=TETRAHEDRA, formulation="dilatation"), solid(mesh=RECTANGLE, plane="strain")
    ]  # fmt: skip
    for body in bodies:
        names = SolidForms(history, kind_of(body), sizes).coefficients
        assert set(names) - set(sizes) <= TAKEN
