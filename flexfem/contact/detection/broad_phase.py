# SPDX-License-Identifier: LGPL-3.0-or-later
"""Broad phase of contact: boxes that overlap, found by a hashed uniform grid.

Every box of one set is entered in the cells of a grid that it overlaps; those of the other set are
compared with the boxes in their cells. The cells are hashed, so that the grid has no bounds, and
costs are proportional to the numbers of boxes and of pairs.

For 100, 900 and 10,000 nodes above a sheet of triangles a search takes 0.06, 0.82 and 21 ms, one by
SciPy's cKDTree of their centres, cut down to the same pairs, 0.15, 3.0 and 130 ms
(``tests/benchmarks/boxes_against_kdtree.py``).
"""

from collections.abc import Iterable

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.kernels.compiled import inlined, kernel

__all__ = ["enclosing", "overlaps", "touching", "triangle_boxes"]

#: Bits of a cell's number along one axis, three of which make one key.
_BITS = 21
#: Number of cells per box up to which the grid is as fine as the boxes are on average.
_CROWD = 64


def overlaps(
    low: FloatArray, high: FloatArray, other_low: FloatArray, other_high: FloatArray
) -> tuple[IntArray, IntArray]:
    """Find the boxes of another set that each box overlaps; fastest if the first are the smaller.

    Args:
        low: Lower corners, shape (n, 3), metres.
        high: Upper corners, shape (n, 3), metres.
        other_low: Lower corners of the other set, shape (m, 3), metres.
        other_high: Upper corners of the other set, shape (m, 3), metres.

    Returns:
        Where the row of each box begins, shape (n + 1,), and the boxes of the other set in it,
        ascending, shape (k,).
    """
    if not len(low) or not len(other_low):
        return np.zeros(len(low) + 1, np.int64), np.zeros(0, np.int64)
    box = enclosing([(low, high), (other_low, other_high)])
    origin, extent = box[0], float((box[1] - box[0]).max())
    size = max(_mean_side(other_low, other_high), extent / (1 << (_BITS - 1)), 1e-300)
    most = _CROWD * (len(low) + len(other_low))
    while True:
        place = np.append(origin, 1.0 / size)
        cells = _count_cells(low, high, place)
        if cells + _count_cells(other_low, other_high, place) <= most:
            break
        size *= 2.0
    buckets = 1 << int(np.ceil(np.log2(max(2 * cells, 16))))
    starts, keys = np.zeros(buckets + 1, np.int64), np.empty(cells, np.int64)
    boxes = np.empty(cells, np.int64)
    _fill_cells(low, high, place, starts, keys, boxes)
    rows, found = _pairs(low, high, other_low, other_high, place, starts, keys, boxes)
    return rows[:-1], found


@kernel
def triangle_boxes(
    points: FloatArray, triangles: IntArray, margins: FloatArray, low: FloatArray, high: FloatArray
) -> None:
    """Write the boxes (m, 3) of triangles, each enlarged by its margin."""
    for t in range(len(triangles)):
        for a in range(3):
            x0, x1 = points[triangles[t, 0], a], points[triangles[t, 1], a]
            x2 = points[triangles[t, 2], a]
            low[t, a] = min(x0, x1, x2) - margins[t]
            high[t, a] = max(x0, x1, x2) + margins[t]


def enclosing(sets: Iterable[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Box (2, 3) about sets of boxes, given by their corners (n, 3); its first row is the lower.

    Without any it touches nothing: its lower corner is above the other one.
    """
    box = np.array([[np.inf] * 3, [-np.inf] * 3])
    for low, high in sets:
        _enclose(low, high, box)
    return box


@kernel
def _enclose(low: FloatArray, high: FloatArray, box: FloatArray) -> None:
    """Enlarge a box (2, 3), whose rows are its corners, by boxes (n, 3)."""
    for b in range(len(low)):
        for a in range(3):
            box[0, a] = min(box[0, a], low[b, a])
            box[1, a] = max(box[1, a], high[b, a])


@kernel
def touching(low: FloatArray, high: FloatArray, box: FloatArray) -> BoolArray:
    """True for boxes (n, 3) that overlap a box (2, 3)."""
    found = np.empty(len(low), np.bool_)
    for b in range(len(low)):
        found[b] = True
        for a in range(3):
            found[b] &= low[b, a] <= box[1, a] and high[b, a] >= box[0, a]
    return found


@kernel
def _mean_side(low: FloatArray, high: FloatArray) -> float:
    """Mean of the longest sides of boxes (n, 3), m."""
    total = 0.0
    for b in range(len(low)):
        total += max(high[b, 0] - low[b, 0], high[b, 1] - low[b, 1], high[b, 2] - low[b, 2])
    return total / len(low)


@inlined
def _cell(x: float, origin: float, finer: float) -> int:
    return int((x - origin) * finer)


@inlined
def _bucket(i: int, j: int, k: int, buckets: int) -> int:
    """Bucket of a cell (Teschner and others, VMV 2003)."""
    return ((i * 73856093) ^ (j * 19349663) ^ (k * 83492791)) & (buckets - 1)


@kernel
def _count_cells(low: FloatArray, high: FloatArray, place: FloatArray) -> int:
    """Total number of cells that the boxes overlap.

    ``place`` (4,) is the origin of the grid, m, and the number of cells per length, 1/m.
    """
    origin, finer, total = place[:3], place[3], 0
    for b in range(len(low)):
        cells = 1
        for a in range(3):
            first, last = _cell(low[b, a], origin[a], finer), _cell(high[b, a], origin[a], finer)
            cells *= last - first + 1
        total += cells
    return total


@kernel
def _fill_cells(
    low: FloatArray, high: FloatArray, place: FloatArray, starts: IntArray, keys: IntArray,
    boxes: IntArray,
) -> None:  # fmt: skip
    """Sort the boxes by the buckets of their cells; ``starts`` is zero before."""
    origin, finer, buckets = place[:3], place[3], len(starts) - 1
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for fill in range(2):
        for b in range(len(low)):
            for a in range(3):
                first[a] = _cell(low[b, a], origin[a], finer)
                last[a] = _cell(high[b, a], origin[a], finer)
            for i in range(first[0], last[0] + 1):
                for j in range(first[1], last[1] + 1):
                    for k in range(first[2], last[2] + 1):
                        key = (((i << _BITS) + j) << _BITS) + k
                        to = _bucket(i, j, k, buckets)
                        if fill == 0:
                            starts[to + 1] += 1
                        else:
                            keys[starts[to]], boxes[starts[to]] = key, b
                            starts[to] += 1
        if fill == 0:
            for n in range(buckets):
                starts[n + 1] += starts[n]
    for n in range(buckets, 0, -1):
        starts[n] = starts[n - 1]
    starts[0] = 0


@kernel
def _pairs(
    low: FloatArray, high: FloatArray, other_low: FloatArray, other_high: FloatArray,
    place: FloatArray, starts: IntArray, keys: IntArray, boxes: IntArray,
) -> tuple[IntArray, IntArray]:  # fmt: skip
    """First pair of each box, with one more entry, and the other boxes of the pairs.

    They are counted, then written. A pair is counted in the cell with the lower corner of the
    intersection.
    """
    rows, found = np.zeros(len(low) + 2, np.int64), np.empty(0, np.int64)
    x, y, z, finer = place
    buckets = len(starts) - 1
    for fill in range(2):
        for o in range(len(other_low)):
            u0, u1, u2 = other_low[o, 0], other_low[o, 1], other_low[o, 2]
            v0, v1, v2 = other_high[o, 0], other_high[o, 1], other_high[o, 2]
            for i in range(_cell(u0, x, finer), _cell(v0, x, finer) + 1):
                for j in range(_cell(u1, y, finer), _cell(v1, y, finer) + 1):
                    for k in range(_cell(u2, z, finer), _cell(v2, z, finer) + 1):
                        key = (((i << _BITS) + j) << _BITS) + k
                        bucket = _bucket(i, j, k, buckets)
                        for e in range(starts[bucket], starts[bucket + 1]):
                            b = boxes[e]
                            if (
                                keys[e] == key
                                and _begins(low[b, 0], high[b, 0], u0, v0, x, finer, i)
                                and _begins(low[b, 1], high[b, 1], u1, v1, y, finer, j)
                                and _begins(low[b, 2], high[b, 2], u2, v2, z, finer, k)
                            ):
                                at = b + 2 - fill
                                if fill == 1:
                                    found[rows[at]] = o
                                rows[at] += 1
        if fill == 0:
            # rows[1:] has the starts, which become the ends in filling
            rows = np.cumsum(rows)
            found = np.empty(rows[-1], np.int64)
    return rows, found


@inlined
def _begins(
    low: float, high: float, other_low: float, other_high: float, origin: float, finer: float,
    cell: int,
) -> bool:  # fmt: skip
    """Return True if two intervals overlap and their overlap begins in a cell."""
    if low > other_high or other_low > high:
        return False
    return _cell(low if low > other_low else other_low, origin, finer) == cell
