# SPDX-License-Identifier: LGPL-3.0-or-later
"""End stops of a slider on its beam."""

from collections.abc import Sequence
from dataclasses import dataclass

from flexfem.core.joint import Joint, JointAction, check_limits, check_sliding
from flexfem.core.laws import limit
from flexfem.core.pose import Pose
from flexfem.core.row import Row

__all__ = ["SlideStop"]


@dataclass(frozen=True, eq=False)
class SlideStop(JointAction):
    """Elastic stops that keep the slider of a sliding joint between two places of its carrier.

    Beyond a stop by d it presses with ``k d (1 + tanh(c v / (k d)))``, see ``LimitStop``. A slider
    that goes beyond the end of its carrier thereby follows the end's continuation, for a tenth of
    the carrier's length at most.

    Attributes:
        joint: the ``Sliding`` joint; in the model too.
        lower, upper: arc lengths from the carrier's start in the undeformed state, m; None for
            none on that side.
        stiffness: k, N/m.
        damping: c, N s/m.
    """

    lower: float | None = None
    upper: float | None = None
    stiffness: float = 0.0
    damping: float = 0.0

    def __post_init__(self) -> None:
        """Check all arguments.

        Raises:
            TypeError: the joint does not slide, or an argument has the wrong type.
            ValueError: no limit or lower above upper, stiffness not positive, damping negative.
        """
        super().__post_init__()
        check_sliding(self)
        check_limits(self.owner, self.lower, self.upper, self.stiffness, self.damping)

    @property
    def partner(self) -> Joint:
        """See :attr:`Joint.partner`."""
        return self.joint

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        law = limit(self.lower, self.upper, self.stiffness, self.damping)
        return tuple(Row((term,), 0.0, law) for term in self.terms(poses))
