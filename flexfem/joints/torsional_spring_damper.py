# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spring and damper about an axis."""

from collections.abc import Sequence

from flexfem import _checks
from flexfem._fields import declared, number
from flexfem.core.joint import AxisJoint, turn_angle
from flexfem.core.laws import spring
from flexfem.core.pose import Pose
from flexfem.core.row import Row

__all__ = ["TorsionalSpringDamper"]


@declared
class TorsionalSpringDamper(AxisJoint):
    """Torsional spring and damper about an axis fixed in marker a.

    It exerts ``stiffness * (angle - rest_angle) + preload + damping * d(angle)/dt`` (N m), the
    angle counted from the start over any number of turns. With ``backlash`` it is slack about the
    rest angle, and beyond as a ``LimitStop``.

    Attributes:
        stiffness: N m/rad.
        damping: N m s/rad.
        rest_angle: rad.
        preload: moment at the rest angle, N m.
        backlash: range of angles about the rest angle without moment, rad.

    Raises:
        TypeError: an argument is not a number.
        ValueError: stiffness, damping or backlash is negative, both former are zero, a preload or
            backlash without stiffness, or both.
    """

    stiffness: float = 0.0
    damping: float = 0.0
    rest_angle: float = number(default=0.0, as_given=True)
    preload: float = number(default=0.0)
    backlash: float = number(default=0.0, nonnegative=True)

    def __post_init__(self) -> None:
        """Check that there is a spring or a damper."""
        super().__post_init__()
        _checks.stiffness_and_damping(self.owner, self.stiffness, self.damping)
        _checks.shaped_spring(self.owner, self.stiffness, self.preload, backlash=self.backlash)

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        law = spring(self.stiffness, self.damping, backlash=self.backlash)
        slack = self.preload / self.stiffness if self.preload else 0.0
        return (Row((turn_angle(self.direction, a, b),), self.rest_angle - slack, law),)
