# SPDX-License-Identifier: LGPL-3.0-or-later
"""Force per length along a beam."""

from dataclasses import dataclass

import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.core.load import NOTHING, Amplitude, Load


@dataclass(frozen=True, eq=False, init=False)
class LineLoad(Load):
    """Uniform force per initial length along a beam.

    Attributes:
        name: Unique name in the model.
        body: Name of the beam.
        force_per_length: In inertial axes, or in section axes for a follower, shape (3,), N/m.
        follower: Whether it turns with the sections.
        amplitude: Factor as a function of time, None for the constant 1.
    """

    name: str
    body: str
    force_per_length: FloatArray
    follower: bool
    amplitude: Amplitude | None

    def __init__(
        self,
        name: str,
        body: str,
        force_per_length: npt.ArrayLike,
        *,
        follower: bool = False,
        amplitude: Amplitude | None = None,
    ) -> None:
        """Create the load.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: An argument has the wrong shape or is not finite.
        """
        _checks.assign(self, name=name, body=body, follower=follower, amplitude=amplitude)
        owner = self._check()
        _checks.text(owner, "body", body)
        _checks.instance(owner, "follower", follower, bool)
        force = _checks.vector(owner, "force_per_length", force_per_length)
        _checks.assign(self, force_per_length=force)

    @property
    def beams(self) -> tuple[str, ...]:
        """Names of the beams along which the load acts."""
        return (self.body,)

    @property
    def wrench(self) -> tuple[FloatArray, FloatArray]:
        """See :attr:`flexfem.core.load.Load.wrench`."""
        return self.force_per_length, NOTHING
