# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid rod between two points."""

from collections.abc import Sequence
from dataclasses import dataclass

from flexfem.core.joint import Joint, distance
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["Distance"]


@dataclass(frozen=True, eq=False)
class Distance(Joint):
    """Massless rigid rod with ball joints: keeps the distance of two points; one constraint.

    The multiplier is the tension of the rod (N).
    """

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`; raises ValueError when both markers start at one point."""
        return (Row((Term(RowKind.DISTANCE),), distance(self.owner, poses)),)
