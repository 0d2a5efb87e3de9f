# SPDX-License-Identifier: LGPL-3.0-or-later
"""Triangles of a grid whose rectangles are cut along diagonals."""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from flexfem._types import BoolArray, FloatArray, IntArray

__all__ = [
    "DIAGONALS",
    "grid_corners",
    "grid_lines",
    "grid_midpoints",
    "grid_triangles",
    "joined_midpoints",
    "turned_midpoints",
]

#: Diagonals of a grid: that of the first rectangle and of every second one, and that of the others.
DIAGONALS = {
    "right": ("right", "right"),
    "left": ("left", "left"),
    "right_left": ("right", "left"),
    "left_right": ("left", "right"),
}


def grid_triangles(columns: int, rows: int, *, closed: bool, diagonal: str) -> IntArray:
    """Return the triangles, two for each rectangle, shape (2 cells, 3).

    Node i + columns * j lies in column i of row j. Triangles run counterclockwise when columns go
    to the right and rows upwards.

    Args:
        columns: Nodes in each row.
        rows: Number of rows.
        closed: Whether the last column is followed by the first.
        diagonal: One of ``DIAGONALS``: "right" runs from bottom left to top right, "left" from
            bottom right to top left; the others change from each rectangle to its neighbours.
    """
    i, j = np.arange(columns if closed else columns - 1), np.arange(rows - 1)[:, np.newaxis]
    parity = ((i + j) % 2).ravel()
    following = (i + 1) % columns
    a, b = (columns * j + i).ravel(), (columns * j + following).ravel()
    c, d = b + columns, a + columns
    right = np.stack([a, b, c, a, c, d], axis=1)
    left = np.stack([a, b, d, b, c, d], axis=1)
    first, second = DIAGONALS[diagonal]
    chosen = np.where(parity == 0, first == "right", second == "right")
    return np.where(chosen[:, np.newaxis], right, left).reshape(-1, 3)


def grid_lines(columns: int, rows: int, *, closed: bool) -> dict[str, IntArray]:
    """Return the node pairs along the sides: bottom, top and, unless closed, left and right."""
    i, j = np.arange(columns), columns * np.arange(rows)
    bottom = np.append(i, 0) if closed else i
    nodes = {"bottom": bottom, "top": bottom + j[-1]}
    if not closed:
        nodes |= {"left": j, "right": j + columns - 1}
    return {side: np.column_stack([line[:-1], line[1:]]) for side, line in nodes.items()}


def grid_corners(columns: int, rows: int) -> dict[str, int]:
    """Return the corner nodes of an open grid."""
    last = columns * (rows - 1)
    return {
        "bottom_left": 0,
        "bottom_right": columns - 1,
        "top_left": last,
        "top_right": last + columns - 1,
    }


def turned_midpoints(midpoints: FloatArray | None, turned: BoolArray) -> FloatArray | None:
    """Return the midpoints of edges (m, 3, 3) with those of triangles (a, b, c) made (a, c, b)."""
    if midpoints is None:
        return None
    result = np.array(midpoints)
    result[turned] = result[turned][:, [0, 2, 1]]
    result.flags.writeable = False
    return result


def grid_midpoints(
    surface: Callable[[FloatArray], npt.ArrayLike], parameters: FloatArray, triangles: IntArray,
    columns: int,
) -> FloatArray:  # fmt: skip
    """Return the midpoints of the edges of a grid, NaN from the last column to the first."""
    corners, column = parameters[triangles], triangles % columns
    middles = 0.5 * (np.roll(corners, -1, axis=1) + np.roll(corners, -2, axis=1))
    ends = np.roll(column, -1, axis=1), np.roll(column, -2, axis=1)
    across = abs(ends[0] - ends[1]) > 1
    found = np.array(surface(middles.reshape(-1, 2)), dtype=np.float64).reshape(-1, 3, 3)
    found[across] = np.nan
    return found


def joined_midpoints(
    meshes: Sequence[tuple[FloatArray | None, int]],
) -> FloatArray | None:
    """Return the midpoints of several meshes one after the other, each with its triangles."""
    if all(midpoints is None for midpoints, _ in meshes):
        return None
    return np.concatenate([
        np.full((count, 3, 3), np.nan) if midpoints is None else midpoints
        for midpoints, count in meshes
    ])  # fmt: skip
