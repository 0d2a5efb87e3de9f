# SPDX-License-Identifier: LGPL-3.0-or-later
"""Prescribed motion of a slider along its beam."""

from collections.abc import Callable, Sequence
from typing import ClassVar

from flexfem import _checks
from flexfem._fields import declared, time_function
from flexfem.core.joint import Joint, JointAction, check_sliding
from flexfem.core.pose import Pose
from flexfem.core.row import Row

__all__ = ["PrescribedSlide"]


@declared
class PrescribedSlide(JointAction):
    """Drives the slider of a sliding joint along its carrier; one constraint.

    Attributes:
        joint: the ``Sliding`` joint; in the model too.
        zeta: function of time (s): arc length from the carrier's start in the undeformed state, m.

    Raises:
        TypeError: the joint does not slide, or zeta is not a function.
        ValueError: its value at t = 0 is not a number.
    """

    zeta: Callable[[float], float] = time_function(default=lambda t: 0.0)

    driven: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Check that the joint slides."""
        super().__post_init__()
        check_sliding(self)

    @property
    def partner(self) -> Joint:
        """See :attr:`Joint.partner`."""
        return self.joint

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        (zeta,) = self.targets(poses, t)
        return tuple(Row((term,), zeta) for term in self.terms(poses))

    def targets(self, poses: Sequence[Pose], t: float) -> tuple[float]:
        """See :meth:`Joint.targets`."""
        return (_checks.returned_number("zeta", self.zeta(t)),)
