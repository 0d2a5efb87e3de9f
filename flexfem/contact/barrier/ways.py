# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ways of points from one trial state to the next."""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.kernels.compiled import kernel

__all__ = ["farthest", "leaves", "moves", "short_part"]


@kernel
def farthest(before: FloatArray, after: FloatArray, known: BoolArray) -> float:
    """Largest way of the known points, m."""
    most = 0.0
    for i in range(len(known)):
        if known[i]:
            square = 0.0
            for a in range(3):
                square += (after[i, a] - before[i, a]) ** 2
            most = max(most, square)
    return float(np.sqrt(most))


def moves(before: FloatArray, after: FloatArray, rows: IntArray) -> bool:
    """True if one of some points moves."""
    return not np.array_equal(before[rows], after[rows])


def short_part(before: FloatArray, after: FloatArray, known: BoolArray, longest: float) -> float:
    """Part of a motion in which no known point moves farther than ``longest``."""
    way = farthest(before, after, known)
    return longest / way if way > longest else 1.0


@kernel
def leaves(points: FloatArray, low: FloatArray, high: FloatArray, known: BoolArray) -> bool:
    """True if a known point is outside of its box, or nowhere."""
    for i in range(len(known)):
        if known[i]:
            for a in range(3):
                if not low[i, a] <= points[i, a] <= high[i, a]:
                    return True
    return False
