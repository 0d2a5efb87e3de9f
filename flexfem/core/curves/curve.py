# SPDX-License-Identifier: LGPL-3.0-or-later
"""Functions of one number through given points."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray

__all__ = ["Curve"]

_KINDS = ("linear", "monotone", "spline")
_BEYOND = ("linear", "constant")


class Curve:
    """Function of one number through given points, for laws of forces.

    Attributes:
        x: (n,) increasing.
        y: (n,) values there.
        kind: "linear" between the points; "monotone" for cubics without overshoot, of which the
            first derivative is continuous (Fritsch, Butland, SIAM J. Sci. Stat. Comput. 5 (1984)
            300-304); "spline" for the cubic spline, whose second one is, too (not-a-knot ends).
        beyond: "linear", along the tangents at the ends, or "constant".
    """

    def __init__(
        self, x: npt.ArrayLike, y: npt.ArrayLike, kind: str = "linear", beyond: str = "linear"
    ) -> None:
        """Make the curve.

        Raises:
            TypeError: x or y does not consist of numbers.
            ValueError: fewer than two points, x and y of different lengths, x that do not increase,
                or an unknown word.
        """
        self.x = _checks.array("Curve", "x", x, (-1,))
        self.y = _checks.array("Curve", "y", y, (-1,))
        self.kind = _checks.word("Curve", "kind", kind, _KINDS)
        self.beyond = _checks.word("Curve", "beyond", beyond, _BEYOND)
        if len(self.x) < 2 or len(self.x) != len(self.y):
            raise ValueError(
                f"Curve: x and y must hold the same number of points, two at least, got "
                f"{len(self.x)} and {len(self.y)}"
            )
        if not (np.diff(self.x) > 0.0).all():
            raise ValueError(f"Curve: x must increase, got {_checks.show(self.x.tolist())}")

    def __repr__(self) -> str:
        """Kind, number of points and range."""
        return f"Curve({len(self.x)} points from {self.x[0]:g} to {self.x[-1]:g}, {self.kind})"

    @cached_property
    def pieces(self) -> FloatArray:
        """(n + 1, 5) start of each piece and coefficients of powers 0 to 3 of the distance from it.

        The first piece lies before the first point, and the last one behind the last.
        """
        if self.kind == "linear" or len(self.x) == 2:
            slope = np.diff(self.y) / np.diff(self.x)
            inner = np.stack([self.y[:-1], slope, 0.0 * slope, 0.0 * slope], axis=1)
        else:
            from scipy.interpolate import CubicSpline, PchipInterpolator

            make = CubicSpline if self.kind == "spline" else PchipInterpolator
            inner = make(self.x, self.y).c[::-1].T
        width = self.x[-1] - self.x[-2]
        last = inner[-1] @ [0.0, 1.0, 2.0 * width, 3.0 * width**2]
        first = inner[0, 1]
        if self.beyond == "constant":
            first = last = 0.0
        before, behind = [self.y[0], first, 0.0, 0.0], [self.y[-1], last, 0.0, 0.0]
        starts = np.concatenate([self.x[:1], self.x])
        return np.column_stack([starts, np.vstack([before, inner, behind])])

    @cached_property
    def function(self) -> Callable[[Any], Any]:
        """The curve as a function of one number that can be compiled."""
        pieces, count = self.pieces, len(self.x)

        def curve(x):  # type: ignore[no-untyped-def]
            k = 0
            while k < count and x > pieces[k + 1, 0]:
                k += 1
            d = x - pieces[k, 0]
            return pieces[k, 1] + d * (pieces[k, 2] + d * (pieces[k, 3] + d * pieces[k, 4]))

        return curve

    def __call__(self, x: Any) -> Any:
        """Value at a number, or at each of an array."""
        if np.ndim(x) == 0:
            return float(self.function(float(x)))
        return np.vectorize(self.function, otypes=[np.float64])(x)
