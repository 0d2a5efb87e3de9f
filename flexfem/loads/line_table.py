# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vectors along a beam, piecewise linear."""

from typing import Any

import numpy as np

from flexfem import _checks
from flexfem._fields import Array, checked, declared
from flexfem._types import FloatArray

__all__ = ["LineTable"]


def _ascending(owner: str, what: str, value: Any) -> FloatArray:
    """Return checked places."""
    places = _checks.array(owner, what, value, (-1,))
    if len(places) < 2 or (np.diff(places) < 0.0).any():
        raise ValueError(
            f"LineTable: places must be at least two that ascend, got {_checks.show(value)}"
        )
    return places


@declared
class LineTable:
    """Piecewise linear vector along a beam, zero before the first and after the last place.

    Two equal places make a jump. Loads are integrated piece by piece, so that kinks and jumps may
    lie anywhere in the elements.

    Attributes:
        places: Ascending places along the beam, shape (n,), m or fractions of the length.
        values: Vectors there, shape (n, 3).

    Raises:
        TypeError: An argument does not consist of numbers.
        ValueError: Fewer than two places, another number of values, NaN, or places that descend.
    """

    places: Array = checked(_ascending)
    values: Array

    def __post_init__(self) -> None:
        """Check that there is a vector for each place."""
        shape = (len(self.places), 3)
        _checks.assign(self, values=_checks.array("LineTable", "values", self.values, shape))

    @property
    def breakpoints(self) -> FloatArray:
        """Places of kinks and jumps, ascending."""
        return np.unique(self.places)

    def __call__(self, place: float) -> FloatArray:
        """Return the vector (3,) at a place; at a jump the value after it."""
        if not self.places[0] <= place <= self.places[-1]:
            return np.zeros(3)
        k = min(int(np.searchsorted(self.places, place, side="right")), len(self.places) - 1)
        low, high = self.places[k - 1 : k + 1]
        share = 1.0 if high == low else (place - low) / (high - low)
        value: FloatArray = (1.0 - share) * self.values[k - 1] + share * self.values[k]
        return value
