# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points on the lines of beams, for the markers of joints."""

from dataclasses import dataclass

from flexfem._types import IntArray
from flexfem.core.line_points import NURBS, SE3
from flexfem.system.line_cells import LineCells

__all__ = ["LinePoint", "Rail"]


@dataclass(frozen=True, eq=False)
class Rail:
    """Line of a beam whose nodes are at the interface of a rank.

    Attributes:
        cells: its elements.
        slots: (m, k) slots of their nodes.
    """

    cells: LineCells
    slots: IntArray

    @property
    def element(self) -> int:
        """How frames are interpolated, see ``core.line_points``."""
        return SE3 if self.cells.shape is None else NURBS


@dataclass(frozen=True, eq=False)
class LinePoint:
    """A marker on a line.

    Attributes:
        rail: the line.
        element: number of the element along the line.
        xi: coordinate in the element, 0 to 1.
        slides: it goes along the line with the other marker of its joint; ``element`` and ``xi``
            say where it starts.
    """

    rail: Rail
    element: int
    xi: float
    slides: bool = False
