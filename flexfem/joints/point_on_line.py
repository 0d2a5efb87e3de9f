# SPDX-License-Identifier: LGPL-3.0-or-later
"""Point on a line."""

from collections.abc import Sequence
from dataclasses import dataclass

from flexfem.core.joint import AxisJoint, line_guidance
from flexfem.core.pose import Pose
from flexfem.core.row import Row

__all__ = ["PointOnLine"]


@dataclass(frozen=True, eq=False)
class PointOnLine(AxisJoint):
    """Keeps marker b on the line through marker a along an axis fixed in a; two constraints."""

    leaves = ("translation",)

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        return line_guidance(self.direction, poses[0])
