# SPDX-License-Identifier: LGPL-3.0-or-later
"""Keys of nodes that are the same on every rank."""

from collections.abc import Iterator, Sequence

import numpy as np

from flexfem._types import IntArray

__all__ = ["NodeKey", "by_kind"]

#: Number of a family and of a node in it.
NodeKey = tuple[int, int]


def by_kind(keys: Sequence[NodeKey]) -> Iterator[tuple[int, IntArray, IntArray]]:
    """Kinds of families, where their keys are, and their nodes."""
    kinds, nodes = np.array(keys, dtype=np.int64).reshape(-1, 2).T
    for kind in np.unique(kinds).tolist():
        at = np.flatnonzero(kinds == kind)
        yield kind, at, nodes[at]
