# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a checkpoint holds of a run, as arrays that do not depend on the number of ranks.

Whatever has a memory offers two methods: ``state()`` returns it, ``restore(...)`` takes it back.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from flexfem._types import BoolArray, FloatArray, IntArray

__all__ = ["Numbering", "State"]


@dataclass(frozen=True)
class Numbering:
    """Where the rows of this rank's arrays are in the arrays of the whole model.

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
    """

    values: Mapping[str, FloatArray] = field(default_factory=dict)
    rows: Mapping[str, Mapping[str, FloatArray]] = field(default_factory=dict)

    def __or__(self, other: "State") -> "State":
        """Both together; no name may be used twice."""
        names = [*self.rows, *(name for name in other.rows if name not in self.rows)]
        rows = {name: {**self.rows.get(name, {}), **other.rows.get(name, {})} for name in names}
        return State({**self.values, **other.values}, rows)
