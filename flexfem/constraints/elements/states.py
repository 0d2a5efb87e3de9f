# SPDX-License-Identifier: LGPL-3.0-or-later
"""Integration of the states of force elements by the scheme of the motion."""

from __future__ import annotations

from dataclasses import dataclass

from flexfem._types import FloatArray

__all__ = ["AT_REST", "StateStep", "state_step"]


@dataclass(frozen=True)
class StateStep:
    """Coefficients of a step of states z with rates ``g = dz/dt``.

    With z0, g0 of the accepted state and w its rate-like variable, the states at the end satisfy
    ``z = z0 + by_auxiliary w0 + by_rate g0 + gain g(z)``.

    Attributes:
        by_auxiliary, by_rate, gain: see above, s.
        first, last: weights (s) of w0 and w in ``z - z0``; zero outside of steps.
    """

    by_auxiliary: float
    by_rate: float
    gain: float
    first: float
    last: float

    def begin(self, z: FloatArray, w: FloatArray, g: FloatArray) -> FloatArray:
        """States at the end without their rates there."""
        return z + self.by_auxiliary * w + self.by_rate * g

    def auxiliary(self, z: FloatArray, z0: FloatArray, w0: FloatArray) -> FloatArray:
        """The rate-like variable at the end of a step."""
        return (z - z0 - self.first * w0) / self.last


#: No step: states stay as they are.
AT_REST = StateStep(0.0, 0.0, 0.0, 0.0, 0.0)


def state_step(h: float, alpha_m: float, alpha_f: float, gamma: float) -> StateStep:
    """Step of size ``h`` (s) of the generalized-alpha method.

    As velocities are integrated: ``z = z0 + (1 - gamma) h w0 + gamma h w`` with
    ``(1 - alpha_m) w + alpha_m w0 = (1 - alpha_f) g + alpha_f g0``, so that positions, velocities
    and states together are integrated by one scheme (Jansen, Whiting, Hulbert, Comput. Methods
    Appl. Mech. Eng. 190 (2000) 305-319, with the weights of Chung and Hulbert).
    """
    first, last, weight = (1.0 - gamma) * h, gamma * h, 1.0 - alpha_m
    return StateStep(
        first - last * alpha_m / weight, last * alpha_f / weight, last * (1.0 - alpha_f) / weight,
        first, last,
    )  # fmt: skip
