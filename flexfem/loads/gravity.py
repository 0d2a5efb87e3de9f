# SPDX-License-Identifier: LGPL-3.0-or-later
"""Uniform gravity."""

from dataclasses import dataclass

import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray


@dataclass(frozen=True, eq=False, init=False)
class Gravity:
    """Uniform gravity on all bodies.

    Attributes:
        acceleration: In inertial axes, shape (3,), m/s^2.
    """

    acceleration: FloatArray

    def __init__(self, acceleration: npt.ArrayLike) -> None:
        """Create gravity.

        Raises:
            TypeError: The acceleration does not consist of numbers.
            ValueError: It is not a finite vector of three.
        """
        _checks.assign(self, acceleration=_checks.vector("Gravity", "acceleration", acceleration))
