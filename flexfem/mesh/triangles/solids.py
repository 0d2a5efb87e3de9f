# SPDX-License-Identifier: LGPL-3.0-or-later
"""Closed surfaces of simple solids about the origin, axes along z, normals outwards.

Each function returns points (n, 3), metres, and triangles (m, 3).
"""

import numpy as np
import numpy.typing as npt

from flexfem._types import FloatArray, IntArray

__all__ = ["box", "capsule", "cylinder"]

#: Faces of a box by its corners.
_QUADS = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)


def box(sizes: npt.ArrayLike) -> tuple[FloatArray, IntArray]:
    """Return the twelve triangles of a box with the given edge lengths (3,), metres."""
    corners = np.array([[i, j, k] for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (-0.5, 0.5)])
    triangles = np.concatenate([_QUADS[:, [0, 1, 2]], _QUADS[:, [0, 2, 3]]])
    return corners * np.asarray(sizes, dtype=np.float64), triangles


def cylinder(radius: float, length: float, sides: int) -> tuple[FloatArray, IntArray]:
    """Return a prism that a cylinder with flat ends contains; its edges are on the cylinder."""
    across, along = np.full(2, radius), np.array([-0.5, 0.5]) * length
    return _revolved(across, along, sides, (-0.5 * length, 0.5 * length))


def capsule(radius: float, length: float, sides: int) -> tuple[FloatArray, IntArray]:
    """Return a cylinder with half spheres, whose centres have the distance ``length``.

    All points are on it; a half sphere has a quarter as many rings as ``sides``.
    """
    lift = 0.5 * np.pi * np.arange(sides // 4) / (sides // 4)
    lift = np.concatenate([-lift[::-1], lift])
    shift = np.repeat([-0.5 * length, 0.5 * length], sides // 4)
    top = 0.5 * length + radius
    return _revolved(radius * np.cos(lift), radius * np.sin(lift) + shift, sides, (-top, top))


def _revolved(
    across: FloatArray, along: FloatArray, sides: int, poles: tuple[float, float]
) -> tuple[FloatArray, IntArray]:
    """Surface of a row of radii at places along z, closed by fans around the poles."""
    phi = 2.0 * np.pi * np.arange(sides) / sides
    rings = np.stack(
        [
            np.outer(across, np.cos(phi)), np.outer(across, np.sin(phi)),
            np.repeat(along[:, np.newaxis], sides, axis=1),
        ],
        axis=-1,
    )  # fmt: skip
    points = np.concatenate([rings.reshape(-1, 3), [[0.0, 0.0, z] for z in poles]])
    j, k, last = np.arange(sides), (np.arange(sides) + 1) % sides, len(across) - 1
    first = sides * np.arange(last)[:, np.newaxis]
    lower, right = (first + j).ravel(), (first + k).ravel()
    south, north = np.full(sides, len(points) - 2), np.full(sides, len(points) - 1)
    faces = [
        (lower, right, right + sides), (lower, right + sides, lower + sides),
        (south, k, j), (north, sides * last + j, sides * last + k),
    ]  # fmt: skip
    return points, np.concatenate([np.stack(face, axis=1) for face in faces]).astype(np.int64)
