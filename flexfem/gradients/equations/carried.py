# SPDX-License-Identifier: LGPL-3.0-or-later
"""What is carried from one state of a motion to the next, or back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray

__all__ = ["Carried"]

#: Names of what is carried.
_NAMES = ("q", "v", "a", "w")


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
        return cls(*(np.zeros(shape) for _ in _NAMES))

    def add(self, other: Carried, factor: float) -> None:
        """Add a multiple of others; arrays that others may share are left alone."""
        for name in _NAMES:
            setattr(self, name, getattr(self, name) + factor * getattr(other, name))

    def product(self, other: Carried) -> float:
        """This rank's part of the sum of products with others."""
        return sum(float((getattr(self, n) * getattr(other, n)).sum()) for n in _NAMES)
