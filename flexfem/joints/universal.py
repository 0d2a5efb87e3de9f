# SPDX-License-Identifier: LGPL-3.0-or-later
"""Universal joint."""

from collections.abc import Mapping, Sequence

from flexfem._fields import declared, vector
from flexfem._types import FloatArray
from flexfem.core.joint import AxisJoint, coincidence, unit
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["Universal"]

#: Largest cosine between the arms of the cross.
_PERPENDICULAR = 1e-6


@declared
class Universal(AxisJoint):
    """Cardan joint: the arms of its cross, one fixed in each marker, stay perpendicular.

    Leaves two rotations; four constraints. Between shafts at an angle b the speeds differ:
    ``w_2 = w_1 cos b / (1 - sin^2 b cos^2 a)``, a the angle of the first arm from the plane of
    the shafts.

    Attributes:
        axis: arm fixed in marker a, inertial axes at the start.
        second_axis: arm fixed in marker b, perpendicular to the other.

    Raises:
        ValueError: an arm is zero, or they are not perpendicular.
    """

    second_axis: Sequence[float] = vector(default=(1.0, 0.0, 0.0), nonzero=True, as_given=True)

    def __post_init__(self) -> None:
        """Check that the arms are perpendicular."""
        super().__post_init__()
        cosine = float(self.direction @ unit(self.second_axis))
        if abs(cosine) > _PERPENDICULAR:
            raise ValueError(
                f"{self.owner}: second_axis must be perpendicular to axis, got a cosine of "
                f"{cosine:.6g}"
            )

    def turned(self, turns: Sequence[FloatArray]) -> Mapping[str, FloatArray]:
        """See :meth:`Joint.turned`."""
        second = unit(self.second_axis)
        return {"axis": turns[0] @ unit(self.axis), "second_axis": turns[1] @ second}

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        first, second = a.rotation.T @ self.direction, b.rotation.T @ unit(self.second_axis)
        return (*coincidence(), Row((Term(RowKind.AXES, u=first, v=second),)))
