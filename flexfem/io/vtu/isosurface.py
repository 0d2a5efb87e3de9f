# SPDX-License-Identifier: LGPL-3.0-or-later
"""Triangles of the surface on which a function of space is zero.

Marching tetrahedra: cells of a grid are cut into six tetrahedra around a diagonal, whose edges have
a point where the function changes its sign. Unlike with marching cubes no case is ambiguous.
"""

from collections.abc import Callable
from itertools import permutations, product

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.io.vtu.surfaces import Surface

__all__ = ["isosurface"]

#: Corners (6, 4, 3) of the tetrahedra of a cell: ways from one corner to the opposite one.
_TETRAHEDRA = np.array([
    np.cumsum([np.zeros(3, int), *(np.eye(3, dtype=int)[a] for a in order)], axis=0)
    for order in permutations(range(3))
])  # fmt: skip


def isosurface(
    function: Callable[[FloatArray], FloatArray], box: FloatArray, cells: int
) -> Surface:
    """Surface on which a function is zero, seen from where it is positive.

    Args:
        function: of points (k, 3), which returns values (k,).
        box: lowest and highest coordinates (2, 3); at its faces the surface ends.
        cells: number of cells along the longest edge of the box.
    """
    edges = box[1] - box[0]
    counts = np.maximum(np.ceil(cells * edges / edges.max()), 1).astype(np.int64)
    steps = [np.linspace(box[0, a], box[1, a], counts[a] + 1) for a in range(3)]
    points = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
    values = function(points)
    corners = _corners(counts)
    positive = values[corners] > 0.0
    triangles, outside = _cut(corners, positive)
    ends, rows = np.unique(np.sort(triangles.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    v = values[ends]
    part = v[:, :1] / (v[:, :1] - v[:, 1:])
    places = points[ends[:, 0]] + part * (points[ends[:, 1]] - points[ends[:, 0]])
    faces = rows.reshape(-1, 3)
    x = places[faces]
    normals = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    inwards = np.einsum("ma,ma->m", normals, points[outside] - x.mean(axis=1)) < 0.0
    faces[inwards] = faces[inwards, ::-1]
    return Surface(places, faces)


def _corners(counts: IntArray) -> IntArray:
    """Grid points (t, 4) of all tetrahedra that may be cut."""
    nx, ny, nz = (np.arange(n) for n in counts)
    cells = np.stack(np.meshgrid(nx, ny, nz, indexing="ij"), axis=-1).reshape(-1, 1, 1, 3)
    strides = np.array([(counts[1] + 1) * (counts[2] + 1), counts[2] + 1, 1])
    corners: IntArray = ((cells + _TETRAHEDRA) @ strides).reshape(-1, 4)
    return corners


def _cut(corners: IntArray, positive: np.ndarray) -> tuple[IntArray, IntArray]:
    """Triangles (m, 3, 2) by the ends of the edges they cut, and a corner outside of each (m,)."""
    triangles, outside = [np.zeros((0, 3, 2), np.int64)], [np.zeros(0, np.int64)]
    for signs in product((False, True), repeat=4):
        rows = corners[(positive == signs).all(axis=1)]
        inner, outer = ([k for k in range(4) if signs[k] is sign] for sign in (False, True))
        for three in _faces(inner, outer):
            triangles.append(rows[:, np.array(three)])
            outside.append(rows[:, outer[0]])
    return np.concatenate(triangles), np.concatenate(outside)


def _faces(inner: list[int], outer: list[int]) -> list[list[tuple[int, int]]]:
    """Edges of a tetrahedron that the triangles between its corners cut."""
    cut = [(i, j) for i in inner for j in outer]
    if len(cut) == 4:  # of a quadrilateral whose sides are 01, 13, 32, 20
        return [[cut[0], cut[1], cut[3]], [cut[0], cut[3], cut[2]]]
    return [cut] if cut else []
