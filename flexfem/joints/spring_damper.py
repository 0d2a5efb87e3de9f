# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spring and damper between two points."""

from collections.abc import Sequence

from flexfem import _checks
from flexfem._fields import declared, flag, number
from flexfem.core.joint import Joint, distance
from flexfem.core.laws import spring
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["SpringDamper"]


@declared
class SpringDamper(Joint):
    """Spring and damper along the line between two markers.

    It pulls with ``stiffness * (length - rest_length) + preload + damping * d(length)/dt`` (N) and
    enters the equations as a constraint with compliance, so that any stiffness leaves the frozen
    factors of the bodies as they are. One that is slack, by ``tension_only`` or ``backlash``, pulls
    or presses with ``k d (1 + tanh(c v / (k d)))`` where it is stretched or compressed beyond that
    by d at the rate v, as a ``LimitStop``: its damper acts softly at first, and never reverses it.

    Attributes:
        stiffness: N/m.
        damping: N s/m.
        rest_length: m; None for the distance at the start.
        preload: force at the rest length, N; positive for tension.
        tension_only: True for a cable, which is slack where the spring would press.
        backlash: range of lengths about the rest length without force, m.

    Raises:
        TypeError: an argument is not a number, or no truth value.
        ValueError: stiffness, damping, rest length or backlash is negative, both former are zero, a
            preload, backlash or cable without stiffness, or a backlash with one of the others.
    """

    stiffness: float = 0.0
    damping: float = 0.0
    rest_length: float | None = number(default=None, nonnegative=True, as_given=True)
    preload: float = number(default=0.0)
    tension_only: bool = flag(default=False)
    backlash: float = number(default=0.0, nonnegative=True)

    def __post_init__(self) -> None:
        """Check that there is a spring or a damper."""
        super().__post_init__()
        _checks.stiffness_and_damping(self.owner, self.stiffness, self.damping)
        _checks.shaped_spring(
            self.owner, self.stiffness, self.preload,
            tension_only=self.tension_only, backlash=self.backlash,
        )  # fmt: skip

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`; raises ValueError when both markers start at one point."""
        length = distance(self.owner, poses)
        rest = length if self.rest_length is None else self.rest_length
        slack = self.preload / self.stiffness if self.preload else 0.0
        law = spring(
            self.stiffness, self.damping, backlash=self.backlash, tension_only=self.tension_only
        )
        return (Row((Term(RowKind.DISTANCE),), rest - slack, law),)
