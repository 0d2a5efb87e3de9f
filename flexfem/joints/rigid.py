# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid connection."""

from collections.abc import Sequence
from dataclasses import dataclass

from flexfem.core.joint import Joint, coincidence, equal_rotation
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
