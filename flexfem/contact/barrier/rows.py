# SPDX-License-Identifier: LGPL-3.0-or-later
"""Closed contacts as springs beside the factors of the bodies, one for each group of pairs.

The tangent of a group is close to ``s J^T J`` with one row J: its forces move together. Single
pairs of a group, such as the edges of a surface under a vertex, have negative slopes; their sum has
none.
"""

from collections.abc import Sequence

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.barrier.pairs import ContactPairs
from flexfem.contact.carriers import Carriers
from flexfem.contact.primitives.data import NORMAL, SLOPE, WEIGHTS
from flexfem.kernels.compiled import kernel

__all__ = ["GroupRows"]


class GroupRows:
    """Rows of the groups that act on this rank at the last evaluation; a ``SpringRows``.

    Attributes:
        slopes: derivative (c,) of each force by its motion, N/m.
    """

    def __init__(self, carriers: Carriers) -> None:
        """Store the points; no rows."""
        self._carriers = carriers
        self._steps, self._forces = np.zeros((2, len(carriers.serial.start), 3))
        self.take([], 1.0)

    def take(self, contacts: Sequence[ContactPairs], factor: float) -> None:
        """Make the rows of all contacts, with ``factor`` times their slopes."""
        made = [_group_rows(one) for one in contacts]
        none = np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0)
        counts, points, vectors, slopes = (
            np.concatenate(parts) for parts in zip(none, *made, strict=True)
        )
        self.slopes = factor * slopes
        self._starts = np.concatenate([[0], np.cumsum(counts)])
        self._points, self._vectors = points, vectors

    def motions(self) -> FloatArray:
        """See ``SpringRows``."""
        self._carriers.move(self._steps)
        found = np.empty(len(self.slopes))
        _motions_into(self._starts, self._points, self._vectors, self._steps, found)
        return found

    def push(self, forces: FloatArray) -> None:
        """See ``SpringRows``."""
        self._forces[:] = 0.0
        _spread(self._starts, self._points, self._vectors, forces, self._forces)
        self._carriers.gather(self._forces)
        for kind in self._carriers.by_kind:
            self._carriers.add_forces(kind, self._forces)


def _group_rows(contact: ContactPairs) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Numbers of points of each row, the points, their vectors (k, 3), and the slopes.

    The row of a group is the mean of those of its pairs, weighted by their slopes.
    """
    count = contact.count
    numbers, groups = contact.response.numbers[:count], contact.groups
    of_pairs = numbers[:, SLOPE]
    begins = np.flatnonzero(np.diff(groups, prepend=-1))
    slopes = np.add.reduceat(of_pairs, begins) if count else np.zeros(0)
    stiff = slopes > 0.0
    sizes = np.diff(np.append(begins, count))
    kept = np.repeat(stiff, sizes)
    share = np.where(kept, of_pairs / np.repeat(np.where(stiff, slopes, 1.0), sizes), 0.0)
    vectors = numbers[:, WEIGHTS : WEIGHTS + 4, np.newaxis] * numbers[:, np.newaxis,
                                                                     NORMAL : NORMAL + 3]
    vectors *= share[:, np.newaxis, np.newaxis]
    points = contact.pairs.points[contact.response.pairs[:count]]
    return 4 * sizes[stiff], points[kept].ravel(), vectors[kept].reshape(-1, 3), slopes[stiff]


@kernel
def _motions_into(
    starts: IntArray, points: IntArray, vectors: FloatArray, steps: FloatArray, out: FloatArray
) -> None:
    """Write the sums of products of vectors and steps (n, 3) of each row."""
    for c in range(len(out)):
        total = 0.0
        for k in range(starts[c], starts[c + 1]):
            for a in range(3):
                total += vectors[k, a] * steps[points[k], a]
        out[c] = total


@kernel
def _spread(
    starts: IntArray, points: IntArray, vectors: FloatArray, forces: FloatArray,
    sums: FloatArray,
) -> None:  # fmt: skip
    """Add forces along the rows to those on the points (n, 3)."""
    for c in range(len(forces)):
        for k in range(starts[c], starts[c + 1]):
            for a in range(3):
                sums[points[k], a] += forces[c] * vectors[k, a]
