# SPDX-License-Identifier: LGPL-3.0-or-later
"""Revolute joint."""

from dataclasses import dataclass

from flexfem.core.joint import AxisJoint, Row, coincidence, parallelism
from flexfem.core.pose import Pose

__all__ = ["Revolute"]


@dataclass(frozen=True, eq=False)
class Revolute(AxisJoint):
    """Leaves one rotation about a common axis; five constraints."""

    def rows(self, a: Pose, b: Pose, t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        return coincidence() + parallelism(self.direction, a, b)
