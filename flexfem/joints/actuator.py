# SPDX-License-Identifier: LGPL-3.0-or-later
"""Actuator: a force or torque between two markers as a function of time."""

from collections.abc import Callable, Sequence
from typing import ClassVar

from flexfem import _checks
from flexfem._fields import declared, one_of, time_function
from flexfem.core.joint import AxisJoint, distance, turn_angle
from flexfem.core.laws import applied
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["Actuator"]

_MOTIONS = ("rotation", "translation", "distance")


@declared
class Actuator(AxisJoint):
    """Drives marker b against marker a by a torque about an axis, or a force along it.

    A positive one increases the angle by which b has rotated from a, the displacement of b from a,
    or their distance; the reaction acts on a. It constrains nothing: combine it with the joint that
    leaves the motion. Its multiplier is the force with the opposite sign, as that of a spring.

    Attributes:
        axis: fixed in marker a, inertial axes at the start.
        motion: "rotation" for a torque about the axis, "translation" for a force along it,
            "distance" for one along the line between the markers, which need no axis.
        force: function of time (s), N m or N; a `Table` is one. A force by the motion is a
            ``CustomForce``, or that of a ``Controller``.

    Raises:
        TypeError: the force is not a function.
        ValueError: an unknown motion, or the force at t = 0 is not a number.
    """

    motion: str = one_of(_MOTIONS, default="rotation")
    force: Callable[[float], float] = time_function(default=lambda t: 0.0)

    driven: ClassVar[bool] = True

    def coordinate(self, poses: Sequence[Pose]) -> Term:
        """The angle (rad), displacement (m) or distance (m) that it acts on.

        Raises:
            ValueError: the distance is zero at the start.
        """
        a, b = poses
        if self.motion == "rotation":
            return turn_angle(self.direction, a, b)
        if self.motion == "distance":
            distance(self.owner, poses)
            return Term(RowKind.DISTANCE)
        return Term(RowKind.ALONG, u=a.rotation.T @ self.direction)

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        return (Row((self.coordinate(poses),), 0.0, applied(*self.applied(t))),)

    def applied(self, t: float) -> tuple[float]:
        """See :meth:`Joint.applied`."""
        return (-_checks.returned_number("force", self.force(t)),)
