# SPDX-License-Identifier: LGPL-3.0-or-later
"""Data of a contact surface: boundaries, areas of nodes, sizes, stiffness."""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray

__all__ = ["automatic_stiffness", "mean_edge", "node_areas", "rim_bits"]

#: Ratio of the automatic stiffness to the inertia in the iteration matrix. With ten times this
#: value sheets gain energy from impacts that steps do not resolve, with a tenth they penetrate four
#: times as far.
_INERTIA = 1.0


def rim_bits(triangles: IntArray, neighbours: IntArray, nodes: int) -> IntArray:
    """Return flags of edges and nodes of triangles on a boundary, bits 0 to 2 and 3 to 5, (m,).

    Args:
        triangles: Node indices, shape (m, 3).
        neighbours: Triangle over the edge opposite to each node, -1 without, shape (m, 3).
        nodes: Number of nodes.
    """
    free = neighbours < 0
    on_rim: BoolArray = np.zeros(nodes, dtype=np.bool_)
    on_rim[np.roll(triangles, -1, 1)[free]] = on_rim[np.roll(triangles, -2, 1)[free]] = True
    flags = np.column_stack([free, on_rim[triangles]]).astype(np.int64)
    return np.asarray(flags @ (1 << np.arange(6)), dtype=np.int64)


def node_areas(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Return a third of the area of all triangles at each node, shape (n,), square metres."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6.0
    return np.bincount(triangles.ravel(), np.repeat(areas, 3), len(points))


def mean_edge(points: FloatArray, triangles: IntArray) -> float:
    """Return the mean length of the edges of triangles, metres."""
    corners = points[triangles]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())


def automatic_stiffness(through: float, density: float, inertia: float) -> float:
    """Return the force per penetration and area at zero penetration, N/m^3.

    It is the smaller of the stiffness through the thickness and of the inertia in the iteration
    matrix: an impact then lasts about two steps, and refined iterations with factors that leave
    contact out take as many as with fresh ones. Deeper contacts are stiffer, see ``stiffening``.

    Args:
        through: Least stiffness through the thickness, N/m^3.
        density: Least mass per area, kg/m^2.
        inertia: Factor of the mass in the iteration matrix, 1/s^2; 0 at rest.
    """
    return min(through, _INERTIA * density * inertia) if density * inertia > 0.0 else through
