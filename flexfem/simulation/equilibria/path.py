# SPDX-License-Identifier: LGPL-3.0-or-later
"""An equilibrium path: steps from one equilibrium to the next, and special points between them."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.status import Status
from flexfem.solvers.statics.arc_length import ArcLength
from flexfem.solvers.statics.equilibrium import Equilibrium
from flexfem.solvers.statics.stability import softest_motion
from flexfem.system.mechanics import END_POINT

__all__ = ["CriticalPoint", "Path", "Point"]

#: Length to which a critical point is located, relative to the step.
_EXACT = 1e-7
_SEARCHES = 60


@dataclass(frozen=True)
class Point:
    """Point of an equilibrium path.

    Attributes:
        t: load parameter.
        slope: derivative of t along the path; 1 in load steps.
        unstable: number of unstable directions, 0 if they are not counted.
    """

    t: float
    slope: float
    unstable: int


@dataclass(frozen=True)
class CriticalPoint:
    """Critical point: limit point or bifurcation of an equilibrium path.

    Attributes:
        kind: "limit point" or "bifurcation".
        t: load parameter there.
        unstable: unstable directions before and after.
        columns: the history's columns there, on the first rank.
        motion: (n_owned, width) of each block, the motion of least stiffness there.
    """

    kind: str
    t: float
    unstable: tuple[int, int]
    columns: dict[str, float]
    motion: list[FloatArray] = field(repr=False)

    def summary(self) -> dict[str, object]:
        """Entry of ``summary.json``."""
        return {"kind": self.kind, "t": self.t, "unstable": list(self.unstable), **self.columns}


class Path:
    """Steps along an equilibrium path, tried until one is accepted.

    Attributes:
        arc: steps along the path; None for load steps.
        point, trial: the accepted equilibrium and the last trial.
        tried: the last trial step.
    """

    def __init__(
        self, equilibrium: Equilibrium, *, follow: bool, count: bool,
        columns: Callable[[], dict[str, float]],
    ) -> None:  # fmt: skip
        """Begin at the present equilibrium (collective).

        Args:
            equilibrium: of the model, solved.
            follow: steps of arc length instead of load.
            count: count unstable directions.
            columns: the history's columns at the trial state (collective).
        """
        self.equilibrium, self._count, self._columns = equilibrium, count, columns
        self.arc = ArcLength(equilibrium) if follow else None
        self._base = equilibrium.keep()
        self._aimed = self.arc is None or self.arc.aim()
        self.point = self._look(self.arc)
        self._next = self.arc
        self.trial = self.point
        self.tried = 0.0

    @property
    def aimed(self) -> bool:
        """True if the path has a direction: something depends on the load parameter."""
        return self._aimed

    def _look(self, arc: ArcLength | None) -> Point:
        """Describe the present equilibrium, whose direction is known."""
        equilibrium = self.equilibrium
        unstable = 0
        if self._count:
            END_POINT.evaluate(equilibrium.system, equilibrium.shifts)
            equilibrium.assemble()
            unstable = equilibrium.inertia.unstable()
        return Point(equilibrium.loading.t, 1.0 if arc is None else arc.slope, unstable)

    def attempt(self, h: float, *, look: bool = True) -> Status:
        """Try a step from the accepted equilibrium; ``trial`` is its result.

        Args:
            h: length, or change of the load parameter.
            look: compute slope and stability there.
        """
        equilibrium, self.tried = self.equilibrium, h
        equilibrium.restore(self._base)
        if self.arc is None:
            status = equilibrium.solve(self._base.t + h)
        else:
            status = self.arc.step(h)
        return self._arrived(status, look)

    def _arrived(self, status: Status, look: bool) -> Status:
        if status is not Status.OK or not look:
            return status
        self._next = None
        if self.arc is not None:
            self._next = ArcLength(self.equilibrium)
            if not self._next.aim(self.arc):
                return Status.SINGULAR
        self.trial = self._look(self._next)
        return status

    def accept(self) -> None:
        """Accept the trial equilibrium."""
        self.equilibrium.accept()
        self._base, self.point, self.arc = self.equilibrium.keep(), self.trial, self._next

    def return_to_base(self) -> None:
        """Discard the trial state."""
        self.equilibrium.restore(self._base)

    def branch_off(self, critical: CriticalPoint, size: float) -> Status:
        """Step off the accepted path at a bifurcation, along its mode.

        Args:
            critical: the bifurcation.
            size: of the step, largest rotation (rad) or relative displacement.
        """
        assert self.arc is not None
        self.arc = ArcLength(self.equilibrium)
        self.arc.point_along(critical.motion)
        return self.attempt(size / self.arc.largest_turn())

    def search(
        self, function: Callable[[], float], span: tuple[float, float],
        ends: tuple[float, float], near: float = 0.0,
    ) -> Status:  # fmt: skip
        """Find the step to a zero of a function of the trial state, left there or just beyond.

        Regula falsi with the weights of the Illinois method; bisection for functions whose values
        have only a meaningful sign.

        Args:
            function: evaluated after each attempt (collective, the same on every rank).
            span: steps before and beyond the zero.
            ends: values of the function there.
            near: size of values that count as zero.
        """
        (low, high), (below, above), side = span, ends, 0
        bisect = abs(below) == abs(above) == 1.0
        for _ in range(_SEARCHES):
            if high - low <= _EXACT * high:
                break
            share = 0.5 if bisect else min(max(below / (below - above), 1e-3), 0.999)
            middle = low + share * (high - low)
            status = self.attempt(middle)
            if status is not Status.OK:
                return status
            value = function()
            if abs(value) <= near:
                return status
            if (value > 0.0) == (above > 0.0):
                high, above, below, side = middle, value, below * (0.5 if side > 0 else 1.0), 1
            else:
                low, below, above, side = middle, value, above * (0.5 if side < 0 else 1.0), -1
        return self.attempt(high)

    def critical_point(self) -> tuple[Status, CriticalPoint | None]:
        """The first limit point or bifurcation within the step just tried, None if there is none.

        The trial state is moved back to just beyond it.
        """
        before, last, span = self.point, self.trial, (0.0, self.tried)
        if not _differ(before, last):
            return Status.OK, None
        if before.unstable == last.unstable:
            ends = before.slope, last.slope
            status = self.search(lambda: self.trial.slope, span, ends)
        else:
            status = self.search(partial(self._passed, before), span, (-1.0, 1.0))
        return status, self._describe(before) if status is Status.OK else None

    def _passed(self, before: Point) -> float:
        return 1.0 if _differ(before, self.trial) else -1.0

    def _describe(self, before: Point) -> CriticalPoint:
        """The critical point at the trial state."""
        equilibrium, trial = self.equilibrium, self.trial
        kind = "limit point" if before.slope * trial.slope < 0.0 else "bifurcation"
        columns = self._columns()
        END_POINT.evaluate(equilibrium.system, equilibrium.shifts)
        equilibrium.assemble()
        _, motion = softest_motion(equilibrium.tangent, equilibrium.weights)
        return CriticalPoint(kind, trial.t, (before.unstable, trial.unstable), columns, motion)


def _differ(a: Point, b: Point) -> bool:
    return bool(a.unstable != b.unstable or np.sign(a.slope) != np.sign(b.slope))
