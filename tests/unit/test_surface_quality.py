# SPDX-License-Identifier: LGPL-3.0-or-later
"""Quality of surface meshes: angles, aspects, alternating patterns."""

import gmsh
import numpy as np
import pytest

import flexfem as ff
from flexfem.mesh.surface_quality import alternating_fraction, angles, aspects

pytestmark = pytest.mark.serial


def plate(cells, diagonal="right"):
    return ff.SurfaceMesh.rectangle("plate", (1.0, 1.0), (cells, cells), diagonal=diagonal)


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
