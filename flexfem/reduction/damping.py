# SPDX-License-Identifier: LGPL-3.0-or-later
"""Damping of reduced coordinates."""

import numpy as np
import scipy.linalg

from flexfem._types import BoolArray, FloatArray

__all__ = ["modal_damping"]


def modal_damping(
    mass: FloatArray, stiffness: FloatArray, held: BoolArray, ratio: float, rigid: int
) -> FloatArray:
    """Matrix that gives all elastic modes of the free body the same damping ratio.

    ``C = sum_i 2 zeta omega_i (M x_i)(M x_i)^T`` over its mass-normalised modes (Clough, Penzien
    1993, section 12-4): rigid motions are not damped.

    Args:
        mass: (n, n) of the coordinates.
        stiffness: (n, n) of the coordinates.
        held: (n,) fixed coordinates.
        ratio: zeta.
        rigid: number of rigid motions, which cost no energy.
    """
    free = np.flatnonzero(~held)
    damping = np.zeros_like(mass)
    if ratio == 0.0 or not len(free):
        return damping
    m, k = mass[np.ix_(free, free)], stiffness[np.ix_(free, free)]
    try:
        squares, vectors = scipy.linalg.eigh(k, m)
    except np.linalg.LinAlgError:
        squares, vectors = _with_massless(k, m)
    squares[:rigid] = 0.0
    part = m @ vectors
    weights = 2.0 * ratio * np.sqrt(np.maximum(squares, 0.0))
    damping[np.ix_(free, free)] = (part * weights) @ part.T
    return damping


def _with_massless(k: FloatArray, m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues and mass-normalised vectors of the coordinates that have mass."""
    shift = 1e-6 * np.trace(k) / np.trace(m)
    inverse, vectors = scipy.linalg.eigh(m, k + shift * m)
    moving = inverse > 1e-12 * inverse.max()
    inverse, vectors = inverse[moving][::-1], vectors[:, moving][:, ::-1]
    return 1.0 / inverse - shift, vectors / np.sqrt(inverse)
