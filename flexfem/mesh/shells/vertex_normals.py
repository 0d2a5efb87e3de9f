# SPDX-License-Identifier: LGPL-3.0-or-later
"""Normals of the surface that flat triangles approximate, at their corners."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.mesh.surface_mesh import SurfaceMesh

__all__ = ["vertex_normals"]


def vertex_normals(surface: SurfaceMesh, kink: float) -> FloatArray:
    """Unit normals at the corners of all triangles, (m, 3, 3).

    Triangles around a node belong to one smooth surface where they are of one body and joined over
    edges at which their normals differ by less than the kink angle. The normal there is what
    remains at the node of a linear function fitted to the normals of these triangles and of those
    around their other corners: a mean inside the surface, an extrapolation at its boundary.

    Args:
        surface: the mesh.
        kink: angle, rad.
    """
    from scipy import sparse

    count = len(surface.triangles)
    fan = _fans(surface, np.cos(kink))
    around = sparse.csr_array(
        (np.ones(3 * count), (fan, np.repeat(np.arange(count), 3))), (int(fan.max()) + 1, count)
    )
    corners = sparse.csr_array(
        (np.ones(3 * count), (np.repeat(np.arange(count), 3), surface.triangles.ravel())),
        (count, len(surface.points)),
    )
    near = (around @ around.T @ around @ corners).tocoo()
    normals = np.zeros((around.shape[0], 3))
    areas = surface.areas[:, None] * surface.normals
    np.add.at(normals, fan, np.repeat(areas, 3, 0))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    places = np.empty_like(normals)
    places[fan] = surface.points[surface.triangles.ravel()]
    fitted = _fitted(near.row, surface.points[near.col] - places[near.row], normals)
    return fitted[fan].reshape(-1, 3, 3)


def _fans(surface: SurfaceMesh, limit: float) -> IntArray:
    """Number of the smooth surface around its node that each corner (3 m,) belongs to."""
    from scipy import sparse
    from scipy.sparse.csgraph import connected_components

    triangles, neighbours = surface.triangles, surface.topology.neighbours
    t, k = np.nonzero(neighbours >= 0)
    other = neighbours[t, k]
    smooth = np.einsum("ta,ta->t", surface.normals[t], surface.normals[other]) >= limit
    t, k, other = t[smooth], k[smooth], other[smooth]
    first, second = [], []
    for step in (1, 2):
        corner = (k + step) % 3
        first.append(3 * t + corner)
        place = np.argmax(triangles[other] == triangles[t, corner, None], 1)
        second.append(3 * other + place)
    pairs = np.concatenate(first), np.concatenate(second)
    graph = sparse.coo_array((np.ones(len(pairs[0]), np.int8), pairs), (triangles.size,) * 2)
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _fitted(fans: IntArray, away: FloatArray, normals: FloatArray) -> FloatArray:
    """Unit normals (f, 3) of quadratic surfaces fitted to points around each fan.

    Args:
        fans: fan of each point, (p,).
        away: the point from the fan's node, (p, 3).
        normals: of the planes over which the surfaces are functions, (f, 3).
    """
    count = len(normals)
    first = np.cross(normals, np.eye(3)[np.argmin(abs(normals), 1)])
    first /= np.linalg.norm(first, axis=1)[:, None]
    axes = np.stack([first, np.cross(normals, first), normals], 1)
    u, v, height = np.einsum("pab,pb->ap", axes[fans], away)
    rows = np.column_stack([u, v, u * u, u * v, v * v])
    system, right = np.zeros((count, 5, 5)), np.zeros((count, 5))
    np.add.at(system, fans, np.einsum("pi,pj->pij", rows, rows))
    np.add.at(right, fans, height[:, None] * rows)
    sizes = np.sqrt(np.einsum("fii->fi", system))
    sizes[sizes == 0.0] = 1.0
    # few points, in one row for example, leave coefficients open: these stay small
    inverse = np.linalg.pinv(system / sizes[:, :, None] / sizes[:, None, :], 1e-6)
    slopes = (np.einsum("fij,fj->fi", inverse, right / sizes) / sizes)[:, :2]
    tilted = normals - np.einsum("fi,fia->fa", slopes, axes[:, :2])
    fitted: FloatArray = tilted / np.linalg.norm(tilted, axis=1)[:, None]
    return fitted
