# SPDX-License-Identifier: LGPL-3.0-or-later
"""Instants of a run, the same after a restart with any new end."""

from dataclasses import dataclass

__all__ = ["TimeGrid"]

#: Part of a step below which a difference of times is round-off.
_ROUND_OFF = 1e-6


@dataclass(frozen=True)
class TimeGrid:
    """Equal steps from zero: ``t_k = span k / count``.

    Attributes:
        span: end of the run that began at zero, s.
        count: its number of steps.
    """

    span: float
    count: int

    @classmethod
    def of(cls, dt: float, t_end: float) -> "TimeGrid":
        """Steps of about ``dt`` that end at ``t_end`` (s)."""
        return cls(t_end, max(1, round(t_end / dt)))

    @property
    def h(self) -> float:
        """Step size, s."""
        return self.span / self.count

    def time(self, step: int) -> float:
        """Time at the end of a step, s."""
        return self.span * step / self.count

    def steps(self, t_end: float) -> int:
        """Number of steps to another end (s)."""
        return max(1, round(t_end / self.h))

    def rest(self, t: float, step: int) -> float:
        """Step size from ``t`` (s) to the end of a step; exactly ``h`` for a whole one."""
        rest = self.time(step) - t
        return self.h if abs(rest - self.h) < _ROUND_OFF * self.h else rest
