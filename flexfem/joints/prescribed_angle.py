# SPDX-License-Identifier: LGPL-3.0-or-later
"""Prescribed relative angle."""

from collections.abc import Callable, Sequence
from typing import ClassVar

from flexfem import _checks
from flexfem._fields import declared, time_function
from flexfem.core.joint import AxisJoint, turn_angle
from flexfem.core.pose import Pose
from flexfem.core.row import Row

__all__ = ["PrescribedAngle"]


@declared
class PrescribedAngle(AxisJoint):
    """Drives the angle by which marker b has rotated relative to marker a; one constraint.

    It holds over any number of turns. Combine it with a joint that keeps the axis, such as
    ``Revolute`` or ``Cylindrical``.

    Attributes:
        angle: function of time (s), rad, counted from the start.

    Raises:
        TypeError: the angle is not a function.
        ValueError: its value at t = 0 is not a number.
    """

    angle: Callable[[float], float] = time_function(default=lambda t: 0.0)

    driven: ClassVar[bool] = True

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        return (Row((turn_angle(self.direction, a, b),), *self.targets(poses, t)),)

    def targets(self, poses: Sequence[Pose], t: float) -> tuple[float]:
        """See :meth:`Joint.targets`."""
        return (_checks.returned_number("angle", self.angle(t)),)
