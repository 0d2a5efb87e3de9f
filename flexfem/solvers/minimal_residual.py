# SPDX-License-Identifier: LGPL-3.0-or-later
"""GMRES for a few vectors, for operators that are close to the identity."""

from collections.abc import Callable

import numpy as np

from flexfem._types import FloatArray

__all__ = ["minimal_residual"]


def minimal_residual(
    apply: Callable[[FloatArray], FloatArray],
    residual: FloatArray,
    dot: Callable[[FloatArray, FloatArray], float],
    tolerance: float,
    most: int,
) -> tuple[FloatArray, bool]:
    """Solve ``B z = residual`` from zero (Saad, Schultz 1986, with modified Gram–Schmidt).

    Args:
        apply: the operator B.
        residual: right-hand side.
        dot: inner product, the same on all ranks.
        tolerance: stop when the norm of the residual falls below it.
        most: largest number of applications of B.

    Returns:
        The solution, not finite where residual or operator are not, which is left to the caller;
        whether it is as accurate as asked for.
    """
    beta = dot(residual, residual) ** 0.5
    if beta <= tolerance or beta == 0.0 or not np.isfinite(beta):
        # one sweep of the fixed point, as good as B is close to one
        return residual.copy(), bool(np.isfinite(beta))
    basis, hessenberg = [residual / beta], np.zeros((most + 1, most))
    right = np.zeros(most + 1)
    right[0] = beta
    weights, left = np.zeros(1), beta
    for k in range(most):
        vector = apply(basis[k])
        for i, other in enumerate(basis):
            hessenberg[i, k] = dot(other, vector)
            vector -= hessenberg[i, k] * other
        hessenberg[k + 1, k] = dot(vector, vector) ** 0.5
        system = hessenberg[: k + 2, : k + 1]
        if not np.isfinite(system).all():
            return np.full_like(residual, np.nan), False
        weights = np.linalg.lstsq(system, right[: k + 2])[0]
        left = float(np.linalg.norm(right[: k + 2] - system @ weights))
        if left <= tolerance or hessenberg[k + 1, k] <= 1e-14 * beta:
            break
        basis.append(vector / hessenberg[k + 1, k])
    solution = np.sum([w * v for w, v in zip(weights, basis, strict=False)], axis=0)
    return solution, left <= tolerance
