# SPDX-License-Identifier: LGPL-3.0-or-later
"""Base class of the loads that a model holds by name."""

from collections.abc import Callable
from math import isfinite, nan

import numpy as np

from flexfem import _checks
from flexfem._faults import FAILURES, ReturnError, noted
from flexfem._types import FloatArray
from flexfem.core.marker import Marker

#: No force or no moment.
NOTHING: FloatArray = np.zeros(3)

#: Factor on a load as a function of time (seconds).
Amplitude = Callable[[float], float]


class Load:
    """Base class of the loads that a model holds by name.

    Attributes:
        name: Unique name of the load in its model.
        amplitude: Factor on the load as a function of time, None for the constant 1.
        follower: True if the load rotates with its marker or section.
    """

    name: str
    amplitude: Amplitude | None
    follower: bool

    @property
    def markers(self) -> tuple[Marker, ...]:
        """Markers the load acts at."""
        return ()

    @property
    def beams(self) -> tuple[str, ...]:
        """Names of the beams along which the load acts."""
        return ()

    @property
    def shells(self) -> tuple[str, ...]:
        """Names of the shells on which the load acts."""
        return ()

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies of further families that take the load (``Body.check_load``)."""
        return ()

    @property
    def wrench(self) -> tuple[FloatArray, FloatArray]:
        """Force and moment at each marker (N, N m), or along each beam (N/m, N), shapes (3,).

        On shells forces per length (N/m) or area (N/m^2).
        """
        raise NotImplementedError

    @property
    def uniform(self) -> bool:
        """True if :attr:`wrench` is the whole load; False where a load varies along a beam."""
        return True

    @property
    def has_moment(self) -> bool:
        """True if the load has moments."""
        return bool(self.wrench[1].any())

    def factor(self, t: float) -> float:
        """Return the amplitude at time `t` in seconds; nan in a run where the function fails.

        It fails where it raises something, and where it does not return a finite number.
        """
        if self.amplitude is None:
            return 1.0
        try:
            value = _checks.returned_number("amplitude", self.amplitude(t))
            if isfinite(value):
                return value
            raise ReturnError(f"amplitude is {value} at t = {t:.6g} s")
        except FAILURES as error:
            noted(f'{type(self).__name__} "{self.name}"', self.amplitude, error)
            return nan

    def _check(self) -> str:
        """Check name and amplitude, and return the owner text of messages."""
        owner = _checks.named(self, self.name)
        if self.amplitude is None:
            return owner
        if not callable(self.amplitude):
            raise TypeError(
                f"{owner}: amplitude must be a function of time, got {_checks.show(self.amplitude)}"
            )
        _checks.arguments(owner, "amplitude", self.amplitude, "t")
        return owner
