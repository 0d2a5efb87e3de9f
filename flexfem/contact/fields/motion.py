# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion of points relative to obstacles, between two states.

Points move along straight lines, x(t) = x0 + t dx, and obstacles by screws, H(t) = H0 exp(t w) with
w = (u, theta), for t from 0 to 1. In the axes of an obstacle a point is at q(t), with

    q' = R^T dx - u - theta x q,    q'' = -theta x (R^T dx + q').
"""

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.fields.obstacles import Placed
from flexfem.kernels.compiled import inlined, kernel
from flexfem.lie import se3

__all__ = ["Paths"]


@dataclass(frozen=True)
class Paths:
    """Ways of points (k,) relative to obstacles.

    Attributes:
        start: Positions at the start, shape (k, 3), metres.
        step: Of the points, shape (k, 3), metres.
        frames: Of the obstacles at the start, shape (k, 12).
        twists: Local increments of the obstacles, shape (k, 6).
    """

    start: FloatArray
    step: FloatArray
    frames: FloatArray
    twists: FloatArray

    @classmethod
    def of(cls, points: IntArray, fields: IntArray, before: Placed, after: Placed) -> "Paths":
        """Ways of points with some rows (k,) relative to obstacles with some numbers (k,)."""
        twists = se3.log(se3.compose(se3.inverse(before.frames), after.frames))
        start = before.points[points]
        return cls(start, after.points[points] - start, before.frames[fields], twists[fields])

    def of_rows(self, rows: IntArray) -> "Paths":
        """Some of them."""
        return Paths(self.start[rows], self.step[rows], self.frames[rows], self.twists[rows])

    def at(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions and rates (k, 3) in the obstacles' axes, and bounds (k,) of q'' from t on."""
        arms, rates, bounds = np.empty((len(t), 3)), np.empty((len(t), 3)), np.empty(len(t))
        _at_into(self.start, self.step, self.frames, self.twists, t, arms, rates, bounds)
        return arms, rates, bounds


@inlined
def _size(v: FloatArray) -> float:
    return float(np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]))


@kernel
def _at_into(
    start: FloatArray, step: FloatArray, frames: FloatArray, twists: FloatArray, t: FloatArray,
    arms: FloatArray, rates: FloatArray, bounds: FloatArray,
) -> None:  # fmt: skip
    """Write the results of :meth:`Paths.at`."""
    w, turn, frame, both = np.empty(6), np.empty(12), np.empty(12), np.empty(3)
    for k in range(len(t)):
        for a in range(6):
            w[a] = t[k] * twists[k, a]
        se3.exp_into(w, turn)
        se3.compose_into(frames[k], turn, frame)
        for a in range(3):
            arms[k, a] = both[a] = 0.0
            for b in range(3):
                way = start[k, b] + t[k] * step[k, b] - frame[b]
                arms[k, a] += frame[3 + 3 * b + a] * way
                both[a] += frame[3 + 3 * b + a] * step[k, b]
        u, theta, arm = twists[k, :3], twists[k, 3:], arms[k]
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            rates[k, a] = both[a] - u[a] - (theta[b] * arm[c] - theta[c] * arm[b])
            both[a] += rates[k, a]
        angle, move, shift = _size(theta), _size(step[k]), _size(u)
        # the bracket changes by theta x (R^T dx) and theta x q' at most, and |q| by moves of both
        fastest = move + shift + angle * (_size(arm) + move + shift)
        later = (1.0 - t[k]) * angle * (move + fastest)
        bounds[k] = angle * (_size(both) + later)
