# SPDX-License-Identifier: LGPL-3.0-or-later
"""Force at a marker."""

from flexfem._fields import Array, declared, vector
from flexfem._types import FloatArray
from flexfem.core.load import NOTHING
from flexfem.loads.point_load import PointLoad


@declared
class PointForce(PointLoad):
    """Force at a marker.

    Attributes:
        name: Unique name in the model.
        marker: Point of action.
        force: In inertial axes, or in the marker's axes for a follower, shape (3,), N.
        follower: True if it rotates with the marker.
        amplitude: Factor as a function of time, None for the constant 1.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: An argument has the wrong shape or is not finite.
    """

    force: Array = vector()

    @property
    def wrench(self) -> tuple[FloatArray, FloatArray]:
        """See :attr:`flexfem.core.load.Load.wrench`."""
        return self.force, NOTHING
