# SPDX-License-Identifier: LGPL-3.0-or-later
"""Functions of time that scale loads or drive joints; any function of time is accepted as well.

Those here declare the times of their jumps and kinks (``breakpoints``, in seconds): steps of a
motion end there. User functions declare them through :class:`TimeFunction`, or by an attribute of
that name.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from flexfem import _checks
from flexfem._fields import Array, checked, declared, function, number, one_of
from flexfem._types import FloatArray


def _increasing(owner: str, what: str, value: Any) -> FloatArray:
    """Return checked times."""
    times = _checks.array(owner, what, value, (-1,))
    if (np.diff(times) <= 0.0).any():
        raise ValueError(f"{owner}: {what} must increase, got {_checks.show(value)}")
    return times


@declared
class Table:
    """Piecewise linear function of time, constant before the first and after the last time.

    Attributes:
        times: Strictly increasing times, shape (n,), seconds.
        values: Values at these times, shape (n,).

    Raises:
        TypeError: An argument does not consist of numbers.
        ValueError: No times, different lengths, NaN, or times that do not increase.
    """

    times: Array = checked(_increasing)
    values: Array

    def __post_init__(self) -> None:
        """Check that there is a value for each time."""
        values = _checks.array("Table", "values", self.values, (len(self.times),))
        if len(values) == 0:
            raise ValueError("Table: times must hold at least one number, got none")
        _checks.assign(self, values=values)

    @property
    def breakpoints(self) -> FloatArray:
        """Times of kinks, seconds."""
        return self.times

    def __call__(self, t: float) -> float:
        """Return the value at time `t` in seconds."""
        return float(np.interp(t, self.times, self.values))


@declared
class Spline:
    """Smooth function of time through given values, constant before the first and after the last.

    An interpolating spline of odd degree p with p - 1 continuous derivatives between the ends; it
    is off by a term of order p + 1 in the distance of the times.

    Attributes:
        times: Strictly increasing times, shape (n,), seconds.
        values: Values at these times, shape (n,).
        degree: 1, 3 or 5, below n.

    Raises:
        TypeError: An argument does not consist of numbers.
        ValueError: Another degree, too few times for it, different lengths, NaN, or times that do
            not increase.
    """

    times: Array
    values: Array
    degree: int = 5

    def __post_init__(self) -> None:
        """Check the table and the degree, and find the polynomials."""
        table, degree = Table(self.times, self.values), self.degree
        if degree not in (1, 3, 5):
            raise ValueError(f"Spline: degree must be 1, 3 or 5, got {_checks.show(degree)}")
        if len(table.times) <= degree:
            raise ValueError(
                f"Spline: degree {degree} needs more than {degree} times, got {len(table.times)}"
            )
        from scipy.interpolate import make_interp_spline

        spline = make_interp_spline(table.times, table.values, k=degree)
        _checks.assign(self, times=table.times, values=table.values, _evaluate=spline)

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


@declared(eq=True)
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
        profile: Name of the profile.

    Raises:
        TypeError: A value is not a number.
        ValueError: A value is not finite, t1 is not after t0, or an unknown profile.
    """

    t0: float = number(as_given=True)
    t1: float = number(as_given=True)
    y0: float = number(default=0.0, as_given=True)
    y1: float = number(default=1.0, as_given=True)
    profile: str = one_of(_PROFILES, default="polynomial")

    def __post_init__(self) -> None:
        """Check that it ends after it begins."""
        if self.t1 <= self.t0:
            raise ValueError(f"SmoothStep: t1 must be after t0 = {self.t0}, got {self.t1}")

    @property
    def breakpoints(self) -> FloatArray:
        """Times at which it begins and ends, seconds."""
        return np.array([self.t0, self.t1])

    def __call__(self, t: float) -> float:
        """Return the value at time `t` in seconds."""
        tau = min(max((t - self.t0) / (self.t1 - self.t0), 0.0), 1.0)
        return self.y0 + (self.y1 - self.y0) * _PROFILES[self.profile](tau)


@declared
class TimeFunction:
    """A function of time with the times at which it jumps or has kinks.

    A step of a motion ends at each of them, so that no pulse is lost between two steps and the
    impulse of a load that is switched is that of its integral. At a jump the value may be that
    before or after.

    Attributes:
        function: Function of time in seconds.
        breakpoints: Strictly increasing times, shape (n,), seconds.

    Raises:
        TypeError: The function is none, or the times do not consist of numbers.
        ValueError: NaN, or times that do not increase.
    """

    function: Callable[[float], Any] = function("time")
    breakpoints: Array = checked(_increasing)

    def __call__(self, t: float) -> Any:
        """Return the value at time `t` in seconds."""
        return self.function(t)
