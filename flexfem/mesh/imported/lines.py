# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lines of a mesh file."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.mesh.imported.mesh_file import MeshFile

__all__ = ["LineData", "line_data"]


class LineData(NamedTuple):
    """Arguments of a LineMesh."""

    points: FloatArray
    cells: IntArray
    line_groups: Mapping[str, IntArray]
    point_groups: Mapping[str, int]


def line_data(
    file: MeshFile, lines: Sequence[str] | None, points: Sequence[str] | None
) -> LineData:
    """Return the lines in named element sets, with single nodes by name.

    Lines of second order are two lines with their middle nodes.

    Raises:
        TypeError: Names that are no list of strings.
        ValueError: No lines, or a name that is not there.
    """
    sets = file.chosen("lines", 1, lines, disjoint=False)
    count = len(file.dimensions)
    taken = np.zeros(count, dtype=np.bool_)
    taken[np.concatenate(list(sets.values()))] = True
    pieces = [np.empty((0, 3), dtype=np.int64)]
    for kind, ends in (("line", [[0, 1]]), ("line3", [[0, 2], [2, 1]])):
        numbers = file.numbered(kind)
        for pair in ends:
            if len(numbers):
                pieces.append(np.column_stack([numbers, file.cells[kind][:, pair]]))
    rows = np.concatenate(pieces)
    rows = rows[taken[rows[:, 0]]]
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    nodes, cells = np.unique(rows[:, 1:], return_inverse=True)
    used = np.zeros(len(file.points), dtype=np.bool_)
    used[nodes] = True
    named = file.one_nodes("points", points, used)
    return LineData(
        file.points[nodes],
        cells.reshape(-1, 2),
        {name: np.flatnonzero(np.isin(rows[:, 0], members)) for name, members in sets.items()},
        {name: int(np.searchsorted(nodes, node)) for name, node in named.items()},
    )
