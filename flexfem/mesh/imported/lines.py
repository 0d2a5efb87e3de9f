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
    file: MeshFile,
    lines: Sequence[str] | None,
    points: Sequence[str] | None,
    separate: bool = False,
) -> LineData:
    """Return the lines in named element sets, with single nodes by name.

    Lines of second order are two lines with their middle nodes.

    Args:
        file: Contents of the file.
        lines: Element sets to take, None for all.
        points: Node sets to take, None for those of one node.
        separate: Give each group nodes of its own; those that it shared with others are points
            called GROUP_seam_1 and so on. A node set then names the node of the first group.

    Raises:
        TypeError: Names that are no list of strings.
        ValueError: No lines, a name that is not there, or separate groups that share lines.
    """
    sets = file.chosen("lines", 1, lines, disjoint=separate)
    group = np.full(len(file.dimensions), -1)
    for number, members in enumerate(sets.values()):
        group[members] = number
    pieces = [np.empty((0, 3), dtype=np.int64)]
    for kind, ends in (("line", [[0, 1]]), ("line3", [[0, 2], [2, 1]])):
        numbers = file.numbered(kind)
        for pair in ends:
            if len(numbers):
                pieces.append(np.column_stack([numbers, file.cells[kind][:, pair]]))
    rows = np.concatenate(pieces)
    rows = rows[group[rows[:, 0]] >= 0]
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    ends_at = rows[:, 1:]
    if separate:  # a node and a group make a node
        ends_at = ends_at * len(sets) + group[rows[:, :1]]
    keys, cells = np.unique(ends_at, return_inverse=True)
    nodes = keys // len(sets) if separate else keys
    used = np.zeros(len(file.points), dtype=np.bool_)
    used[nodes] = True
    named = {
        name: int(np.searchsorted(nodes, node))
        for name, node in file.one_nodes("points", points, used).items()
    }
    return LineData(
        file.points[nodes],
        cells.reshape(-1, 2),
        {name: _places(rows[:, 0], members) for name, members in sets.items()},
        named | (_seams(list(sets), nodes, keys % len(sets)) if separate else {}),
    )


def _places(numbers: IntArray, members: IntArray) -> IntArray:
    """Return where members are among ascending numbers; files may have a set for each element."""
    members = np.unique(members)
    first = np.searchsorted(numbers, members)
    counts = np.searchsorted(numbers, members, side="right") - first
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    places: IntArray = np.repeat(first, counts) + within
    return places


def _seams(names: Sequence[str], nodes: IntArray, groups: IntArray) -> dict[str, int]:
    """Return the nodes that groups shared, by names made of those of the groups."""
    _, place, times = np.unique(nodes, return_inverse=True, return_counts=True)
    shared = times[place.ravel()] > 1
    count = dict.fromkeys(names, 0)
    found = {}
    for row in np.flatnonzero(shared).tolist():
        name = names[groups[row]]
        count[name] += 1
        found[f"{name}_seam_{count[name]}"] = row
    return found
