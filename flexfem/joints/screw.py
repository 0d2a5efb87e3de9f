# SPDX-License-Identifier: LGPL-3.0-or-later
"""Screw joint."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import tau

from flexfem import _checks
from flexfem.core.joint import AxisJoint, displacement, line_guidance, parallelism, turn_angle
from flexfem.core.pose import Pose
from flexfem.core.row import Row

__all__ = ["Screw"]


@dataclass(frozen=True, eq=False)
class Screw(AxisJoint):
    """Couples the translation along a common axis to the rotation about it; five constraints.

    Attributes:
        pitch: advance of marker b along the axis in one positive turn, m; negative for a left-hand
            thread.
    """

    pitch: float = 1e-3

    leaves = ("translation", "rotation")

    def __post_init__(self) -> None:
        """Check the pitch.

        Raises:
            TypeError: the pitch is not a number.
            ValueError: the pitch is zero.
        """
        super().__post_init__()
        if _checks.number(self.owner, "pitch", self.pitch) == 0.0:
            raise ValueError(f"{self.owner}: pitch must not be zero, got {self.pitch}")

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        axis = self.direction
        along = displacement(axis, a)
        turn = replace(turn_angle(axis, a, b), factor=-self.pitch / tau)
        start = float(axis @ (b.position - a.position))
        thread = Row((*along.terms, turn), start)
        return (*line_guidance(axis, a), *parallelism(axis, a, b), thread)
