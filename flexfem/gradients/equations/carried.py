# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is carried from one state of a motion to the next, or back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray

__all__ = ["CARRIED", "Carried"]

#: Names of what is carried.
CARRIED = ("q", "v", "a", "w")


@dataclass
class Carried:
    """Sums of all later influences on the owned nodes of a block, or their changes, (n, w)."""

    q: FloatArray
    v: FloatArray
    a: FloatArray
    w: FloatArray

    @classmethod
    def nothing(cls, shape: tuple[int, ...]) -> Carried:
        """Zeros."""
        return cls(*(np.zeros(shape) for _ in range(4)))
