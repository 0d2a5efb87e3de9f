# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodes of director shells: curved edges, directors, kinks, fixed unknowns."""

import numpy as np
import pytest

from flexfem.mesh.shells.director_nodes import director_nodes
from flexfem.mesh.shells.vertex_normals import vertex_normals
from flexfem.mesh.surface_mesh import SurfaceMesh

pytestmark = pytest.mark.serial


def cylinder(parameters):
    angle, y = parameters.T
    return np.column_stack([np.sin(angle), y, np.cos(angle)])


def arc(cells, surface=cylinder):
    return SurfaceMesh.grid(
        "arc", np.linspace(0.0, 1.5, cells + 1), np.linspace(0.0, 1.0, cells + 1), surface
    )


def without_midpoints(mesh):
    return SurfaceMesh(mesh.points, mesh.triangles, mesh.bodies, mesh.lines, mesh.nodes)


def nodes_of(mesh):
    return director_nodes(mesh, np.arange(len(mesh.triangles)))


def test_middles_of_given_surfaces_are_on_them():
    mesh = arc(4)
    found = nodes_of(mesh)
    corners = len(found.corners)
    places = found.frames[:, :3]
    np.testing.assert_allclose(np.hypot(places[:, 0], places[:, 2]), 1.0, rtol=1e-14)
    # each triangle's midside nodes are those of its own edges
    ends = mesh.points[mesh.triangles]
    chords = (np.roll(ends, -1, 1) + np.roll(ends, -2, 1)) / 2
    assert abs(places[found.nodes[:, 3:]] - chords).max() < 0.02
    # directors are unit normals up to third order in the size of cells
    directors = found.frames[corners:, [5, 8, 11]]
    np.testing.assert_allclose(directors, places[corners:] * [1.0, 0.0, 1.0], atol=3e-3)


@pytest.mark.parametrize(("cells", "offset", "tilt"), [(8, 1.5e-4, 3e-3), (16, 1e-5, 4e-4)])
def test_middles_are_found_from_neighbours(cells, offset, tilt):
    mesh = arc(cells)
    found, exact = nodes_of(without_midpoints(mesh)), nodes_of(mesh)
    # measured 1.2e-4 and 8e-6, fourth order; the chord is off by 4.4e-3 and 1.1e-3
    assert abs(found.frames[:, :3] - exact.frames[:, :3]).max() < offset
    # third order; means of the normals of flat triangles are of first order at the boundary
    assert abs(found.directors - exact.directors).max() < tilt


def test_vertex_normals_of_flat_and_folded_strips():
    """Two squares that meet at a right angle, one element wide."""
    points = [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 1, 0], [1, 1, 0], [1, 1, 1]]
    triangles = [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]]
    mesh = SurfaceMesh(np.array(points, float), triangles, {"fold": np.arange(4)})
    normals = vertex_normals(mesh, 0.5)
    np.testing.assert_allclose(normals[:2], np.tile([0.0, 0, 1], (2, 3, 1)), atol=1e-14)
    np.testing.assert_allclose(normals[2:], np.tile([-1.0, 0, 0], (2, 3, 1)), atol=1e-14)
    found = nodes_of(mesh)
    # the fold's middle has two directors and nothing idle
    fold = len(found.corners) + int(np.argmax((found.edges == [1, 4]).all(1)))
    assert found.held[:, 5].sum() == len(found.held) - 1
    assert not found.held[fold].any()
    own = found.directors[found.nodes[:, 3:] == fold]
    np.testing.assert_allclose(own, [[0.0, 0, 1], [-1, 0, 0]], atol=1e-14)
    # taken as smooth, both have the mean
    smooth = director_nodes(mesh, np.arange(4), kink=1.6)
    own = smooth.directors[smooth.nodes[:, 3:] == fold]
    np.testing.assert_allclose(own, np.tile([-(0.5**0.5), 0, 0.5**0.5], (2, 1)), atol=0.1)
    assert smooth.held[fold, 5]


def test_turned_triangles_keep_their_midpoints():
    mesh = arc(3)
    triangles, midpoints = mesh.triangles.copy(), np.array(mesh.midpoints)
    triangles[4], midpoints[4] = triangles[4][[0, 2, 1]], midpoints[4][[0, 2, 1]]
    turned = SurfaceMesh(mesh.points, triangles, mesh.bodies, midpoints=midpoints)
    np.testing.assert_array_equal(turned.midpoints, mesh.midpoints)
    np.testing.assert_array_equal(turned.triangles, mesh.triangles)


def test_joined_and_closed_grids():
    angles = np.arange(16) * np.pi / 8
    ring = SurfaceMesh.grid("ring", angles, [0.0, 0.5, 1.0], cylinder, closed=True)
    flat = SurfaceMesh.rectangle("flat", (1.0, 1.0), (2, 2))
    joined = SurfaceMesh.join([ring, flat])
    # unknown across the seam, where the parameter jumps, and for the rectangle
    known = np.isfinite(joined.midpoints).all(2)
    assert known[: len(ring.triangles)].any()
    assert not known[len(ring.triangles) :].any()
    found = nodes_of(joined)
    places = found.frames[np.unique(found.nodes[: len(ring.triangles)]), :3]
    # found where unknown, within 1e-3; the chords of the seam are 1.9e-2 inside
    np.testing.assert_allclose(np.hypot(places[:, 0], places[:, 2]), 1.0, atol=2e-3)


def test_midpoints_that_turn_a_triangle_inside_out_are_refused():
    mesh = arc(3)
    midpoints = np.array(mesh.midpoints)
    midpoints[:, 1] = midpoints[:, 1].mean(0) + 3.0
    wrong = SurfaceMesh(mesh.points, mesh.triangles, mesh.bodies, midpoints=midpoints)
    with pytest.raises(ValueError, match="invert triangle"):
        nodes_of(wrong)
