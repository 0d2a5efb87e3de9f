# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tangents of the forces of points and obstacles.

With the weights w_i of the five points and their relative motion e = sum w_i dx_i the tangent of
equilibria is the Hessian of the potential, as a function of the five positions,

    K(dx, dx') = e . (k n n^T + B) e' + sum_i ((F . dx_i) (g_i . e') + (F . dx_i') (g_i . e)),

where F is the force on the point, i counts the points of the obstacle, and g_i is the gradient of
the weight of i. For steps k is the slope of the difference quotient and the rest is left out, as
for pairs of cells.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.fields.data import AXES, CURVES, SHARES
from flexfem.contact.primitives.data import NORMAL, SLOPE, Pairs, Response
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Memory, unpack

__all__ = ["add_actions", "blocks_into"]


@inlined
def _gradient(numbers: FloatArray, i: int, a: int) -> float:
    """Component a of g_i, of the origin for i = 1 and then of the points on the axes."""
    if i > 1:
        return float(numbers[AXES + 3 * (i - 2) + a])
    return float(-(numbers[AXES + a] + numbers[AXES + 3 + a] + numbers[AXES + 6 + a]))


@inlined
def _stiffness(numbers: FloatArray, a: int, b: int) -> float:
    """Entry of k n n^T + B."""
    along = numbers[SLOPE] * numbers[NORMAL + a] * numbers[NORMAL + b]
    return float(along + numbers[CURVES + 3 * a + b])


@kernel
def add_actions(
    pairs: Memory, response: Memory, scale: float, steps: FloatArray, sums: FloatArray
) -> None:
    """Add ``scale`` times the tangent applied to steps of all points (n, 3) to their ``sums``."""
    paired, own = unpack(Pairs, pairs), unpack(Response, response)
    e, h = np.empty(3), np.empty(3)
    for k in range(own.count[0]):
        numbers, rows, force = own.numbers[k], paired.points[own.pairs[k]], own.forces[k]
        for a in range(3):
            e[a] = 0.0
            for i in range(5):
                e[a] += numbers[SHARES + i] * steps[rows[i], a]
        for a in range(3):
            h[a] = 0.0
            for b in range(3):
                h[a] += _stiffness(numbers, a, b) * e[b]
        for i in range(1, 5):
            done = turned = 0.0
            for a in range(3):
                done += force[a] * steps[rows[i], a]
                turned += _gradient(numbers, i, a) * e[a]
            for a in range(3):
                h[a] += done * _gradient(numbers, i, a)
                sums[rows[i], a] += scale * turned * force[a]
        for i in range(5):
            for a in range(3):
                sums[rows[i], a] += scale * numbers[SHARES + i] * h[a]


@kernel
def blocks_into(response: Memory, scale: float, blocks: FloatArray) -> None:
    """Write ``scale`` times the tangents (c, 15, 15) of the pairs that act, by their points."""
    own = unpack(Response, response)
    for k in range(own.count[0]):
        numbers, force = own.numbers[k], own.forces[k]
        for p in range(15):
            i, a = p // 3, p % 3
            for q in range(15):
                j, b = q // 3, q % 3
                w, v = numbers[SHARES + i], numbers[SHARES + j]
                value = w * v * _stiffness(numbers, a, b)
                if j > 0:
                    value += w * _gradient(numbers, j, a) * force[b]
                if i > 0:
                    value += v * _gradient(numbers, i, b) * force[a]
                blocks[k, p, q] = scale * value
