# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact forces of points and obstacles in equilibria: the gradient of the potential."""

from flexfem._types import FloatArray
from flexfem.contact.fields.data import (
    ARM,
    BEND,
    GAP,
    LOAD,
    NORMAL,
    POTENTIAL,
    SLOPE,
    FieldPairs,
    FieldResponse,
    FieldState,
)
from flexfem.contact.primitives.barrier import barrier, curvature, slope
from flexfem.kernels.compiled import kernel
from flexfem.kernels.records import Memory, unpack

__all__ = ["forces_at_rest"]


@kernel
def forces_at_rest(pairs: Memory, state: Memory, bends: FloatArray, response: Memory) -> None:
    """Write the response of all pairs at one state.

    Args:
        pairs: memory of :class:`FieldPairs`.
        state: of :class:`FieldState`.
        bends: second derivatives (m, 9) of the distances, of ``Obstacles.bends``; with zeros the
            tangent lacks them.
        response: of :class:`FieldResponse`.
    """
    own, at, out = (
        unpack(FieldPairs, pairs),
        unpack(FieldState, state),
        unpack(FieldResponse, response),
    )
    count = 0
    for p in range(len(own.points)):
        distance, dhat, kappa, weight = at.distance[p], own.dhat[p], own.kappa[p], own.weight[p]
        gap = distance - own.touch[p]
        if gap >= dhat:
            continue
        numbers, frame, point = out.numbers[count], at.frames[own.fields[p]], own.points[p]
        push = weight * slope(gap, dhat, kappa)
        numbers[GAP], numbers[POTENTIAL] = gap, weight * barrier(gap, dhat, kappa)
        numbers[SLOPE] = weight * curvature(gap, dhat, kappa)
        for a in range(3):
            foot = frame[a]
            for b in range(3):
                foot += frame[3 + 3 * a + b] * at.arms[p, b]
            numbers[NORMAL + a] = (at.points[point, a] - foot) / distance
            numbers[ARM + a] = at.arms[p, a]
            out.forces[count, a] = -push * numbers[NORMAL + a]
            numbers[LOAD + a] = out.forces[count, a]
        for k in range(9):
            numbers[BEND + k] = push * bends[p, k]
        out.pairs[count] = p
        count += 1
    out.count[0] = count
