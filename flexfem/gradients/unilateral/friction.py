# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivative of Coulomb's friction over a step by normal force and slips.

With the slip s and that of the final slip rate sigma (``contact.dissipation.friction``),

``t = -N c(|x|) x``,  ``x = p sigma``,  ``p = min(max(s . sigma/|sigma|^2, 0), 1)``.

It has kinks where p is 0 or 1; the derivative there is that of one side. Where nothing slips p
counts as 1: what sticks in an impact has a final slip rate of zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.dissipation.data import FORCE, PUSH, SIGMA, SLIP, Law

__all__ = ["Friction"]

#: Slip, in parts of that from which on friction is that of Coulomb's law, up to which it is none.
_RESTS = 1e-9


@dataclass(frozen=True)
class Friction:
    """Friction of groups.

    Attributes:
        force: t (g, 3), N.
        slopes: (g, 3, 7) derivatives by N, s and sigma.
    """

    force: FloatArray
    slopes: FloatArray

    @classmethod
    def of(cls, law: Law, dt: float, numbers: FloatArray) -> Friction:
        """That of groups with some numbers (g, GROUP_FIELDS), in a step of size dt, s."""
        push, s, sigma = numbers[:, PUSH], numbers[:, SLIP:SIGMA], numbers[:, SIGMA : SIGMA + 3]
        square = (sigma**2).sum(axis=1)
        work = (s * sigma).sum(axis=1)
        rests = square <= (_RESTS * law.slip_speed * dt) ** 2
        inside = (work > 0.0) & (work < square) & ~rests
        p = np.divide(work, square, out=((work >= square) | rests).astype(float), where=inside)
        x = p[:, np.newaxis] * sigma
        by = np.zeros((len(push), 3, 6))
        by[:, :, 3:] = p[:, np.newaxis, np.newaxis] * np.eye(3)
        changes = np.concatenate([sigma, s - 2.0 * p[:, np.newaxis] * sigma], axis=1)
        more = sigma[:, :, np.newaxis] * changes[:, np.newaxis]
        by[inside] += more[inside] / square[inside, np.newaxis, np.newaxis]
        size = np.sqrt((x**2).sum(axis=1))
        secant, tangent = _coefficients(law, size, dt)
        along = np.divide(
            x, size[:, np.newaxis], out=np.zeros_like(x), where=size[:, np.newaxis] > 0.0
        )
        slope = secant[:, np.newaxis, np.newaxis] * np.eye(3)
        slope = slope + (tangent - secant)[:, np.newaxis, np.newaxis] * (
            along[:, :, np.newaxis] * along[:, np.newaxis]
        )
        slopes = np.empty((len(push), 3, 7))
        slopes[:, :, 0] = -secant[:, np.newaxis] * x
        slopes[:, :, 1:] = -push[:, np.newaxis, np.newaxis] * (slope @ by)
        return cls(numbers[:, FORCE : FORCE + 3], slopes)


def _coefficients(law: Law, size: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
    """C and the derivative of c |x| by |x|, 1/m, for slips (g,), m."""
    width = law.slip_speed * dt
    ratio = size / (law.stribeck_speed * dt)
    more = (law.static_friction - law.friction) * np.exp(-(ratio**2))
    mu, y = law.friction + more, np.minimum(size / width, 1.0)
    change = -2.0 * more * ratio / (law.stribeck_speed * dt)
    ramp = y * (2.0 - y)
    secant = mu * np.divide(ramp, size, out=np.full_like(size, 2.0 / width), where=size > 0.0)
    return secant, change * ramp + mu * 2.0 * (1.0 - y) / width
