# SPDX-License-Identifier: LGPL-3.0-or-later
"""Massless link with a hinge at one end and a ball at the other."""

from collections.abc import Sequence
from dataclasses import dataclass

from flexfem.core.joint import AxisJoint, displacement, distance
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["RevoluteSpherical"]


@dataclass(frozen=True, eq=False)
class RevoluteSpherical(AxisJoint):
    """Rigid massless link: a revolute joint at marker a, a spherical one at marker b.

    Marker b stays in the plane through marker a normal to the axis, at the distance of the start:
    on a circle about the axis. Two constraints, where the link as a body would have six unknowns
    and eight constraints (Haug, Computer Aided Kinematics and Dynamics of Mechanical Systems,
    1989, section 9.4). The multipliers are the force along the axis and the tension (N).

    Attributes:
        axis: of the hinge, fixed in marker a, given in inertial axes at the start.
    """

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`; raises ValueError when both markers start at one point."""
        in_plane = displacement(self.direction, poses[0])
        return in_plane, Row((Term(RowKind.DISTANCE),), distance(self.owner, poses))
