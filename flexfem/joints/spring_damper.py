# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spring and damper between two points."""

from collections.abc import Callable, Sequence

from flexfem import _checks
from flexfem._fields import declared, flag, number
from flexfem.core.curves.curve import Curve
from flexfem.core.joint import Joint, distance
from flexfem.core.laws import Law, curve, press, spring
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

    In place of stiffness, damping and preload a function gives the force by the stretch x (m) and,
    if wanted, its rate v (m/s): ``force(x)`` or ``force(x, v)``, or a `Curve`. ``force(x, 0)`` is
    elastic, and its integral is strain energy; what v adds is dissipated. Slack springs give it the
    stretch beyond the slack range.

    Attributes:
        stiffness: N/m.
        damping: N s/m.
        rest_length: m; None for the distance at the start.
        preload: force at the rest length, N; positive for tension.
        tension_only: True for a cable, which is slack where the spring would press.
        backlash: range of lengths about the rest length without force, m.
        force: function made by def or lambda, compiled with its derivatives, or a `Curve`; N,
            positive for tension. None for the linear spring.

    Raises:
        TypeError: an argument is not a number, or no truth value, or no function.
        ValueError: stiffness, damping, rest length or backlash is negative, both former are zero, a
            preload, backlash or cable without stiffness, or a backlash with one of the others; a
            function with other arguments, or beside stiffness, damping or preload.
    """

    stiffness: float = 0.0
    damping: float = 0.0
    rest_length: float | None = number(default=None, nonnegative=True, as_given=True)
    preload: float = number(default=0.0)
    tension_only: bool = flag(default=False)
    backlash: float = number(default=0.0, nonnegative=True)
    force: Callable[..., float] | Curve | None = None

    def __post_init__(self) -> None:
        """Check that there is a spring or a damper."""
        super().__post_init__()
        if self.force is not None:
            _checks.replaces(
                self.owner, "force", stiffness=self.stiffness, damping=self.damping,
                preload=self.preload,
            )  # fmt: skip
            if self.tension_only and self.backlash:
                raise ValueError(f"{self.owner}: backlash excludes tension_only")
            _ = self._law
            return
        _checks.stiffness_and_damping(self.owner, self.stiffness, self.damping)
        _checks.shaped_spring(
            self.owner, self.stiffness, self.preload,
            tension_only=self.tension_only, backlash=self.backlash,
        )  # fmt: skip

    @property
    def _law(self) -> Law:
        if self.force is None:
            return spring(
                self.stiffness, self.damping, backlash=self.backlash,
                tension_only=self.tension_only,
            )  # fmt: skip
        if self.tension_only:
            return press(self.owner, "force", self.force, None, 0.0)
        return curve(self.owner, "force", self.force, backlash=self.backlash)

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`; raises ValueError when both markers start at one point."""
        length = distance(self.owner, poses)
        rest = length if self.rest_length is None else self.rest_length
        slack = self.preload / self.stiffness if self.preload else 0.0
        return (Row((Term(RowKind.DISTANCE),), rest - slack, self._law),)
