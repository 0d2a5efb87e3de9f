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


#: First number of the second square.
_SECOND = 7


@inlined
def _parameters(kind: int, w: FloatArray, turn: FloatArray) -> int:
    """Write dw/dz of the free parameters in the places of a_m; returns how many there are.

    They are those of the ways between two points of a primitive whose weights are not zero.
    """
    count, at = 0, -1
    for i in range(0 if kind >= EDGE_EDGE else 1, 4):
        if kind >= EDGE_EDGE and i == 2:
            at = -1
        if w[i] != 0.0:
            if at >= 0:
                # the weights of the second primitive are negative
                sign = 1.0 if i > 1 or kind < EDGE_EDGE else -1.0
                turn[_SECOND * count + at], turn[_SECOND * count + i] = sign, -sign
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
    for k in range(2 * _SECOND):
        turn[k] = 0.0
    free, aa, ab, bb = _parameters(kind, w, turn), rho, 0.0, rho
    if free == 0:
        return
    for a in range(3):
        for i in range(4):
            turn[4 + a] += turn[i] * x[i, a]
            turn[_SECOND + 4 + a] += turn[_SECOND + i] * x[i, a]
        aa += turn[4 + a] * turn[4 + a]
        ab += turn[4 + a] * turn[_SECOND + 4 + a]
        bb += turn[_SECOND + 4 + a] * turn[_SECOND + 4 + a]
    # rows of the inverse of the Cholesky factor of (aa, ab; ab, bb)
    first, rest = 1.0 / np.sqrt(aa), bb - ab * ab / aa
    second = 1.0 / np.sqrt(rest) if free > 1 and rest > 0.0 else 0.0
    mixed = -ab / aa * second
    for k in range(_SECOND):
        size = distance if k < 4 else 1.0
        turn[_SECOND + k] = size * (mixed * turn[k] + second * turn[_SECOND + k])
        turn[k] *= size * first
