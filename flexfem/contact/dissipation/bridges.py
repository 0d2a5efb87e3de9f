# SPDX-License-Identifier: LGPL-3.0-or-later
"""Slopes over the steep parts of regularised laws, for Newton's method.

Between two sides where they hardly change, friction and restitution fall within a small motion w:
with the slopes of the trial states, Newton's method would jump from one side to the other for ever
where the solution lies between. But the last slope and the motion since then say which force is
wanted now: that of the linear model there. If it lies between those of both sides, so does the
solution: the slope is that to the point of the law that has this force, which is a step of
Newton's method for the motion as a function of the force.
"""

import numpy as np

from flexfem.kernels.compiled import inlined

__all__ = ["inverse", "is_near", "ramp"]

#: Distance from the point with the wanted force, in parts of w, within which the slope of the law
#: is the better one; and where the law has no slope, round-off.
_NEAR, _NOWHERE = 0.1, 1e-9


@inlined
def ramp(way: float, width: float) -> tuple[float, float]:
    """f(way / width) and its derivative by the way."""
    y = way / width
    if y < 0.0:
        return 0.0, 0.0
    return (1.0, 0.0) if y >= 1.0 else (y * (2.0 - y), 2.0 * (1.0 - y) / width)


@inlined
def inverse(part: float) -> float:
    """The y in [0, 1] with f(y) = y (2 - y) = part."""
    return float(1.0 - np.sqrt(max(1.0 - part, 0.0)))


@inlined
def is_near(way: float, width: float, steep: bool) -> bool:
    """Return True if the slope of the law is the better one.

    Args:
        way: of the trial state from the point of the law with the wanted force, m.
        width: w, m.
        steep: True if the law is steep at the trial state.
    """
    return way <= (_NEAR if steep else _NOWHERE) * width
