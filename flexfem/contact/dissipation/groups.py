# SPDX-License-Identifier: LGPL-3.0-or-later
"""Groups of pairs as single contacts: normal, normal force and weights of points.

The pairs of a vertex with one body add and subtract the forces of triangles, edges and vertices,
whose sum alone means something. With the force f_i on each point and the normal n_r of each pair,

    N = sum_r n_r . (sum of f_i on the first primitive),   w_i = sum_r n_r . f_i / N,

where w_i have the sum 1 over points of the first primitives and -1 over those of the second ones.
For a vertex over a plane, N is the size of the whole force; for one in a groove it is the sum of
the forces of both walls, which is what friction along the groove is proportional to.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.dissipation.data import NORMAL, PUSH, Groups
from flexfem.contact.primitives.data import EDGE_EDGE, SLOPE, Pairs, Response
from flexfem.contact.primitives.data import NORMAL as PAIR_NORMAL
from flexfem.kernels.compiled import inlined, subroutine

__all__ = ["collect"]

#: Size of the whole force, in parts of N, below which walls push against each other, and the normal
#: is that of the strongest pair.
_OPPOSED = 0.1


@inlined
def _entry(groups: Groups, start: int, end: int, point: int) -> int:
    """Entry of a point among those of a group, or ``end`` if it has none."""
    for e in range(start, end):
        if groups.points[e] == point:
            return e
    return end


@inlined
def _write_normal(
    groups: Groups, g: int, whole: FloatArray, strongest: FloatArray, push: float
) -> None:
    """Write the direction of the whole force, or that of the strongest pair."""
    size = np.sqrt(whole[0] ** 2 + whole[1] ** 2 + whole[2] ** 2)
    for a in range(3):
        n = whole[a] / size if size > _OPPOSED * push else strongest[PAIR_NORMAL + a]
        groups.numbers[g, NORMAL + a] = n


@inlined
def _write_slope(out: Response, first: int, end: int, groups: Groups, g: int) -> None:
    """Write the stiffness along the normal."""
    total, normal = 0.0, groups.numbers[g]
    for k in range(first, end):
        along = 0.0
        for a in range(3):
            along += normal[NORMAL + a] * out.numbers[k, PAIR_NORMAL + a]
        total += out.numbers[k, SLOPE] * along * along
    groups.slopes[g, 0] = max(total, 0.0)


@subroutine
def collect(own: Pairs, out: Response, first: int, end: int, groups: Groups, g: int) -> bool:
    """Write points, weights, normal, normal force and stiffness of a group.

    Args:
        own: all pairs.
        out: their response.
        first: first pair of the group that acts, a row of the response.
        end: row after the last one.
        groups: result.
        g: row of the group there.

    Returns:
        False if it does not push.
    """
    start = last = groups.starts[g]
    whole, push, most, at = np.zeros(3), 0.0, 0.0, first
    for k in range(first, end):
        p, numbers, forces, alone = out.pairs[k], out.numbers[k], out.forces[k], 0.0
        middle = 2 if own.kind[p] >= EDGE_EDGE else 1
        for i in range(own.points.shape[1]):
            along = 0.0
            for a in range(3):
                along += forces[3 * i + a] * numbers[PAIR_NORMAL + a]
                if i < middle:
                    whole[a] += forces[3 * i + a]
            if i < middle:
                alone += along
            elif along == 0.0:
                continue
            e = _entry(groups, start, last, own.points[p, i])
            if e == last:
                groups.points[e], groups.weights[e] = own.points[p, i], 0.0
                last += 1
                if i < middle:
                    groups.sides[g] = last
            groups.weights[e] += along
        push += alone
        if abs(alone) > most:
            most, at = abs(alone), k
    groups.starts[g + 1], groups.numbers[g, PUSH] = last, push
    if not 0.0 < push < np.inf:
        return False
    for e in range(start, last):
        groups.weights[e] /= push
    _write_normal(groups, g, whole, out.numbers[at], push)
    _write_slope(out, first, end, groups, g)
    return True
