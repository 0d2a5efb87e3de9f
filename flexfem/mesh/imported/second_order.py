# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells of second order: whether they are straight, and the nodes that serendipity cells lack."""

import numpy as np

from flexfem._types import FloatArray, IntArray

__all__ = ["FULL_ORDER", "full_order", "is_straight"]

#: Kinds with all nodes of complete polynomials, by the kinds of second order.
FULL_ORDER = {
    "triangle6": "triangle6",
    "quad8": "quad9",
    "quad9": "quad9",
    "tetra10": "tetra10",
    "hexahedron20": "hexahedron27",
    "hexahedron27": "hexahedron27",
}

# Distance of a middle node from where it is in a straight cell, relative to the cell's size
_STRAIGHT = 1e-9

_EDGES = {
    "triangle6": ((0, 1), (1, 2), (2, 0)),
    "quad9": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra10": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "hexahedron27": (
        (0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4),
        (0, 4), (1, 5), (2, 6), (3, 7),
    ),
}  # fmt: skip
# Corners around the centres of faces and of the cell, in the order of VTK
_MIDDLES: dict[str, tuple[tuple[int, ...], ...]] = {
    "triangle6": (),
    "quad9": ((0, 1, 2, 3),),
    "tetra10": (),
    "hexahedron27": (
        (0, 3, 7, 4), (1, 2, 6, 5), (0, 1, 5, 4), (3, 2, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7),
        (0, 1, 2, 3, 4, 5, 6, 7),
    ),
}  # fmt: skip


def is_straight(points: FloatArray, kind: str, nodes: IntArray) -> bool:
    """Tell whether all further nodes are in the middle of their corners."""
    full = FULL_ORDER[kind]
    corners = [*_EDGES[full], *_MIDDLES[full]]
    count = len(corners) if kind == full else len(_EDGES[full])
    first = nodes.shape[1] - count
    size = np.ptp(points[nodes[:, :first]], axis=1).max(axis=1)
    for i in range(count):
        middle = points[nodes[:, list(corners[i])]].mean(axis=1)
        away = np.linalg.norm(points[nodes[:, first + i]] - middle, axis=1)
        if (away > _STRAIGHT * size).any():
            return False
    return True


def full_order(points: FloatArray, kind: str, nodes: IntArray) -> tuple[FloatArray, IntArray]:
    """Return points and cells with the central nodes that serendipity cells lack.

    These are where the shape functions of the cell have them, so that its form is the same: the
    polynomials of 8 and 20 nodes are among those of 9 and 27.
    """
    full = FULL_ORDER[kind]
    if full == kind:
        return points, nodes
    edges = _EDGES[full]
    corners = nodes.shape[1] - len(edges)
    places = []
    total = len(points)
    for around in _MIDDLES[full]:
        own = [corners + i for i, edge in enumerate(edges) if set(edge) <= set(around)]
        keys = np.sort(nodes[:, list(around)], axis=1)
        of_corners = points[nodes[:, list(around)]].sum(axis=1)
        of_edges = points[nodes[:, own]].sum(axis=1)
        # at the middle: corners -1/4 each, edges 1/2 in a quadrilateral and 1/4 in a hexahedron
        places.append((keys, (1.0 if len(around) == 8 else 2.0) / 4.0 * of_edges - of_corners / 4))
    points_added, new = _numbered(places)
    columns = [total + column for column in new]
    return np.concatenate([points, points_added]), np.column_stack([nodes, *columns])


def _numbered(
    places: list[tuple[IntArray, FloatArray]],
) -> tuple[FloatArray, list[IntArray]]:
    """Return the positions of new nodes, each once, and their numbers place by place."""
    width = max(keys.shape[1] for keys, _ in places)
    padded = [np.pad(keys, ((0, 0), (0, width - keys.shape[1])), constant_values=-1)
              for keys, _ in places]  # fmt: skip
    _, first, number = np.unique(
        np.concatenate(padded), axis=0, return_index=True, return_inverse=True
    )
    positions = np.concatenate([place for _, place in places])[first]
    return positions, np.split(number.ravel(), len(places))
