# SPDX-License-Identifier: LGPL-3.0-or-later
"""PID law of one measurement and one output."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf, sqrt

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray

__all__ = ["PID"]


@dataclass(eq=False)
class PID:
    """Discrete PID law with filtered derivative, setpoint weights, limits and anti-windup.

    With the sample time h since the last sample, error ``e = r - y`` and output u within limits::

        P = proportional (b r - y)
        D = (T_f D + derivative ((c r - y) - (c r - y)_last)) / (T_f + h)
        v = P + I + D,   u = min(max(v, lower), upper)
        I = I_last + h integral e_last + h / T_t (u - v)_last

    (backward differences for D, forward ones for I, back-calculation against windup: Åström and
    Hägglund, PID Controllers, 2nd ed. 1995, sections 3.4, 3.5 and 8.4).

    Attributes:
        proportional: gain, output per measurement.
        integral: gain, output per measurement and second.
        derivative: gain, output seconds per measurement.
        setpoint: r, a number or a function of time (s).
        filter_time: T_f, s; 0 for none.
        lower, upper: limits of the output.
        weights: b and c, weights of the setpoint in the proportional and derivative parts.
        tracking_time: T_t, s, within which the integral recovers from a limit; None for
            ``sqrt(T_i T_d)``, or ``T_i`` without derivative, never less than h.
        state: time, ``c r - y``, D, I, e and ``u - v`` of the last sample; time is NaN before it.
    """

    proportional: float
    integral: float = 0.0
    derivative: float = 0.0
    setpoint: float | Callable[[float], float] = 0.0
    filter_time: float = 0.0
    lower: float = -inf
    upper: float = inf
    weights: tuple[float, float] = (1.0, 0.0)
    tracking_time: float | None = None
    state: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check all numbers.

        Raises:
            TypeError: an argument has the wrong type.
            ValueError: one is not finite or negative where it must not be, or the limits cross.
        """
        for what in ("proportional", "integral", "derivative"):
            _checks.number("PID", what, getattr(self, what))
        _checks.number("PID", "filter_time", self.filter_time, nonnegative=True)
        if callable(self.setpoint):
            _checks.function("PID", "setpoint", self.setpoint, ())
        else:
            _checks.number("PID", "setpoint", self.setpoint)
        self.weights = tuple(_checks.array("PID", "weights", self.weights, (2,)).tolist())
        if self.tracking_time is not None:
            _checks.number("PID", "tracking_time", self.tracking_time, positive=True)
        for what in ("lower", "upper"):
            limit = getattr(self, what)
            if limit not in (-inf, inf):
                _checks.number("PID", what, limit)
        if not self.lower < self.upper:
            raise ValueError(f"PID: lower must be below upper, got {self.lower} and {self.upper}")
        self.state = np.array([np.nan, 0.0, 0.0, 0.0, 0.0, 0.0])

    def update(self, t: float, y: FloatArray) -> float:
        """Take one measurement, shape (1,), at a sample ``t`` (s); returns the output.

        Raises:
            TypeError: the setpoint is not a number.
            ValueError: there is not one measurement, or the setpoint is not finite.
        """
        if len(y) != 1:
            raise ValueError(f"PID: takes one measurement, got {len(y)}")
        last, seen, slope, integral, error, excess = self.state.tolist()
        target = self._target(t)
        value, h = float(y[0]), t - last
        b, c = self.weights
        now = c * target - value
        if h > 0.0:  # not at the first sample, where the time of the last one is not a number
            slope = (self.filter_time * slope + self.derivative * (now - seen)) / (
                self.filter_time + h
            )
            integral += h * self.integral * error
            if self.integral:
                integral += excess * min(h / self._tracking(h), 1.0)
        wanted = self.proportional * (b * target - value) + integral + slope
        output: float = min(max(wanted, self.lower), self.upper)
        self.state = np.array([t, now, slope, integral, target - value, output - wanted])
        return output

    def _target(self, t: float) -> float:
        """Setpoint at a time, s."""
        if not callable(self.setpoint):
            return self.setpoint
        value = self.setpoint(t)
        _checks.number("PID", f"setpoint({t:.6g})", value)
        return float(value)

    def _tracking(self, h: float) -> float:
        """T_t, s."""
        if self.tracking_time is not None:
            return self.tracking_time
        if not self.proportional:
            return h
        reset, rate = self.proportional / self.integral, self.derivative / self.proportional
        return sqrt(abs(reset * rate)) if rate else abs(reset)
