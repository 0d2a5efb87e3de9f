# SPDX-License-Identifier: LGPL-3.0-or-later
"""What series for ParaView hold: names of their fields, and the precision of their numbers."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["EVERYTHING", "FieldChoice"]

#: Arrays of a series whatever fields are chosen.
_ALWAYS = ("body", "joint", "section", "section_axes", "e1", "e2", "e3")


@dataclass(frozen=True)
class FieldChoice:
    """Fields to write, and their precision.

    Attributes:
        names: of the fields; None for all. Those that tell bodies, joints and sections are always
            written.
        precision: "single", "double", or "mixed": positions in double precision, fields in single.
    """

    names: frozenset[str] | None = None
    precision: str = "mixed"

    def __contains__(self, name: str) -> bool:
        """Return True if a field is to be written."""
        return self.names is None or name in self.names or name in _ALWAYS

    @property
    def of_fields(self) -> type[np.floating]:
        """Type of the numbers of fields."""
        return np.float64 if self.precision == "double" else np.float32

    @property
    def of_places(self) -> type[np.floating]:
        """Type of the coordinates of points."""
        return np.float32 if self.precision == "single" else np.float64

    def rounded(self, values: NDArray[np.floating]) -> NDArray[np.floating]:
        """Values of a field as they are written, contiguous; infinite where they are too large."""
        with np.errstate(over="ignore", under="ignore"):
            return np.ascontiguousarray(values, dtype=self.of_fields)


EVERYTHING = FieldChoice()
