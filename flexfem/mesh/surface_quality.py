# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shape and pattern of triangles."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.mesh.surface_topology import match_sides, side_nodes

__all__ = ["alternating_fraction", "angles", "aspects"]


def angles(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Return the angles at the three nodes of each triangle, shape (m, 3), radians.

    Args:
        points: Node positions, shape (n, 3), metres.
        triangles: Node indices, shape (m, 3), with an area.
    """
    corners = points[triangles]
    ahead = np.roll(corners, -1, axis=1) - corners
    back = np.roll(corners, 1, axis=1) - corners
    # The arc tangent is exact for small angles, where the arc cosine loses half the digits
    sine = np.linalg.norm(np.cross(ahead, back), axis=-1)
    return np.arctan2(sine, (ahead * back).sum(axis=-1))


def aspects(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Return circumradius over twice the inradius of each triangle, shape (m,).

    It is 1 for an equilateral triangle, 1.21 for half a square and grows without bound as an
    angle goes to zero or to 180 degrees. With edges a, b, c and area A it is
    a b c (a + b + c) / (16 A^2).

    Args:
        points: Node positions, shape (n, 3), metres.
        triangles: Node indices, shape (m, 3), with an area.
    """
    corners = points[triangles]
    edges = np.roll(corners, -1, axis=1) - corners
    lengths = np.linalg.norm(edges, axis=-1)
    double = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=-1)
    return lengths.prod(axis=1) * lengths.sum(axis=1) / (2.0 * double) ** 2


def alternating_fraction(triangles: IntArray) -> float:
    """Return the fraction of inner nodes at which 4 or 8 triangles meet.

    It is 1 on union-jack meshes (diagonals that alternate from rectangle to rectangle) and on
    crossed meshes (both diagonals in every rectangle), where fits of a quadratic function to a
    triangle and its neighbours converge to a wrong curvature. It is 0 where all diagonals run
    alike, and small on unstructured meshes. What a mesh does to fits is measured by
    `patch_checks.moment_imbalance`, at more expense.

    Args:
        triangles: Node indices of one body, shape (m, 3), whose edges have at most two triangles.

    Returns:
        The fraction, 0 when there is no inner node.
    """
    nodes, flat = np.unique(triangles, return_inverse=True)
    rows = flat.reshape(-1, 3)
    valence = np.bincount(rows.ravel())
    sides = match_sides(rows, np.zeros(len(rows), dtype=np.int64), len(nodes))
    rim = sides.order[sides.starts[sides.counts == 1]]
    inner = np.ones(len(nodes), dtype=bool)
    for ends in side_nodes(rows):
        inner[ends[rim]] = False
    return float(np.isin(valence[inner], (4, 8)).mean()) if inner.any() else 0.0
