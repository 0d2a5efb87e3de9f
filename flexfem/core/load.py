# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the model knows of a load."""

from collections.abc import Callable

from flexfem import _checks
from flexfem.core.marker import Marker

#: Factor on a load as a function of time (seconds).
Amplitude = Callable[[float], float]


class Load:
    """Base class of the loads that a model holds by name.

    Attributes:
        name: Unique name of the load in its model.
        amplitude: Factor on the load as a function of time, None for the constant 1.
    """

    name: str
    amplitude: Amplitude | None

    @property
    def markers(self) -> tuple[Marker, ...]:
        """Markers the load acts at."""
        return ()

    @property
    def beams(self) -> tuple[str, ...]:
        """Names of the beams along which the load acts."""
        return ()

    def factor(self, t: float) -> float:
        """Return the amplitude at time `t` in seconds."""
        return 1.0 if self.amplitude is None else float(self.amplitude(t))

    def _check(self) -> str:
        """Check name and amplitude, and return the owner text of messages."""
        owner = _checks.named(self, self.name)
        if self.amplitude is not None and not callable(self.amplitude):
            raise TypeError(
                f"{owner}: amplitude must be a function of time, got {_checks.show(self.amplitude)}"
            )
        return owner
