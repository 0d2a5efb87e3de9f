# SPDX-License-Identifier: LGPL-3.0-or-later
"""End stop."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, InitVar

import numpy as np

from flexfem import _checks
from flexfem._fields import declared, one_of
from flexfem._types import FloatArray
from flexfem.core.curves.curve import Curve
from flexfem.core.joint import Joint, check_limits, displacement, distance, turn_angle, unit
from flexfem.core.laws import Law, limit, press
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["LimitStop"]

_MOTIONS = ("translation", "rotation", "distance")
#: Names of these options in other programs and in earlier versions.
_FORMER = {"displacement": "translation", "angle": "rotation"}


@declared
class LimitStop(Joint):
    """Stop that presses where a relative coordinate x passes a limit.

    Beyond the limit by d it presses with ``k d (1 + tanh(c v / (k d)))``, v the speed of d: a
    spring and damper while the damper's force is small against the spring's, which begins softly
    and never pulls. A function gives the force in their place: ``force(d)`` or ``force(d, v)``, or
    a `Curve`; it presses where it is positive, ``force(d, 0)`` is elastic, and what v adds is
    dissipated. In impacts it acts by its mean over each step, the change of the stored energy over
    that of the coordinate: they neither make nor lose energy in the scheme, whatever the step. Such
    means are what a `ReactionProbe` records then, and forces at the end of steps while it stays
    closed.

    Attributes:
        motion: "translation" of b from a along an axis fixed in a (m), "rotation" by which b has
            rotated from a about it since the start (rad), or "distance" of the markers (m).
        axis: for translation and rotation, inertial axes at the start.
        lower, upper: limits; None for none on that side.
        stiffness: k, N/m or N m/rad.
        damping: c, N s/m or N m s/rad.
        force: function made by def or lambda, compiled with its derivatives, or a `Curve`; N or
            N m; None for the spring and damper.
        coordinate: not accepted: ``motion`` defines it.
    """

    motion: str = one_of(_MOTIONS, default="translation")
    axis: Sequence[float] | None = None
    lower: float | None = None
    upper: float | None = None
    stiffness: float = 0.0
    damping: float = 0.0
    force: Callable[..., float] | Curve | None = None
    _: KW_ONLY
    coordinate: InitVar[object] = None

    def __post_init__(self, coordinate: object) -> None:
        """Check all arguments.

        Raises:
            TypeError: an argument has the wrong type.
            ValueError: an unknown motion, no or a zero axis, no limit or lower above upper,
                stiffness not positive, damping negative; a function beside them, or with other
                arguments.
        """
        super().__post_init__()
        if coordinate is not None:
            motion = _FORMER.get(str(coordinate), "distance")
            raise ValueError(
                f'{self.owner}: coordinate={_checks.show(coordinate)} is written motion="{motion}"'
            )
        if self.motion == "distance":
            if self.axis is not None:
                raise ValueError(f"{self.owner}: a distance has no axis, got {self.axis}")
        else:
            _checks.vector(self.owner, "axis", self.axis, nonzero=True)
        stiffness = self.stiffness
        if self.force is not None:
            _checks.replaces(self.owner, "force", stiffness=stiffness, damping=self.damping)
            stiffness = 1.0
        check_limits(self.owner, self.lower, self.upper, stiffness, self.damping)
        _ = self._law

    @property
    def _law(self) -> Law:
        if self.force is None:
            return limit(self.lower, self.upper, self.stiffness, self.damping)
        return press(self.owner, "force", self.force, self.lower, self.upper)

    @property
    def direction(self) -> FloatArray | None:
        """See :attr:`Joint.direction`."""
        return None if self.axis is None else unit(self.axis)

    def turned(self, turns: Sequence[FloatArray]) -> Mapping[str, FloatArray]:
        """See :meth:`Joint.turned`."""
        return {} if self.axis is None else {"axis": turns[0] @ unit(self.axis)}

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`; raises ValueError for a distance that is zero at the start."""
        a, b = poses
        law = self._law
        if self.direction is None:
            distance(self.owner, poses)
            return (Row((Term(RowKind.DISTANCE),), 0.0, law),)
        if self.motion == "rotation":
            return (Row((turn_angle(self.direction, a, b),), 0.0, law),)
        return (displacement(np.asarray(self.direction), a, 0.0, law),)
