# SPDX-License-Identifier: LGPL-3.0-or-later
"""Prismatic joint."""

from collections.abc import Sequence
from dataclasses import dataclass

from flexfem.core.joint import AxisJoint, equal_rotation, line_guidance
from flexfem.core.pose import Pose
from flexfem.core.row import Row

__all__ = ["Prismatic"]


@dataclass(frozen=True, eq=False)
class Prismatic(AxisJoint):
    """Leaves one translation along an axis fixed in marker a; five constraints.

    The markers keep their initial relative rotation.
    """

    leaves = ("translation",)

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        return line_guidance(self.direction, a) + equal_rotation(a, b)
