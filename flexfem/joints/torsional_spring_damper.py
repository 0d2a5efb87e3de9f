# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spring and damper about an axis."""

from collections.abc import Callable, Sequence

from flexfem import _checks
from flexfem._fields import declared, number
from flexfem.core.curves.curve import Curve
from flexfem.core.joint import AxisJoint, turn_angle
from flexfem.core.laws import Law, curve, spring
from flexfem.core.pose import Pose
from flexfem.core.row import Row

__all__ = ["TorsionalSpringDamper"]


@declared
class TorsionalSpringDamper(AxisJoint):
    """Torsional spring and damper about an axis fixed in marker a.

    It exerts ``stiffness * (angle - rest_angle) + preload + damping * d(angle)/dt`` (N m), the
    angle counted from the start over any number of turns. With ``backlash`` it is slack about the
    rest angle, and beyond as a ``LimitStop``.

    A function gives the moment in place of stiffness, damping and preload: ``moment(x)`` or
    ``moment(x, v)`` of the angle beyond rest (rad) and its rate (rad/s), or a `Curve`, as the force
    of a ``SpringDamper``.

    Attributes:
        stiffness: N m/rad.
        damping: N m s/rad.
        rest_angle: rad.
        preload: moment at the rest angle, N m.
        backlash: range of angles about the rest angle without moment, rad.
        moment: function or `Curve`, N m; None for the linear spring.

    Raises:
        TypeError: an argument is not a number, or no function.
        ValueError: stiffness, damping or backlash is negative, both former are zero, a preload or
            backlash without stiffness, or both; a function with other arguments, or beside
            stiffness, damping or preload.
    """

    stiffness: float = 0.0
    damping: float = 0.0
    rest_angle: float = number(default=0.0, as_given=True)
    preload: float = number(default=0.0)
    backlash: float = number(default=0.0, nonnegative=True)
    moment: Callable[..., float] | Curve | None = None

    def __post_init__(self) -> None:
        """Check that there is a spring or a damper."""
        super().__post_init__()
        if self.moment is not None:
            _checks.replaces(
                self.owner, "moment", stiffness=self.stiffness, damping=self.damping,
                preload=self.preload,
            )  # fmt: skip
            _ = self._law
            return
        _checks.stiffness_and_damping(self.owner, self.stiffness, self.damping)
        _checks.shaped_spring(self.owner, self.stiffness, self.preload, backlash=self.backlash)

    @property
    def _law(self) -> Law:
        if self.moment is None:
            return spring(self.stiffness, self.damping, backlash=self.backlash)
        return curve(self.owner, "moment", self.moment, backlash=self.backlash)

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        slack = self.preload / self.stiffness if self.preload else 0.0
        return (Row((turn_angle(self.direction, a, b),), self.rest_angle - slack, self._law),)
