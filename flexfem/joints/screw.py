# SPDX-License-Identifier: LGPL-3.0-or-later
"""Screw joint."""

from collections.abc import Sequence
from dataclasses import replace
from math import tau

from flexfem._fields import declared, number
from flexfem.core.joint import AxisJoint, displacement, line_guidance, parallelism, turn_angle
from flexfem.core.pose import Pose
from flexfem.core.row import Row

__all__ = ["Screw"]


@declared
class Screw(AxisJoint):
    """Couples the translation along a common axis to the rotation about it; five constraints.

    Attributes:
        pitch: advance of marker b along the axis in one positive turn, m; negative for a left-hand
            thread.

    Raises:
        TypeError: the pitch is not a number.
        ValueError: the pitch is zero.
    """

    pitch: float = number(default=1e-3, nonzero=True, as_given=True)

    leaves = ("translation", "rotation")

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        axis = self.direction
        along = displacement(axis, a)
        turn = replace(turn_angle(axis, a, b), factor=-self.pitch / tau)
        start = float(axis @ (b.position - a.position))
        thread = Row((*along.terms, turn), start)
        return (*line_guidance(axis, a), *parallelism(axis, a, b), thread)
