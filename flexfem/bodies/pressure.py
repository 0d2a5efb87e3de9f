# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled forces of pressures on flat triangles.

A pressure p on the corners x0, x1, x2 makes the force ``p/2 N`` with ``N = x0 x x1 + x1 x x2 +
x2 x x0``, a third of it at each corner; ``dN = sum_j (x_k - x_i) x dx_j`` for the cyclic i, j, k.
The tangent is unsymmetric at free edges and symmetric after summation inside.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.kernels.compiled import inlined, kernel

__all__ = ["add_pressures", "pressure_states", "pressure_tangent"]


@inlined
def _normal(nodes: IntArray, frames: FloatArray, out: FloatArray) -> None:
    """N (3,), twice the area long."""
    a, b, c = frames[nodes[0]], frames[nodes[1]], frames[nodes[2]]
    for i in range(3):
        p, q = (i + 1) % 3, (i + 2) % 3
        out[i] = (b[p] - a[p]) * (c[q] - a[q]) - (b[q] - a[q]) * (c[p] - a[p])


@kernel
def add_pressures(
    nodes: IntArray, pressure: FloatArray, load: IntArray, factors: FloatArray, frames: FloatArray,
    scale: float, residual: FloatArray,
) -> None:  # fmt: skip
    """Subtract ``scale * factors[load]`` times every pressure's forces, in node axes."""
    N = np.empty(3)
    for m in range(len(nodes)):
        _normal(nodes[m], frames, N)
        f = scale * factors[load[m]] * pressure[m] / 6.0
        for k in range(3):
            H, to = frames[nodes[m, k]], residual[nodes[m, k]]
            for i in range(3):
                to[i] -= f * (H[3 + i] * N[0] + H[6 + i] * N[1] + H[9 + i] * N[2])


@kernel
def pressure_tangent(
    nodes: IntArray, pressure: FloatArray, load: IntArray, factors: FloatArray, frames: FloatArray,
    scale: float, out: FloatArray,
) -> None:  # fmt: skip
    """Write ``scale`` times the derivative along translations in node axes to ``out`` (m, 9, 9)."""
    e, d, R = np.empty(3), np.empty(3), np.empty((3, 3))
    for m in range(len(nodes)):
        f = -scale * factors[load[m]] * pressure[m] / 6.0
        for j in range(3):
            H = frames[nodes[m, j]]
            a, b = frames[nodes[m, (j + 1) % 3]], frames[nodes[m, (j + 2) % 3]]
            for i in range(3):
                e[i] = b[i] - a[i]
            for c in range(3):  # along column c of the node's axes
                for i in range(3):
                    p, q = (i + 1) % 3, (i + 2) % 3
                    d[i] = f * (e[p] * H[3 + 3 * q + c] - e[q] * H[3 + 3 * p + c])
                for i in range(3):
                    R[i, c] = d[i]
            for k in range(3):
                G = frames[nodes[m, k]]
                for r in range(3):
                    for c in range(3):
                        out[m, 3 * k + r, 3 * j + c] = (
                            G[3 + r] * R[0, c] + G[6 + r] * R[1, c] + G[9 + r] * R[2, c]
                        )


@kernel
def pressure_states(
    nodes: IntArray, pressure: FloatArray, load: IntArray, factors: FloatArray, frames: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Write force, no moment, centroid and no angular velocity of each triangle to (m, 12).

    Equal forces at the corners do the work of their sum at the centroid.
    """
    N = np.empty(3)
    for m in range(len(nodes)):
        _normal(nodes[m], frames, N)
        for i in range(3):
            out[m, i] = 0.5 * factors[load[m]] * pressure[m] * N[i]
            total = 0.0
            for k in range(3):
                total += frames[nodes[m, k], i]
            out[m, 3 + i], out[m, 6 + i], out[m, 9 + i] = 0.0, total / 3.0, 0.0
