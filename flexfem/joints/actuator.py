# SPDX-License-Identifier: LGPL-3.0-or-later
"""Actuator: a force or torque between two markers as a function of time."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from flexfem import _checks
from flexfem.core.joint import AxisJoint, distance, turn_angle
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term, applied

__all__ = ["Actuator"]

_MOTIONS = ("rotation", "translation", "distance")


@dataclass(frozen=True, eq=False)
class Actuator(AxisJoint):
    """Drives marker b against marker a by a torque about an axis, or a force along it.

    A positive one increases the angle by which b has turned from a, the displacement of b from a,
    or their distance; a bears the reaction. It holds nothing: combine it with the joint that leaves
    the motion. Its multiplier is the force with the opposite sign, as that of a spring.

    Attributes:
        axis: fixed in marker a, inertial axes at the start.
        motion: "rotation" for a torque about the axis, "translation" for a force along it,
            "distance" for one along the line between the markers, which need no axis.
        force: function of time (s), N m or N.
    """

    motion: str = "rotation"
    force: Callable[[float], float] = lambda t: 0.0

    driven: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Check motion and function.

        Raises:
            TypeError: the force is not a function.
            ValueError: an unknown motion, or the force at t = 0 is not a number.
        """
        super().__post_init__()
        if self.motion not in _MOTIONS:
            raise ValueError(
                f"{self.owner}: motion must be one of {', '.join(_MOTIONS)}, got "
                f"{_checks.show(self.motion)}"
            )
        _checks.function(self.owner, "force", self.force, ())

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
        force = _checks.returned_number("force", self.force(t))
        return (Row((self.coordinate(poses),), 0.0, applied(-force)),)
