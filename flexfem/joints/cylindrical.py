# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cylindrical joint."""

from dataclasses import dataclass

from flexfem.core.joint import AxisJoint, Row, line_guidance, parallelism
from flexfem.core.pose import Pose

__all__ = ["Cylindrical"]


@dataclass(frozen=True, eq=False)
class Cylindrical(AxisJoint):
    """Leaves translation along and rotation about a common axis; four constraints."""

    def rows(self, a: Pose, b: Pose, t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        return line_guidance(self.direction, a) + parallelism(self.direction, a, b)
