# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact forces of points and obstacles over a step: discrete derivatives of the potential.

The closest points c0 and c1 of the obstacle before and after the step are fixed to its carrier.
The point and these two are a pair with the weights (1, -1, 0) before and (1, 0, -1) after, in which
the distance is the least one at both ends, as no point of the obstacle is nearer. The force along
the mean line of these (``contact.primitives.mean_lines``) hence does exactly the work of the
potential: on the point, and on the place between c0 and c1 that moves with the carrier.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.fields.data import (
    ARM,
    FIELDS,
    GAP,
    LOAD,
    NORMAL,
    POTENTIAL,
    SLOPE,
    FieldPairs,
    FieldResponse,
    FieldState,
)
from flexfem.contact.primitives.barrier import barrier, quotient, secant
from flexfem.contact.primitives.mean_lines import mean_line
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Memory, unpack

__all__ = ["forces_of_step"]


@kernel
def forces_of_step(pairs: Memory, before: Memory, after: Memory, response: Memory) -> None:
    """Write the response of all pairs to a step.

    No pair may touch before or after it.

    Args:
        pairs: memory of :class:`FieldPairs`.
        before: of the :class:`FieldState` at the start.
        after: of that at the end.
        response: of :class:`FieldResponse`.
    """
    own, out = unpack(FieldPairs, pairs), unpack(FieldResponse, response)
    start, end = unpack(FieldState, before), unpack(FieldState, after)
    x, w, line, r, count = np.empty((4, 4, 3)), np.empty((2, 4)), np.empty(4), np.empty(3), 0
    feet, gaps = np.empty((2, 3)), np.empty(2)
    for p in range(len(own.points)):
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
        for a in range(3):
            out.numbers[count, ARM + a] = -line[1] * feet[0, a] - line[2] * feet[1, a]
        _write(own, p, gaps, r, sizes, out.numbers[count], out.forces[count])
        out.pairs[count] = p
        count += 1
    out.count[0] = count


@inlined
def _put(frame: FloatArray, arm: FloatArray, x: FloatArray) -> None:
    """Write the position of a point that is fixed to a frame."""
    for a in range(3):
        turned = frame[3 + 3 * a] * arm[0] + frame[4 + 3 * a] * arm[1] + frame[5 + 3 * a] * arm[2]
        x[a] = frame[a] + turned


@inlined
def _place(
    own: FieldPairs, p: int, start: FieldState, end: FieldState, feet: FloatArray, x: FloatArray
) -> None:
    """Write the closest points (2, 3) of both ends and the positions (2, 4, 3) of a pair.

    A closest point that is not known is far away, where the potential is zero: any other will do.
    """
    for a in range(3):
        feet[0, a], feet[1, a] = start.arms[p, a], end.arms[p, a]
    for a in range(3):
        if np.isnan(feet[0, a]):
            feet[0, a] = feet[1, a]
        if np.isnan(feet[1, a]):
            feet[1, a] = feet[0, a]
    point, field = own.points[p], own.fields[p]
    for a in range(3):
        x[0, 0, a] = x[0, 3, a] = start.points[point, a]
        x[1, 0, a] = x[1, 3, a] = end.points[point, a]
    for c in range(2):
        _put(start.frames[field], feet[c], x[0, 1 + c])
        _put(end.frames[field], feet[c], x[1, 1 + c])


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
    own: FieldPairs, p: int, gaps: FloatArray, r: FloatArray, sizes: float, numbers: FloatArray,
    force: FloatArray,
) -> None:  # fmt: skip
    """Write the force along the vector r of the mean line, gap, potential and slope."""
    dhat, kappa, weight = own.dhat[p], own.kappa[p], own.weight[p]
    final, size = barrier(gaps[1], dhat, kappa), 0.0
    change = final - barrier(gaps[0], dhat, kappa)
    factor = -weight * quotient(gaps[0], gaps[1], change, dhat, kappa) / (0.5 * sizes)
    for a in range(3):
        force[a] = factor * r[a]
        size += r[a] * r[a]
    size = np.sqrt(size)
    for a in range(3):
        numbers[NORMAL + a] = r[a] / size
    ratio = 2.0 * size / sizes
    numbers[GAP], numbers[POTENTIAL] = gaps[1], weight * final
    numbers[SLOPE] = weight * secant(gaps[0], gaps[1], change, dhat, kappa) * ratio * ratio
    for k in range(LOAD, FIELDS):
        numbers[k] = 0.0
