# SPDX-License-Identifier: LGPL-3.0-or-later
"""Moment at a marker."""

from dataclasses import dataclass

import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.core.load import NOTHING, Amplitude, Load
from flexfem.core.marker import Marker


@dataclass(frozen=True, eq=False, init=False)
class PointMoment(Load):
    """Moment at a marker.

    Attributes:
        name: Unique name in the model.
        marker: Where it acts.
        moment: In inertial axes, or in the marker's axes for a follower, shape (3,), N m.
        follower: Whether it turns with the marker.
        amplitude: Factor as a function of time, None for the constant 1.
    """

    name: str
    marker: Marker
    moment: FloatArray
    follower: bool
    amplitude: Amplitude | None

    def __init__(
        self,
        name: str,
        marker: Marker,
        moment: npt.ArrayLike,
        *,
        follower: bool = False,
        amplitude: Amplitude | None = None,
    ) -> None:
        """Create the load.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: An argument has the wrong shape or is not finite.
        """
        _checks.assign(self, name=name, marker=marker, follower=follower, amplitude=amplitude)
        owner = self._check()
        _checks.instance(owner, "marker", marker, Marker)
        _checks.instance(owner, "follower", follower, bool)
        _checks.assign(self, moment=_checks.vector(owner, "moment", moment))

    @property
    def markers(self) -> tuple[Marker, ...]:
        """Markers the load acts at."""
        return (self.marker,)

    @property
    def wrench(self) -> tuple[FloatArray, FloatArray]:
        """See :attr:`flexfem.core.load.Load.wrench`."""
        return NOTHING, self.moment
