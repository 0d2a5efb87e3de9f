# SPDX-License-Identifier: LGPL-3.0-or-later
"""Changes of strain rates with places and rotations, which tangents of shells leave out.

Forces by strain rates ``r(y, v)`` are ``B^T D r`` with ``B = dr/dv``. Newton's method needs no
``B^T D dr/dy``, which is small for slow rotations; the linearised motion does. Derivatives by y are
differences, cell by cell: each cell has nodes of its own, whose unknowns move in all cells at once.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from flexfem._types import FloatArray, IndexArray
from flexfem.core.differences import central

__all__ = ["CellRates", "add_pairs", "own_nodes", "rate_tangents"]

#: Step of differences, in lengths of cells and in rad.
_STEP = 1e-3


class CellRates(Protocol):
    """Strain rates of cells with nodes of their own.

    Attributes:
        unknowns: number of unknowns of a cell, k.
        sizes: (m, k) lengths of cells, m, for translations, one for rotations.
    """

    unknowns: int
    sizes: FloatArray

    def moved(self, unknown: int, step: FloatArray) -> FloatArray:
        """Strain rates (m, s) where an unknown of each cell has moved by ``step`` (m,)."""
        ...

    def along(self, unknown: int) -> FloatArray:
        """Strain rates (m, s) by the rate of an unknown of each cell alone."""
        ...


def own_nodes(nodes: IndexArray) -> IndexArray:
    """Numbers (m, k) of as many nodes for each cell as it has, -1 for missing ones."""
    own = np.arange(nodes.size, dtype=np.int32).reshape(nodes.shape)
    found: IndexArray = np.where(nodes >= 0, own, -1).astype(np.int32)
    return found


def rate_tangents(rates: CellRates, stiffness: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``B^T D dr/dy`` and ``B`` of all cells, (m, k, k) and (m, s, k).

    Args:
        rates: of the strains.
        stiffness: D, (m, s, s), times areas.
    """
    sizes = rates.sizes
    changes = central(lambda j, part: rates.moved(j, part * sizes[:, j]), [_STEP] * rates.unknowns)
    changes /= sizes[:, np.newaxis]
    along = np.stack([rates.along(j) for j in range(rates.unknowns)], axis=-1)
    found: FloatArray = along.transpose(0, 2, 1) @ (stiffness @ changes)
    return found, along


def add_pairs(
    matrices: FloatArray, index: IndexArray, places: Sequence[tuple[int, int]], blocks: FloatArray
) -> None:
    """Add matrices (m, 3 j, 3 j) of cells to those of pairs of nodes (b, w, w).

    Args:
        matrices: of the cells, three unknowns after the other.
        index: numbers (m, i, i) of the pairs, -1 where a node is missing.
        places: node of a cell and its first unknown, of each three unknowns.
        blocks: matrices of the pairs.
    """
    for j, (a, row) in enumerate(places):
        for k, (b, column) in enumerate(places):
            there = index[:, a, b] >= 0
            own = matrices[there, 3 * j : 3 * j + 3, 3 * k : 3 * k + 3]
            np.add.at(blocks[:, row : row + 3, column : column + 3], index[there, a, b], own)
