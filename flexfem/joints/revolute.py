# SPDX-License-Identifier: LGPL-3.0-or-later
"""Revolute joint."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.joint import (
    AxisJoint,
    axes_of,
    coincidence,
    coincidence_directions,
    parallelism,
    parallelism_directions,
)
from flexfem.core.pose import Pose
from flexfem.core.row import Row

__all__ = ["Revolute"]


@dataclass(frozen=True, eq=False)
class Revolute(AxisJoint):
    """Leaves one rotation about a common axis; five constraints."""

    leaves = ("rotation",)

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        return coincidence() + parallelism(self.direction, a, b)

    @staticmethod
    def directions(joints: Sequence[AxisJoint], rotations: FloatArray) -> FloatArray:
        """See :meth:`Joint.directions`."""
        parallel = parallelism_directions(axes_of(joints), rotations)
        return np.concatenate([coincidence_directions(len(joints)), parallel], axis=1)
