# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solid cells of different shapes cut into tetrahedra that fit together."""

import numpy as np

from flexfem._types import IntArray

__all__ = ["CELL_FACES", "cut_faces", "cut_solids"]

#: Corners of the faces of cells by their shape.
CELL_FACES: dict[str, tuple[tuple[int, ...], ...]] = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (0, 2, 3)),
    "pyramid": ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "hexahedron": (
        (0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0),
    ),
}  # fmt: skip


def cut_solids(shape: str, cells: IntArray) -> tuple[IntArray, IntArray]:
    """Return the tetrahedra of cells and the row of the cell that each is of.

    A cell is the pyramids of its lowest node over the faces without it, quadrilaterals being cut
    through their lowest node: both cells at a face cut it along the same diagonal (Dompierre,
    Labbé, Vallet and Camarero, How to subdivide pyramids, prisms and hexahedra into tetrahedra,
    Proceedings of the 8th International Meshing Roundtable, 1999).
    """
    top = cells.min(axis=1)
    pieces, rows = [np.empty((0, 4), dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    for corners in CELL_FACES[shape]:
        face = cells[:, corners]
        away = np.flatnonzero((face != top[:, np.newaxis]).all(axis=1))
        triangles, which = cut_faces(face[away])
        pieces.append(np.column_stack([triangles, top[away][which]]))
        rows.append(away[which])
    row = np.concatenate(rows)
    order = np.argsort(row, kind="stable")
    return np.concatenate(pieces)[order], row[order]


def cut_faces(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Return the triangles of faces, cut through their lowest node, and the row of each."""
    numbers = np.arange(len(faces))
    if faces.shape[1] == 3:
        return faces, numbers
    first = faces.argmin(axis=1)[:, np.newaxis]
    turned = np.take_along_axis(faces, (first + np.arange(4)) % 4, axis=1)
    return turned[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3), np.repeat(numbers, 2)
