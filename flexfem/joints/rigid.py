# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid connection."""

from dataclasses import dataclass

from flexfem.core.joint import Joint, Row, coincidence, equal_rotation
from flexfem.core.pose import Pose

__all__ = ["Rigid"]


@dataclass(frozen=True, eq=False)
class Rigid(Joint):
    """Keeps the origins of two markers together and their relative rotation; six constraints."""

    def rows(self, a: Pose, b: Pose, t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        return coincidence() + equal_rotation(a, b)
