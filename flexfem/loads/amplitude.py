# SPDX-License-Identifier: LGPL-3.0-or-later
"""Functions of time that scale loads or drive joints; any function of time will do as well.

Those here tell at which times they jump or have kinks (``breakpoints``, in seconds): steps of a
motion end there. Functions of a user's own tell it through :class:`TimeFunction`, or by an
attribute of that name.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray


@dataclass(frozen=True, eq=False, init=False)
class Table:
    """Piecewise linear function of time, constant before the first and after the last time.

    Attributes:
        times: Strictly increasing times, shape (n,), seconds.
        values: Values at these times, shape (n,).
    """

    times: FloatArray
    values: FloatArray

    def __init__(self, times: npt.ArrayLike, values: npt.ArrayLike) -> None:
        """Create a table.

        Raises:
            TypeError: An argument does not consist of numbers.
            ValueError: No times, different lengths, NaN, or times that do not increase.
        """
        t = _checks.array("Table", "times", times, (-1,))
        y = _checks.array("Table", "values", values, (len(t),))
        if len(t) == 0:
            raise ValueError("Table: times must hold at least one number, got none")
        if (np.diff(t) <= 0.0).any():
            raise ValueError(f"Table: times must increase, got {_checks.show(times)}")
        _checks.assign(self, times=t, values=y)

    @property
    def breakpoints(self) -> FloatArray:
        """Times of kinks, seconds."""
        return self.times

    def __call__(self, t: float) -> float:
        """Return the value at time `t` in seconds."""
        return float(np.interp(t, self.times, self.values))


@dataclass(frozen=True, eq=False, init=False)
class Spline:
    """Smooth function of time through given values, constant before the first and after the last.

    An interpolating spline of odd degree p with p - 1 continuous derivatives between the ends; it
    is off by a term of order p + 1 in the distance of the times.

    Attributes:
        times: Strictly increasing times, shape (n,), seconds.
        values: Values at these times, shape (n,).
        degree: 1, 3 or 5, below n.
    """

    times: FloatArray
    values: FloatArray
    degree: int

    def __init__(self, times: npt.ArrayLike, values: npt.ArrayLike, degree: int = 5) -> None:
        """Create a spline.

        Raises:
            TypeError: An argument does not consist of numbers.
            ValueError: Another degree, too few times for it, different lengths, NaN, or times that
                do not increase.
        """
        table = Table(times, values)
        if degree not in (1, 3, 5):
            raise ValueError(f"Spline: degree must be 1, 3 or 5, got {_checks.show(degree)}")
        if len(table.times) <= degree:
            raise ValueError(
                f"Spline: degree {degree} needs more than {degree} times, got {len(table.times)}"
            )
        from scipy.interpolate import make_interp_spline

        spline = make_interp_spline(table.times, table.values, k=degree)
        _checks.assign(
            self, times=table.times, values=table.values, degree=degree, _evaluate=spline
        )

    @property
    def breakpoints(self) -> FloatArray:
        """Times of kinks in seconds, which are both ends, and for degree 1 all times."""
        return self.times if self.degree == 1 else self.times[[0, -1]]

    def __call__(self, t: float) -> float:
        """Return the value at time `t` in seconds."""
        return float(self._evaluate(min(max(t, self.times[0]), self.times[-1])))  # type: ignore[attr-defined]

    def derivative(self, t: float, order: int = 1) -> float:
        """Return a derivative by time at time `t` in seconds, zero outside the given times."""
        if not self.times[0] <= t <= self.times[-1]:
            return 0.0
        return float(self._evaluate(t, order))  # type: ignore[attr-defined]


#: Transitions from 0 to 1 over tau in [0, 1].
_PROFILES: dict[str, Callable[[float], float]] = {
    "linear": lambda tau: tau,
    "polynomial": lambda tau: tau**3 * (10.0 + tau * (6.0 * tau - 15.0)),
    "cycloid": lambda tau: tau - math.sin(2.0 * math.pi * tau) / (2.0 * math.pi),
    "cosine": lambda tau: (
        (8.0 - 9.0 * math.cos(math.pi * tau) + math.cos(3.0 * math.pi * tau)) / 16.0
    ),
}


@dataclass(frozen=True)
class SmoothStep:
    """Step from y0 to y1 along one of four profiles p of tau = (t - t0)/(t1 - t0) in [0, 1].

    The value is `y0 + (y1 - y0) p(tau)` with

    - "polynomial": `6 tau^5 - 15 tau^4 + 10 tau^3`,
    - "cycloid": `tau - sin(2 pi tau) / (2 pi)`,
    - "cosine": `1/2 - 9/16 cos(pi tau) + 1/16 cos(3 pi tau)`,
    - "linear": `tau`, smooth nowhere but between the ends.

    Polynomial and cycloid begin and end with zero velocity and acceleration, the cosine with zero
    third derivative too (Wu et al., Appl. Sci. 10 (2020) 1231).

    Attributes:
        t0: Time at which the step begins, seconds.
        t1: Time at which it ends, seconds.
        y0: Value before.
        y1: Value after.
        profile: How it goes.
    """

    t0: float
    t1: float
    y0: float = 0.0
    y1: float = 1.0
    profile: str = "polynomial"

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            TypeError: A value is not a number.
            ValueError: A value is not finite, t1 is not after t0, or an unknown profile.
        """
        for what in ("t0", "t1", "y0", "y1"):
            _checks.number("SmoothStep", what, getattr(self, what))
        if self.t1 <= self.t0:
            raise ValueError(f"SmoothStep: t1 must be after t0 = {self.t0}, got {self.t1}")
        if self.profile not in _PROFILES:
            known, got = ", ".join(_PROFILES), _checks.show(self.profile)
            raise ValueError(f"SmoothStep: profile must be one of {known}, got {got}")

    @property
    def breakpoints(self) -> FloatArray:
        """Times at which it begins and ends, seconds."""
        return np.array([self.t0, self.t1])

    def __call__(self, t: float) -> float:
        """Return the value at time `t` in seconds."""
        tau = min(max((t - self.t0) / (self.t1 - self.t0), 0.0), 1.0)
        return self.y0 + (self.y1 - self.y0) * _PROFILES[self.profile](tau)


@dataclass(frozen=True, eq=False, init=False)
class TimeFunction:
    """A function of time with the times at which it jumps or has kinks.

    A step of a motion ends at each of them, so that no pulse is lost between two steps and the
    impulse of a load that is switched is that of its integral. At a jump the value may be that
    before or after.

    Attributes:
        function: Function of time in seconds.
        breakpoints: Strictly increasing times, shape (n,), seconds.
    """

    function: Callable[[float], Any]
    breakpoints: FloatArray

    def __init__(self, function: Callable[[float], Any], breakpoints: npt.ArrayLike) -> None:
        """Create the function.

        Raises:
            TypeError: The function is none, or the times do not consist of numbers.
            ValueError: NaN, or times that do not increase.
        """
        if not callable(function):
            raise TypeError(
                f"TimeFunction: function must be a function of time, got {_checks.show(function)}"
            )
        t = _checks.array("TimeFunction", "breakpoints", breakpoints, (-1,))
        if (np.diff(t) <= 0.0).any():
            raise ValueError(
                f"TimeFunction: breakpoints must increase, got {_checks.show(breakpoints)}"
            )
        _checks.assign(self, function=function, breakpoints=t)

    def __call__(self, t: float) -> Any:
        """Return the value at time `t` in seconds."""
        return self.function(t)
