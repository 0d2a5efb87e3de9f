# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces that depend on both ends of a step, beside those of elements and joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from flexfem._types import FloatArray
from flexfem.system.system import Shifts

__all__ = ["StateChange", "StateFactors", "Unilateral"]


@dataclass(frozen=True)
class StateChange:
    """Change of the accepted state at the start of a step, for each block.

    Attributes:
        twists: (n_owned, w) local twists.
        rates: (n_owned, w) changes of the rates of increments.
    """

    twists: list[FloatArray]
    rates: list[FloatArray]


#: What multiplies such changes.
StateFactors = StateChange


class Unilateral(Protocol):
    """Derivatives of forces in the equations of the blocks, scaled as these."""

    def take(self, shifts: Shifts) -> None:
        """Compute them at the trial state at the end of a step, as evaluated last (collective)."""

    def add(self) -> None:
        """Add the change by the blocks' steps, local twists at the end, to the residuals.

        Those of ghosts are known. Collective.
        """

    def add_transposed(self) -> None:
        """Add the transposed :meth:`add` (collective)."""

    def add_start(self, change: StateChange) -> FloatArray:
        """Add the change by that of the start to the residuals; that of rows (r,) (collective)."""
        ...

    def start_transposed(self, z: list[FloatArray], mu: FloatArray) -> StateFactors:
        """Factors of changes of the start by those of the equations (collective)."""
