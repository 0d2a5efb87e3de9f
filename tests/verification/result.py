# SPDX-License-Identifier: LGPL-3.0-or-later
"""One line of the verification table."""

from dataclasses import dataclass

__all__ = ["Result"]


@dataclass(frozen=True)
class Result:
    """A computed quantity beside its reference.

    Attributes:
        case: name of the benchmark.
        quantity: what is compared, with its unit.
        reference: number to compare with.
        source: where the reference comes from.
        ours: number computed here.
        mesh: discretisation in space and time.
        tolerance: largest error that passes.
        scale: size below which the reference does not count as one to divide by.
    """

    case: str
    quantity: str
    reference: float
    source: str
    ours: float
    mesh: str
    tolerance: float
    scale: float = 0.0

    @property
    def error(self) -> float:
        """Distance from the reference, relative to its size or to the scale; absolute for zero."""
        size = max(abs(self.reference), self.scale)
        return abs(self.ours - self.reference) / (size if size > 0.0 else 1.0)

    @property
    def passed(self) -> bool:
        """The error is admissible (a NaN is not)."""
        return self.error <= self.tolerance
