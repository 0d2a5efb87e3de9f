# SPDX-License-Identifier: LGPL-3.0-or-later
"""Common parts of forces and moments at a marker."""

import numpy.typing as npt

from flexfem import _checks
from flexfem.core.load import Amplitude, Load
from flexfem.core.marker import Marker


class PointLoad(Load):
    """Load at a marker.

    Attributes:
        name: Unique name in the model.
        marker: Where it acts.
        follower: Whether it turns with the marker.
        amplitude: Factor as a function of time, None for the constant 1.
    """

    marker: Marker

    def _assign(
        self,
        name: str,
        marker: Marker,
        what: str,
        value: npt.ArrayLike,
        follower: bool,
        amplitude: Amplitude | None,
    ) -> None:
        """Check and store the fields; `value` becomes the attribute `what`, shape (3,).

        Raises:
            TypeError: A field has the wrong type.
            ValueError: The value has the wrong shape or is not finite.
        """
        _checks.assign(self, name=name, marker=marker, follower=follower, amplitude=amplitude)
        owner = self._check()
        _checks.instance(owner, "marker", marker, Marker)
        _checks.instance(owner, "follower", follower, bool)
        _checks.assign(self, **{what: _checks.vector(owner, what, value)})

    @property
    def markers(self) -> tuple[Marker, ...]:
        """Markers the load acts at."""
        return (self.marker,)
