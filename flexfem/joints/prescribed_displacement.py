# SPDX-License-Identifier: LGPL-3.0-or-later
"""Prescribed displacement along an axis."""

from collections.abc import Callable, Sequence
from typing import ClassVar

from flexfem import _checks
from flexfem._fields import declared, time_function
from flexfem.core.joint import AxisJoint, displacement
from flexfem.core.pose import Pose
from flexfem.core.row import Row

__all__ = ["PrescribedDisplacement"]


@declared
class PrescribedDisplacement(AxisJoint):
    """Drives the displacement of marker b from marker a along an axis; one constraint.

    Attributes:
        axis: direction fixed in marker a, inertial axes at the start.
        displacement: function of time (s), m; added to the position at the start.

    Raises:
        TypeError: the displacement is not a function.
        ValueError: its value at t = 0 is not a number.
    """

    displacement: Callable[[float], float] = time_function(default=lambda t: 0.0)

    driven: ClassVar[bool] = True

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        return (displacement(self.direction, poses[0], *self.targets(poses, t)),)

    def targets(self, poses: Sequence[Pose], t: float) -> tuple[float]:
        """See :meth:`Joint.targets`."""
        a, b = poses
        start = float(self.direction @ (b.position - a.position))
        return (start + _checks.returned_number("displacement", self.displacement(t)),)
