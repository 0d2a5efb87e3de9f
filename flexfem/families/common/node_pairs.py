# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pairs of nodes that triangles couple: their matrices are summed before assembly."""

from collections.abc import Sequence

import numpy as np

from flexfem._types import IndexArray, IntArray

__all__ = ["NodePairs"]


class NodePairs:
    """All pairs of nodes that occur in some elements, and those of every node with itself.

    Attributes:
        rows, columns: (k,) nodes of the pairs.
        diagonal: (n,) number of the pair of each node with itself.
        index: numbers (m, p, p) of the pairs in each group of elements, -1 for missing nodes.
    """

    def __init__(self, count: int, groups: Sequence[IndexArray]) -> None:
        """Number the pairs.

        Args:
            count: number of nodes n.
            groups: nodes (m, p) of the elements of each group, -1 for missing ones.
        """
        keys = [_keys(count, nodes.astype(np.int64)) for nodes in groups]
        own: IntArray = np.arange(count) * (count + 1)
        known = np.unique(np.concatenate([own, *(key.ravel() for key in keys)]))
        known = known[known >= 0]
        self.rows, self.columns = known // count, known % count
        self.diagonal = np.searchsorted(known, own)
        self.index = [
            np.where(key >= 0, np.searchsorted(known, key), -1).astype(np.int32) for key in keys
        ]

    @property
    def couplings(self) -> list[tuple[IndexArray, IndexArray]]:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return [(self.rows[:, np.newaxis], self.columns[:, np.newaxis])]


def _keys(count: int, nodes: IntArray) -> IntArray:
    """Numbers (m, p, p) of all pairs of the nodes of elements, -1 where one is missing."""
    first, second = nodes[:, :, np.newaxis], nodes[:, np.newaxis]
    keys: IntArray = np.where((first >= 0) & (second >= 0), first * count + second, -1)
    return keys
