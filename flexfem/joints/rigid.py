# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid connection."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.joint import (
    Joint,
    coincidence,
    coincidence_directions,
    equal_rotation,
    equal_rotation_directions,
)
from flexfem.core.pose import Pose
from flexfem.core.row import Row

__all__ = ["Rigid"]


@dataclass(frozen=True, eq=False)
class Rigid(Joint):
    """Keeps the origins of two markers together and their relative rotation; six constraints."""

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        return coincidence() + equal_rotation(a, b)

    @staticmethod
    def directions(joints: Sequence[Joint], rotations: FloatArray) -> FloatArray:
        """See :meth:`Joint.directions`."""
        same = equal_rotation_directions(rotations)
        return np.concatenate([coincidence_directions(len(joints)), same], axis=1)
