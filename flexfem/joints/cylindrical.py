# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cylindrical joint."""

from collections.abc import Sequence
from dataclasses import dataclass

from flexfem.core.joint import AxisJoint, line_guidance, parallelism
from flexfem.core.pose import Pose
from flexfem.core.row import Row

__all__ = ["Cylindrical"]


@dataclass(frozen=True, eq=False)
class Cylindrical(AxisJoint):
    """Leaves translation along and rotation about a common axis; four constraints."""

    leaves = ("translation", "rotation")

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        return line_guidance(self.direction, a) + parallelism(self.direction, a, b)
