# SPDX-License-Identifier: LGPL-3.0-or-later
"""Point on a plane."""

from collections.abc import Sequence
from dataclasses import dataclass

from flexfem.core.joint import AxisJoint, displacement
from flexfem.core.pose import Pose
from flexfem.core.row import Row

__all__ = ["PointOnPlane"]


@dataclass(frozen=True, eq=False)
class PointOnPlane(AxisJoint):
    """Keeps marker b on the plane through marker a; one constraint.

    Attributes:
        axis: normal of the plane, fixed in marker a, given in inertial axes at the start.
    """

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        return (displacement(self.direction, poses[0]),)
