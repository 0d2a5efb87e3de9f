# SPDX-License-Identifier: LGPL-3.0-or-later
"""Prescribed relative rotation."""

from collections.abc import Callable, Sequence
from typing import ClassVar

import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import declared, time_function
from flexfem.core.joint import Joint, equal_rotation
from flexfem.core.pose import Pose
from flexfem.core.row import Row

__all__ = ["PrescribedRotation"]


@declared
class PrescribedRotation(Joint):
    """Drives the rotation of marker b relative to marker a; three constraints.

    Attributes:
        rotation: function of time (s) that returns the rotation vector (rad), shape (3,), in the
            axes of marker a, by which b has rotated since the start.

    Raises:
        TypeError: the rotation is not a function.
        ValueError: its value at t = 0 has the wrong shape.
    """

    rotation: Callable[[float], npt.ArrayLike] = time_function(3, default=lambda t: (0.0, 0.0, 0.0))

    driven: ClassVar[bool] = True

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        from flexfem.lie import so3

        turned = so3.exp(_checks.returned("rotation", self.rotation(t), (3,)))
        return equal_rotation(a, b, turned)
