# SPDX-License-Identifier: LGPL-3.0-or-later
"""Prescribed distance."""

from collections.abc import Callable, Sequence
from typing import ClassVar

from flexfem import _checks
from flexfem._fields import declared, time_function
from flexfem.core.joint import Joint, distance
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["PrescribedDistance"]


@declared
class PrescribedDistance(Joint):
    """Drives the distance of two markers, as a hydraulic cylinder does; one constraint.

    Attributes:
        elongation: function of time (s), m; added to the distance at the start.

    Raises:
        TypeError: the elongation is not a function.
        ValueError: its value at t = 0 is not a number.
    """

    elongation: Callable[[float], float] = time_function(default=lambda t: 0.0)

    driven: ClassVar[bool] = True

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`; raises ValueError when both markers start at one point."""
        return (Row((Term(RowKind.DISTANCE),), *self.targets(poses, t)),)

    def targets(self, poses: Sequence[Pose], t: float) -> tuple[float]:
        """See :meth:`Joint.targets`."""
        start = distance(self.owner, poses)
        return (start + _checks.returned_number("elongation", self.elongation(t)),)
