# SPDX-License-Identifier: LGPL-3.0-or-later
"""Normals of surfaces, smooth but for edges that are sharp at the first instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Shaded", "shade", "triangulated", "vertex_normals"]

type FloatArray = NDArray[np.floating[Any]]
type IntArray = NDArray[np.integer[Any]]

#: Cosine of the angle between faces from which an edge is sharp: 35 degrees.
_SHARP = 0.82
#: Faces at a point beyond which it takes the normal of each: pairs of faces are compared.
_MANY = 64


@dataclass(frozen=True)
class Shaded:
    """Vertices of a surface: every point as often as it has normals.

    Attributes:
        point: (v,) the point of each vertex.
        normal: (v, 3) unit vectors.
        triangles: (t, 3) vertices.
    """

    point: IntArray
    normal: FloatArray
    triangles: IntArray


def triangulated(cells: IntArray) -> tuple[IntArray, IntArray]:
    """Triangles (t, 3) of triangles or quadrilaterals, and the cell of each (t,)."""
    number = np.arange(len(cells))
    if cells.shape[1] == 3:
        return cells, number
    both = np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
    owner = np.concatenate([number, number])
    # a face of an end may repeat a vertex
    flat = (both[:, 0] == both[:, 1]) | (both[:, 1] == both[:, 2]) | (both[:, 0] == both[:, 2])
    return both[~flat], owner[~flat]


def shade(points: FloatArray, triangles: IntArray) -> Shaded:
    """Give the corners of triangles (t, 3) normals: the mean of the faces at their point.

    Faces across sharp edges do not count.
    """
    a, b, c = (points[triangles[:, i]] for i in range(3))
    area = np.cross(b - a, c - a)
    length = np.linalg.norm(area, axis=1)
    face = area / np.where(length > 0.0, length, 1.0)[:, None]
    corner = triangles.reshape(-1)
    of = np.repeat(np.arange(len(triangles)), 3)
    sums = face[of].copy()
    first, second = _pairs(corner)
    smooth = np.einsum("ij,ij->i", face[of[first]], face[of[second]]) > _SHARP
    np.add.at(sums, first[smooth], area[of[second[smooth]]])
    sums[:] = np.where(np.bincount(first[smooth], minlength=len(corner))[:, None] > 0,
                       sums - face[of], sums)  # fmt: skip
    size = np.linalg.norm(sums, axis=1)
    normal = sums / np.where(size > 0.0, size, 1.0)[:, None]
    key = np.column_stack([corner, np.rint(normal * 1000.0).astype(np.int64)])
    _, index, inverse = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return Shaded(corner[index], normal[index], inverse.reshape(-1, 3))


def vertex_normals(points: FloatArray, triangles: IntArray) -> FloatArray:
    """Unit normals (v, 3) of vertices: the mean of their triangles by area."""
    a, b, c = (points[triangles[:, i]].astype(float) for i in range(3))
    area = np.cross(b - a, c - a)
    sums = np.zeros((len(points), 3))
    np.add.at(sums, triangles, area[:, None])
    size = np.linalg.norm(sums, axis=1, keepdims=True)
    return sums / np.where(size > 0.0, size, 1.0)


def _pairs(corner: IntArray) -> tuple[IntArray, IntArray]:
    """All ordered pairs of corners at the same point, each with itself included."""
    order = np.argsort(corner, kind="stable")
    _, start, count = np.unique(corner[order], return_index=True, return_counts=True)
    count = np.where(count > _MANY, 1, count)
    size, begin = np.repeat(count, count), np.repeat(start, count)
    within = np.arange(len(size)) - np.repeat(np.cumsum(count) - count, count)
    first = np.repeat(order[begin + within], size)
    at = np.arange(size.sum()) - np.repeat(np.cumsum(size) - size, size)
    return first, order[np.repeat(begin, size) + at]
