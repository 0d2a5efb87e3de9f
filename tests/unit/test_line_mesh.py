# SPDX-License-Identifier: LGPL-3.0-or-later
"""Line meshes: order, tangents, section frames, and the way through gmsh."""

import os
import subprocess
import sys
from pathlib import Path

import gmsh
import numpy as np
import pytest

import flexfem
from flexfem.mesh.geometry.topology import trace_lines
from flexfem.mesh.library import build_mesh
from flexfem.mesh.line_mesh import (
    LineMesh,
    frames_of_lines,
    group_order,
    node_tangents,
    read_mesh,
    section_frames,
)
from flexfem.resources import shipped_folder
from tests.unit.executed import executed_lines

pytestmark = pytest.mark.serial

EX, EY, EZ = np.eye(3)


def path_cells(n):
    return np.column_stack([np.arange(n), np.arange(1, n + 1)])


def arc(angles, radius=2.0):
    angles = np.asarray(angles)
    points = radius * np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    tangents = np.column_stack([-np.sin(angles), np.cos(angles), 0 * angles])
    return points, tangents


@pytest.fixture
def no_gmsh():
    assert not gmsh.isInitialized()
    yield
    if gmsh.isInitialized():
        gmsh.finalize()


def test_straight_lines():
    mesh = LineMesh.straight({"a": (EX, 3.0 * EX), "b": (3.0 * EX, EY)}, 2)
    np.testing.assert_allclose(mesh.points[[0, 1, 2, 3, 5]], [EX, 2 * EX, 3 * EX, 3 * EX, EY])
    # lines that meet have nodes of their own
    assert [mesh.order(name).tolist() for name in ("a", "b")] == [[0, 1, 2], [3, 4, 5]]


# --- order ---------------------------------------------------------------------------------------


def test_order_of_a_line():
    np.testing.assert_array_equal(group_order(path_cells(4)), [0, 1, 2, 3, 4])


def test_order_follows_the_first_cell():
    cells = np.array([[3, 2], [1, 2], [4, 3], [1, 0]])
    np.testing.assert_array_equal(group_order(cells), [4, 3, 2, 1, 0])


def test_order_of_a_closed_line():
    cells = np.array([[5, 7], [9, 7], [9, 5]])
    np.testing.assert_array_equal(group_order(cells), [5, 7, 9, 5])


@pytest.mark.parametrize(
    "cells",
    [
        [[0, 1], [1, 2], [1, 3]],  # branch
        [[0, 1], [2, 3]],  # two pieces
        [[0, 1], [1, 2], [2, 0], [2, 3]],  # loop with a tail
        [[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3]],  # two loops
    ],
)
def test_no_order(cells):
    assert group_order(np.array(cells)) is None


def test_shuffled_and_turned_cells(rng):
    n = 200
    names = rng.permutation(n + 1)
    cells = names[path_cells(n)]
    turned = rng.random(n) < 0.5
    cells[turned] = cells[turned, ::-1]
    cells = cells[rng.permutation(n)]
    order = group_order(cells)
    assert order.tolist() in (names.tolist(), names[::-1].tolist())
    position = np.argsort(order)
    assert position[cells[0, 0]] < position[cells[0, 1]]
    line = trace_lines(cells)[0]
    ahead = np.where(line.reversed[:, None], cells[line.cells, ::-1], cells[line.cells])
    np.testing.assert_array_equal(ahead, np.column_stack([order[:-1], order[1:]]))


def test_lines_end_at_branches():
    cells = np.array([[0, 1], [1, 2], [2, 3], [2, 4], [4, 5]])
    assert [line.nodes.tolist() for line in trace_lines(cells)] == [[0, 1, 2], [2, 3], [2, 4, 5]]


def test_mesh_stores_cells_head_to_tail():
    points = np.arange(4.0)[:, None] * EX
    mesh = LineMesh(points, [[0, 1], [2, 1], [2, 3]], {"a": [0, 1, 2]})
    np.testing.assert_array_equal(mesh.cells, path_cells(3))
    np.testing.assert_array_equal(mesh.order("a"), [0, 1, 2, 3])


# --- tangents ------------------------------------------------------------------------------------


def test_tangents_of_an_arc_are_exact(rng):
    """Unequal cells: the plain mean of directions would be wrong by a tenth."""
    angles = np.cumsum(rng.uniform(0.1, 0.6, 12))
    points, exact = arc(angles)
    tangents = node_tangents(points, path_cells(11))
    np.testing.assert_allclose(tangents[:, 0], exact[:-1], atol=1e-13)
    np.testing.assert_allclose(tangents[:, 1], exact[1:], atol=1e-13)


def test_tangents_of_a_circle_of_eight_cells():
    points, exact = arc(np.arange(8) * np.pi / 4)
    cells = np.column_stack([np.arange(8), (np.arange(8) + 1) % 8])
    np.testing.assert_allclose(node_tangents(points, cells)[:, 0], exact, atol=1e-14)


def test_tangents_of_turned_cells():
    points, exact = arc([0.0, 0.3, 0.7])
    tangents = node_tangents(points, np.array([[0, 1], [2, 1]]))
    np.testing.assert_allclose(tangents[0], exact[:2], atol=1e-14)
    np.testing.assert_allclose(tangents[1], -exact[[2, 1]], atol=1e-14)


def test_corners_are_kept():
    points = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [2, 2, 0]], dtype=float)
    tangents = node_tangents(points, path_cells(4))
    np.testing.assert_array_equal(tangents, [[EX, EX], [EX, EX], [EY, EY], [EY, EY]])
    smooth = node_tangents(points, path_cells(4), corner_angle=np.deg2rad(100))
    np.testing.assert_allclose(smooth[1, 1], (EX + EY) / np.sqrt(2), atol=1e-15)
    np.testing.assert_allclose(smooth[1, 1], smooth[2, 0], atol=0)


def test_arc_ending_in_a_corner_keeps_its_own_tangent():
    points, exact = arc([0.0, 0.2, 0.5])
    points = np.vstack([points, points[-1] - exact[-1] + 3 * EZ])
    tangents = node_tangents(points, path_cells(3))
    np.testing.assert_allclose(tangents[1, 1], exact[2], atol=1e-14)


def test_branches_keep_their_own_direction():
    points = np.array([[0, 0, 0], [1, 0, 0], [2, 0.1, 0], [1, 1, 0]], dtype=float)
    tangents = node_tangents(points, np.array([[0, 1], [1, 2], [1, 3]]))
    np.testing.assert_array_equal(tangents[:, 0], tangents[:, 1])
    np.testing.assert_array_equal(tangents[2], [EY, EY])


# --- section frames ------------------------------------------------------------------------------


def assert_rotations(frames):
    product = np.einsum("...ji,...jk->...ik", frames, frames)
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(3), product.shape), atol=1e-14)
    assert (np.linalg.det(frames) > 0).all()


def test_straight_line_along_x_has_the_inertial_axes():
    frames = section_frames(np.arange(4.0)[:, None] * EX, path_cells(3))
    np.testing.assert_array_equal(frames, np.broadcast_to(np.eye(3), (3, 2, 3, 3)))


def test_frames_of_many_lines_are_those_of_each(rng):
    """Arcs, straight lines and a branched one, without orientation, by vectors or by functions."""
    straight = np.array([[0, 1], [1, 2], [2, 3]])
    shapes = [straight, straight[[2, 0, 1]], straight[:1], np.array([[0, 1], [1, 2], [1, 3]])]
    ways = [None, (0.0, 0.3, 1.0), lambda points: points + 1.0, (1.0, 2.0, -0.5)]
    given = [(shape, way) for shape in shapes for way in ways]
    lines = [shape + 4 * k for k, (shape, _) in enumerate(given)]
    points = rng.normal(size=(4 * len(given), 3))
    ways = [way for _, way in given]
    found = frames_of_lines(points, lines, ways)
    for line, way, frames in zip(lines, ways, found, strict=True):
        # round-off of sums in another order; frames of a neighbour differ by order 1
        np.testing.assert_allclose(frames, section_frames(points, line, way), atol=1e-14)
    along = points[lines[0][0, 1]] - points[lines[0][0, 0]]
    with pytest.raises(ValueError, match="is parallel to the tangent at"):
        frames_of_lines(points, [lines[2][:1], lines[0][:1]], [(0.0, 0.3, 1.0), along])


@pytest.mark.parametrize("direction", [EX, EY, EZ, -EZ, np.array([1.0, 2.0, 3.0])])
def test_frames_start_from_any_normal(direction):
    frames = section_frames(np.arange(4.0)[:, None] * direction, path_cells(3))
    assert_rotations(frames)
    np.testing.assert_allclose(frames[..., 0], np.broadcast_to(frames[0, 0, :, 0], (3, 2, 3)))
    np.testing.assert_allclose(frames, np.broadcast_to(frames[0, 0], frames.shape), atol=1e-15)


def test_plane_curves_keep_their_normal():
    """A polygon with arcs and corners in a slanted plane, started horizontally."""
    points, _ = arc(np.linspace(0, 2.0, 9))
    points = np.vstack([points, points[-1] + [2.0, 0, 0], points[-1] + [2.0, -1.0, 0]])
    tilt = np.array([[1, 0, 0], [0, np.cos(0.4), -np.sin(0.4)], [0, np.sin(0.4), np.cos(0.4)]])
    frames = section_frames(points @ tilt.T, path_cells(10))
    assert_rotations(frames)
    normal = tilt @ EZ
    component = np.einsum("csij,i->csj", frames, normal)
    # e2 and e3 keep their angle with the plane
    np.testing.assert_allclose(component, np.broadcast_to(component[0, 0], (10, 2, 3)), atol=1e-14)


def test_helix_turns_by_its_torsion():
    """Against Frenet's normal, the frame turns back by the torsion integrated along the curve."""
    radius, pitch = 1.0, 0.4
    errors = []
    for n in (100, 200):
        angle = np.linspace(0, 4.0, n + 1)
        points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), pitch * angle])
        frames = section_frames(points, path_cells(n))
        frenet = np.column_stack([-np.cos(angle), -np.sin(angle), 0 * angle])

        def turn(frame, normal):
            return np.arctan2(normal @ frame[:, 2], normal @ frame[:, 1])

        turned = turn(frames[-1, 1], frenet[-1]) - turn(frames[0, 0], frenet[0])
        exact = pitch / np.hypot(radius, pitch) * 4.0  # torsion times arc length
        errors.append(abs((turned - exact + np.pi) % (2 * np.pi) - np.pi))
        np.testing.assert_allclose(frames[:-1, 1], frames[1:, 0], atol=1e-13)
        assert_rotations(frames)
    assert errors[1] < 1e-4
    assert np.log2(errors[0] / errors[1]) > 1.9


def test_frames_do_not_depend_on_the_order_of_cells(rng):
    angle = np.linspace(0, 4.0, 31)
    points = np.column_stack([np.cos(angle), np.sin(angle), 0.4 * angle])
    cells = path_cells(30)
    # The first cell stays first, for it gives the direction
    order = np.concatenate([[0], 1 + rng.permutation(29)])
    plain = section_frames(points, cells)
    np.testing.assert_allclose(section_frames(points, cells[order]), plain[order], atol=1e-13)


def test_turned_cells_share_e2():
    angle = np.linspace(0, 1.0, 4)
    points = np.column_stack([np.cos(angle), np.sin(angle), 0.4 * angle])
    plain = section_frames(points, path_cells(3))
    turned = section_frames(points, np.array([[0, 1], [2, 1], [2, 3]]))
    assert_rotations(turned)
    np.testing.assert_allclose(turned[1, ::-1, :, 1], plain[1, :, :, 1], atol=1e-13)
    np.testing.assert_allclose(turned[1, ::-1, :, 0], -plain[1, :, :, 0], atol=1e-13)
    np.testing.assert_allclose(turned[2], plain[2], atol=1e-13)


@pytest.mark.parametrize(
    "cells", [[[0, 1], [1, 2], [2, 3], [1, 4]], [[3, 2], [1, 2], [1, 4], [1, 0]]]
)
def test_branches_continue_the_frame(cells):
    points = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0.3, 0], [1, 1.0, 0]])
    frames = section_frames(points, np.array(cells))
    assert_rotations(frames)
    # All in one horizontal plane, so that e3 stays vertical along branches too
    np.testing.assert_allclose(np.abs(frames[..., 2, 2]), 1.0, atol=1e-14)


def test_orientation_by_vector_and_function():
    points, exact = arc(np.linspace(0, 1.5, 7))
    by_vector = section_frames(points, path_cells(6), orientation=(0.0, 0.0, 5.0))
    np.testing.assert_allclose(by_vector[..., 1], np.broadcast_to(EZ, (6, 2, 3)), atol=1e-15)
    by_function = section_frames(points, path_cells(6), orientation=lambda x: -x)
    inwards = -points / 2.0
    np.testing.assert_allclose(by_function[:, 0, :, 1], inwards[:-1], atol=1e-14)
    np.testing.assert_allclose(by_function[:, 1, :, 0], exact[1:], atol=1e-14)


def test_fold_by_half_a_turn():
    points = np.array([[0, 0, 0], [1, 0, 0], [0.5, 0, 0]])
    frames = section_frames(points, path_cells(2))
    assert_rotations(frames)
    np.testing.assert_allclose(frames[1, 0, :, 0], -EX, atol=0)


def test_large_lines_are_fast():
    """No Python loop over cells."""
    n = 200_000
    angle = np.linspace(0, 100.0, n + 1)
    points = np.column_stack([np.cos(angle), np.sin(angle), 0.1 * angle])

    def made():
        mesh = LineMesh(points, path_cells(n), {"a": np.arange(n)})
        return mesh.order("a"), section_frames(mesh.points, mesh.cells)

    (order, frames), lines = executed_lines(made)
    assert order[-1] == n
    assert lines < n // 4
    assert_rotations(frames[-10:])


# --- gmsh ----------------------------------------------------------------------------------------


def test_slider_crank(no_gmsh):
    mesh = build_mesh("slider_crank", elements=6, length_1=0.2)
    assert not gmsh.isInitialized()
    rod_1, rod_2 = mesh.points[mesh.order("rod_1")], mesh.points[mesh.order("rod_2")]
    np.testing.assert_allclose(rod_1, np.linspace(0, 0.2, 7)[:, None] * EX, atol=1e-12)
    np.testing.assert_allclose(rod_2, np.linspace(0.2, 0.8, 7)[:, None] * EX, atol=1e-12)
    assert mesh.order("rod_2")[[0, 3, 6]].tolist() == [
        mesh.point_groups[name] for name in ("rod_2_root", "rod_2_middle", "slider_pin")
    ]
    assert mesh.point_groups["rod_1_tip"] != mesh.point_groups["rod_2_root"]
    odd = build_mesh("slider_crank", elements=5)
    assert "rod_2_middle" not in odd.point_groups
    assert len(odd.cells) == 10


def test_flying_spaghetti():
    mesh = build_mesh("flying_spaghetti", elements=10)
    points = mesh.points[mesh.order("beam")]
    np.testing.assert_allclose(points[[0, -1]], [[6, 0, 0], [0, 8, 0]], atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(np.diff(points, axis=0), axis=1), 1.0, rtol=1e-9)
    assert dict(mesh.point_groups) == {
        "lower": mesh.order("beam")[0],
        "upper": mesh.order("beam")[-1],
    }


def test_long_chain_is_fast():
    """No Python loop over cells, only over links."""
    mesh, lines = executed_lines(lambda: build_mesh("chain", links=256, elements=32))
    assert lines < 20 * 8192
    assert (len(mesh.points), len(mesh.cells)) == (256 * 33, 256 * 32)
    last = mesh.order("link_256")
    assert last[0] == mesh.point_groups["link_256_start"]
    assert mesh.points[last[-1]] == pytest.approx([128.0, 0.0, 0.0])


def run_mesh_file(name, *arguments, cwd):
    """Run a mesh file as a script, with the package under test."""
    return subprocess.run(
        [sys.executable, shipped_folder("meshes") / f"{name}.py", *arguments],
        capture_output=True,
        text=True,
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(Path(flexfem.__file__).parents[1])},
        timeout=60,
        check=False,
    )


@pytest.mark.parametrize(
    "name", ["arc", "chain", "flying_spaghetti", "frame", "shaft", "slider_crank", "sliding_beam"]
)
def test_meshes_run_as_scripts(name, tmp_path, no_gmsh):
    output = tmp_path / "mesh.msh"
    done = run_mesh_file(name, "--output", output, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    read, built = read_mesh(output), build_mesh(name)
    assert not gmsh.isInitialized()
    np.testing.assert_allclose(read.points, built.points, atol=1e-14)
    np.testing.assert_array_equal(read.cells, built.cells)
    assert dict(read.point_groups) == dict(built.point_groups)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--links", "0"], "links must be positive, got 0"),
        (["--output", "chain.stl"], "must be a .msh file"),
        (["--lengths", "1"], "unrecognized arguments"),
    ],
)
def test_scripts_refuse_bad_options(arguments, message, tmp_path):
    done = run_mesh_file("chain", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr.splitlines()[-1]
    assert not list(tmp_path.iterdir())


def test_an_open_gmsh_session_stays_as_it_is(tmp_path, no_gmsh):
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("mine")
    line = gmsh.model.geo.addLine(
        gmsh.model.geo.addPoint(0, 0, 0, 1.0), gmsh.model.geo.addPoint(2, 0, 0, 1.0)
    )
    gmsh.model.geo.synchronize()
    gmsh.model.addPhysicalGroup(1, [line], name="bar")
    gmsh.model.mesh.generate(1)
    gmsh.write(str(tmp_path / "bar.msh"))
    models = gmsh.model.list()
    for _ in range(2):
        assert list(read_mesh(tmp_path / "bar.msh").line_groups) == ["bar"]
        build_mesh("chain")
    assert gmsh.model.list() == models
    assert gmsh.model.getCurrent() == "mine"
    assert len(LineMesh.from_gmsh_model().cells) == 2
    gmsh.model.mesh.setOrder(2)
    with pytest.raises(ValueError, match='"bar" has elements "Line 3", only lines of first order'):
        LineMesh.from_gmsh_model()


def test_unnamed_and_distant_groups_are_left_out(no_gmsh):
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("groups")
    geo = gmsh.model.geo
    points = [geo.addPoint(float(i), 0, 0, 1.0) for i in range(4)]
    lines = [geo.addLine(points[i], points[i + 1]) for i in range(3)]
    geo.synchronize()
    gmsh.model.addPhysicalGroup(1, lines[:2], name="both")
    gmsh.model.addPhysicalGroup(1, lines[1:2], name="second")
    gmsh.model.addPhysicalGroup(1, lines[2:])
    gmsh.model.addPhysicalGroup(0, points[3:], name="far")
    gmsh.model.addPhysicalGroup(0, points[2:3], name="near")
    gmsh.model.mesh.generate(1)
    mesh = LineMesh.from_gmsh_model()
    assert mesh.points[:, 0].max() == 2.0
    assert {name: len(rows) for name, rows in mesh.line_groups.items()} == {"both": 2, "second": 1}
    assert list(mesh.point_groups) == ["near"]
    gmsh.model.addPhysicalGroup(0, points[:2], name="pair")
    with pytest.raises(ValueError, match='point group "pair" must hold one node, got 2'):
        LineMesh.from_gmsh_model()


def test_joined_meshes_keep_their_nodes_apart():
    a = LineMesh.straight({"one": [(0, 0, 0), (1, 0, 0)]}, 2)
    b = LineMesh([(1, 0, 0), (1, 1, 0)], [(1, 0)], {"two": [0]}, {"corner": 0})
    both = LineMesh.join([a, b])
    np.testing.assert_array_equal(both.points, np.concatenate([a.points, b.points]))
    np.testing.assert_array_equal(both.cells, [(0, 1), (1, 2), (4, 3)])
    np.testing.assert_array_equal(both.order("two"), [4, 3])
    assert both.line_groups["one"].tolist() == [0, 1]
    assert both.point_groups == {"corner": 3}
    with pytest.raises(
        ValueError, match=r'LineMesh.join: line_groups: the name "two" is used twice'
    ):
        LineMesh.join([b, b])
    with pytest.raises(ValueError, match="must hold at least one mesh"):
        LineMesh.join([])
    with pytest.raises(TypeError, match="each mesh must be a LineMesh"):
        LineMesh.join([a, "b"])
