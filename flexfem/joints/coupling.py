# SPDX-License-Identifier: LGPL-3.0-or-later
"""Coupling of two relative motions."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from flexfem import _checks
from flexfem._fields import checked, declared, number, vector
from flexfem._types import FloatArray
from flexfem.core.joint import Joint, turn_angle, unit
from flexfem.core.laws import Law, spring
from flexfem.core.marker import Attachment
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["Coupling"]

_MOTIONS = ("rotation", "translation")


def _two_motions(owner: str, what: str, value: Any) -> Any:
    """Return checked names of two motions."""
    if not isinstance(value, (tuple, list)) or len(value) != 2 or {*value} - {*_MOTIONS}:
        raise ValueError(
            f"{owner}: {what} must be two of rotation and translation, got {_checks.show(value)}"
        )
    return value


@declared
class Coupling(Joint):
    """Couples two relative motions from the start on: that of d from c = ratio times b from a.

    One constraint: gears, a rack and its pinion, fingers that close together. It needs joints that
    keep both axes, such as ``Revolute`` or ``Prismatic`` between a and b and between c and d.
    Angles hold over any number of turns.

    With a stiffness it is a force instead: a spring and damper on the motion of d beyond ratio
    times that of b, with play where there is a backlash, as that of a ``SpringDamper``.

    Attributes:
        c: third marker.
        d: fourth marker.
        axis: axis of the first motion, fixed in marker a, inertial axes at the start.
        second_axis: axis of the second motion, fixed in marker c; None for the same direction.
        ratio: motion of d from c over motion of b from a; 1, m/rad or rad/m where one of them is a
            translation; not zero.
        motions: of b from a and of d from c: "rotation" about or "translation" along the axis.
        stiffness: N m/rad or N/m, by the motion of d; None for a constraint.
        damping: N m s/rad or N s/m.
        backlash: play of the motion of d, rad or m; the start is in its middle.

    Raises:
        TypeError: a marker is none, or an argument is not a number.
        ValueError: an axis or the ratio is zero, or not two known motions; a stiffness that is not
            positive, damping or backlash that is negative, or without stiffness.
    """

    c: Attachment
    d: Attachment
    axis: Sequence[float] = vector(default=(0.0, 0.0, 1.0), nonzero=True, as_given=True)
    second_axis: Sequence[float] | None = vector(default=None, nonzero=True, as_given=True)
    ratio: float = number(default=1.0, nonzero=True, as_given=True)
    motions: tuple[str, str] = checked(_two_motions, default=("rotation", "rotation"))
    stiffness: float | None = number(default=None, positive=True, kw_only=True)
    damping: float = number(default=0.0, nonnegative=True, kw_only=True)
    backlash: float = number(default=0.0, nonnegative=True, kw_only=True)

    def __post_init__(self) -> None:
        """Check that there is a stiffness where it is needed."""
        super().__post_init__()
        for what, value in (("damping", self.damping), ("backlash", self.backlash)):
            if value and self.stiffness is None:
                raise ValueError(f"{self.owner}: {what} needs a stiffness, got {value:g} alone")

    @property
    def _law(self) -> Law | None:
        if self.stiffness is None:
            return None
        return spring(self.stiffness, self.damping, backlash=self.backlash)

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

    @property
    def _second(self) -> FloatArray:
        return self.direction if self.second_axis is None else unit(self.second_axis)

    def turned(self, turns: Sequence[FloatArray]) -> Mapping[str, FloatArray]:
        """See :meth:`Joint.turned`."""
        return {"axis": turns[0] @ self.direction, "second_axis": turns[2] @ self._second}

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        axes, pairs = (self.direction, self._second), self.pairs
        (driving, x), (driven, y) = (
            _motion(kind, axis, poses, pair)
            for kind, axis, pair in zip(self.motions, axes, pairs, strict=True)
        )
        terms = replace(driving, factor=-self.ratio), driven
        return (Row(terms, y - self.ratio * x, self._law),)


def _motion(
    kind: str, axis: FloatArray, poses: Sequence[Pose], pair: tuple[int, int]
) -> tuple[Term, float]:
    """Angle (rad) or displacement (m) of a pair of markers, and its value at the start."""
    a, b = (poses[number] for number in pair)
    if kind == "rotation":
        return turn_angle(axis, a, b, pair), 0.0
    along = Term(RowKind.ALONG, u=a.rotation.T @ axis, a=pair[0], b=pair[1])
    return along, float(np.dot(axis, b.position - a.position))
