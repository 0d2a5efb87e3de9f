# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion of points relative to carriers, between two states.

Points move along straight lines, x(t) = x0 + t dx, and carriers by screws, H(t) = H0 exp(t w) with
w = (u, theta), for t from 0 to 1. In the axes of a carrier a point is at q(t), with

    q' = R^T dx - u - theta x q,    q'' = -theta x (R^T dx + q').
"""

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.fields.obstacles import Placed, arms_of
from flexfem.lie import se3

__all__ = ["Paths"]


@dataclass(frozen=True)
class Paths:
    """Ways of points (k,) relative to carriers.

    Attributes:
        start: Positions at the start, shape (k, 3), metres.
        step: Of the points, shape (k, 3), metres.
        frames: Of the carriers at the start, shape (k, 12).
        twists: Local increments of the carriers, shape (k, 6).
    """

    start: FloatArray
    step: FloatArray
    frames: FloatArray
    twists: FloatArray

    @classmethod
    def of(cls, points: IntArray, fields: IntArray, before: Placed, after: Placed) -> "Paths":
        """Ways of points with some rows (k,) relative to carriers with some numbers (k,)."""
        twists = se3.log(se3.compose(se3.inverse(before.frames), after.frames))
        start = before.points[points]
        return cls(start, after.points[points] - start, before.frames[fields], twists[fields])

    def of_rows(self, rows: IntArray) -> "Paths":
        """Some of them."""
        return Paths(self.start[rows], self.step[rows], self.frames[rows], self.twists[rows])

    def at(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions and rates (k, 3) in the carriers' axes, and bounds (k,) of q'' from t on."""
        frames = se3.compose(self.frames, se3.exp(t[:, None] * self.twists))
        arms = arms_of(self.start + t[:, None] * self.step, frames)
        u, theta = self.twists[:, :3], self.twists[:, 3:]
        local = np.einsum("kba,kb->ka", se3.rotation(frames), self.step)
        rates = local - u - np.cross(theta, arms)
        turn, move, shift = (np.linalg.norm(x, axis=1) for x in (theta, self.step, u))
        # the bracket changes by theta x (R^T dx) and theta x q' at most, and |q| by moves of both
        fastest = move + shift + turn * (np.linalg.norm(arms, axis=1) + move + shift)
        later = (1.0 - t) * turn * (move + fastest)
        bound = turn * (np.linalg.norm(local + rates, axis=1) + later)
        return arms, rates, bound

    def ways(self) -> FloatArray:
        """Bounds (k,) of the relative ways, m."""
        _, rates, bound = self.at(np.zeros(len(self.start)))
        ways: FloatArray = np.linalg.norm(rates, axis=1) + 0.5 * bound
        return ways
