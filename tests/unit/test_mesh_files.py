# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lines and surfaces in the files of other programs: positions, cells and sets as they stand."""

from pathlib import Path

import numpy as np
import pytest

import flexfem as ff
from tests.unit import mesh_texts

pytestmark = pytest.mark.serial

# positions are typed decimal numbers times a scale: round-off only
EXACT = {"rtol": 0.0, "atol": 1e-15}


@pytest.fixture
def file(tmp_path):
    """Write a text to a file of a name and return its path."""

    def write(name: str, text: str) -> Path:
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return write


def ends(mesh, name):
    """Positions of the ends of a line group's cells, without direction."""
    return sorted(sorted(map(tuple, pair)) for pair in mesh.points[mesh.group_cells(name)].tolist())


def test_abaqus_lines(file) -> None:
    path = file("frame.inp", mesh_texts.ABAQUS_FRAME)
    mesh = ff.read_mesh(path, scale=1e-3)
    assert set(mesh.line_groups) == {"LEGS", "Beam", "FRAME"}
    assert dict(mesh.point_groups) == {"TOP_LEFT": 2}
    # the leg on the left in two cells, the one of B33 on the right in one
    legs = [[(0, 0, 0), (0, 0, 0.5)], [(0, 0, 0.5), (0, 0, 1)], [(2, 0, 0), (2, 0, 1)]]
    np.testing.assert_allclose(ends(mesh, "LEGS"), legs, **EXACT)
    # B32 has its middle node second: last, the beam would run to its middle and back
    beam = [[(0, 0, 1), (1, 0, 1)], [(1, 0, 1), (2, 0, 1)]]
    np.testing.assert_allclose(ends(mesh, "Beam"), beam, **EXACT)
    assert len(mesh.line_groups["FRAME"]) == 5


def test_abaqus_nodes_of_a_set_are_numbered_when_asked_for(file) -> None:
    path = file("frame.inp", mesh_texts.ABAQUS_FRAME)
    mesh = ff.read_mesh(path, lines=["FRAME"], points=["FEET", "CORNERS", "left leg"])
    places = {name: mesh.points[node].tolist() for name, node in mesh.point_groups.items()}
    assert places == {
        "FEET_1": [0, 0, 0],
        "FEET_2": [2000, 0, 0],
        "CORNERS_1": [0, 0, 1000],  # by the name of another set
        "CORNERS_2": [2000, 0, 1000],  # after a name
        "left leg_1": [0, 0, 0],
        "left leg_2": [0, 0, 500],
        "left leg_3": [0, 0, 1000],
    }


def test_abaqus_assembly(file) -> None:
    mesh = ff.read_mesh(
        file("rods.inp", mesh_texts.ABAQUS_ASSEMBLY), points=["ENDS", "SECOND_TIP", "First.TIP"]
    )
    # moved to x = 1, then rotated by 90 degrees about the vertical through it
    np.testing.assert_allclose(mesh.points[3:6], [[1, 0, 0], [1, 1, 0], [1, 2, 0]], **EXACT)
    assert set(mesh.line_groups) == {"RODS", "First.ROOT_CELL", "Second.ROOT_CELL", "PIN_CELLS"}
    assert {name: len(rows) for name, rows in mesh.line_groups.items()}["RODS"] == 4
    np.testing.assert_allclose(ends(mesh, "PIN_CELLS"), [[(0, 0, 5), (0, 0, 6)]], **EXACT)
    places = {
        name: mesh.points[node].round(12).tolist() for name, node in mesh.point_groups.items()
    }
    assert places == {
        "ENDS_1": [0, 0, 0],
        "ENDS_2": [1, 2, 0],
        "SECOND_TIP": [1, 2, 0],
        "First.TIP": [2, 0, 0],
    }
    inner = ff.read_mesh(file("rods.inp", mesh_texts.ABAQUS_ASSEMBLY), lines=["_inner"])
    np.testing.assert_allclose(ends(inner, "_inner"), [[(0, 0, 0), (1, 0, 0)]], **EXACT)


def test_abaqus_meshes_in_instances(file) -> None:
    """Nodes, elements and sets that an instance has beside its part's, and sets of the assembly."""
    path = file("job.inp", mesh_texts.ABAQUS_INSTANCES)
    mesh = ff.read_mesh(path)
    rod, pin = [[(0, 0, 0), (1, 0, 0)], [(1, 0, 0), (2, 0, 0)]], [[(1, 2, 0), (1, 5, 0)]]
    # the pin, along x in its part, is rotated by 90 degrees about z and moved by (1, 2, 0)
    np.testing.assert_allclose(ends(mesh, "rod-1.cells"), rod, atol=1e-14)
    np.testing.assert_allclose(ends(mesh, "pin-1.cells"), pin, atol=1e-14)
    np.testing.assert_allclose(ends(mesh, "both"), rod + pin, atol=1e-14)
    places = {name: mesh.points[node] for name, node in mesh.point_groups.items()}
    expected = {"foot": (1, 2, 0), "tip": (1, 5, 0), "left": (0, 0, 0), "right": (2, 0, 0)}
    assert set(places) == set(expected)  # the reference point is in no line
    for name, place in expected.items():
        np.testing.assert_allclose(places[name], place, atol=1e-14)
    assert "_half" not in mesh.line_groups
    assert len(ff.read_mesh(path, lines=["_half"]).cells) == 1


def test_abaqus_surfaces(file) -> None:
    mesh = ff.read_surface_mesh(file("plates.inp", mesh_texts.ABAQUS_PLATES))
    areas = {name: mesh.areas[rows].sum() for name, rows in mesh.bodies.items()}
    assert areas == pytest.approx({"FLOOR": 2.0, "WALL": 1.0}, rel=1e-14)  # one cell is 0.5 or 1
    along = {name: mesh.points[mesh.line_nodes(name)] for name in mesh.lines}
    expected = {
        "STIFFENER": [[0, 0, 0], [1, 0, 0]],
        "RIGHT": [[2, 0, 0], [2, 1, 0]],
        "TOP": [[0, 0, 1], [1, 0, 1]],
        "BACK": [[0, 1, 0], [1, 1, 0], [2, 1, 0]],
    }
    for name, points in expected.items():
        assert sorted(along[name].tolist()) == sorted(points), name
    # all nodes of the floor: its boundary, also where the wall stands on it
    assert along["FLOOR_NODES"][0].tolist() == along["FLOOR_NODES"][-1].tolist()
    assert len(along["FLOOR_NODES"]) == 7
    assert {name: mesh.points[node].tolist() for name, node in mesh.nodes.items()} == {
        "CORNER": [2, 0, 0]
    }
    wall = ff.read_surface_mesh(file("plates.inp", mesh_texts.ABAQUS_PLATES), bodies=["WALL"])
    assert (len(wall.points), list(wall.bodies), len(wall.triangles)) == (4, ["WALL"], 2)
    # of the floor's nodes two are on the wall, of its back none
    assert set(wall.lines) == {"STIFFENER", "TOP", "FLOOR_NODES"}


def test_nastran(file) -> None:
    path = file("frame.bdf", mesh_texts.NASTRAN_FRAME)
    mesh = ff.read_mesh(path, scale=1e-3)
    bars = [[(0, 0, 0), (0, 0, 1)], [(0, 0, 1), (1, 0, 1)]]
    assert set(mesh.line_groups) == {"property_7", "property_31"}
    np.testing.assert_allclose(ends(mesh, "property_7"), bars, **EXACT)
    np.testing.assert_allclose(ends(mesh, "property_31"), [[(0, 0, 0), (1, 0, 1)]], **EXACT)
    chosen = ff.read_mesh(path, lines=["material_3", "set_6"], points=["set_5"])
    assert {name: len(rows) for name, rows in chosen.line_groups.items()} == {
        "material_3": 2,
        "set_6": 1,
    }
    assert set(chosen.point_groups) == {"set_5_1", "set_5_2", "set_5_3"}  # 9 is on no bar
    sheet = ff.read_surface_mesh(path, scale=1e-3)
    areas = {name: sheet.areas[rows].sum() for name, rows in sheet.bodies.items()}
    # the element angle in the field after the corners is no node
    assert areas == pytest.approx({"property_8": 1.0, "property_9": 0.5}, rel=1e-14)
    np.testing.assert_allclose(sheet.points[sheet.line_nodes("set_9")][:, 1:], [[1, 1]] * 2)
    both = ff.read_surface_mesh(path, bodies=["set_8"])
    assert len(both.triangles) == 3  # 21 THRU 30 where there are 21 and 22


def test_nastran_sets_with_numbers_that_are_not_there(file) -> None:
    """They are no sets of what is left."""
    text = """SET1,1,1,2
SET1,2,2,9
GRID,1,,0.,0.,0.
GRID,2,,1.,0.,0.
GRID,3,,2.,0.,0.
GRID,4,,3.,0.,0.
CROD,1,1,1,2
CROD,2,1,2,3
CROD,3,1,3,4
"""
    path = file("sets.bdf", text)
    ff.read_mesh(path, points=["set_1"], lines=["set_1"])  # both nodes and both rods
    with pytest.raises(ValueError, match=r"set_2.*its numbers are not all those of nodes"):
        ff.read_mesh(path, points=["set_2"])

    """Points by hand: a cylinder about the x axis at z = 10, a sphere in it, a system of points."""
    text = """CORD2C,3,0,0.,0.,10.,1.,0.,10.,+
+,0.,1.,10.
CORD2S,4,3,5.,90.,0.,5.,90.,1.,+
+,6.,90.,0.
CORD1R,5,1,2,3
GRID,1,0,0.,0.,0.
GRID,2,0,0.,0.,2.
GRID,3,0,0.,3.,0.
GRID,4,3,2.,90.,7.
GRID,5,4,3.,90.,90.
GRID,6,4,3.,0.,0.
GRID,7,5,1.,2.,3.
GRDSET,,3
GRID,8,,1.,0.,1.
CROD,1,1,1,2
CROD,2,1,2,3
CROD,3,1,3,4
CROD,4,1,4,5
CROD,5,1,5,6
CROD,6,1,6,7
CROD,7,1,7,8
"""
    mesh = ff.read_mesh(file("grid.bdf", text))
    expected = [
        [0, 0, 0],
        [0, 0, 2],
        [0, 3, 0],
        [7, 0, 12],  # 90 degrees from y about x is z
        [0, -3, 15],  # first axis z, second -y, third x
        [3, 0, 15],
        [-2, 1, 3],  # third axis z, first y
        [1, 1, 10],
    ]
    np.testing.assert_allclose(mesh.points, expected, atol=1e-14)  # round-off of cos 90 degrees


def test_vtk(file) -> None:
    mesh = ff.read_surface_mesh(file("sheet.vtk", mesh_texts.VTK_SHEET))
    areas = {name: mesh.areas[rows].sum() for name, rows in mesh.bodies.items()}
    assert areas == pytest.approx({"material_0": 1.0, "material_4": 1.0}, rel=1e-14)
    assert sorted(mesh.points[mesh.line_nodes("mark_7")].tolist()) == [[1, 0, 0], [1, 1, 0]]
    assert mesh.points[mesh.nodes["mark_3"]].tolist() == [2, 1, 0]
    import meshio

    # the same through XML, compressed; without sets, the body is called after the file
    old = meshio.vtk.read(str(file("sheet.vtk", mesh_texts.VTK_SHEET)))
    path = Path(file("sheet.vtk", mesh_texts.VTK_SHEET)).with_name("other.vtu")
    meshio.vtu.write(str(path), old)
    again = ff.read_surface_mesh(path)
    np.testing.assert_array_equal(again.triangles, mesh.triangles)
    np.testing.assert_array_equal(again.points, mesh.points)
    assert set(again.lines) == set(mesh.lines)
    meshio.vtu.write(str(path), meshio.Mesh(old.points, old.cells))
    assert list(ff.read_surface_mesh(path).bodies) == ["other"]


def test_gmsh_files_in_full(tmp_path, gmsh_model) -> None:
    """Quadrilaterals, groups without names and elements of second order."""
    import gmsh

    square = gmsh_model.occ.addRectangle(0, 0, 0, 2, 1)
    gmsh_model.occ.synchronize()
    gmsh_model.addPhysicalGroup(2, [square], tag=5)
    edge = gmsh_model.getEntitiesInBoundingBox(-1e-3, -1e-3, -1e-3, 1e-3, 2, 1e-3, 1)
    gmsh_model.addPhysicalGroup(1, [edge[0][1]], name="left")
    gmsh_model.mesh.setTransfiniteSurface(square)
    gmsh_model.mesh.setRecombine(2, square)
    gmsh_model.mesh.generate(2)
    gmsh.write(str(tmp_path / "square.msh"))
    mesh = ff.read_surface_mesh(tmp_path / "square.msh", scale=2.0)
    assert list(mesh.bodies) == ["physical_5"]
    assert mesh.areas.sum() == pytest.approx(8.0, rel=1e-12)
    left = mesh.points[mesh.line_nodes("left")]
    assert left[:, 0].tolist() == [0.0] * len(left)
    assert np.ptp(left[:, 1]) == pytest.approx(2.0, rel=1e-12)
    gmsh_model.mesh.setOrder(2)
    gmsh.write(str(tmp_path / "square.msh"))
    second = ff.read_surface_mesh(tmp_path / "square.msh", scale=2.0)
    assert len(second.triangles) == len(mesh.triangles)
    # the midside nodes of straight edges are at the midpoints: a wrong edge is off by half a cell
    corners = second.points[second.triangles]
    middles = 0.5 * (np.roll(corners, -1, axis=1) + np.roll(corners, -2, axis=1))
    np.testing.assert_allclose(second.midpoints, middles, atol=1e-14)


def test_of_equal_sets_the_last_is_the_body(file) -> None:
    more = PLATE + "*ELSET, ELSET=SKIN\n1\n"
    assert list(ff.read_surface_mesh(file("plate.inp", more)).bodies) == ["SKIN"]
    assert list(ff.read_surface_mesh(file("plate.inp", more), bodies=["PLATE"]).bodies) == ["PLATE"]


def test_middle_nodes_are_those_of_the_arc(file) -> None:
    """Eight and six nodes on a cylinder of radius 1 along y."""
    angle = np.deg2rad
    arc = [(np.cos(a), np.sin(a)) for a in map(angle, (90.0, 75.0, 60.0, 45.0, 30.0))]
    rows = [f"{10 * (i + 1) + j}, {x}, {0.5 * j}, {z}" for i, (x, z) in enumerate(arc)
            for j in range(3)]  # fmt: skip
    cells = """*ELEMENT, TYPE=S8R, ELSET=ROOF
1, 10, 30, 32, 12, 20, 31, 22, 11
*ELEMENT, TYPE=STRI65, ELSET=ROOF
2, 30, 50, 52, 40, 51, 41
3, 30, 52, 32, 41, 42, 31
"""
    text = "\n".join(["*NODE", *rows, cells])
    mesh = ff.read_surface_mesh(file("roof.inp", text))
    assert len(mesh.triangles) == 4
    away = np.hypot(mesh.midpoints[..., 0], mesh.midpoints[..., 2]) - 1.0
    # of chords of 30 degrees 0.034; the centre of eight nodes is on the circle but for 1e-16
    np.testing.assert_allclose(away, 0.0, atol=1e-12)
    corners = mesh.points[mesh.triangles]
    middles = 0.5 * (np.roll(corners, -1, axis=1) + np.roll(corners, -2, axis=1))
    # the rise of the arc over its chord; another edge's middle is 0.25 away and more
    assert np.linalg.norm(mesh.midpoints - middles, axis=2).max() < 0.04


def test_quadrilaterals_are_cut_along_the_shorter_diagonal(file) -> None:
    text = """*NODE
1, 0, 0, 0
2, 1, 0, 0
3, 1.5, 1, 0
4, 0.5, 1, 0
*ELEMENT, TYPE=S4, ELSET=P
{}
"""
    for row in ("1, 1, 2, 3, 4", "1, 2, 3, 4, 1"):
        mesh = ff.read_surface_mesh(file("p.inp", text.format(row)))
        # the short diagonal is that of nodes 2 and 4, whatever comes first
        assert all({1, 3} <= set(triangle) for triangle in mesh.triangles.tolist())


def test_nodes_in_one_place_are_merged_on_demand(file) -> None:
    text = """*NODE
1, 0, 0, 0
2, 1000, 0, 0
3, 1000.001, 0, 0
4, 2000, 0, 0
*ELEMENT, TYPE=B31, ELSET=BAR
1, 1, 2
2, 3, 4
*NSET, NSET=MIDDLE
3
"""
    apart = ff.read_mesh(file("bar.inp", text), scale=1e-3)
    assert apart.order("BAR") is None
    one = ff.read_mesh(file("bar.inp", text), scale=1e-3, merge=1e-5)
    assert one.points[one.order("BAR")][:, 0].tolist() == [0.0, 1.0, 2.0]
    assert dict(one.point_groups) == {"MIDDLE": 1}


def test_welds_of_ends_without_names() -> None:
    """A post, and two girders that begin where it ends."""
    rod = ff.Section.circle(0.01, ff.Material(210e9, 0.3, 7850.0))
    lines = {"post": [(0, 0, 0), (0, 0, 1)], "one": [(0, 0, 1), (1, 0, 1)],
             "two": [(0, 1, 1), (0, 0, 1)]}  # fmt: skip
    mesh = ff.LineMesh.straight(lines, 2)
    joints = ff.weld(mesh, [ff.Beam(name, rod, group=name) for name in lines])
    assert [f"{joint.a} {joint.b}" for joint in joints] == [
        "post:end one:start",
        "post:end two:end",
    ]


def test_welds_of_beams(file) -> None:
    path = file("frame.inp", mesh_texts.ABAQUS_FRAME)
    mesh = ff.read_mesh(path, scale=1e-3, lines=["LEGS", "Beam"], separate=True)
    assert {k: mesh.points[v].tolist() for k, v in mesh.point_groups.items() if "seam" in k} == {
        "LEGS_seam_1": [0, 0, 1],
        "Beam_seam_1": [0, 0, 1],
        "LEGS_seam_2": [2, 0, 1],
        "Beam_seam_2": [2, 0, 1],
    }
    rod = ff.Section.circle(0.01, ff.Material(210e9, 0.3, 7850.0))
    legs, beam = ff.Beam("legs", rod, group="LEGS"), ff.Beam("beam", rod, group="Beam")
    joints = ff.weld(mesh, [legs, beam])
    assert [joint.name for joint in joints] == ["legs_beam", "legs_beam_2"]
    # the node set TOP_LEFT names the node of the legs, which is that of their first seam
    assert [str(joint.a) for joint in joints][1] == "legs:LEGS_seam_2"
    assert ff.weld(mesh, [legs]) == []
    with pytest.raises(ValueError, match='group "ROOF" is not in the mesh'):
        ff.weld(mesh, [ff.Beam("roof", rod, group="ROOF")])
    with pytest.raises(TypeError, match="weld: each beam must be a Beam, got 'legs'"):
        ff.weld(mesh, ["legs"])
    with pytest.raises(ValueError, match=r'"LEGS" and "FRAME" share 3 elements: .*, lines=\['):
        ff.read_mesh(path, separate=True)


def test_included_files(file) -> None:
    file("nodes.inc", "*NODE\n1, 0, 0, 0\n2, 3, 0, 0\n")
    path = file("bar.inp", "*INCLUDE, INPUT=nodes.inc\n*ELEMENT, TYPE=T3D2, ELSET=B\n1, 1, 2\n")
    assert ff.read_mesh(path).points[1].tolist() == [3, 0, 0]
    file("grid.bdf", "GRID,1,,0.,0.,0.\nGRID,2,,4.,0.,0.\n")
    path = file("bar.bdf", "BEGIN BULK\nINCLUDE 'grid.bdf'\nCROD,1,1,1,2\nENDDATA\n")
    assert ff.read_mesh(path).points[1].tolist() == [4, 0, 0]


NODES = "*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n3, 1, 1, 0\n4, 0, 1, 0\n"
BAR = NODES + "*ELEMENT, TYPE=B31, ELSET=BAR\n1, 1, 2\n"
PLATE = NODES + "*ELEMENT, TYPE=S4, ELSET=PLATE\n1, 1, 2, 3, 4\n"


def lines(text, name="bad.inp", **options):
    return lambda write: ff.read_mesh(write(name, text), **options)


def surface(text, name="bad.inp", **options):
    return lambda write: ff.read_surface_mesh(write(name, text), **options)


BAD = [
    (lines(BAR, scale=0.0), "scale must be positive, got 0.0"),
    (lines(BAR, scale="mm"), "scale must be a number, got 'mm'"),
    (lines(BAR, merge=-1.0), "merge must not be negative"),
    (lines(BAR, merge=2.0), r"merge=2 makes corners of 1 lines one, the first at \(0, 0, 0\) m"),
    (lines(BAR, name="bad.step"), r'bad.step" must end in .msh, .inp, .bdf, '),
    (lines(BAR, lines="BAR"), "lines must be a list of names, got 'BAR'"),
    (lines(BAR, lines=["BAR", "BAR"]), 'lines has "BAR" twice'),
    (lines(BAR, lines=["ROD"]), 'there is no element set "ROD"; sets with lines are BAR$'),
    (lines(BAR, points=["TIP"]), 'there is no node set "TIP"; node sets there are none'),
    (
        lines(BAR + "*NSET, NSET=TIP\n3\n", points=["TIP"]),
        'node set "TIP" has no node of this mesh',
    ),
    (lines(BAR + "*NSET, NSET=TIP\n", points=["TIP"]), 'node set "TIP" is empty'),
    (lines(BAR + "*ELSET, ELSET=E\n", lines=["E"]), 'element set "E" is empty; sets with lines'),
    (
        lines(BAR + "*ELEMENT, TYPE=S3, ELSET=S\n2, 1, 2, 3\n", lines=["S"]),
        'element set "S" has no lines; sets with lines are BAR',
    ),
    (lines(PLATE + "*ELEMENT, TYPE=MASS\n9, 1\n"), "no lines; it has 1 quadrilaterals, 1 MASS"),
    (lines(NODES + "*ELEMENT, TYPE=B31\n1, 1, 7\n"), "element 1: node 7 is not in the file"),
    (lines(BAR + "*NSET, NSET=N\n1, 8\n"), 'node set "N": node 8 is not in the file'),
    (lines(BAR + "*NSET, NSET=N\nM\n"), r'line 9: \*NSET: there is no node set "M" up to here'),
    (lines(BAR + "*NODE\n1, 5, 0, 0\n"), r"line 9: node 1 occurs twice, at \(0.0, 0.0, 0.0\)"),
    (lines(BAR + "1, 1, 3\n"), "line 8: element 1 occurs twice"),
    (lines(NODES + "*ELEMENT, TYPE=B31\n1, 1, x\n"), r"line 7: \*ELEMENT: needs whole numbers"),
    (lines(NODES + "*ELEMENT, TYPE=S4\n1, 1, 2, 3\n"), "type S4 needs 4 nodes, got 3"),
    (lines(NODES + "*ELEMENT, TYPE=B31\n1, 1, 1\n"), "element 1 has a node twice: 1, 1"),
    (lines("*NODE\n1, 0, 1..2, 0\n"), r"line 2: \*NODE: needs numbers, got"),
    (lines("*NODE\n1, 0, nan, 0\n"), "line 2: .NODE: needs numbers, got '0, nan, 0'"),
    (lines("*NODE\n1, 0, 1e60, 0\n"), r"a node is at \(0, 1e\+60, 0\), beyond 1e\+50 m"),
    (lines("1, 2, 3\n"), "line 1: a keyword .* must come first, got '1, 2, 3'"),
    (lines(""), "no nodes"),
    (lines(BAR + "*NGEN\n1, 2\n"), r"line 8: \*NGEN: cannot be read; write nodes and"),
    (lines(BAR + "*INCLUDE, INPUT=no.inp\n"), r'line 8: \*INCLUDE: file "no.inp" does not exist'),
    (lines("*INCLUDE, INPUT=bad.inp\n"), "INCLUDE without end"),
    (lines("*INSTANCE, NAME=A, PART=P\n"), 'line 1: .*instance "A" is of a part that is not in'),
    (
        lines("*PART, NAME=P\n*END PART\n" + "*INSTANCE, NAME=A, PART=P\n*END INSTANCE\n" * 2),
        'line 5: .*instance "A" occurs twice',
    ),
    (lines(BAR + "*NSET, NSET=N, GENERATE\n3, 1\n"), "line 9: .*cannot generate from '3, 1'"),
    (surface(BAR), "no triangles or quadrilaterals; it has 1 lines"),
    (
        surface(PLATE + "*ELEMENT, TYPE=S3\n2, 1, 2, 3\n*ELSET, ELSET=ALL\n1, 2\n"),
        r'"PLATE" and "ALL" share 1 elements: choose those that are needed, bodies=\[...\], from',
    ),
    (
        surface(PLATE + "*NSET, NSET=E\n1, 2\n", lines=["F"]),
        'line "F": there is no such set of lines, edges or nodes; lines there are E$',
    ),
    (
        surface(PLATE + "*NODE\n5, 2, 0, 0\n*ELEMENT, TYPE=B31, ELSET=E\n2, 1, 5\n", lines=["E"]),
        'line "E": 1 of its 1 lines follow no edge of the triangles; lines there are none',
    ),
    (lines("GRID,1,,0.,a,0.\n", "bad.bdf"), "line 1: GRID: field 5 must be a number, got 'a'"),
    (lines("GRID,1,4,0.,0.,0.\n", "bad.bdf"), "line 1: GRID: coordinate system '4' is not in"),
    (
        lines("GRID,1,,0.\nGRID,2,,1.\nGRDSET,,2\nCROD,1,1,1,2\n", "bad.bdf"),
        "line 1: GRID: coordinate system '2' is not in the file",
    ),
    (lines("GRID,1\nGRID,2,,1.\nCBAR,1,1,1\n", "bad.bdf"), "line 3: CBAR: field 5 must be the"),
    (
        lines("GRID,1\nGRID,2,,1.\nCROD,1,P,1,2\n", "bad.bdf"),
        "line 3: CROD: property 'P' is no number",
    ),
    (
        lines("GRID,1,4\nCORD2R,4,4,1.\n", "bad.bdf"),
        "line 2: CORD2R: system 4 is defined by itself",
    ),
    (lines("GRID,1,4\nCORD2R,4,,1.\n", "bad.bdf"), "three points of system 4 are on one line"),
    (lines("GRID,1\nGRID,1,,1.\n", "bad.bdf"), "line 2: GRID: point 1 occurs twice, also in"),
    (lines("nothing", "bad.vtk"), 'bad.vtk" cannot be read: '),
    (lines("<xml", "bad.vtu"), 'bad.vtu" cannot be read: '),
    (lines(mesh_texts.VTK_SHEET, "bad.vtk"), "no lines; it has 2 triangles, 1 quadrilaterals"),
]


@pytest.mark.parametrize(("read", "message"), BAD, ids=[message for _, message in BAD])
def test_bad_files_are_refused_in_one_line(read, message, file) -> None:
    with pytest.raises((ValueError, TypeError), match=message) as caught:
        read(file)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith("mesh file ")
