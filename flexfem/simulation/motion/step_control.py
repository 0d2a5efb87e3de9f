# SPDX-License-Identifier: LGPL-3.0-or-later
"""Step-size control on a dyadic grid: the largest step or 2^-k of it.

Sizes are quantised so that the factors of few sizes serve a whole run, and steps are only doubled
where they are on the grid of the doubled step, so that steps end at every multiple of the largest
one.
"""

from math import ceil, log2

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.state import counts

__all__ = ["HALVINGS", "StepControl"]

#: Number of times that a step is halved before the run fails.
HALVINGS = 12
_FULL = 1 << HALVINGS
#: Number of successive steps after which a step is doubled with error control, and the part of the
#: admissible error that is expected of their doubles.
_PATIENCE, _SAFETY = 3, 0.5
#: Largest number of halvings at once after too large an error.
_MOST = 3


class StepControl:
    """Steps within one largest step, all of them on a grid of halves.

    Without error control a failed step is halved, and the next one is as large as the grid allows.

    Attributes:
        tolerance: largest local error (m or rad) of a step, None for no error control.
    """

    def __init__(self, tolerance: float | None, order: int) -> None:
        """Start with the largest step; ``order`` is that of the integrator."""
        self.tolerance = tolerance
        self._power = order + 1
        self._level = self._position = self._good = 0

    def state(self) -> FloatArray:
        """Return the memory between largest steps."""
        return np.array([self._level, self._good], dtype=np.float64)

    def restore(self, state: FloatArray) -> None:
        """Restore a result of :meth:`state`."""
        self._level, self._good = counts("control", state)
        if self._level > HALVINGS:
            raise ValueError(f"a step was halved {self._level} times, at most {HALVINGS} are")

    def begin(self) -> None:
        """Start the next largest step."""
        self._position = 0

    @property
    def done(self) -> bool:
        """True if the largest step is complete."""
        return self._position == _FULL

    @property
    def part(self) -> float:
        """Size of the next step as a part of the largest one, a power of two."""
        return 0.5**self._level

    @property
    def end(self) -> float:
        """End of the next step, as a part of the largest one."""
        return (self._position + (_FULL >> self._level)) / _FULL

    def accepted(self, error: float) -> None:
        """Record an accepted step with this local error (any number without error control)."""
        self._position += _FULL >> self._level
        if self.tolerance is None:
            while self._may_double():
                self._level -= 1
            return
        good = 2.0**self._power * error <= _SAFETY * self.tolerance
        self._good = self._good + 1 if good else 0
        if self._good >= _PATIENCE and self._may_double():
            self._level -= 1
            self._good = 0

    def _may_double(self) -> bool:
        return self._level > 0 and self._position % (_FULL >> (self._level - 1)) == 0

    def refused(self, error: float | None = None) -> bool:
        """Reduce the step; False if it is the smallest.

        Args:
            error: that of the step, None if there was no solution.
        """
        halvings = 1
        if error is not None and self.tolerance is not None:
            excess = error / (_SAFETY * self.tolerance)
            halvings = min(max(ceil(log2(excess) / self._power), 1), _MOST)
        self._good = 0
        if self._level == HALVINGS:
            return False
        self._level = min(self._level + halvings, HALVINGS)
        return True
