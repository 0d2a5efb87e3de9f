# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spring and damper about an axis."""

from collections.abc import Sequence

from flexfem import _checks
from flexfem._fields import declared, number
from flexfem.core.joint import AxisJoint, turn_angle
from flexfem.core.pose import Pose
from flexfem.core.row import Row, spring

__all__ = ["TorsionalSpringDamper"]


@declared
class TorsionalSpringDamper(AxisJoint):
    """Linear torsional spring and damper about an axis fixed in marker a.

    It exerts ``stiffness * (angle - rest_angle) + damping * d(angle)/dt`` (N m), the angle counted
    from the start over any number of turns.

    Attributes:
        stiffness: N m/rad.
        damping: N m s/rad.
        rest_angle: rad.

    Raises:
        TypeError: an argument is not a number.
        ValueError: stiffness or damping is negative, or both are zero.
    """

    stiffness: float = 0.0
    damping: float = 0.0
    rest_angle: float = number(default=0.0, as_given=True)

    def __post_init__(self) -> None:
        """Check that there is a spring or a damper."""
        super().__post_init__()
        _checks.stiffness_and_damping(self.owner, self.stiffness, self.damping)

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        law = spring(self.stiffness, self.damping)
        return (Row((turn_angle(self.direction, a, b),), self.rest_angle, law),)
