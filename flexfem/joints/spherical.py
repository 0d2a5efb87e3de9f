# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spherical joint."""

from collections.abc import Sequence
from dataclasses import dataclass

from flexfem._types import FloatArray
from flexfem.core.joint import Joint, coincidence, coincidence_directions
from flexfem.core.pose import Pose
from flexfem.core.row import Row

__all__ = ["Spherical"]


@dataclass(frozen=True, eq=False)
class Spherical(Joint):
    """Keeps the origins of two markers together; three constraints.

    The multipliers are the components, in inertial axes, of the force (N) by which marker b pulls
    marker a.
    """

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        return coincidence()

    @staticmethod
    def directions(joints: Sequence[Joint], rotations: FloatArray) -> FloatArray:
        """See :meth:`Joint.directions`."""
        return coincidence_directions(len(joints))
