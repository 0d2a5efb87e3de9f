# SPDX-License-Identifier: LGPL-3.0-or-later
"""Prismatic joint."""

from dataclasses import dataclass

from flexfem.core.joint import AxisJoint, Row, equal_rotation, line_guidance
from flexfem.core.pose import Pose

__all__ = ["Prismatic"]


@dataclass(frozen=True, eq=False)
class Prismatic(AxisJoint):
    """Leaves one translation along an axis fixed in marker a; five constraints.

    The markers keep their initial relative rotation.
    """

    def rows(self, a: Pose, b: Pose, t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        return line_guidance(self.direction, a) + equal_rotation(a, b)
