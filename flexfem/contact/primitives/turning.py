# SPDX-License-Identifier: LGPL-3.0-or-later
"""How closest points move on their primitives: second derivatives of the distance.

The weights w depend on parameters z of the closest points on their primitives. The envelope theorem
gives dD = sum w_i r . dx_i / D; with r_p = dr/dz_p and w_p = dw/dz_p (constant),

    d^2 (D^2/2) = |w dx|^2 - sum_pq B_pq v_p(dx) v_q(dx),   v_p(dx) = w_p dx . r + w dx . r_p,

where B is the inverse of r_p . r_q + rho delta_pq for the parameters that are free, those of points
inside their primitives. Its Cholesky factor leaves a sum of at most two squares of

    v_m(dx) = D a_m dx . n + w dx . b_m,   n = r / D.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.primitives.data import EDGE_EDGE
from flexfem.kernels.compiled import inlined, subroutine

__all__ = ["write_turn"]


@inlined
def _parameters(kind: int, w: FloatArray, ways: FloatArray) -> int:
    """Write dw/dz (2, 4) of the free parameters; returns how many there are.

    They are those of the ways between two points of a primitive whose weights are not zero.
    """
    ways[:] = 0.0
    count = 0
    if kind >= EDGE_EDGE:
        for first in (0, 2):
            if w[first] != 0.0 and w[first + 1] != 0.0:
                ways[count, first], ways[count, first + 1] = -1.0, 1.0
                if first == 2:
                    ways[count, 2], ways[count, 3] = 1.0, -1.0
                count += 1
        return count
    at = 0
    for i in range(1, 4):
        if w[i] != 0.0:
            if at > 0:
                ways[count, at], ways[count, i] = 1.0, -1.0
                count += 1
            else:
                at = i
    return count


@subroutine
def write_turn(
    kind: int, x: FloatArray, rho: float, w: FloatArray, distance: float, turn: FloatArray
) -> None:
    """Write D a_m (4) and b_m (3) of both squares (14,).

    Args:
        kind: kind of the pair.
        x: positions (4, 3) of its points, m.
        rho: square of the length that regularises crossing edges, m^2.
        w: weights of the closest points.
        distance: D, m.
        turn: result.
    """
    ways, turns = np.empty((2, 4)), np.zeros((2, 3))
    free = _parameters(kind, w, ways)
    for p in range(2):
        for a in range(3):
            for i in range(4):
                turns[p, a] += ways[p, i] * x[i, a]
    aa, ab, bb = rho, 0.0, rho
    for a in range(3):
        aa += turns[0, a] * turns[0, a]
        ab += turns[0, a] * turns[1, a]
        bb += turns[1, a] * turns[1, a]
    # columns of the transposed inverse of the Cholesky factor of (aa, ab; ab, bb)
    first = 1.0 / np.sqrt(aa) if free > 0 else 0.0
    rest = bb - ab * ab / aa if free > 1 else 0.0
    second = 1.0 / np.sqrt(rest) if rest > 0.0 else 0.0
    mixed = -ab / aa * second if free > 1 else 0.0
    for i in range(4):
        turn[i] = distance * first * ways[0, i]
        turn[7 + i] = distance * (mixed * ways[0, i] + second * ways[1, i])
    for a in range(3):
        turn[4 + a] = first * turns[0, a]
        turn[11 + a] = mixed * turns[0, a] + second * turns[1, a]
