# SPDX-License-Identifier: LGPL-3.0-or-later
"""Continuous collision detection: the part of a motion during which all pairs keep a gap.

Conservative advancement. Closest points at one instant tell how long a pair's distance stays above
a bound at least: that of the plane across the line between them, from which all points of one
primitive move away linearly in time, or of the sum of the fastest motions of both (additive CCD: Li
and others, Codimensional incremental potential contact, 2021). The longer one is taken, again and
again. Planes end a sliding motion in one or two steps, for which the sum needs as many as it has
gaps. Crossing edges are regularised, which is the plain distance in five dimensions (``closest``).
What is returned is safe after any number of steps.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.primitives.closest import apart, closest
from flexfem.contact.primitives.data import (
    CROSSING_EDGE_VERTEX,
    CROSSING_VERTICES,
    EDGE_EDGE,
    Pairs,
    regularisation,
)
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Memory, unpack

__all__ = ["mark_unsafe", "safe_part"]

#: Steps of a pair at most.
_STEPS = 200
#: Part of what a gap may lose, at which a pair's advancement ends.
_CLOSE = 0.02


@kernel
def safe_part(pairs: Memory, before: FloatArray, after: FloatArray, keep: float) -> float:
    """Largest part of a motion without contact.

    Args:
        pairs: memory of the pairs.
        before: positions (n, 3) at the start, m.
        after: those at the end of the linear motion of all points.
        keep: part, between 0 and 1, of its gap (at most of its dhat) that each pair keeps.

    Returns:
        A number in [0, 1], 0 if a pair touches at the start: each gap is larger than what the pair
        keeps on the whole way until then.
    """
    own, part = unpack(Pairs, pairs), 1.0
    x, p, w, r = np.empty((4, 3)), np.empty((4, 3)), np.empty(4), np.empty(3)
    for k in range(len(own.kind)):
        part = min(part, _part(own, k, before, after, keep, part, x, p, w, r))
    return part


@kernel
def mark_unsafe(
    pairs: Memory, before: FloatArray, after: FloatArray, keep: float, asleep: FloatArray,
    ways: tuple[float, float], marks: FloatArray,
) -> float:  # fmt: skip
    """The same, for small motions, marking the points of all pairs that it cuts.

    Args:
        pairs: memory of the pairs.
        before: positions (n, 3) at the start, m.
        after: those at the end of the linear motion of all points.
        keep: part of its gap that each pair keeps.
        asleep: way (m,) of two points on which a pair certainly does not act; updated, m.
        ways: that of all points so far, and that of this motion, m.
        marks: (n, 3), increased by one for points of pairs that are cut, in the first column.
    """
    own, least = unpack(Pairs, pairs), 1.0
    x, p, w, r = np.empty((4, 3)), np.empty((4, 3)), np.empty(4), np.empty(3)
    for k in range(len(own.kind)):
        if asleep[k] > ways[0] + ways[1]:
            continue
        kind, nodes, reach = own.kind[k], own.points[k], own.touch[k] + own.dhat[k]
        for i in range(4):
            for a in range(3):
                x[i, a] = before[nodes[i], a]
        rho = regularisation(kind, own.touch[k], own.dhat[k])
        far = np.sqrt(closest(kind, x, rho, w, r)) - reach
        asleep[k] = ways[0] + far
        part = 1.0 if far > ways[1] else _part(own, k, before, after, keep, 1.0, x, p, w, r)
        if part < 1.0:
            least = min(least, part)
            for i in range(4):
                marks[nodes[i], 0] += 1.0
    return least


@inlined
def _part(
    own: Pairs, k: int, before: FloatArray, after: FloatArray, keep: float, most: float,
    x: FloatArray, p: FloatArray, w: FloatArray, r: FloatArray,
) -> float:  # fmt: skip
    """Part of a motion during which a pair keeps a part of its gap, sought up to ``most``."""
    kind, nodes, touch, dhat = own.kind[k], own.points[k], own.touch[k], own.dhat[k]
    if apart(before, after, kind, nodes, touch + keep * dhat):
        return 1.0
    rho, t, least, end = regularisation(kind, touch, dhat), 0.0, 0.0, 0.0
    for i in range(4):
        for a in range(3):
            p[i, a] = after[nodes[i], a] - before[nodes[i], a]
    for step in range(_STEPS):
        for i in range(4):
            for a in range(3):
                x[i, a] = before[nodes[i], a] + t * p[i, a]
        distance = np.sqrt(closest(kind, x, rho, w, r))
        if step == 0:
            gap = min(distance - touch, dhat)
            if not gap > 0.0:
                return 0.0
            least = touch + keep * gap
            end = least + _CLOSE * (1.0 - keep) * gap
        if distance <= end:
            break
        t += max(
            _by_plane(kind, x, p, w, r, distance, rho, least),
            (distance - least) / max(_fastest(kind, p), 1e-300),
        )
        if t >= most:
            break
    return float(t)


@inlined
def _ends(kind: int) -> tuple[int, int, int]:
    """First and last but one points of the first primitive, then the last one of the second."""
    if kind < EDGE_EDGE:
        return 0, 1, 2 + kind
    return (1 if kind == CROSSING_VERTICES else 0), 2, 4


@inlined
def _by_plane(
    kind: int, x: FloatArray, p: FloatArray, w: FloatArray, r: FloatArray, distance: float,
    rho: float, least: float,
) -> float:  # fmt: skip
    """Time until points of both primitives are nearer than ``least``, seen across their plane.

    Args:
        kind: kind of the pair.
        x: positions (4, 3), m.
        p: their motion in unit time.
        w: weights of the closest points.
        r: vector of the closest points.
        distance: that of the primitives.
        rho: square of the length that regularises crossing edges.
        least: distance to keep.
    """
    first, middle, last = _ends(kind)
    second = 3 if kind in (CROSSING_EDGE_VERTEX, CROSSING_VERTICES) else middle
    time, half = 1e300, 0.5 * np.sqrt(rho)
    # fourth and fifth components of the vector, times the ends' half lengths
    fourth, fifth = 2.0 * half * (w[1] - 0.5) * half, 2.0 * half * (w[3] + 0.5) * half
    for i in range(first, middle):
        for j in range(second, last):
            way, closing = 0.0, 0.0
            for a in range(3):
                way += r[a] * (x[i, a] - x[j, a])
                closing += r[a] * (p[j, a] - p[i, a])
            if kind >= EDGE_EDGE:
                way += (fourth if i == 1 else -fourth) - (fifth if j == 3 else -fifth)
            if closing > 0.0:
                time = min(time, max(way - distance * least, 0.0) / closing)
    return time


@inlined
def _fastest(kind: int, p: FloatArray) -> float:
    """Bound of the relative speed (m in unit time): fastest points about the common motion."""
    first, middle, last = _ends(kind)
    total = 0.0
    mean0, mean1, mean2 = 0.0, 0.0, 0.0
    for i in range(last):
        mean0 += p[i, 0] / last
        mean1 += p[i, 1] / last
        mean2 += p[i, 2] / last
    for one in range(2):
        most = 0.0
        for i in range(first if one == 0 else middle, middle if one == 0 else last):
            most = max(most, (p[i, 0] - mean0) ** 2 + (p[i, 1] - mean1) ** 2
                       + (p[i, 2] - mean2) ** 2)  # fmt: skip
        total += np.sqrt(most)
    return total
