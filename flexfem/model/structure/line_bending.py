# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bending that is missing where triangles of shells end at a line."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.mesh.surface_mesh import SurfaceMesh
from flexfem.model.bodies.shell import Shell

__all__ = ["line_slopes", "line_stiffness"]

#: Difference of two places along an edge, relative to its length, that leaves no digits.
_NEAR = 0.25


def line_stiffness(mesh: SurfaceMesh, shell: Shell, sides: IntArray) -> FloatArray:
    """Moments per length and angle (k,), N, by which triangles at a line resist rotation there.

    A rotation-free triangle of height d that ends at a free edge bends so that no moment acts there
    (``mesh.shells.patches``). Turning the edge by an angle theta against that adds a curvature of 2
    theta / d across it and the energy ``D/2 (2 theta / d)^2 l d/2``, D being the bending stiffness
    across
    the edge, l its length: the moment is ``2 D / d theta``. Two such triangles make up an inner
    edge. The stiffness is infinite where nothing is missing: with directors, and where the
    triangle has a neighbour over the edge.

    Args:
        mesh: the surface mesh.
        shell: the shell.
        sides: 3 x triangle of the mesh + edge.
    """
    triangle, k = sides // 3, sides % 3
    if shell.element != "rotation_free":
        return np.full(len(sides), np.inf)
    corners = mesh.points[mesh.triangles[triangle]]
    at = np.arange(len(sides))
    edge = corners[at, (k + 2) % 3] - corners[at, (k + 1) % 3]
    lengths = np.linalg.norm(edge, axis=1)
    normals = mesh.normals[triangle]
    outwards = np.cross(edge / lengths[:, np.newaxis], normals)
    first = corners[:, 1] - corners[:, 0]
    if shell.direction is not None:
        given = shell.direction
        given = given(corners.mean(axis=1)) if callable(given) else given
        first = np.broadcast_to(np.asarray(given, dtype=np.float64), first.shape)
    along = (first * outwards).sum(axis=1)
    across = (np.cross(normals, first) * outwards).sum(axis=1)
    c, s = np.stack([along, across]) / np.hypot(along, across)
    bent = np.stack([c * c, s * s, 2.0 * c * s], axis=1)
    stiffness = np.einsum("ki,ij,kj->k", bent, shell.section.stiffness[3:, 3:], bent)
    heights = 2.0 * mesh.areas[triangle] / lengths
    free = mesh.topology.neighbours[triangle, k] < 0
    result: FloatArray = np.where(free, 2.0 * stiffness / heights, np.inf)
    return result


def line_slopes(mesh: SurfaceMesh, sides: IntArray) -> tuple[IntArray, FloatArray]:
    """Triangles (k, 2) whose slopes across an edge represent those along it, and where (k, 2).

    On lattices the slope of a triangle, across an edge, is that of the shell where a line of the
    lattice from the edge meets it: for the neighbours that share one end of the edge at this end,
    for the triangle itself beside its third node. Between two of them follows the slope anywhere on
    the edge, whatever the twist. Places are from 0 to 1 as the triangle runs along the edge.

    Args:
        mesh: the surface mesh.
        sides: 3 x triangle of the mesh + edge.
    """
    triangle, k = sides // 3, sides % 3
    at = np.arange(len(sides))
    corners = mesh.points[mesh.triangles[triangle]]
    start, end, apex = (corners[at, (k + i) % 3] for i in (1, 2, 0))
    edge = end - start
    own = np.clip(((apex - start) * edge).sum(axis=1) / (edge**2).sum(axis=1), 0.0, 1.0)
    neighbours = mesh.topology.neighbours
    # over the edges to the third node: from the start, from the end
    found = np.stack([neighbours[triangle, (k + i) % 3] for i in (2, 1)], axis=1)
    missing = found < 0
    places = np.where(missing, own[:, np.newaxis], [0.0, 1.0])
    near = (np.abs(places[:, 1] - places[:, 0]) < _NEAR)[:, np.newaxis]
    places = np.where(near, own[:, np.newaxis], places)
    return np.where(missing | near, triangle[:, np.newaxis], found), places
