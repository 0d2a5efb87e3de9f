# SPDX-License-Identifier: LGPL-3.0-or-later
"""Point on a line."""

from dataclasses import dataclass

from flexfem.core.joint import AxisJoint, Row, line_guidance
from flexfem.core.pose import Pose

__all__ = ["PointOnLine"]


@dataclass(frozen=True, eq=False)
class PointOnLine(AxisJoint):
    """Keeps marker b on the line through marker a along an axis fixed in a; two constraints."""

    def rows(self, a: Pose, b: Pose, t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        return line_guidance(self.direction, a)
