# SPDX-License-Identifier: LGPL-3.0-or-later
"""Common parts of forces and moments at a marker."""

from dataclasses import KW_ONLY

from flexfem._fields import declared, flag, instance
from flexfem.core.load import Amplitude, Load
from flexfem.core.marker import Marker


@declared
class PointLoad(Load):
    """Load at a marker.

    Attributes:
        name: Unique name in the model.
        marker: Point of action.
        follower: True if it rotates with the marker.
        amplitude: Factor as a function of time, None for the constant 1.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: An argument has the wrong shape or is not finite.
    """

    name: str
    marker: Marker = instance(Marker)
    _: KW_ONLY
    follower: bool = flag(default=False)
    amplitude: Amplitude | None = None

    _owner = property(Load._check)

    @property
    def markers(self) -> tuple[Marker, ...]:
        """Markers the load acts at."""
        return (self.marker,)
