# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arrays of all nodes of which rows are found when they are asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from flexfem._checks import InputError
from flexfem._types import IntArray

__all__ = ["node_rows"]


class _NodeRows:
    """Array (n, w) of which rows are indexed by numbers of nodes, and columns then."""

    def __init__(
        self, owner: str, shape: tuple[int, int], at: Callable[[IntArray], Any], columns: Any
    ) -> None:
        self._owner, self.shape, self._at, self._columns = owner, shape, at, columns

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, key: Any) -> Any:
        """Rows, or all rows with some columns."""
        if isinstance(key, tuple):
            rows, columns = key
            if isinstance(rows, slice) and rows == slice(None) and isinstance(columns, slice):
                width = len(range(*columns.indices(self.shape[1])))
                return _NodeRows(self._owner, (self.shape[0], width), self._at, columns)
            return self[rows][..., columns]
        if isinstance(key, slice):
            self.__array__()
        rows = np.asarray(key, dtype=np.int64)
        found = self._at(rows.ravel())[:, self._columns]
        return found.reshape(*rows.shape, found.shape[1])

    def __array__(self, *_: Any, **__: Any) -> Any:
        """Refuse to find all rows."""
        raise InputError(
            f"{self._owner}: this needs the places of all nodes, and of a stored mesh each rank "
            "reads its part; take the SolidMesh from which it was stored"
        )


def node_rows(owner: str, count: int, width: int, at: Callable[[IntArray], Any]) -> Any:
    """An array (n, w) of all nodes that is indexed as one of NumPy.

    Whoever needs all of it is refused, since it may not fit into memory.

    Args:
        owner: prefix of the message then.
        count: n.
        width: w.
        at: returns rows (k, w) of nodes (k,).
    """
    return _NodeRows(owner, (count, width), at, slice(None))
