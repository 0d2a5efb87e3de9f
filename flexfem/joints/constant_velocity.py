# SPDX-License-Identifier: LGPL-3.0-or-later
"""Constant-velocity joint."""

from collections.abc import Mapping, Sequence

import numpy as np

from flexfem import _checks
from flexfem._fields import declared, vector
from flexfem._types import FloatArray
from flexfem.core.joint import AxisJoint, coincidence, perpendicular, unit
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["ConstantVelocity"]


@declared
class ConstantVelocity(AxisJoint):
    """Homokinetic joint: both shafts turn at the same speed at any angle between them.

    The shafts meet in one point, and the rotation that maps one to the other has no part along
    them; four constraints. The shafts may be bent by less than a straight angle.

    Attributes:
        axis: shaft fixed in marker a, inertial axes at the start.
        second_axis: shaft fixed in marker b in the same sense; None for the same direction.

    Raises:
        ValueError: a shaft is zero, or they point against each other.
    """

    second_axis: Sequence[float] | None = vector(default=None, nonzero=True, as_given=True)

    def __post_init__(self) -> None:
        """Check that the shafts do not oppose one another."""
        super().__post_init__()
        second = self.axis if self.second_axis is None else self.second_axis
        if float(self.direction @ unit(second)) < -1.0 + 1e-9:
            shown = _checks.show(self.second_axis)
            raise ValueError(f"{self.owner}: second_axis must not oppose axis, got {shown}")

    def turned(self, turns: Sequence[FloatArray]) -> Mapping[str, FloatArray]:
        """See :meth:`Joint.turned`."""
        second = unit(self.axis if self.second_axis is None else self.second_axis)
        return {"axis": turns[0] @ unit(self.axis), "second_axis": turns[1] @ second}

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        second = self.direction if self.second_axis is None else unit(self.second_axis)
        p, q = perpendicular(self.direction)
        bend = _shortest_turn(self.direction, second)
        terms = (
            Term(RowKind.AXES, u=a.rotation.T @ p, v=b.rotation.T @ bend @ q),
            Term(RowKind.AXES, u=a.rotation.T @ q, v=b.rotation.T @ bend @ p, factor=-1.0),
        )
        return (*coincidence(), Row(terms))


def _shortest_turn(first: FloatArray, second: FloatArray) -> FloatArray:
    """Rotation matrix about the common perpendicular that maps one unit vector to another."""
    n = np.cross(first, second)
    skew = np.array([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]])
    return np.asarray(np.eye(3) + skew + skew @ skew / (1.0 + first @ second))
