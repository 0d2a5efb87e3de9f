# SPDX-License-Identifier: LGPL-3.0-or-later
"""Exact discrete derivatives of UFL expressions.

A :class:`Change` holds a quantity at both ends of a step and a linear form ``d`` of a test motion
that equals the difference of both values when the test motion is the motion of the step itself. The
rules below carry this identity through products, quotients, roots and polynomials without any
division by a difference, so that it holds to rounding for steps of any size, zero included:
``mean(a) db + mean(b) da`` for ``ab``, ``-da / (a_0 a_1)`` for ``1/a``, ``da / (sqrt(a_0) +
sqrt(a_1))`` for the root, and the divided difference by Horner's scheme for polynomials.

Forces derived with such forms do exactly the work by which an energy changes (discrete gradients in
the sense of Gonzalez, J. Nonlinear Sci. 6 (1996) 449-467). As every rule is built of invariants
where the quantities are, nothing is lost of their objectivity either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import ufl

from flexfem.forms.lie import Expr

__all__ = ["Change", "cross", "dot", "inverse", "polynomial", "root"]


@dataclass(frozen=True)
class Change:
    """A quantity over a step.

    Attributes:
        start, end: values at both ends.
        d: linear form of the test motion.
    """

    start: Expr
    end: Expr
    d: Expr

    @property
    def values(self) -> tuple[Expr, Expr, Expr]:
        """Start, end and linear form."""
        return self.start, self.end, self.d

    @property
    def mean(self) -> Expr:
        """Average of both values."""
        return 0.5 * (self.start + self.end)

    def __add__(self, other: Change | float) -> Change:
        """Sum, also with a number."""
        if isinstance(other, Change):
            return Change(self.start + other.start, self.end + other.end, self.d + other.d)
        return Change(self.start + other, self.end + other, self.d)

    __radd__ = __add__

    def __mul__(self, other: Change | float) -> Change:
        """Product with a number or with another change, one of them scalar."""
        if isinstance(other, Change):
            return Change(
                self.start * other.start,
                self.end * other.end,
                self.d * other.mean + self.mean * other.d,
            )
        return Change(other * self.start, other * self.end, other * self.d)

    __rmul__ = __mul__

    def __neg__(self) -> Change:
        """Opposite."""
        return Change(-self.start, -self.end, -self.d)

    def __sub__(self, other: Change) -> Change:
        """Difference."""
        return self + (-other)


def dot(a: Change, b: Change) -> Change:
    """Scalar product of vectors."""
    return Change(
        ufl.dot(a.start, b.start),
        ufl.dot(a.end, b.end),
        ufl.dot(a.d, b.mean) + ufl.dot(a.mean, b.d),
    )


def cross(a: Change, b: Change) -> Change:
    """Vector product."""
    return Change(
        ufl.cross(a.start, b.start),
        ufl.cross(a.end, b.end),
        ufl.cross(a.d, b.mean) + ufl.cross(a.mean, b.d),
    )


def inverse(a: Change) -> Change:
    """``1 / a``."""
    start, end = 1 / a.start, 1 / a.end
    return Change(start, end, -(start * end) * a.d)


def root(a: Change) -> Change:
    """Square root."""
    start, end = ufl.sqrt(a.start), ufl.sqrt(a.end)
    return Change(start, end, a.d / (start + end))


def polynomial(series: Sequence[float], a: Change) -> Change:
    """``series[0] + series[1] a + ...``."""
    start = end = ufl.as_ufl(series[-1])
    slope = ufl.as_ufl(0.0)
    for factor in reversed(series[:-1]):
        slope = slope * a.end + start  # divided difference of the next factor
        start, end = start * a.start + factor, end * a.end + factor
    return Change(start, end, slope * a.d)
