# SPDX-License-Identifier: LGPL-3.0-or-later
"""Jumps and kinks of loads and drives, at which steps of a motion end.

Functions of time list them in an attribute ``breakpoints``. Steps end at some of them:

- jumps of loads always, where the loads are those before in the step that ends there and those
  behind in the next one;
- kinks, if the change of slope matters within a step, and both ends of pieces that are shorter than
  some steps, unless they lie on the grid of steps anyway;
- never those of functions with many more breakpoints than steps: such loads are sampled.
"""

from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import fields
from typing import Any

import numpy as np

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._types import BoolArray, FloatArray
from flexfem.core.joint import Joint
from flexfem.joints.actuator import Actuator
from flexfem.loads.amplitude import SmoothStep, Spline, Table
from flexfem.model.model import Model
from flexfem.simulation.run.time_grid import TimeGrid

__all__ = ["Breakpoints"]

#: Distance from a jump at which a function is evaluated, as a part of a step and of the time.
_BESIDE = 1e-12
#: Parts of a step: distance at which a time is that of a breakpoint; at which two breakpoints are
#: one; at which a continuous function between two breakpoints counts as jumping, since each may
#: have been moved to the grid.
_SAME, _ONE, _STEEP = 1e-6, 2e-6, 4e-6
#: Largest number of breakpoints off the grid per step, of all functions together, and some more in
#: short runs: a step in parts costs as much as some ten others.
_MOST_PER_STEP, _MORE = 0.25, 20
#: Jump relative to the largest value, and change within a step by a change of slope, that matter.
#: The error of a step's impulse is an eighth of the latter.
_JUMP, _KINK = 1e-9, 1e-3
#: Part of a step, or of a shorter piece, over which slopes are taken.
_SPAN = 1e-4
#: Number of steps below which steps end at both ends of a piece.
_SHORT = 4.0


class Breakpoints:
    """Times at which steps end, the same on every rank.

    Attributes:
        times: increasing, s.
        texts: warnings for the run.
    """

    def __init__(self, model: Model, grid: TimeGrid, t_end: float) -> None:
        """Collect the breakpoints of all loads and drives.

        Args:
            model: the model, controllers left out.
            grid: of the steps.
            t_end: end of the run, s.

        Raises:
            InputError: breakpoints that are not times, or a function that fails at them.
        """
        self._h = grid.h
        functions = [_Function(*one, grid, t_end) for one in _functions(model)]
        most, off = _MORE + _MOST_PER_STEP * grid.steps(t_end), 0
        self.texts: list[str] = []
        jumps: list[tuple[float, float]] = []
        kinks: list[float] = []
        # functions with few of them first: those with many may be left out
        for function in sorted(functions, key=lambda one: int(one.off.sum())):
            sampled = off + int(function.off.sum()) > most
            if sampled and (text := function.sampled()):
                self.texts.append(text)
            mine, others = function.met(not sampled)
            jumps += zip(function.times[mine], function.real[mine], strict=True)
            kinks += function.times[others].tolist()
            off += 0 if sampled else int(function.off[mine | others].sum())
        self._merge(jumps, kinks)

    def _merge(self, jumps: list[tuple[float, float]], kinks: list[float]) -> None:
        """Merge equal times, with the instants just before and after them."""
        self.times: list[float] = []
        self._beside: dict[int, tuple[float, float]] = {}
        reals = dict[float, list[float]]()
        for t, real in jumps:
            reals.setdefault(float(t), []).append(float(real))
        for t in sorted({*reals, *kinks}):
            if not self.times or t - self.times[-1] > _ONE * self._h:
                self.times.append(t)
            if t in reals:
                k, aside = len(self.times) - 1, _BESIDE * (abs(t) + self._h)
                low, high = self._beside.get(k, (np.inf, -np.inf))
                near = reals[t]
                self._beside[k] = min(low, min(near) - aside), max(high, max(near) + aside)

    def _at(self, t: float) -> int:
        """Number of the breakpoint at a time (s), -1 if there is none."""
        tolerance = _SAME * self._h
        k = bisect_right(self.times, t + tolerance) - 1
        return k if k >= 0 and self.times[k] > t - tolerance else -1

    def lead(self, t: float, *, before: bool) -> float:
        """Time (s) from ``t`` to just before, or just after, a jump there; 0 for none."""
        if not self._beside:
            return 0.0
        beside = self._beside.get(self._at(t))
        return 0.0 if beside is None else beside[0 if before else 1] - t

    def same(self, other: "Breakpoints") -> bool:
        """Return True if steps of another model end at the same times."""
        return self.times == other.times and self._beside == other._beside

    def next(self, start: float, end: float) -> float:
        """The first breakpoint after ``start`` and before ``end``, else ``end`` (s)."""
        tolerance = _SAME * self._h
        k = bisect_right(self.times, start + tolerance)
        return self.times[k] if k < len(self.times) and self.times[k] < end - tolerance else end

    def within(self, start: float, end: float) -> bool:
        """Return True if a breakpoint lies after ``start`` and before ``end`` (s)."""
        return bool(self.times) and self.next(start, end) != end


class _Function:
    """A function of time with its breakpoints within a run.

    Attributes:
        real: (n,) breakpoints, s.
        times: (n,) the same, those within rounding of a step's end moved there.
        off: (n,) True for those that are not on the grid.
    """

    def __init__(
        self, owner: str, function: Callable[[float], Any], drives: bool, grid: TimeGrid,
        t_end: float,
    ) -> None:  # fmt: skip
        self._owner, self._function = owner, function
        self._h = grid.h
        try:
            t = np.unique(np.asarray(function.breakpoints, dtype=np.float64).ravel())  # type: ignore[attr-defined]
        except (TypeError, ValueError):
            t = np.array([np.nan])
        if not np.isfinite(t).all():
            got = _checks.show(function.breakpoints)  # type: ignore[attr-defined]
            raise InputError(f"{owner}: breakpoints must be times in seconds, got {got}")
        self._gaps = np.diff(t, prepend=-np.inf, append=np.inf)
        inside = (t >= -_SAME * self._h) & (t <= t_end + _SAME * self._h)
        self._gaps = np.stack([self._gaps[:-1], self._gaps[1:]], axis=1)[inside]
        self.real: FloatArray = t[inside]
        self._steep: BoolArray = self._gaps.min(axis=1) <= _STEEP * self._h
        continuous = isinstance(function, (Table, Spline, SmoothStep))
        self._may_jump: BoolArray = (self._steep | (not continuous)) & (not drives)
        nearest = grid.span * np.round(self.real / self._h) / grid.count
        self.off: BoolArray = np.abs(self.real - nearest) > _SAME * self._h
        self.times: FloatArray = np.where(self.off, self.real, nearest)

    def sampled(self) -> str:
        """Warning of a function with breakpoints within steps, empty if there are few."""
        count = int(self.off.sum())
        steps = max(float(np.ptp(self.real)) / self._h, 1.0)
        if count <= steps:
            return ""
        return (
            f"{self._owner}: {count} breakpoints within steps, {count / steps:.3g} in each of "
            f"{self._h:.3g} s: its values at the ends of steps are used; reduce dt, or give means "
            "over the steps"
        )

    def met(self, off_grid: bool) -> tuple[BoolArray, BoolArray]:
        """Return flags of jumps of a load, and of other breakpoints a step must end at."""
        # on the grid only jumps matter
        looked = self.off * off_grid + ~self.off * self._may_jump
        sizes, changes, bends = np.zeros((3, len(self.real)))
        for k in np.flatnonzero(looked).tolist():
            sizes[k], changes[k], bends[k] = self._around(k)
        scale, short = sizes.max(initial=0.0), self._gaps.min(axis=1) < _SHORT * self._h
        jumps = (changes > _JUMP * scale) | (looked & self._steep)
        kinks = looked & self.off & (short | jumps | (bends > _KINK * scale))
        jumps &= self._may_jump
        return jumps, kinks & ~jumps

    def _around(self, k: int) -> tuple[float, float, float]:
        """Size, jump, and effect of the change of slope within a step, of a breakpoint."""
        t = float(self.real[k])
        aside = _BESIDE * (abs(t) + self._h)
        span = _SPAN * min(self._h, float(self._gaps[k].min()))
        far0, near0, near1, far1 = (
            self._value(t + s) for s in (-aside - span, -aside, aside, aside + span)
        )
        bend = np.abs((far1 - near1) - (near0 - far0)).max() / span * self._h
        size = max(np.abs(near0).max(), np.abs(near1).max())
        return float(size), float(np.abs(near1 - near0).max()), float(bend)

    def _value(self, t: float) -> FloatArray:
        return np.atleast_1d(np.asarray(self._function(t), dtype=np.float64))


def _functions(model: Model) -> Iterator[tuple[str, Callable[[float], Any], bool]]:
    """Functions with breakpoints: their owners, and True for those that drive positions."""
    for load in model.loads:
        if hasattr(load.amplitude, "breakpoints"):
            assert load.amplitude is not None
            yield f'{type(load).__name__} "{load.name}"', load.amplitude, False
    for joint in model.joints:
        for function in _of_joint(joint) if joint.driven else ():
            yield joint.owner, function, not isinstance(joint, Actuator)


def _of_joint(joint: Joint) -> Iterator[Callable[[float], Any]]:
    values = (getattr(joint, field.name) for field in fields(joint))
    return (value for value in values if callable(value) and hasattr(value, "breakpoints"))
