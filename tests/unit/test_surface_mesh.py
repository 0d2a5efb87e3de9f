# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surface meshes: generators, edges and neighbours, orientation, the way through gmsh."""

import os
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import gmsh
import numpy as np
import pytest

import flexfem as ff
from flexfem.mesh.geometry.topology import arc_length
from flexfem.resources import shipped_folder
from tests.unit.executed import executed_lines

pytestmark = pytest.mark.serial


def cylinder(columns=12, rows=4, radius=2.0, height=3.0):
    """A whole cylinder, normals outwards."""
    return ff.SurfaceMesh.grid(
        "tube",
        2.0 * np.pi * np.arange(columns) / columns,
        np.linspace(0.0, height, rows + 1),
        lambda p: np.column_stack(
            [radius * np.cos(p[:, 0]), radius * np.sin(p[:, 0]), p[:, 1]]
        ),
        closed=True,
    )  # fmt: skip


def hemisphere(cells, radius=10.0, hole=0.1 * np.pi):
    """The quarter of a hemisphere with a hole at the pole, as in the benchmark of shells."""
    return ff.SurfaceMesh.grid(
        "shell",
        np.linspace(0.0, 0.5 * np.pi, cells + 1),
        np.linspace(0.0, 0.5 * np.pi - hole, cells + 1),
        lambda p: (
            radius
            * np.column_stack(
                [np.cos(p[:, 1]) * np.cos(p[:, 0]), np.cos(p[:, 1]) * np.sin(p[:, 0]),
                 np.sin(p[:, 1])]
            )
        ),
    )  # fmt: skip


def shuffled(mesh, rng, turn=True):
    """The same body with nodes and triangles renumbered, triangles started anywhere and flipped."""
    node, row = rng.permutation(len(mesh.points)), rng.permutation(len(mesh.triangles))
    points = np.empty_like(mesh.points)
    points[node] = mesh.points
    triangles = node[mesh.triangles[row]]
    shift = rng.integers(0, 3, len(triangles))[:, np.newaxis]
    triangles = np.take_along_axis(triangles, (np.arange(3) + shift) % 3, axis=1)
    if turn:
        flip = rng.random(len(triangles)) < 0.5
        flip[0] = False
        triangles[flip] = triangles[flip][:, [1, 0, 2]]
    return ff.SurfaceMesh(points, triangles, {"body": np.arange(len(triangles))})


# --- generators ----------------------------------------------------------------------------------


def test_rectangle():
    mesh = ff.SurfaceMesh.rectangle("plate", (2.0, 1.0), (2, 1))
    np.testing.assert_array_equal(mesh.triangles, [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])
    np.testing.assert_array_equal(mesh.points[4], [1.0, 1.0, 0.0])
    np.testing.assert_array_equal(mesh.normals, np.tile([0.0, 0.0, 1.0], (4, 1)))
    assert {name: mesh.line_nodes(name).tolist() for name in mesh.lines} == {
        "plate_bottom": [0, 1, 2], "plate_top": [3, 4, 5], "plate_left": [0, 3],
        "plate_right": [2, 5],
    }  # fmt: skip
    assert dict(mesh.nodes) == {
        "plate_bottom_left": 0, "plate_bottom_right": 2, "plate_top_left": 3, "plate_top_right": 5,
    }  # fmt: skip
    left = ff.SurfaceMesh.rectangle("plate", (2.0, 1.0), (2, 1), diagonal="left")
    np.testing.assert_array_equal(left.triangles[:2], [[0, 1, 3], [1, 4, 3]])
    np.testing.assert_allclose(left.areas, 0.5, rtol=1e-15)


def test_graded_grid():
    mesh = ff.SurfaceMesh.grid("plate", [0.0, 0.1, 1.0], [0.0, 2.0])
    np.testing.assert_allclose(mesh.areas, [0.1, 0.1, 0.9, 0.9], rtol=1e-14)


def test_cylinder():
    mesh = cylinder()
    # The area of a prism of twelve sides is exact; one column missing or doubled is 8 per cent
    assert mesh.areas.sum() == pytest.approx(12 * 2 * 2.0 * np.sin(np.pi / 12) * 3.0, rel=1e-13)
    centres = mesh.points[mesh.triangles].mean(axis=1) * [1.0, 1.0, 0.0]
    assert (np.einsum("mi,mi->m", centres, mesh.normals) > 0.0).all()
    bottom = mesh.line_nodes("tube_bottom")
    assert (bottom[0], bottom[-1], len(bottom)) == (0, 0, 13)
    assert set(mesh.lines) == {"tube_bottom", "tube_top"}
    assert not mesh.nodes


def test_slit_annulus():
    mesh = ff.SurfaceMesh.grid(
        "ring",
        np.linspace(0.0, 2.0 * np.pi, 25),
        np.linspace(6.0, 10.0, 5),
        lambda p: np.column_stack(
            [p[:, 1] * np.cos(p[:, 0]), p[:, 1] * np.sin(p[:, 0]), 0.0 * p[:, 0]]
        ),
    )  # fmt: skip
    # Trapezoids between rays 15 degrees apart are met exactly
    assert mesh.areas.sum() == pytest.approx(12 * np.sin(np.pi / 12) * 64.0, rel=1e-13)
    # The lips of the slit coincide, their nodes do not
    left, right = mesh.line_nodes("ring_left"), mesh.line_nodes("ring_right")
    np.testing.assert_allclose(mesh.points[left], mesh.points[right], atol=1e-13)
    assert not set(left) & set(right)
    assert len(mesh.boundary_lines("ring")) == 1


def test_hemisphere_converges_to_its_area():
    exact = 0.5 * np.pi * 100.0 * np.cos(np.deg2rad(18.0))
    errors = [exact - hemisphere(cells).areas.sum() for cells in (8, 16, 32)]
    # Flat triangles are of second order; a surface met otherwise leaves an error that stays
    np.testing.assert_allclose(np.log2(errors[:-1]) - np.log2(errors[1:]), 2.0, atol=0.05)


def test_join_keeps_nodes_apart():
    one = ff.SurfaceMesh.rectangle("one", (1.0, 1.0), (2, 2))
    two = ff.SurfaceMesh.rectangle("two", (1.0, 1.0), (3, 1))
    mesh = ff.SurfaceMesh.join([one, two])
    np.testing.assert_array_equal(mesh.points[mesh.triangles[8:]], two.points[two.triangles])
    assert mesh.bodies["two"].tolist() == list(range(8, 14))
    assert mesh.line_nodes("two_top").tolist() == [13, 14, 15, 16]
    assert mesh.nodes["two_bottom_left"] == 9
    assert (mesh.topology.neighbours[8:].max(), mesh.topology.neighbours[8:].min()) == (13, -1)
    assert mesh.closest_node([0.1, 0.1, 0.0]) == 0
    assert mesh.closest_node([0.1, 0.1, 0.0], "two") == 9
    assert mesh.body_nodes("two").tolist() == list(range(9, 17))


# --- edges and neighbours ------------------------------------------------------------------------


def test_two_triangles_by_hand():
    mesh = ff.SurfaceMesh(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [2, 3, 0]], {"a": [0, 1]}
    )
    topology = mesh.topology
    assert topology.neighbours.tolist() == [[-1, 1, -1], [-1, 0, -1]]
    assert topology.opposite.tolist() == [[-1, 3, -1], [-1, 1, -1]]
    diagonal = topology.triangle_edges[0, 1]
    assert topology.triangle_edges[1, 1] == diagonal
    assert topology.edges[diagonal].tolist() == [2, 0]
    assert topology.edge_triangles[diagonal].tolist() == [0, 1]
    assert len(topology.boundary_edges) == 4
    [line] = mesh.boundary_lines("a")
    # The body lies on the left: counterclockwise
    first = line.tolist().index(0)
    assert np.roll(line[:-1], -first).tolist() == [0, 1, 2, 3]
    assert line[-1] == line[0]
    offsets, triangles = mesh.node_triangles
    assert offsets.tolist() == [0, 2, 3, 5, 6]
    assert triangles.tolist() == [0, 1, 0, 0, 1, 1]


def test_topology_against_a_search(rng):
    """Everything found edge by edge with a dictionary, on a mesh in no order."""
    mesh = shuffled(cylinder(), rng)
    owners = defaultdict(list)
    for t, nodes in enumerate(mesh.triangles.tolist()):
        for k in range(3):
            owners[frozenset((nodes[(k + 1) % 3], nodes[(k + 2) % 3]))].append((t, nodes[k]))
    topology = mesh.topology
    assert len(topology.edges) == len(owners)
    for t, nodes in enumerate(mesh.triangles.tolist()):
        for k in range(3):
            pair = frozenset((nodes[(k + 1) % 3], nodes[(k + 2) % 3]))
            others = [entry for entry in owners[pair] if entry[0] != t]
            expected = others[0] if others else (-1, -1)
            assert (topology.neighbours[t, k], topology.opposite[t, k]) == expected
            assert frozenset(topology.edges[topology.triangle_edges[t, k]].tolist()) == pair
    offsets, around = mesh.node_triangles
    for node in range(len(mesh.points)):
        found = np.flatnonzero((mesh.triangles == node).any(axis=1))
        assert around[offsets[node] : offsets[node + 1]].tolist() == found.tolist()


@pytest.mark.parametrize(
    ("mesh", "euler", "lines"),
    [(hemisphere(5), 1, 1), (cylinder(), 0, 2)],
    ids=["disc", "tube"],
)
def test_boundary_and_euler_number(mesh, euler, lines, rng):
    mixed = shuffled(mesh, rng)
    assert len(mixed.points) - len(mixed.topology.edges) + len(mixed.triangles) == euler
    rows = mixed.boundary_lines("body")
    assert len(rows) == lines
    assert sum(len(row) - 1 for row in rows) == len(mixed.topology.boundary_edges)
    start, end = mixed.triangles, np.roll(mixed.triangles, -1, axis=1)
    sides = set(zip(start.ravel().tolist(), end.ravel().tolist(), strict=True))
    for row in rows:
        assert row[0] == row[-1]
        # Along a triangle's own direction, so that the body lies on the left
        assert set(zip(row[:-1].tolist(), row[1:].tolist(), strict=True)) <= sides


def test_bodies_that_share_nodes_are_no_neighbours():
    """Three triangles at one edge, which is a boundary of each of the three bodies."""
    points = [[0, 0, 0], [0, 1, 0], [1, 0, 0], [-1, 0, 1], [-1, 0, -1]]
    mesh = ff.SurfaceMesh(points, [[0, 2, 1], [0, 3, 1], [0, 1, 4]], {"a": [0], "b": [1], "c": [2]})
    assert (mesh.topology.neighbours == -1).all()
    assert len(mesh.topology.edges) == 9
    assert mesh.triangles.tolist() == [[0, 2, 1], [0, 3, 1], [0, 1, 4]]


# --- orientation ---------------------------------------------------------------------------------


def test_triangles_turn_to_the_side_of_the_first(rng):
    plain = hemisphere(6)
    outward = np.einsum("mi,mi->m", plain.points[plain.triangles].mean(axis=1), plain.normals)
    assert (outward > 0.0).all()
    mixed = shuffled(plain, rng)
    outward = np.einsum("mi,mi->m", mixed.points[mixed.triangles].mean(axis=1), mixed.normals)
    assert (outward > 0.0).all()
    assert mixed.areas.sum() == pytest.approx(plain.areas.sum(), rel=1e-13)


def test_every_part_follows_its_own_first_triangle():
    one = ff.SurfaceMesh.rectangle("one", (1.0, 1.0), (2, 2))
    down = one.triangles[:, [0, 2, 1]].copy()
    down[5:] = one.triangles[5:]
    mesh = ff.SurfaceMesh(
        np.concatenate([one.points, one.points + 5.0]),
        np.concatenate([one.triangles, down + 9]),
        {"both": np.arange(16)},
    )
    np.testing.assert_array_equal(mesh.normals[:, 2], [1.0] * 8 + [-1.0] * 8)
    assert mesh.parts.tolist() == [0] * 8 + [1] * 8
    # (a, b, c) turns into (a, c, b), the others stay
    np.testing.assert_array_equal(mesh.triangles[8:], one.triangles[:, [0, 2, 1]] + 9)


# --- gmsh ----------------------------------------------------------------------------------------


def two_squares(model):
    """Squares that share the line x = 1, a wire and a point outside; coarse."""
    geo = model.geo
    corner = [geo.addPoint(x, y, 0.0, 0.5) for y in (0.0, 1.0) for x in (0.0, 1.0, 2.0)]
    far = geo.addPoint(0.0, 0.0, 3.0, 0.5)
    a, b, c, d = corner[0], corner[1], corner[4], corner[3]
    first = [geo.addLine(p, q) for p, q in ((a, b), (b, c), (c, d), (d, a))]
    e, f = corner[2], corner[5]
    second = [geo.addLine(p, q) for p, q in ((b, e), (e, f), (f, c))]
    wire = geo.addLine(a, far)
    surfaces = [
        geo.addPlaneSurface([geo.addCurveLoop(loop)])
        for loop in (first, [*second, -first[1]])
    ]  # fmt: skip
    geo.synchronize()
    model.addPhysicalGroup(2, surfaces[:1], name="left")
    model.addPhysicalGroup(2, surfaces[1:], name="right")
    model.addPhysicalGroup(1, [first[1]], name="hinge")
    model.addPhysicalGroup(1, [first[3], first[0]], name="clamp")
    model.addPhysicalGroup(1, [wire], name="wire")
    model.addPhysicalGroup(0, [e], name="corner")
    model.addPhysicalGroup(0, [far], name="far")
    model.mesh.generate(2)
    return first, wire


def test_gmsh_groups(gmsh_model, tmp_path):
    two_squares(gmsh_model)
    mesh = ff.SurfaceMesh.from_gmsh_model()
    assert [mesh.areas[rows].sum() for rows in mesh.bodies.values()] == pytest.approx([1.0, 1.0])
    assert set(mesh.lines) == {"hinge", "clamp"}
    hinge = mesh.points[mesh.line_nodes("hinge")]
    np.testing.assert_allclose(hinge[:, 0], 1.0, atol=1e-14)
    assert (np.diff(hinge[:, 1]) > 0.0).all()
    assert arc_length(mesh.points[mesh.line_nodes("clamp")])[-1] == pytest.approx(2.0)
    assert list(mesh.nodes) == ["corner"]
    np.testing.assert_array_equal(mesh.points[mesh.nodes["corner"]], [2.0, 0.0, 0.0])
    # the shared line is a boundary of both
    assert all(len(mesh.boundary_lines(name)) == 1 for name in mesh.bodies)
    gmsh.write(str(tmp_path / "squares.msh"))
    read = ff.read_surface_mesh(tmp_path / "squares.msh")
    assert gmsh.model.getCurrent() == "test"
    np.testing.assert_allclose(read.points, mesh.points, atol=1e-14)
    np.testing.assert_array_equal(read.triangles, mesh.triangles)
    np.testing.assert_array_equal(read.body, mesh.body)
    assert dict(read.nodes) == dict(mesh.nodes)
    np.testing.assert_array_equal(read.line_nodes("clamp"), mesh.line_nodes("clamp"))


@pytest.mark.parametrize("version", [2.2, 4.1])
def test_round_trip_through_a_file(version, gmsh_model, tmp_path):
    """Triangles given to gmsh come back the same from either format of its files."""
    mesh = hemisphere(4)
    surface = gmsh_model.addDiscreteEntity(2)
    gmsh_model.mesh.addNodes(2, surface, np.arange(1, 26), mesh.points.ravel())
    gmsh_model.mesh.addElementsByType(surface, 2, [], mesh.triangles.ravel() + 1)
    gmsh_model.addPhysicalGroup(2, [surface], name="shell")
    gmsh.option.setNumber("Mesh.MshFileVersion", version)
    gmsh.write(str(tmp_path / "shell.msh"))
    read = ff.read_surface_mesh(tmp_path / "shell.msh")
    np.testing.assert_allclose(read.points, mesh.points, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(read.triangles, mesh.triangles)
    assert read.bodies["shell"].tolist() == list(range(32))


def test_curves_half_on_the_surface_are_refused(gmsh_model):
    first, wire = two_squares(gmsh_model)
    gmsh_model.addPhysicalGroup(1, [first[0], wire], name="mixed")
    with pytest.raises(ValueError, match='"mixed" follows the triangles with 2 of its 8 lines'):
        ff.SurfaceMesh.from_gmsh_model()


def test_overlapping_surfaces_are_refused(gmsh_model):
    two_squares(gmsh_model)
    surface = gmsh_model.getEntities(2)[0][1]
    gmsh_model.addPhysicalGroup(2, [surface], name="again")
    with pytest.raises(ValueError, match='triangle 0 belongs to body "left" and to body "again"'):
        ff.SurfaceMesh.from_gmsh_model()


def test_large_surfaces_are_fast(rng):
    """No Python loop over triangles."""
    plain = ff.SurfaceMesh.rectangle("plate", (1.0, 1.0), (224, 224))

    def made():
        mesh = shuffled(plain, rng)
        return mesh, mesh.boundary_lines("body"), mesh.parts

    (mesh, rims, parts), lines = executed_lines(made)
    assert len(rims[0]) == 4 * 224 + 1
    assert np.ptp(mesh.normals[:, 2]) < 1e-12
    assert parts.max() == 0
    # the mesh has 100352 triangles
    assert lines < 50000


@pytest.mark.parametrize("name", ["cylindrical_pendulum", "plate_with_hole"])
def test_meshes_of_the_library(name, tmp_path):
    """Built, and written and read, they are the same; boundary lines are those that are named."""
    built = ff.build_surface_mesh(name)
    output = tmp_path / "mesh.msh"
    script = shipped_folder("meshes") / f"{name}.py"
    environment = {**os.environ, "PYTHONPATH": str(Path(ff.__file__).parents[1])}
    command = [sys.executable, script, "--output", output]
    subprocess.run(command, check=True, env=environment, cwd=tmp_path, timeout=60)
    read = ff.read_surface_mesh(output)
    np.testing.assert_array_equal(read.triangles, built.triangles)
    named = np.concatenate([built.line_nodes(line) for line in built.lines])
    rim = np.concatenate([nodes for body in built.bodies for nodes in built.boundary_lines(body)])
    assert set(named) == set(rim)


def test_half_cylinders_of_the_library():
    mesh = ff.build_surface_mesh("cylindrical_pendulum", radius=0.5, length=2.0, size=0.1)
    # chords of size h miss (h / r)^2 / 24, and no triangle may be missing
    assert mesh.areas.sum() == pytest.approx(2.0 * np.pi * 0.5 * 2.0, rel=3e-3)
    np.testing.assert_allclose(np.hypot(mesh.points[:, 0], mesh.points[:, 2]), 0.5, rtol=1e-9)
    assert mesh.points[:, 2].max() < 1e-9
    corner = mesh.points[mesh.nodes["second_top_left"]]
    np.testing.assert_allclose(corner, [0.5, 4.0, 0.0], atol=1e-9)


def test_meshes_of_the_library_that_will_not_do():
    with pytest.raises(ValueError, match="no triangles"):
        ff.build_surface_mesh("chain")
    with pytest.raises(ValueError, match="no room for a hole of radius 3"):
        ff.build_surface_mesh("plate_with_hole", radius=3.0)
