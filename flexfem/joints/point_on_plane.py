# SPDX-License-Identifier: LGPL-3.0-or-later
"""Point on a plane."""

from dataclasses import dataclass

from flexfem.core.joint import AxisJoint, Row, RowKind
from flexfem.core.pose import Pose

__all__ = ["PointOnPlane"]


@dataclass(frozen=True, eq=False)
class PointOnPlane(AxisJoint):
    """Keeps marker b on the plane through marker a; one constraint.

    Attributes:
        axis: normal of the plane, fixed in marker a, given in inertial axes at the start.
    """

    def rows(self, a: Pose, b: Pose, t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        return (Row(RowKind.ALONG, u=a.rotation.T @ self.direction),)
