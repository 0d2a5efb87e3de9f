# SPDX-License-Identifier: LGPL-3.0-or-later
"""Uniform gravity."""

from flexfem._fields import Array, declared, vector


@declared
class Gravity:
    """Uniform gravity on all bodies.

    Attributes:
        acceleration: In inertial axes, shape (3,), m/s^2.

    Raises:
        TypeError: The acceleration does not consist of numbers.
        ValueError: It is not a finite vector of three.
    """

    acceleration: Array = vector()
