# SPDX-License-Identifier: LGPL-3.0-or-later
"""Revolute joint."""

from collections.abc import Sequence
from dataclasses import dataclass

from flexfem.core.joint import AxisJoint, coincidence, parallelism
from flexfem.core.pose import Pose
from flexfem.core.row import Row

__all__ = ["Revolute"]


@dataclass(frozen=True, eq=False)
class Revolute(AxisJoint):
    """Leaves one rotation about a common axis; five constraints."""

    leaves = ("rotation",)

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        return coincidence() + parallelism(self.direction, a, b)
