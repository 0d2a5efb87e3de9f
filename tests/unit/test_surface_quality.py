# SPDX-License-Identifier: LGPL-3.0-or-later
"""Quality of surface meshes: angles, aspects, alternating patterns, softening of patches."""

import gmsh
import numpy as np
import pytest

import flexfem as ff
from flexfem.mesh.patch_quality import patch_softening
from flexfem.mesh.surface_quality import alternating_fraction, angles, aspects

pytestmark = pytest.mark.serial


def plate(cells, diagonal="right"):
    return ff.SurfaceMesh.rectangle("plate", (1.0, 1.0), (cells, cells), diagonal=diagonal)


@pytest.fixture
def gmsh_model():
    """A fresh gmsh model, closed again at the end."""
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.add("test")
    yield gmsh.model
    gmsh.finalize()


def union_jack(cells):
    """Diagonals that alternate from square to square."""
    right = plate(cells).triangles.reshape(-1, 2, 3)
    left = plate(cells, "left")
    i, j = np.arange(cells), np.arange(cells)[:, np.newaxis]
    even = ((i + j) % 2 == 0).ravel()[:, np.newaxis, np.newaxis]
    return np.where(even, right, left.triangles.reshape(-1, 2, 3)).reshape(-1, 3)


def crossed(cells):
    """Both diagonals in each square, which meet in a node of its own."""
    triangles = plate(cells).triangles
    a, b, c = triangles[::2].T
    d, centre = triangles[1::2, 2], (cells + 1) ** 2 + np.arange(cells**2)
    sides = [(a, b), (b, c), (c, d), (d, a)]
    return np.concatenate([np.column_stack([p, q, centre]) for p, q in sides])


def test_angles_and_aspects():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0.0, 0.75**0.5], [0.5, 1e-8, 0]])
    triangles = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    exact = [np.pi / 4, np.pi / 3, 2e-8]
    np.testing.assert_allclose(angles(points, triangles).min(axis=1), exact, rtol=1e-12)
    np.testing.assert_allclose(angles(points, triangles).sum(axis=1), np.pi, rtol=1e-14)
    found = aspects(points, triangles)
    np.testing.assert_allclose(found[:2], [(1.0 + np.sqrt(2.0)) / 2.0, 1.0], rtol=1e-12)
    assert found[2] > 1e7


def test_alternating_patterns():
    assert alternating_fraction(union_jack(6)) == 1.0
    assert alternating_fraction(crossed(6)) == 1.0
    assert alternating_fraction(plate(6).triangles) == 0.0
    assert alternating_fraction(plate(1).triangles) == 0.0  # no inner node


@pytest.mark.parametrize("algorithm", [1, 5, 6])
def test_unstructured_meshes_hardly_alternate(algorithm, gmsh_model):
    disk = gmsh_model.occ.addDisk(0, 0, 0, 1.0, 0.7)
    gmsh_model.occ.synchronize()
    gmsh_model.addPhysicalGroup(2, [disk], name="disk")
    gmsh.option.setNumber("Mesh.Algorithm", algorithm)
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.06)
    gmsh_model.mesh.generate(2)
    mesh = ff.SurfaceMesh.from_gmsh_model()
    # 0.00 to 0.06; a count of the boundary's nodes too, or of valence 5 and 7, gives 0.2 and more
    assert alternating_fraction(mesh.triangles) < 0.15


def softening(mesh):
    return patch_softening(mesh.points, mesh.triangles, mesh.topology.opposite)


def softening_node_by_node(mesh):
    """The same for a flat mesh, from the energy's values as each node moves up and down."""
    whole = (mesh.topology.opposite >= 0).all(axis=1)
    patches = np.column_stack([mesh.triangles, mesh.topology.opposite])
    x, y = mesh.points[:, 0], mesh.points[:, 1]
    terms = np.column_stack([np.ones(len(x)), x, y, x * x, y * y, x * y])

    def energy(rows, w):
        # second derivatives 2 c3, 2 c4, c5 of the fitted function
        c = np.array([np.linalg.solve(terms[p], w[p])[3:] for p in patches[rows]])
        return mesh.areas[rows] @ (2.0 * c[:, 0] ** 2 + 2.0 * c[:, 1] ** 2 + c[:, 2] ** 2)

    drop = area = 0.0
    for node in np.setdiff1d(np.arange(len(x)), patches[~whole]):
        rows = np.flatnonzero((patches == node).any(axis=1))
        area += mesh.areas[(mesh.triangles == node).any(axis=1)].sum() / 3.0
        for field in (0.5 * x * x, 0.5 * y * y, x * y / np.sqrt(2.0)):
            bump = np.zeros(len(x))
            bump[node] = 1.0
            low, middle, high = (energy(rows, field + s * bump) for s in (-1.0, 0.0, 1.0))
            drop += (high - low) ** 2 / (8.0 * (low - 2.0 * middle + high))
    # each of the three fields has the energy 1/2 per area
    return drop / (1.5 * area)


def test_softening_by_patches(rng):
    plain = ff.SurfaceMesh.rectangle("plate", (8.0, 8.0), (8, 8))
    assert softening(plain) < 1e-20
    points = plain.points + 0.2 * rng.uniform(-1.0, 1.0, plain.points.shape) * [1.0, 1.0, 0.0]
    jack = ff.SurfaceMesh(points, union_jack(8), {"plate": np.arange(128)})
    expected = softening_node_by_node(jack)
    assert 0.3 < expected < 0.9
    assert softening(jack) == pytest.approx(expected, rel=1e-9)
    # Unfolding a roll brings the flat mesh back
    straight = ff.SurfaceMesh(plain.points, union_jack(8), {"plate": np.arange(128)})
    angle = straight.points[:, 0] / 5.0
    rolled = np.column_stack([np.sin(angle), straight.points[:, 1] / 5.0, np.cos(angle)])
    stretch = [2.0 * np.sin(0.1) * 5.0, 1.0, 1.0]
    flat = ff.SurfaceMesh(straight.points * stretch, straight.triangles, straight.bodies)
    bent = ff.SurfaceMesh(5.0 * rolled, straight.triangles, straight.bodies)
    # The nodes' axes are projected across folds, an error of 7e-5; neighbours that are projected
    # instead of unfolded are too short by 2 per cent
    assert softening(bent) == pytest.approx(softening(flat), rel=1e-3)


def test_softening_of_few_and_of_singular_patches():
    assert softening(ff.SurfaceMesh.rectangle("plate", (1.0, 1.0), (2, 2))) == 0.0
    # The corners of a regular hexagon lie on a circle: the middle triangle fits no curvature
    angle = np.pi / 3.0 * np.arange(18)
    radius = np.repeat([1.0, 2.0, 3.0], 6)
    points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * angle])
    ring = np.arange(6)
    triangles = [[0, 2, 4], [0, 1, 2], [2, 3, 4], [4, 5, 0]]
    for inside in (0, 6):
        a, b = inside + ring, inside + (ring + 1) % 6
        triangles += np.column_stack([a, a + 6, b + 6]).tolist()
        triangles += np.column_stack([a, b + 6, b]).tolist()
    mesh = ff.SurfaceMesh(points, triangles, {"plate": np.arange(len(triangles))})
    assert softening(mesh) == np.inf
