# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact forces of an equilibrium: the gradient of the potential, with its exact Hessian."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.primitives.barrier import barrier, curvature, slope
from flexfem.contact.primitives.closest import apart, closest, place
from flexfem.contact.primitives.data import (
    BEND,
    GAP,
    NORMAL,
    POTENTIAL,
    SLOPE,
    TURN,
    WEIGHTS,
    Pairs,
    Response,
    regularisation,
)
from flexfem.contact.primitives.turning import write_turn
from flexfem.kernels.compiled import kernel, subroutine
from flexfem.kernels.records import Memory, unpack

__all__ = ["forces_at_rest", "respond_at_rest"]


@kernel
def forces_at_rest(
    pairs: Memory, points: FloatArray, asleep: FloatArray, way: float, response: Memory
) -> None:
    """Write the response of all pairs at positions (n, 3).

    Pairs with more ``asleep`` (m,) than the ``way`` (m) of the points so far do not act.
    """
    own, out = unpack(Pairs, pairs), unpack(Response, response)
    x, w, r, count = np.empty((4, 3)), np.empty(4), np.empty(3), 0
    for p in range(len(own.kind)):
        if asleep[p] > way:
            continue
        reach = own.touch[p] + own.dhat[p]
        if apart(points, points, own.kind[p], own.points[p], reach):
            continue
        place(points, points, own.points[p], 0.0, x)
        if respond_at_rest(own, p, x, w, r, out.numbers[count], out.forces[count]):
            out.pairs[count], out.whole[count] = p, 0
            count += 1
    out.count[0] = count


@subroutine
def respond_at_rest(
    own: Pairs, p: int, x: FloatArray, w: FloatArray, r: FloatArray, numbers: FloatArray,
    forces: FloatArray,
) -> bool:  # fmt: skip
    """Write numbers and forces (12,) of a pair at positions (4, 3); False if it does not act.

    Args:
        own: the pairs.
        p: number of the pair.
        x: positions of its points, m.
        w: work space (4,), for the weights of the closest points.
        r: work space (3,), for the vector between them.
        numbers: result (FIELDS,).
        forces: result.
    """
    kind, touch, dhat, kappa = own.kind[p], own.touch[p], own.dhat[p], own.kappa[p]
    rho = regularisation(kind, touch, dhat)
    distance = np.sqrt(closest(kind, x, rho, w, r))
    gap = distance - touch
    if gap >= dhat:
        return False
    weight = own.weight[p]
    push = weight * slope(gap, dhat, kappa)
    numbers[GAP], numbers[POTENTIAL] = gap, weight * barrier(gap, dhat, kappa)
    numbers[BEND] = push / distance
    numbers[SLOPE] = weight * curvature(gap, dhat, kappa) - push / distance
    for a in range(3):
        numbers[NORMAL + a] = r[a] / distance
    for i in range(4):
        numbers[WEIGHTS + i] = w[i]
        for a in range(3):
            forces[3 * i + a] = -push * w[i] * numbers[NORMAL + a]
    write_turn(kind, x, rho, w, distance, numbers[TURN:])
    return True
