# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arcs as rational quadratics, and the helix as a function."""

from dataclasses import dataclass
from math import ceil, cos, pi, sin
from typing import Self

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.mesh.nurbs.checks import OWNER, count

# Largest turn of a rational quadratic piece: the middle weight is then 0.5
_LARGEST_TURN = 2.0 * pi / 3.0
_ROUND_OFF = 1e-12


@dataclass(frozen=True)
class Helix:
    """The path of a point that rotates about an axis and moves along it, a function of [0, 1].

    Attributes:
        foot: Point of the axis next to the start.
        radial: From there to the start.
        axis: Unit vector of the axis.
        angle: Whole rotation, radians.
        rise: Whole rise along the axis, metres.
    """

    foot: FloatArray
    radial: FloatArray
    axis: FloatArray
    angle: float
    rise: float

    @classmethod
    def checked(
        cls,
        centre: npt.ArrayLike,
        start: npt.ArrayLike,
        axis: npt.ArrayLike,
        angle: object,
        pitch: object,
    ) -> Self:
        """Check and return the helix with the given rise per full turn, metres.

        Raises:
            TypeError: an argument is not a number.
            ValueError: the axis or the angle is zero, or the start lies on the axis.
        """
        a = _checks.vector(OWNER, "axis", axis, nonzero=True)
        a = a / np.linalg.norm(a)
        c = _checks.vector(OWNER, "centre", centre)
        arm = _checks.vector(OWNER, "start", start) - c
        turn = _checks.number(OWNER, "angle", angle)
        if turn == 0.0:
            raise ValueError(f"{OWNER}: angle must not be zero")
        radial = arm - (arm @ a) * a
        if np.linalg.norm(radial) <= _ROUND_OFF * np.linalg.norm(arm):
            raise ValueError(f"{OWNER}: start {_checks.show(start)} lies on the axis")
        rise = _checks.number(OWNER, "pitch", pitch) * turn / (2.0 * pi)
        return cls(c + (arm @ a) * a, radial, a, turn, rise)

    @property
    def radius(self) -> float:
        """Radius, metres."""
        return float(np.linalg.norm(self.radial))

    def __call__(self, u: FloatArray) -> FloatArray:
        """Return the points at u (n,), shape (n, 3)."""
        turn = self.angle * np.asarray(u)[:, None]
        side = np.cross(self.axis, self.radial)
        path = np.cos(turn) * self.radial + np.sin(turn) * side
        return np.asarray(self.foot + path + self.rise * np.asarray(u)[:, None] * self.axis)


def arc_elements(angle: object, elements: object) -> int:
    """Return the number of elements of an arc: one per quarter turn, or the given one.

    Raises:
        TypeError: an argument is not a number.
        ValueError: the angle is more than 2 pi, or the elements are too few.
    """
    turn = abs(_checks.number(OWNER, "angle", angle))
    if turn > 2.0 * pi * (1.0 + _ROUND_OFF):
        raise ValueError(f"{OWNER}: angle must be 2 pi at most, got {turn:g}")
    if elements is None:
        return max(ceil(turn / (0.5 * pi) - _ROUND_OFF), 1)
    number = count("elements", elements)
    least = ceil(turn / _LARGEST_TURN - _ROUND_OFF)
    if number < least:
        raise ValueError(
            f"{OWNER}: an arc of {turn:g} rad needs {least} elements at least, got {number}"
        )
    return number


def arc(
    centre: npt.ArrayLike,
    start: npt.ArrayLike,
    axis: npt.ArrayLike,
    angle: float,
    elements: int,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return knots, points and weights of an arc of quadratic pieces.

    As few pieces as divide `elements` and turn by 120 degrees at most each (Piegl, Tiller 1997,
    section 7.3).
    """
    circle = Helix.checked(centre, start, axis, angle, 0.0)
    least = ceil(abs(circle.angle) / _LARGEST_TURN - _ROUND_OFF)
    pieces = next(n for n in range(max(least, 1), elements + 1) if elements % n == 0)
    points = circle(np.linspace(0.0, 1.0, 2 * pieces + 1))
    weights = np.ones(2 * pieces + 1)
    weights[1::2] = cos(0.5 * circle.angle / pieces)
    points[1::2] = circle.foot + (points[1::2] - circle.foot) / weights[1]
    if abs(sin(0.5 * circle.angle)) < _ROUND_OFF:
        points[-1] = points[0]
    breaks = np.linspace(0.0, 1.0, pieces + 1)
    knots = np.repeat(breaks, [3, *[2] * (pieces - 1), 3])
    return knots, points, weights
