# SPDX-License-Identifier: LGPL-3.0-or-later
"""Damping of reduced coordinates."""

import numpy as np
import scipy.linalg

from flexfem._types import BoolArray, FloatArray

__all__ = ["modal_damping"]


def modal_damping(
    mass: FloatArray, stiffness: FloatArray, held: BoolArray, ratio: float
) -> FloatArray:
    """Matrix that gives all elastic modes of the free body the same damping ratio.

    ``C = sum_i 2 zeta omega_i (M x_i)(M x_i)^T`` over its mass-normalised modes (Clough, Penzien
    1993, section 12-4): rigid motions are not damped.

    Args:
        mass: (n, n) of the coordinates.
        stiffness: (n, n) of the coordinates.
        held: (n,) coordinates that are not there.
        ratio: zeta.
    """
    free = np.flatnonzero(~held)
    damping = np.zeros_like(mass)
    if ratio == 0.0 or not len(free):
        return damping
    m, k = mass[np.ix_(free, free)], stiffness[np.ix_(free, free)]
    # coordinates without mass have infinite frequencies: their inverses are computed
    shift = 1e-6 * np.trace(k) / np.trace(m)
    inverse, vectors = scipy.linalg.eigh(m, k + shift * m)
    inverse = np.maximum(inverse, 0.0)
    momenta = m @ vectors
    moving = inverse > 1e-15 * inverse.max()
    square = np.maximum(1.0 / inverse[moving] - shift, 0.0)
    # round-off of a rigid motion's zero
    square[square < 1e-6 * shift] = 0.0
    weights = 2.0 * ratio * np.sqrt(square) / inverse[moving]
    part = momenta[:, moving]
    damping[np.ix_(free, free)] = (part * weights) @ part.T
    return damping
