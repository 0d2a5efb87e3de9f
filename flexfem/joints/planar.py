# SPDX-License-Identifier: LGPL-3.0-or-later
"""Planar joint."""

from collections.abc import Sequence
from dataclasses import dataclass

from flexfem.core.joint import AxisJoint, displacement, parallelism
from flexfem.core.pose import Pose
from flexfem.core.row import Row

__all__ = ["Planar"]


@dataclass(frozen=True, eq=False)
class Planar(AxisJoint):
    """Leaves translations in a plane and the rotation about its normal; three constraints.

    Attributes:
        axis: normal of the plane, which passes through marker a and is fixed in it, given in
            inertial axes at the start.
    """

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        return (displacement(self.direction, a), *parallelism(self.direction, a, b))
