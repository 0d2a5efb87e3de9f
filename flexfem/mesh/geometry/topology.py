# SPDX-License-Identifier: LGPL-3.0-or-later
"""Order of cells and nodes along lines.

Cells are pairs of node indices, shape (m, 2). The work per cell is done by NumPy; Python loops
run over stretches of cells that already follow one another, of which a mesh has few.
"""

from dataclasses import dataclass
from itertools import chain

import numpy as np

from flexfem._types import FloatArray, IntArray


@dataclass(frozen=True)
class Line:
    """Cells between two ends, corners included, without branching.

    Attributes:
        cells: Row numbers of the cells in the order of the line, shape (k,).
        reversed: True for each cell that runs against the line, shape (k,).
        nodes: Node indices in the order of the line, shape (k + 1,); the last equals the first
            on a closed line.
    """

    cells: IntArray
    reversed: np.typing.NDArray[np.bool_]
    nodes: IntArray


def edge_keys(pairs: IntArray, nodes: int) -> IntArray:
    """Return a number for each pair of nodes, whatever their order."""
    return pairs.min(axis=1) * nodes + pairs.max(axis=1)


def trace_lines(cells: IntArray) -> list[Line]:
    """Split cells into lines that end at free ends and at branching nodes.

    The direction of a line is that of its cell with the lowest row number; lines are sorted by
    that number. A closed line starts at that cell.

    Args:
        cells: Node indices, shape (m, 2).

    Returns:
        The lines; every cell belongs to exactly one.
    """
    if len(cells) == 0:
        return []
    first, last = _stretches(cells)
    paths = _link(np.column_stack([cells[first, 0], cells[last, 1]]))
    lines = [_line(cells, first, last, path) for path in paths]
    return sorted(lines, key=lambda line: int(line.cells.min()))


def group_order(cells: IntArray) -> IntArray | None:
    """Return the nodes of one line in order, or None when the cells branch or fall apart.

    The line runs in the direction of its first cell. On a closed line the first node is
    repeated at the end.

    Args:
        cells: Node indices, shape (m, 2).

    Returns:
        Node indices, shape (m + 1,), or None.
    """
    lines = trace_lines(cells)
    return lines[0].nodes if len(lines) == 1 else None


def orient(cells: IntArray) -> IntArray:
    """Return the cells with those reversed that run against the first cell of their line."""
    result = cells.copy()
    for line in trace_lines(cells):
        turned = line.cells[line.reversed]
        result[turned] = cells[turned, ::-1]
    return result


def arc_length(points: FloatArray) -> FloatArray:
    """Return the length of the polygon up to each of its points, shape (k,), from zero."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def meeting_ends(cells: IntArray) -> IntArray:
    """Return the pairs of ends that meet at nodes where no third one does.

    Args:
        cells: Node indices of first and second end, shape (m, 2).

    Returns:
        Ends, numbered 2 cell + side, shape (k, 2).
    """
    nodes = cells.ravel()
    order = np.argsort(nodes, kind="stable")
    starts = np.flatnonzero(np.diff(nodes[order], prepend=-1))
    counts = np.diff(np.append(starts, len(nodes)))
    pairs = starts[counts == 2]
    return np.column_stack([order[pairs], order[pairs + 1]])


def _stretches(cells: IntArray) -> tuple[IntArray, IntArray]:
    """Return first and last row of the stretches of cells that follow one another head to tail."""
    passing = np.bincount(cells.ravel()) == 2
    follows = (cells[:-1, 1] == cells[1:, 0]) & passing[cells[:-1, 1]]
    breaks = np.flatnonzero(~follows)
    first = np.concatenate([[0], breaks + 1]).astype(np.int64)
    last = np.concatenate([breaks, [len(cells) - 1]]).astype(np.int64)
    return first, last


def _link(ends: IntArray) -> list[IntArray]:
    """Join stretches, given by their end nodes (k, 2), across the nodes where just two meet.

    A path through stretch k is numbered 2 k forwards and 2 k + 1 backwards: the end that it leaves
    from. The reverse path has the last bit flipped.

    Returns:
        Paths in order, one array for each line.
    """
    pairs = meeting_ends(ends)
    follower = np.full(2 * len(ends), -1)
    follower[pairs[:, 0] ^ 1] = pairs[:, 1]
    follower[pairs[:, 1] ^ 1] = pairs[:, 0]
    following = follower.tolist()
    free = np.flatnonzero(follower[np.arange(len(follower)) ^ 1] < 0)
    used = [False] * len(ends)
    paths = []
    # The rest, after the lines with free ends, are closed lines
    for start in chain(free.tolist(), range(0, 2 * len(ends), 2)):
        path = []
        way = start
        while way >= 0 and not used[way >> 1]:
            used[way >> 1] = True
            path.append(way)
            way = following[way]
        if path:
            paths.append(np.array(path, dtype=np.int64))
    return paths


def _line(cells: IntArray, first: IntArray, last: IntArray, path: IntArray) -> Line:
    """Return the line along the given paths, in the direction of its lowest cell."""
    if path[np.argmin(path)] & 1:
        path = path[::-1] ^ 1
    stretch = path >> 1
    lengths = last[stretch] - first[stretch] + 1
    step = np.arange(lengths.sum()) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    turned = np.repeat((path & 1).astype(bool), lengths)
    rows = np.where(
        turned, np.repeat(last[stretch], lengths) - step, np.repeat(first[stretch], lengths) + step
    )
    start = np.where(turned, cells[rows, 1], cells[rows, 0])
    end = cells[rows[-1], 0 if turned[-1] else 1]
    if start[0] == end:
        shift = -int(np.argmin(rows))
        rows, turned, start = (np.roll(values, shift) for values in (rows, turned, start))
        end = start[0]
    return Line(rows, turned, np.append(start, end))
