# SPDX-License-Identifier: LGPL-3.0-or-later
"""GMRES with a few basis vectors, for operators that are close to the identity.

Inner products are an argument: those of frozen steps omit the multipliers, which several ranks may
have, and need one reduction a vector, together with the norm. PETSc's GMRES has neither. By itself
it is faster on one rank, 11 against 45 us for three vectors of 54 unknowns and 58 against 99 us of
5000; an application takes more (``tests/benchmarks/gmres_against_petsc.py``).
"""

from collections.abc import Callable
from math import hypot, isfinite, sqrt

import numpy as np

from flexfem._types import FloatArray

__all__ = ["minimal_residual"]

#: Part of its square by which one orthogonalisation may reduce a vector; beyond it a second one
#: follows (Daniel, Gragg, Kaufman, Stewart 1976).
_LOST = 0.99


def minimal_residual(
    apply: Callable[[FloatArray], FloatArray],
    residual: FloatArray,
    norm: float,
    products: Callable[[FloatArray, FloatArray], FloatArray],
    tolerance: float,
    most: int,
) -> tuple[FloatArray, bool]:
    """Solve ``B z = residual`` from zero (Saad, Schultz 1986), with one reduction a vector.

    Classical Gram–Schmidt acts on ``(B - I) v``, which is small, so that little is cancelled.

    Args:
        apply: the operator B; returns a new vector.
        residual: right-hand side (n,).
        norm: its norm.
        products: inner products (k,) of the rows of (k, n) with (n,), the same on all ranks.
        tolerance: stop when the norm of the residual falls below it.
        most: largest number of applications of B.

    Returns:
        The solution, not finite if residual or operator are not, which the caller must check; True
        if it is as accurate as required.
    """
    if norm <= tolerance or norm == 0.0 or not isfinite(norm):
        # one fixed-point iteration, accurate if B is close to the identity
        return residual.copy(), isfinite(norm)
    basis, triangle = np.empty((most + 1, len(residual))), np.zeros((most, most))
    np.divide(residual, norm, out=basis[0])
    turns: list[tuple[float, float]] = []
    right = [norm]
    for k in range(most):
        np.subtract(apply(basis[k]), basis[k], out=basis[k + 1])
        column, length = _orthogonalise(basis[: k + 2], products)
        column[k] += 1.0
        if not isfinite(sum(column) + length):
            return np.full_like(residual, np.nan), False
        for i, (c, s) in enumerate(turns):
            first, second = column[i : i + 2]
            column[i : i + 2] = c * first + s * second, c * second - s * first
        size = hypot(column[k], length)
        if size == 0.0:  # B is singular here
            break
        c, s = column[k] / size, length / size
        column[k] = size
        turns.append((c, s))
        triangle[: k + 1, k] = column
        right[k:] = [c * right[k], -s * right[k]]
        if abs(right[-1]) <= tolerance or length <= 1e-14:
            break
        basis[k + 1] /= length
    used = len(turns)
    weights = np.linalg.solve(triangle[:used, :used], right[:used])
    return weights @ basis[:used], abs(right[-1]) <= tolerance


def _orthogonalise(
    rows: FloatArray, products: Callable[[FloatArray, FloatArray], FloatArray]
) -> tuple[list[float], float]:
    """Make the last row orthogonal to those before it, which are orthonormal.

    Returns:
        Its components along them, and its remaining length.
    """
    basis, vector = rows[:-1], rows[-1]
    column, left = np.zeros(len(basis)), 0.0
    for _ in range(2):
        *found, square = products(rows, vector)
        vector -= np.dot(found, basis)
        column += found
        left = square - float(np.dot(found, found))
        if left > (1.0 - _LOST) * square:
            break
    return column.tolist(), sqrt(max(left, 0.0)) if isfinite(left) else left
