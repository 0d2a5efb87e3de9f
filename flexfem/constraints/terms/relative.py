# SPDX-License-Identifier: LGPL-3.0-or-later
"""Terms that are functions of the relative pose of their markers: gradients and Hessians.

Such a function of ``p = R_a^T (x_b - x_a)`` and ``R = R_a^T R_b`` is given by its value and
derivatives ``g_b`` (6) and ``h_bb`` (6, 6) along local twists of b. Twists of a act like those
``T_a delta_a`` of b, ``T_a = -Ad(H_ab^-1)``, whence ``g_a = T_a^T g_b``; T_a itself changes by
``-ad(T delta) T_a`` along both twists, with ``T = (T_a, 1)``.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.constraints.terms.vectors import rotate_back_into
from flexfem.kernels.compiled import subroutine

__all__ = ["gradient_of_both", "hessian_of_both", "relative_pose"]


@subroutine
def relative_pose(Ha: FloatArray, Hb: FloatArray, order: int, x: FloatArray) -> None:
    """Relative position and rotation (12) and the order of derivatives wanted in ``x`` (13)."""
    arm = np.empty(3)
    for i in range(3):
        arm[i] = Hb[i] - Ha[i]
    rotate_back_into(Ha, arm, x, 0)
    for i in range(3):
        for j in range(3):
            x[3 + 3 * i + j] = Ha[3 + i] * Hb[3 + j] + Ha[6 + i] * Hb[6 + j] + Ha[9 + i] * Hb[9 + j]
    x[12] = order


@subroutine
def _twists_of_a(x: FloatArray, T: FloatArray) -> None:
    """Matrix ``T`` (12, 6): equivalent twists of b for unit twists of a and of b, row by row."""
    T[:] = 0.0
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        for m in range(3):
            column = x[3 + 3 * k + m]
            T[k, m] = T[3 + k, 3 + m] = -column
            # -R^T (e_k x p)
            T[3 + k, m] = x[3 + 3 * i + m] * x[j] - x[3 + 3 * j + m] * x[i]
        T[6 + k, k] = T[9 + k, 3 + k] = 1.0


@subroutine
def _bracket(a: FloatArray, b: FloatArray, g: FloatArray) -> float:
    """``g . [a, b]`` of two twists (V, Omega)."""
    total = 0.0
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        total += g[k] * (a[3 + i] * b[j] - a[3 + j] * b[i] + a[i] * b[3 + j] - a[j] * b[3 + i])
        total += g[3 + k] * (a[3 + i] * b[3 + j] - a[3 + j] * b[3 + i])
    return total


@subroutine
def gradient_of_both(x: FloatArray, by_b: FloatArray, g: FloatArray) -> None:
    """Gradient ``g`` (12) along twists of both markers from that (6) along twists of b."""
    T = np.empty((12, 6))
    _twists_of_a(x, T)
    for i in range(12):
        g[i] = 0.0
        for k in range(6):
            g[i] += T[i, k] * by_b[k]


@subroutine
def hessian_of_both(x: FloatArray, by_b: FloatArray, second: FloatArray, h: FloatArray) -> None:
    """Derivative ``h`` (12, 12) of the gradient from those (6) and (36) along twists of b."""
    T, left = np.empty((12, 6)), np.empty((12, 6))
    _twists_of_a(x, T)
    left[:] = 0.0
    for i in range(12):
        for k in range(6):
            for m in range(6):
                left[i, m] += T[i, k] * second[6 * k + m]
    for i in range(12):
        for j in range(12):
            h[i, j] = 0.0
            for m in range(6):
                h[i, j] += left[i, m] * T[j, m]
            if i < 6:
                h[i, j] -= _bracket(T[j], T[i], by_b)
