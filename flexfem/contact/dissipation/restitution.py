# SPDX-License-Identifier: LGPL-3.0-or-later
"""Restitution: impulses that pull at what separates, at the end of a step.

The forces of a step are elastic. They have changed the speeds of separation of its contacts by w to
u: those with u > 0 give energy back, from the speed b = u - w on, or from rest if this was an
approach. Of this energy, e^2 is kept: the speed is to be

    t = (max(b, 0)^2 + e^2 (u^2 - max(b, 0)^2))^(1/2).

So bodies separate with e times the speed of approach, whether an impact takes one step, in which
it turns back, or hundreds: the energy that is given back adds up to that which has been taken. The
pulls f of all contacts, in the place of the force N of each, are those of dampers at the speeds u'
after them,

    u' = u - D f,   f = u' / c,   c = t w / ((u - t) N),

D the changes of speeds by forces over the step, w = D N. For a single contact u' = t. As ``u' f >=
0`` and ``f D f >= 0``, no pulls make energy, whatever c; they are at most the forces N, so that
nothing adheres.

A group acts along the line of its nearest pair at the end of the step: pulls have no sum and no
torque.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.dissipation.data import NORMAL, Groups
from flexfem.contact.primitives.closest import closest, place
from flexfem.contact.primitives.data import EDGE_EDGE, Pairs, Response, regularisation
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Memory, unpack

__all__ = ["compliances", "place_ends"]

#: Least speed wanted, in parts of that before the pulls: with it these are unique also where there
#: are more contacts than a rigid body has motions.
_LEAST = 1e-9


def compliances(
    speeds: FloatArray, changes: FloatArray, forces: FloatArray, restitution: FloatArray
) -> FloatArray:
    """Compliances c (g,) of the dampers, m/(N s); infinite for groups without a pull.

    Args:
        speeds: of separation, u (g,), m/s.
        changes: their changes by the forces, w (g,), m/s.
        forces: N (g,), N.
        restitution: e (g,).
    """
    first = np.maximum(speeds - changes, 0.0) ** 2
    square = first + restitution**2 * np.maximum(speeds**2 - first, 0.0)
    wanted = np.maximum(_LEAST * speeds, np.sqrt(square))
    pulls = (speeds > 0.0) & (changes > 0.0) & (forces > 0.0) & (wanted < speeds)
    found = np.full(len(speeds), np.inf)
    lack = (speeds - wanted)[pulls] * forces[pulls]
    found[pulls] = wanted[pulls] * changes[pulls] / lack
    return found


@inlined
def _write_end(own: Pairs, p: int, w: FloatArray, r: FloatArray, ends: Groups, g: int) -> None:
    """Write points, weights and normal of a group: those of a pair."""
    start, middle = ends.starts[g], 2 if own.kind[p] >= EDGE_EDGE else 1
    for i in range(4):
        ends.points[start + i], ends.weights[start + i] = own.points[p, i], w[i]
    ends.sides[g], ends.starts[g + 1] = start + middle, start + 4
    size = np.sqrt(r[0] ** 2 + r[1] ** 2 + r[2] ** 2)
    for a in range(3):
        ends.numbers[g, NORMAL + a] = r[a] / size


@kernel
def place_ends(
    pairs: Memory, response: Memory, groups: Memory, points: FloatArray, ends: Memory
) -> None:
    """Write the nearest pair of each group that has acted in a step, at its end.

    Args:
        pairs: of :class:`Pairs`.
        response: their response to the step.
        groups: groups that have acted in it, of :class:`Groups`.
        points: positions at the end (n, 3), m.
        ends: result, of :class:`Groups`: points, weights and normals.
    """
    own, out = unpack(Pairs, pairs), unpack(Response, response)
    acting, result = unpack(Groups, groups), unpack(Groups, ends)
    x, w, r, nearest, line = np.empty((4, 3)), np.empty(4), np.empty(3), np.empty(4), np.empty(3)
    result.count[0] = acting.count[0]
    for g in range(acting.count[0]):
        least, best = np.inf, out.pairs[acting.rows[g, 0]]
        for k in range(acting.rows[g, 0], acting.rows[g, 1]):
            p = out.pairs[k]
            place(points, points, own.points[p], 0.0, x)
            rho = regularisation(own.kind[p], own.touch[p], own.dhat[p])
            closest(own.kind[p], x, rho, w, r)
            gap = np.sqrt(r[0] ** 2 + r[1] ** 2 + r[2] ** 2) - own.touch[p]
            if gap < least:
                least, best = gap, p
                nearest[:], line[:] = w, r
        _write_end(own, best, nearest, line, result, g)
