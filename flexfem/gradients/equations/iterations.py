# SPDX-License-Identifier: LGPL-3.0-or-later
"""Iterative solution of linear equations with the factors that a motion has kept."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray
from flexfem.solvers.linear.gmres import minimal_residual

__all__ = ["Operator", "iterated"]

#: Applications of the operator before GMRES begins again, and how often it does.
_MOST, _ROUNDS = 40, 5
#: Rounds without the small part of the operator: it should be in the last digits after these.
_WITHOUT = 2

_Map = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Operator:
    """A linear operator on vectors, each part of which is collective.

    Attributes:
        act: its products with vectors.
        precondition: solves with an operator near to it.
        products: inner products (k,) of rows (k, n) with a vector.
        rest: a small part of it that ``act`` leaves out, since it is costly; None for nothing.
    """

    act: _Map
    precondition: _Map
    products: Callable[[FloatArray, FloatArray], FloatArray]
    rest: _Map | None = None

    def whole(self, vector: FloatArray) -> FloatArray:
        """Product of the whole operator."""
        return self.act(vector) if self.rest is None else self.act(vector) + self.rest(vector)

    def size(self, vector: FloatArray) -> float:
        """Norm of a vector."""
        return float(np.sqrt(self.products(vector[np.newaxis], vector)[0]))


def iterated(
    operator: Operator, right: FloatArray, accuracy: float, guess: FloatArray | None
) -> tuple[FloatArray, FloatArray] | None:
    """Solve equations (collective).

    Args:
        operator: of the equations.
        right: their right-hand sides.
        accuracy: of the solution, relative to that of the preconditioner.
        guess: a vector to begin with.

    Returns:
        The solution and what it misses of the right-hand sides; None without success.
    """
    first = operator.precondition(right)
    solution = first if guess is None else guess
    goal = accuracy * operator.size(first)
    left = right - operator.whole(solution)
    for k in range(_ROUNDS):
        missed = operator.precondition(left)
        size = operator.size(missed)
        if not np.isfinite(size):
            return None
        if size <= goal:
            # the norm is that of the blocks: what is missed along the rows may be large
            return solution + missed, left - operator.whole(missed)
        act = operator.act if k < _WITHOUT else operator.whole
        more, image = _improvement(operator, act, missed, (size, goal))
        solution, left = solution + more, left - image
        if operator.rest is not None and k < _WITHOUT:
            left = left - operator.rest(more)
    return None


def _improvement(
    operator: Operator, act: _Map, missed: FloatArray, sizes: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """What to add to a solution that misses a vector by GMRES, and its image.

    ``sizes`` are that of what is missed, and that of what may be.
    """
    basis: list[FloatArray] = []
    images: list[FloatArray] = []

    def apply(vector: FloatArray) -> FloatArray:
        basis.append(vector)
        images.append(act(vector))
        return operator.precondition(images[-1])

    more, _ = minimal_residual(apply, missed, sizes[0], operator.products, sizes[1], _MOST)
    return more, operator.products(np.array(basis), more) @ np.array(images)
