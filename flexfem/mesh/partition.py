# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which rank gets which body.

Bodies stay whole, so that their factors and solves are local to a rank and only joints cross ranks;
neighbours in the order of the model stay neighbours. A body is split only when it is larger than a
rank's share and large enough to be worth it.
"""

import numpy as np

from flexfem._types import IntArray
from flexfem.mesh.surface_mesh import SurfaceMesh

__all__ = ["partition_bodies", "partition_surface"]


def partition_bodies(cells: IntArray, ranks: int, split_above: int) -> list[IntArray]:
    """Distribute bodies over ranks by their number of cells.

    Args:
        cells: (n_bodies,) number of cells of each body, in the order of the model.
        ranks: number of ranks.
        split_above: a body may be split if it has more cells than this and than a rank's share.

    Returns:
        For each body the rank of each of its cells, ascending along the body.
    """
    total = int(cells.sum())
    start = np.concatenate([[0], np.cumsum(cells)])
    destination = []
    for body, count in enumerate(cells):
        if count > max(split_above, total / ranks):
            position = start[body] + np.arange(count) + 0.5
        else:
            position = np.full(count, start[body] + 0.5 * count)
        rank = np.minimum((position * ranks / max(total, 1)).astype(np.int64), ranks - 1)
        destination.append(rank)
    return destination


def partition_surface(surface: SurfaceMesh, ranks: int, split_above: int) -> IntArray:
    """Distribute the bodies of a surface mesh over ranks by their number of triangles.

    A body that is split is cut into strips across the coordinate axis along which it is longest,
    so that few triangles have neighbours on other ranks, however they are numbered.

    Args:
        surface: the mesh.
        ranks: number of ranks.
        split_above: as in `partition_bodies`.

    Returns:
        (m,) rank of each triangle.
    """
    counts = np.array([len(rows) for rows in surface.bodies.values()], dtype=np.int64)
    destination = np.empty(len(surface.triangles), dtype=np.int64)
    parts = partition_bodies(counts, ranks, split_above)
    for rows, part in zip(surface.bodies.values(), parts, strict=True):
        centres = surface.points[surface.triangles[rows]].mean(axis=1)
        along = centres[:, np.argmax(np.ptp(centres, axis=0))]
        destination[rows[np.argsort(along, kind="stable")]] = part
    return destination
