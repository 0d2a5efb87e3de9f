# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact forces of points and obstacles over a step: discrete derivatives of the potential.

The closest points c0 and c1 of the obstacle before and after the step are fixed to it. The point
and these two are a pair with the weights (1, -1, 0) before and (1, 0, -1) after, in which the
distance is the least one at both ends, as no point of the obstacle is nearer. The force along the
mean line of these (``contact.primitives.mean_lines``) hence does exactly the work of the potential:
on the point, and on the place between c0 and c1 that moves with the obstacle.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.fields.data import CURVES, FIELD_NUMBERS, SHARES, FieldState
from flexfem.contact.primitives.barrier import barrier, quotient, secant
from flexfem.contact.primitives.data import GAP, NORMAL, POTENTIAL, SLOPE, Pairs, Response
from flexfem.contact.primitives.mean_lines import mean_line
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Memory, unpack

__all__ = ["forces_of_step"]


@kernel
def forces_of_step(pairs: Memory, before: Memory, after: Memory, response: Memory) -> None:
    """Write the response of all pairs to a step.

    No pair may touch before or after it.

    Args:
        pairs: memory of :class:`Pairs` with five points.
        before: of the :class:`FieldState` at the start.
        after: of that at the end.
        response: of :class:`Response`.
    """
    own, out = unpack(Pairs, pairs), unpack(Response, response)
    start, end = unpack(FieldState, before), unpack(FieldState, after)
    x, w, line, r, count = np.empty((4, 4, 3)), np.empty((2, 4)), np.empty(4), np.empty(3), 0
    feet, gaps = np.empty((2, 4)), np.empty(2)
    for p in range(len(own.kind)):
        touch, dhat = own.touch[p], own.dhat[p]
        if min(start.distance[p], end.distance[p]) - touch >= dhat:
            continue
        _place(own, p, start, end, feet, x)
        for c in range(2):
            _choose(x[c], w[c], 1 + c)
        gaps[0] = np.copysign(_length(x[0], w[0]), start.distance[p]) - touch
        gaps[1] = np.copysign(_length(x[1], w[1]), end.distance[p]) - touch
        if min(gaps[0], gaps[1]) >= dhat:
            continue
        for i in range(4):
            for a in range(3):
                x[2, i, a] = 0.5 * (x[0, i, a] + x[1, i, a])
                x[3, i, a] = x[1, i, a] - x[0, i, a]
        sizes = abs(gaps[0] + touch) + abs(gaps[1] + touch)
        way = abs(gaps[1] + touch) - abs(gaps[0] + touch)
        mean_line(x[2], x[3], w[0], w[1], way * sizes, line, r)
        numbers = out.numbers[count]
        numbers[SHARES] = 1.0
        for i in range(4):
            numbers[SHARES + 1 + i] = line[1] * feet[0, i] + line[2] * feet[1, i]
        _write(own, p, gaps, r, sizes, numbers, out.forces[count])
        out.pairs[count] = p
        count += 1
    out.count[0] = count


@inlined
def _put(points: FloatArray, rows: IntArray, weights: FloatArray, x: FloatArray) -> None:
    """Write the position of a place with some weights of the points of its obstacle."""
    for a in range(3):
        x[a] = 0.0
        for i in range(4):
            x[a] += weights[i] * points[rows[1 + i], a]


@inlined
def _place(
    own: Pairs, p: int, start: FieldState, end: FieldState, feet: FloatArray, x: FloatArray
) -> None:
    """Write the closest points (2, 4) of both ends and the positions (2, 4, 3) of a pair.

    A closest point that is not known is far away, where the potential is zero: any other will do.
    """
    for i in range(4):
        feet[0, i], feet[1, i] = start.feet[p, i], end.feet[p, i]
    for i in range(4):
        if np.isnan(feet[0, i]):
            feet[0, i] = feet[1, i]
        if np.isnan(feet[1, i]):
            feet[1, i] = feet[0, i]
    rows = own.points[p]
    for a in range(3):
        x[0, 0, a] = x[0, 3, a] = start.points[rows[0], a]
        x[1, 0, a] = x[1, 3, a] = end.points[rows[0], a]
    for c in range(2):
        _put(start.points, rows, feet[c], x[0, 1 + c])
        _put(end.points, rows, feet[c], x[1, 1 + c])


@inlined
def _choose(x: FloatArray, w: FloatArray, own: int) -> None:
    """Write the weights of the closer one of both points, of the ``own`` one if they are equal.

    The other one is closer where a search has found a foot that is not the closest point.
    """
    squares, other = np.zeros(3), 3 - own
    for i in range(1, 3):
        for a in range(3):
            squares[i] += (x[0, a] - x[i, a]) ** 2
    w[0], w[1], w[2], w[3] = 1.0, 0.0, 0.0, 0.0
    w[other if squares[other] < squares[own] else own] = -1.0


@inlined
def _length(x: FloatArray, w: FloatArray) -> float:
    """Distance of the point from the chosen one."""
    square = 0.0
    for a in range(3):
        square += (x[0, a] + w[1] * x[1, a] + w[2] * x[2, a]) ** 2
    return float(np.sqrt(square))


@inlined
def _write(
    own: Pairs, p: int, gaps: FloatArray, r: FloatArray, sizes: float, numbers: FloatArray,
    forces: FloatArray,
) -> None:  # fmt: skip
    """Write the forces along the vector r of the mean line, gap, potential and slope."""
    dhat, kappa, weight = own.dhat[p], own.kappa[p], own.weight[p]
    final, size = barrier(gaps[1], dhat, kappa), 0.0
    change = final - barrier(gaps[0], dhat, kappa)
    factor = -weight * quotient(gaps[0], gaps[1], change, dhat, kappa) / (0.5 * sizes)
    for a in range(3):
        for i in range(5):
            forces[3 * i + a] = factor * numbers[SHARES + i] * r[a]
        size += r[a] * r[a]
    size = np.sqrt(size)
    for a in range(3):
        numbers[NORMAL + a] = r[a] / size
    ratio = 2.0 * size / sizes
    numbers[GAP], numbers[POTENTIAL] = gaps[1], weight * final
    numbers[SLOPE] = weight * secant(gaps[0], gaps[1], change, dhat, kappa) * ratio * ratio
    for k in range(CURVES, FIELD_NUMBERS):
        numbers[k] = 0.0
