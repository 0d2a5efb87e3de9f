# SPDX-License-Identifier: LGPL-3.0-or-later
"""Narrow phase of contact: node-to-surface closest points.

A node touches a surface where its distance has a local minimum: inside a triangle, on an edge when
the same holds for all triangles there, or at a node. The surface is thus rounded at edges and
corners, with a force that is continuous while the node slides from one region into another. Of
minima whose normals differ by less than 60 degrees only the nearest is a contact, so that the force
is not doubled in a shallow valley; in a steep one a node touches both walls.

The distance has a sign: that of the side of the surface on which the node was when it approached.
Of connected triangles only the nearest can have been passed through, so that other layers of a
folded sheet exert no force. Beyond the boundary of an open surface there is no side, and the
boundary is rounded.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.detection.closest import (
    AT,
    CORNERS,
    LEAST,
    REGION,
    SQUARE,
    closest_candidates,
    is_first,
    leave_minima,
    signed_distance,
)
from flexfem.contact.detection.regions import FACE, dot, unit_normal
from flexfem.contact.law.closed_contacts import MOST_CLOSED
from flexfem.contact.law.data import (
    AREAS,
    BEND,
    DISTANCE,
    FIELDS,
    FIRST,
    GAP,
    NORMAL,
    REACH,
    SECOND,
    TURN,
    Candidates,
    Found,
    Masters,
    Slaves,
)
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Memory, unpack

__all__ = ["MOST", "find_contacts", "normals_into"]

#: Contacts of one node with one surface, at most.
MOST = MOST_CLOSED
#: Cosine of the angle of normals beyond which one node has two contacts.
_APART = 0.5


@kernel
def normals_into(points: FloatArray, masters: Memory, candidates: Memory) -> None:
    """Write the unit normals of the chosen triangles."""
    own = unpack(Candidates, candidates)
    triangles, normals = unpack(Masters, masters).triangles, own.normals
    for t in own.chosen:
        i, j, k = triangles[t]
        unit_normal(points[i], points[j], points[k], normals[t])


@inlined
def _basis(contact: FloatArray) -> None:
    """Write two orthonormal directions in the tangent plane."""
    n, e = contact[NORMAL : NORMAL + 3], contact[FIRST : FIRST + 3]
    k = 0 if abs(n[0]) < 0.6 else 1
    nk = n[k]
    size = np.sqrt(1.0 - nk * nk)
    e[0], e[1], e[2] = -nk * n[0] / size, -nk * n[1] / size, -nk * n[2] / size
    e[k] += 1.0 / size


@inlined
def _way(points: FloatArray, a: int, b: int) -> tuple[float, float, float]:
    """Write the vector from one node to another."""
    return points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]


@inlined
def _geometry(points: FloatArray, i: int, j: int, k: int, region: int, contact: FloatArray) -> None:
    """Write directions, rotations and curvatures of a contact from its normal and distance."""
    n, e, f = contact[NORMAL : NORMAL + 3], contact[FIRST : FIRST + 3], contact[SECOND : SECOND + 3]
    contact[TURN : TURN + 6] = 0.0
    contact[BEND] = contact[BEND + 1] = 0.0
    bend = 1.0 / contact[DISTANCE] if contact[DISTANCE] != 0.0 else 0.0
    first = 0 if region == FACE else region % 3
    if region > 3:
        contact[BEND] = bend
        _basis(contact)
    else:
        a, b = (i, j) if first == 0 else ((j, k) if first == 1 else (k, i))
        d0, d1, d2 = _way(points, a, b)
        short = 1.0 / np.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
        e[0], e[1], e[2] = d0 * short, d1 * short, d2 * short
        contact[TURN + first], contact[TURN + (first + 1) % 3] = -short, short
    n0, n1, n2, e0, e1, e2 = n[0], n[1], n[2], e[0], e[1], e[2]
    f0, f1, f2 = n1 * e2 - n2 * e1, n2 * e0 - n0 * e2, n0 * e1 - n1 * e0
    f[0], f[1], f[2] = f0, f1, f2
    if region != FACE:
        contact[BEND + 1] = bend
        return
    d0, d1, d2 = _way(points, i, k)
    along, across = d0 * e0 + d1 * e1 + d2 * e2, 1.0 / (d0 * f0 + d1 * f1 + d2 * f2)
    contact[TURN + 3] = (-1.0 - along * contact[TURN]) * across
    contact[TURN + 4], contact[TURN + 5] = -along * contact[TURN + 1] * across, across


@inlined
def _keeps_apart(contacts: FloatArray, first: int, count: int, n: FloatArray) -> bool:
    """Return True if a normal differs enough from those of the node's other contacts."""
    apart = True
    for c in range(first, count):
        apart = apart and dot(contacts[c, NORMAL : NORMAL + 3], n) <= _APART
    return apart


@inlined
def _following(candidates: Candidates, count: int, one: int, last: float) -> int:
    """The next minimum in the order of distances, then of numbers; -1 at the end."""
    near, measures = candidates.near, candidates.measures
    following, least = -1, np.inf
    for o in range(count):
        d = measures[o, SQUARE]
        if near[o, LEAST] == 1 and (d > last or (d == last and o > one)) and d < least:
            following, least = o, d
    return following


@inlined
def _minima(
    points: FloatArray, masters: Masters, candidates: Candidates, count: int, found: Found,
    first: int,
) -> int:  # fmt: skip
    """Write the minima of one slave that are contacts, from row ``first`` on.

    Returns:
        The row after the last one, negative where one has a negative distance.
    """
    near, measures, contacts = candidates.near, candidates.measures, found.numbers
    kept, one, last, sign = first, -1, -1.0, 1
    for _ in range(leave_minima(candidates, count)):
        one = _following(candidates, count, one, last)
        last = measures[one, SQUARE]
        c, n = contacts[kept], contacts[kept, NORMAL : NORMAL + 3]
        c[DISTANCE] = signed_distance(points, masters, candidates, count, one, n)
        through = c[DISTANCE] < 0.0 and not is_first(candidates, count, one)
        if through or not _keeps_apart(contacts, first, kept, n):
            continue
        if c[DISTANCE] < 0.0:
            sign = -1
        for a in range(3):
            c[AREAS + a] = measures[one, a]
        found.ends[kept, 1] = candidates.triangles[near[one, AT]]
        i, j, k = near[one, CORNERS], near[one, CORNERS + 1], near[one, CORNERS + 2]
        _geometry(points, i, j, k, near[one, REGION], c)
        kept += 1
        if kept == first + MOST:
            break
    return sign * kept


@kernel
def find_contacts(
    points: FloatArray, slaves: Memory, masters: Memory, candidates: Memory, found: Memory
) -> None:
    """Write all contacts: their nodes and triangles, geometry, gaps and reaches.

    ``points`` (n, 3) are positions, m; normals are up to date.
    """
    touching, touched = unpack(Slaves, slaves), unpack(Masters, masters)
    own, made = unpack(Candidates, candidates), unpack(Found, found)
    offsets, thickness, starts = touching.offsets, touched.thickness, own.starts
    ends, contacts = made.ends, made.numbers
    closed = 0
    for i in range(len(offsets)):
        if starts[i] == starts[i + 1]:
            continue
        node = touching.nodes[i]
        count = closest_candidates(points, node, touched, own, i, offsets[i])
        kept = _minima(points, touched, own, count, made, closed)
        if kept < 0:
            # the node may have passed through, which depends on all candidates
            count = closest_candidates(points, node, touched, own, i, np.inf)
            kept = _minima(points, touched, own, count, made, closed)
        for c in range(closed, abs(kept)):
            t = ends[c, 1]
            gap = contacts[c, DISTANCE] - offsets[i] - thickness[t]
            if gap < 0.0:
                if c != closed:
                    for a in range(FIELDS):
                        contacts[closed, a] = contacts[c, a]
                contacts[closed, GAP], contacts[closed, REACH] = gap, offsets[i] + thickness[t]
                ends[closed, 0], ends[closed, 1] = i, t
                closed += 1
    made.closed[0] = closed
