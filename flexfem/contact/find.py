# SPDX-License-Identifier: LGPL-3.0-or-later
"""Narrow phase of contact: nodes against the triangles that they touch.

A node touches a surface where its distance has a local minimum: inside a triangle, on an edge when
the same holds for all triangles there, or at a node. The surface seen from outside is thus round at
edges and corners, with a force that is continuous while the node slides from one region into
another. Of minima whose normals differ by less than 60 degrees only the nearest counts, so that a
node in a shallow valley is not pushed twice; in a steep one it is held by both walls.

The distance has a sign: that of the side of the surface on which the node was when it came near.
Of triangles that hang together only the nearest can have been passed through, so that other layers
of a folded sheet do not pull.
Beyond the rim of an open surface there is no side, and the rim is round.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.closest import closest_candidates, is_first, leave_minima, signed_distance
from flexfem.contact.held_contacts import MOST_HELD
from flexfem.contact.regions import FACE, dot, unit_normal
from flexfem.lie.compiled import inlined, kernel

__all__ = ["FIELDS", "MOST", "find_contacts", "normals_into"]

#: Numbers of a contact: area coordinates (0), gap (3), distance (4), normal (5), directions (8),
#: how the normal turns with the nodes about each of them (14), curvatures of the distance (20),
#: force (22), its slope (23) and potential (24), over the stiffness.
FIELDS = 25
#: Contacts of one node with one surface, at most.
MOST = MOST_HELD
#: Cosine of the angle of normals beyond which contacts of one node are two.
_APART = 0.5


@kernel
def normals_into(
    points: FloatArray, triangles: IntArray, chosen: IntArray, normals: FloatArray
) -> None:
    """Write the unit normals (m, 3) of the chosen triangles."""
    for t in chosen:
        i, j, k = triangles[t]
        unit_normal(points[i], points[j], points[k], normals[t])


@inlined
def _basis(contact: FloatArray) -> None:
    """Write any two directions across the normal."""
    n0, n1, n2 = contact[5], contact[6], contact[7]
    k = 0 if abs(n0) < 0.6 else 1
    nk = contact[5 + k]
    size = np.sqrt(1.0 - nk * nk)
    contact[8], contact[9], contact[10] = -nk * n0 / size, -nk * n1 / size, -nk * n2 / size
    contact[8 + k] += 1.0 / size


@inlined
def _way(points: FloatArray, a: int, b: int) -> tuple[float, float, float]:
    """From one node to another."""
    return points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]


@inlined
def _geometry(points: FloatArray, i: int, j: int, k: int, region: int, contact: FloatArray) -> None:
    """Write directions, turns and curvatures of a contact from its normal and distance."""
    contact[14:22] = 0.0
    bend = 1.0 / contact[4] if contact[4] != 0.0 else 0.0
    first = 0 if region == FACE else region % 3
    if region > 3:
        contact[20] = bend
        _basis(contact)
    else:
        a, b = (i, j) if first == 0 else ((j, k) if first == 1 else (k, i))
        d0, d1, d2 = (
            points[b, 0] - points[a, 0],
            points[b, 1] - points[a, 1],
            points[b, 2] - points[a, 2],
        )
        short = 1.0 / np.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
        contact[8], contact[9], contact[10] = d0 * short, d1 * short, d2 * short
        contact[14 + first], contact[14 + (first + 1) % 3] = -short, short
    n0, n1, n2, e0, e1, e2 = contact[5], contact[6], contact[7], contact[8], contact[9], contact[10]
    f0, f1, f2 = n1 * e2 - n2 * e1, n2 * e0 - n0 * e2, n0 * e1 - n1 * e0
    contact[11], contact[12], contact[13] = f0, f1, f2
    if region != FACE:
        contact[21] = bend
        return
    d0, d1, d2 = (
        points[k, 0] - points[i, 0],
        points[k, 1] - points[i, 1],
        points[k, 2] - points[i, 2],
    )
    along, across = d0 * e0 + d1 * e1 + d2 * e2, 1.0 / (d0 * f0 + d1 * f1 + d2 * f2)
    contact[17] = (-1.0 - along * contact[14]) * across
    contact[18], contact[19] = -along * contact[15] * across, across


@inlined
def _keeps_apart(contacts: FloatArray, first: int, count: int, n: FloatArray) -> bool:
    """Return True if a normal differs enough from those of the node's other contacts."""
    apart = True
    for c in range(first, count):
        apart = apart and dot(contacts[c, 5:8], n) <= _APART
    return apart


@inlined
def _following(near: IntArray, measures: FloatArray, count: int, one: int, last: float) -> int:
    """The next minimum by distance, then by number; -1 at the end."""
    following, least = -1, np.inf
    for o in range(count):
        d = measures[o, 3]
        if near[o, 2] == 1 and (d > last or (d == last and o > one)) and d < least:
            following, least = o, d
    return following


@inlined
def _minima(
    points: FloatArray, triangles: IntArray, rims: IntArray, normals: FloatArray, row: IntArray,
    side: IntArray, near: IntArray, measures: FloatArray, count: int, contacts: FloatArray,
    ends: IntArray, first: int,
) -> int:  # fmt: skip
    """Write one slave's minima that count, from row ``first`` on.

    Returns:
        The row after the last one, negative where one has a negative distance.
    """
    kept, one, last, sign = first, -1, -1.0, 1
    for _ in range(leave_minima(near, measures, count)):
        one = _following(near, measures, count, one, last)
        last = measures[one, 3]
        c = contacts[kept]
        c[4] = signed_distance(
            points, triangles, normals, rims, row, side[near[one, 0]], near, measures, count, one,
            c[5:8],
        )  # fmt: skip
        through = c[4] < 0.0 and not is_first(near, measures, count, one)
        if through or not _keeps_apart(contacts, first, kept, c[5:8]):
            continue
        if c[4] < 0.0:
            sign = -1
        c[0], c[1], c[2] = measures[one, 0], measures[one, 1], measures[one, 2]
        ends[kept, 1] = row[near[one, 0]]
        _geometry(points, near[one, 3], near[one, 4], near[one, 5], near[one, 1], c)
        kept += 1
        if kept == first + MOST:
            break
    return sign * kept


@kernel
def find_contacts(
    points: FloatArray, slaves: IntArray, offsets: FloatArray, triangles: IntArray,
    thickness: FloatArray, rims: IntArray, normals: FloatArray, starts: IntArray,
    candidates: IntArray, sides: IntArray, labels: IntArray, near: IntArray, measures: FloatArray,
    ends: IntArray, contacts: FloatArray,
) -> int:  # fmt: skip
    """Write slave and triangle (c, 2) and the numbers (c, ``FIELDS``) of all contacts.

    Args:
        points: Positions, shape (n, 3), metres.
        slaves: Their nodes, shape (s,).
        offsets: Distance at which each slave touches a mid-surface of no thickness, (s,), metres.
        triangles: Node indices, shape (m, 3).
        thickness: Half the thickness of each triangle, shape (m,), metres.
        rims: Which edges and nodes of each triangle are on a rim, bits, shape (m,).
        normals: Unit normals of the triangles, shape (m, 3).
        starts: Where the candidates of each slave begin, shape (s + 1,).
        candidates: Triangles that may be near, shape (k,).
        sides: On which side of each the slave belongs: 1, -1, or 0 for none, shape (k,).
        labels: Which candidates of a slave hang together, shape (k,).
        near: Work space, (longest row of candidates, 9).
        measures: Work space, (longest row of candidates, 7).
        ends: Shape (MOST (s + 1), 2).
        contacts: Shape (MOST (s + 1), FIELDS).

    Returns:
        Number of contacts.
    """
    found = 0
    for i in range(len(slaves)):
        if starts[i] == starts[i + 1]:
            continue
        row, side = candidates[starts[i] : starts[i + 1]], sides[starts[i] : starts[i + 1]]
        label, p = labels[starts[i] : starts[i + 1]], points[slaves[i]]
        count = closest_candidates(
            points, p, triangles, normals, offsets[i], thickness, row, side, label, near, measures
        )
        kept = _minima(
            points, triangles, rims, normals, row, side, near, measures, count, contacts, ends,
            found,
        )  # fmt: skip
        if kept < 0:
            # the node seems to have got through: only all candidates tell whether it has
            count = closest_candidates(
                points, p, triangles, normals, np.inf, thickness, row, side, label, near, measures
            )
            kept = _minima(
                points, triangles, rims, normals, row, side, near, measures, count, contacts, ends,
                found,
            )  # fmt: skip
        for c in range(found, abs(kept)):
            t = ends[c, 1]
            gap = contacts[c, 4] - offsets[i] - thickness[t]
            if gap < 0.0:
                if c != found:
                    for a in range(FIELDS):
                        contacts[found, a] = contacts[c, a]
                contacts[found, 3], ends[found, 0], ends[found, 1] = gap, i, t
                found += 1
    return found
