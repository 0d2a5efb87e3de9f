# SPDX-License-Identifier: LGPL-3.0-or-later
"""Force at a marker."""

from dataclasses import dataclass

import numpy.typing as npt

from flexfem._types import FloatArray
from flexfem.core.load import NOTHING, Amplitude
from flexfem.core.marker import Marker
from flexfem.loads.point_load import PointLoad


@dataclass(frozen=True, eq=False, init=False)
class PointForce(PointLoad):
    """Force at a marker.

    Attributes:
        force: In inertial axes, or in the marker's axes for a follower, shape (3,), N.
    """

    force: FloatArray

    def __init__(
        self,
        name: str,
        marker: Marker,
        force: npt.ArrayLike,
        *,
        follower: bool = False,
        amplitude: Amplitude | None = None,
    ) -> None:
        """Create the load.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: An argument has the wrong shape or is not finite.
        """
        self._assign(name, marker, "force", force, follower, amplitude)

    @property
    def wrench(self) -> tuple[FloatArray, FloatArray]:
        """See :attr:`flexfem.core.load.Load.wrench`."""
        return self.force, NOTHING
