# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surfaces that intersect, or penetrate too deeply, in the initial configuration."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.detection.broad_phase import overlaps, triangle_boxes
from flexfem.contact.detection.neighbours import Rows
from flexfem.contact.law.data import GAP, REACH, Masters, Slaves
from flexfem.contact.obstacles.triangles import TriangleContact
from flexfem.kernels.compiled import kernel, subroutine

__all__ = ["contact_at_start", "deepest_start", "first_crossing", "winding_numbers"]


def contact_at_start(
    points: FloatArray, slaves: Slaves, masters: Masters, chosen: IntArray, excluded: Rows,
    skin: float = 0.0,
) -> TriangleContact:  # fmt: skip
    """Return the contact of slaves with the ``chosen`` triangles, evaluated at positions (n, 3)."""
    made = TriangleContact(slaves, masters, skin, excluded)
    made.search(points, chosen)
    made.settle(points)
    made.evaluate(points)
    return made


def deepest_start(contact: TriangleContact) -> tuple[float, int, int]:
    """Return the largest penetration over the sum of half thicknesses, its node and triangle.

    They are 0 and -1 without contact. ``contact`` is that of :func:`contact_at_start`.
    """
    if contact.count == 0:
        return 0.0, -1, -1
    parts = -contact.contacts[:, GAP] / np.maximum(contact.contacts[:, REACH], 1e-300)
    worst = int(np.argmax(parts))
    slave, triangle = contact.ends[worst].tolist()
    return float(parts[worst]), int(contact.slaves.nodes[slave]), triangle


def winding_numbers(points: FloatArray, corners: FloatArray) -> FloatArray:
    """Return the winding numbers of triangles around points: 1 inside, 0 outside, (n,).

    Args:
        points: Positions, shape (n, 3), metres.
        corners: Corners of the triangles, normals outwards, shape (m, 3, 3), metres.

    Sums of solid angles (Van Oosterom, Strackee, IEEE Trans. Biomed. Eng. 30, 1983).
    """
    turns = np.empty(len(points))
    for k, point in enumerate(points):
        a, b, c = (corners[:, i] - point for i in range(3))
        x, y, z = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        volume = np.einsum("mi,mi->m", a, np.cross(b, c))
        ab, bc, ca = (np.einsum("mi,mi->m", u, v) for u, v in ((a, b), (b, c), (c, a)))
        turns[k] = np.arctan2(volume, x * y * z + ab * z + bc * x + ca * y).sum() / (2.0 * np.pi)
    return turns


def first_crossing(
    points: FloatArray, edges: IntArray, triangles: IntArray, excluded: Rows
) -> tuple[int, int]:
    """Return the first edge that intersects a triangle, and the triangle; (-1, -1) without.

    Args:
        points: Positions, shape (n, 3), metres.
        edges: Node indices, shape (e, 2).
        triangles: Node indices, shape (m, 3).
        excluded: Nodes whose triangles each edge may cross.
    """
    ends = points[edges]
    low, high = np.empty((len(triangles), 3)), np.empty((len(triangles), 3))
    triangle_boxes(points, triangles, np.zeros(len(triangles)), low, high)
    starts, found = overlaps(ends.min(1), ends.max(1), low, high)
    crossing = np.empty(2, np.int64)
    _cross_first(
        points, edges, triangles, excluded.starts, excluded.values, starts, found, crossing
    )
    return int(crossing[0]), int(crossing[1])


@kernel
def _cross_first(
    points: FloatArray, edges: IntArray, triangles: IntArray, ex_starts: IntArray,
    ex_nodes: IntArray, starts: IntArray, found: IntArray, crossing: IntArray,
) -> None:  # fmt: skip
    """Write the first edge and the triangle that it intersects."""
    crossing[:] = -1
    x = np.empty((5, 3))
    for e in range(len(edges)):
        never = ex_nodes[ex_starts[e] : ex_starts[e + 1]]
        for f in range(starts[e], starts[e + 1]):
            t, allowed = found[f], True
            for k in range(3):
                node = triangles[t, k]
                place = np.searchsorted(never, node)
                if node == edges[e, 0] or node == edges[e, 1]:
                    allowed = False
                if place < never.size and never[place] == node:
                    allowed = False
                for a in range(3):
                    x[k, a] = points[node, a]
            if not allowed:
                continue
            for a in range(3):
                x[3, a], x[4, a] = points[edges[e, 0], a], points[edges[e, 1], a]
            if _volume(x, 0, 1, 2, 3) * _volume(x, 0, 1, 2, 4) >= 0.0:
                continue
            u, v, w = _volume(x, 3, 4, 0, 1), _volume(x, 3, 4, 1, 2), _volume(x, 3, 4, 2, 0)
            if (u > 0.0) == (v > 0.0) and (v > 0.0) == (w > 0.0):
                crossing[0], crossing[1] = e, t
                return


@subroutine
def _volume(x: FloatArray, i: int, j: int, k: int, l: int) -> float:  # noqa: E741
    """Six times the volume of a tetrahedron, with its sign."""
    total = 0.0
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        u, v = x[j, b] - x[i, b], x[k, c] - x[i, c]
        p, q = x[j, c] - x[i, c], x[k, b] - x[i, b]
        total += (u * v - p * q) * (x[l, a] - x[i, a])
    return total
