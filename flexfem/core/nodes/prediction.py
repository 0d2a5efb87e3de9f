# SPDX-License-Identifier: LGPL-3.0-or-later
"""Predictors of the increments of a step, of order 0 to 2."""

from enum import IntEnum

__all__ = ["Misses", "Prediction"]

#: Errors of the predictions below, in their order, m or rad.
Misses = tuple[float, float, float]


class Prediction(IntEnum):
    """Sources of the guess that Newton's method begins with.

    Velocities of vibrations that a step does not resolve, after an impact say, lead far away from
    the solution; so do accelerations after a load has jumped.
    """

    #: nothing: the last state
    REST = 0
    VELOCITY = 1
    #: velocities and accelerations
    ACCELERATION = 2
