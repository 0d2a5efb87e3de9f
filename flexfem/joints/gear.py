# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gear pair."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.core.joint import Joint, turn_angle, unit
from flexfem.core.marker import Attachment
from flexfem.core.pose import Pose
from flexfem.core.row import Row

__all__ = ["Gear"]


@dataclass(frozen=True, eq=False)
class Gear(Joint):
    """Couples two relative rotations: turn of d from c = ratio times turn of b from a.

    One constraint, over any number of turns. It needs joints that keep both axes, such as
    ``Revolute`` between a and b and between c and d; a and c are the carriers (often the same body
    or the ground), b and d the wheels. Forces between the teeth other than their moments are not
    represented.

    Attributes:
        c: third marker.
        d: fourth marker.
        axis: axis of the first turn, fixed in marker a, inertial axes at the start.
        second_axis: axis of the second turn, fixed in marker c; None for the same direction.
        ratio: turn of d from c over turn of b from a; negative for wheels that mesh externally
            on parallel axes of one sense.
    """

    c: Attachment
    d: Attachment
    axis: Sequence[float] = (0.0, 0.0, 1.0)
    second_axis: Sequence[float] | None = None
    ratio: float = 1.0

    def __post_init__(self) -> None:
        """Check axes and ratio.

        Raises:
            TypeError: a marker is none, or the ratio is not a number.
            ValueError: an axis or the ratio is zero.
        """
        super().__post_init__()
        _checks.vector(self.owner, "axis", self.axis, nonzero=True)
        if self.second_axis is not None:
            _checks.vector(self.owner, "second_axis", self.second_axis, nonzero=True)
        if _checks.number(self.owner, "ratio", self.ratio) == 0.0:
            raise ValueError(f"{self.owner}: ratio must not be zero, got {self.ratio}")

    @property
    def places(self) -> tuple[tuple[str, Attachment], ...]:
        """See :attr:`Joint.places`."""
        return ("a", self.a), ("b", self.b), ("c", self.c), ("d", self.d)

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """See :attr:`Joint.pairs`."""
        return (0, 1), (2, 3)

    @property
    def direction(self) -> FloatArray:
        """See :attr:`Joint.direction`."""
        return unit(self.axis)

    def turned(self, turns: Sequence[FloatArray]) -> Mapping[str, FloatArray]:
        """See :meth:`Joint.turned`."""
        second = unit(self.axis if self.second_axis is None else self.second_axis)
        return {"axis": turns[0] @ unit(self.axis), "second_axis": turns[2] @ second}

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b, c, d = poses
        second = self.direction if self.second_axis is None else unit(self.second_axis)
        driving = replace(turn_angle(self.direction, a, b), factor=-self.ratio)
        return (Row((driving, turn_angle(second, c, d, (2, 3)))),)
