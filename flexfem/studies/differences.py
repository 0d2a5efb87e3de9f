# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives by central differences with two steps, and what they are worth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

__all__ = ["OFFSETS", "TRUST", "Derivative", "derivative"]

#: Where the function is evaluated, in steps.
OFFSETS = (-1.0, -0.5, 0.0, 0.5, 1.0)
#: Relative error above which a derivative comes with a warning.
TRUST = 1e-2


class Derivative(NamedTuple):
    """A derivative and its estimated error.

    Attributes:
        value: of the derivative.
        truncation: error of the shorter step by its difference to the longer one.
        noise: error by the noise of the five values.
        both: derivatives of the longer and the shorter step alone.
        level: noise of the function.
    """

    value: float
    truncation: float
    noise: float
    both: tuple[float, float]
    level: float

    @property
    def error(self) -> float:
        """Sum of both errors."""
        return self.truncation + self.noise

    @property
    def poor(self) -> bool:
        """The error is more than a hundredth of the derivative."""
        return not self.error <= TRUST * abs(self.value)

    @property
    def noisy(self) -> bool:
        """Noise is the larger error: a longer step is better."""
        return self.noise > self.truncation


def derivative(places: Sequence[float], values: Sequence[float]) -> Derivative:
    """Richardson's extrapolation of two central differences.

    The noise of values, by tolerances and round-off, is estimated from their fourth difference, in
    which smooth functions all but vanish (Hamming, Numerical Methods for Scientists and Engineers,
    1973, section 10.6): its variance is 70 times that of the values. Noise counts by two standard
    deviations of the extrapolated derivative.

    Args:
        places: five, at ``OFFSETS``.
        values: of the function there.
    """
    x, f = np.asarray(places), np.asarray(values)
    long, short = (f[4] - f[0]) / (x[4] - x[0]), (f[3] - f[1]) / (x[3] - x[1])
    fourth = abs(f[0] - 4.0 * f[1] + 6.0 * f[2] - 4.0 * f[3] + f[4])
    level = max(fourth / 70.0**0.5, np.finfo(float).eps * np.abs(f).max())
    if (f == f[0]).all():  # it does not depend on this at all
        level = 0.0
    return Derivative(
        float((4.0 * short - long) / 3.0), float(abs(short - long) / 3.0),
        float(4.0 * level / (x[3] - x[1])), (float(long), float(short)), float(level),
    )  # fmt: skip
