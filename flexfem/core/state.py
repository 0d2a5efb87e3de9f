# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contents of a checkpoint, as arrays that do not depend on the number of ranks.

Whatever has a memory offers two methods: ``state()`` returns it, ``restore(...)`` takes it back.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray

__all__ = ["Numbering", "State", "counts"]


@dataclass(frozen=True)
class Numbering:
    """Global numbers of the rows of this rank's arrays in the arrays of the whole model.

    Attributes:
        numbers: (k,) row in the whole array, in the order of the model.
        owned: (k,) whether this rank writes the row; one rank does.
        size: rows of the whole array.
    """

    numbers: IntArray
    owned: BoolArray
    size: int


@dataclass(frozen=True)
class State:
    """State of a run, or of a part of it.

    Attributes:
        values: arrays that are the same on every rank (the first one's are written).
        rows: arrays (k, ...) of this rank by the name of their numbering and their own.
        optional: names of values that a file of the state may lack.
    """

    values: Mapping[str, FloatArray] = field(default_factory=dict)
    rows: Mapping[str, Mapping[str, FloatArray]] = field(default_factory=dict)
    optional: frozenset[str] = frozenset()

    def __or__(self, other: "State") -> "State":
        """Both together; no name may be used twice."""
        names = [*self.rows, *(name for name in other.rows if name not in self.rows)]
        rows = {name: {**self.rows.get(name, {}), **other.rows.get(name, {})} for name in names}
        return State({**self.values, **other.values}, rows, self.optional | other.optional)

    def misfit(self, found: "State") -> str:
        """Return a difference between a state read from a file and this one; empty if none.

        Names and shapes must be the same, but for the number of rows of arrays that are empty here:
        of events that have not happened yet, for example. Numbers must be finite where they are
        here.

        Args:
            found: this rank's part of the data read.
        """
        for name, mine in self.values.items():
            theirs = found.values.get(name)
            if name in self.optional and (theirs is None or not len(mine)):
                continue
            if theirs is None and not len(mine):
                continue
            if why := _misfit(name, mine, theirs, name not in self.optional):
                return why
        for group, arrays in self.rows.items():
            for name, mine in arrays.items():
                if why := _misfit(f"{group}/{name}", mine, found.rows[group].get(name), True):
                    return why
        for group, arrays in found.rows.items():
            for name, theirs in arrays.items():
                if not np.isfinite(theirs).all():
                    return f'"{group}/{name}" must be finite'
        return ""


def counts(name: str, values: FloatArray) -> list[int]:
    """Whole numbers that were written as a part of a state.

    Raises:
        ValueError: one is none, or negative.
    """
    numbers = [float(value) for value in values]
    for number in numbers:
        if not (number.is_integer() and 0.0 <= number < _MOST):
            raise ValueError(f'"{name}" must hold whole numbers that are not negative')
    return [int(number) for number in numbers]


#: Whole numbers up to here are exact.
_MOST = 2.0**53


def _misfit(name: str, mine: FloatArray, theirs: FloatArray | None, finite: bool) -> str:
    """Return the difference between two arrays as text."""
    if theirs is None:
        return f'it has no "{name}"'
    grows = mine.ndim > 0 and theirs.ndim == mine.ndim and not len(mine)
    if theirs.shape != mine.shape and not (grows and theirs.shape[1:] == mine.shape[1:]):
        return f'"{name}" has the shape {theirs.shape}, not {mine.shape}'
    if finite and not np.isfinite(theirs).all() and np.isfinite(mine).all():
        return f'"{name}" must be finite'
    return ""
