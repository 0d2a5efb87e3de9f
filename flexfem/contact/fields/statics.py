# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact forces of points and obstacles in equilibria: the gradient of the potential."""

from flexfem._types import FloatArray
from flexfem.contact.fields.data import AXES, CURVES, SHARES, FieldState
from flexfem.contact.primitives.barrier import barrier, curvature, slope
from flexfem.contact.primitives.data import GAP, NORMAL, POTENTIAL, SLOPE, Pairs, Response
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Memory, unpack

__all__ = ["forces_at_rest"]


@kernel
def forces_at_rest(pairs: Memory, state: Memory, bends: FloatArray, response: Memory) -> None:
    """Write the response of all pairs at one state.

    Forces act at the place of the point on both sides: on the obstacle that is on the line through
    the closest point.

    Args:
        pairs: memory of :class:`Pairs` with five points.
        state: of :class:`FieldState`.
        bends: second derivatives (m, 9) of the distances, 1/m.
        response: of :class:`Response`.
    """
    own, at, out = unpack(Pairs, pairs), unpack(FieldState, state), unpack(Response, response)
    count = 0
    for p in range(len(own.kind)):
        distance, dhat, kappa, weight = at.distance[p], own.dhat[p], own.kappa[p], own.weight[p]
        gap = distance - own.touch[p]
        if gap >= dhat:
            continue
        numbers, rows, push = out.numbers[count], own.points[p], weight * slope(gap, dhat, kappa)
        numbers[GAP], numbers[POTENTIAL] = gap, weight * barrier(gap, dhat, kappa)
        numbers[SLOPE], numbers[SHARES] = weight * curvature(gap, dhat, kappa), 1.0
        for a in range(3):
            foot = 0.0
            for i in range(4):
                foot += at.feet[p, i] * at.points[rows[1 + i], a]
            numbers[NORMAL + a] = (at.points[rows[0], a] - foot) / distance
            out.forces[count, a] = -push * numbers[NORMAL + a]
        for i in range(4):
            numbers[SHARES + 1 + i] = -at.places[p, i]
            for a in range(3):
                out.forces[count, 3 + 3 * i + a] = -at.places[p, i] * out.forces[count, a]
        for k in range(9):
            numbers[CURVES + k] = push * bends[p, k]
        for a in range(3):
            _write_axis(at.points[rows[1]], at.points[rows[2 + a]], numbers[AXES + 3 * a :])
        out.pairs[count] = p
        count += 1
    out.count[0] = count


@inlined
def _write_axis(origin: FloatArray, end: FloatArray, axis: FloatArray) -> None:
    """Write how the weight of the point at the end of an axis changes with the position."""
    square = 0.0
    for a in range(3):
        axis[a] = end[a] - origin[a]
        square += axis[a] * axis[a]
    for a in range(3):
        axis[a] /= square
