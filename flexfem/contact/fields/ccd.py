# SPDX-License-Identifier: LGPL-3.0-or-later
"""Continuous collision detection: the part of a motion during which points keep off obstacles.

Conservative advancement. A distance d changes by no more than the relative way of point and
obstacle. Outside of convex obstacles it is above its tangent along a straight line, inside of
convex walls above its chord: these bounds end a sliding motion in one or two steps. Where the
obstacle turns, the way is within b s^2 / 2 of a straight line after the time s. What is returned is
safe after any number of steps.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.fields.data import FieldPairs
from flexfem.contact.fields.motion import Paths
from flexfem.contact.fields.obstacles import Obstacle, Obstacles, Placed
from flexfem.contact.fields.shapes import Bend

__all__ = ["safe_part"]

#: Steps of a pair at most.
_STEPS = 200
#: Part of what a gap may lose, at which a pair's advancement ends.
_CLOSE = 0.02


def safe_part(
    obstacles: Obstacles, found: FieldPairs, before: Placed, after: Placed, keep: float
) -> float:
    """Largest part of a motion without contact.

    Args:
        obstacles: the obstacles.
        found: pairs with all that may touch during the motion.
        before: positions at the start.
        after: those at the end of the motion, linear for points, a screw for each obstacle.
        keep: part, between 0 and 1, of its gap (at most of its dhat) that each pair keeps.

    Returns:
        A number in [0, 1], 0 if a pair touches at the start: each gap is larger than what the pair
        keeps on the whole way until then.
    """
    part, pairs = 1.0, found.pairs
    paths = Paths.of(pairs.points[:, 0], found.fields, before, after)
    for f, obstacle in enumerate(obstacles.every):
        own = np.flatnonzero(found.fields == f)
        if len(own):
            touch, dhat = pairs.touch[own], pairs.dhat[own]
            part = min(part, _advance(obstacle, paths.of_rows(own), touch, dhat, keep))
    return part


def _advance(
    obstacle: Obstacle, paths: Paths, touch: FloatArray, dhat: FloatArray, keep: float
) -> float:
    """Safe part of the motion of points near one obstacle."""
    count = len(touch)
    t, part, left = np.zeros(count), 1.0, np.arange(count)
    arms, rates, bound = paths.at(t)
    distance, feet = obstacle.distance.closest(arms)
    gap = np.minimum(distance - touch, dhat)
    if not (gap > 0.0).all():
        return 0.0
    least = touch + keep * gap
    end = least + _CLOSE * (1.0 - keep) * gap
    for _ in range(_STEPS):
        slope = _slope(obstacle, arms, rates, 1.0 - t[left], distance, feet)
        t[left] += _time(distance - least[left], slope, bound)
        left = left[t[left] < part]
        if not len(left):
            return part
        arms, rates, bound = paths.of_rows(left).at(t[left])
        distance, feet = obstacle.distance.closest(arms)
        close = ~(distance > end[left])
        part = min(part, float(t[left[close]].min(initial=1.0)))
        kept = ~close & (t[left] < part)
        left, arms, rates, bound = left[kept], arms[kept], rates[kept], bound[kept]
        distance, feet = distance[kept], feet[kept]
    return min(part, float(t[left].min(initial=1.0)))


def _slope(
    obstacle: Obstacle, arms: FloatArray, rates: FloatArray, rest: FloatArray,
    distance: FloatArray, feet: FloatArray,
) -> FloatArray:  # fmt: skip
    """Lower bounds (k,) of the mean rate of distances along straight lines, m in unit time.

    Args:
        obstacle: the obstacle.
        arms: positions (k, 3) in its axes.
        rates: their rates.
        rest: time left, (k,).
        distance: present distances.
        feet: closest points.
    """
    # the way itself bounds it
    least: FloatArray = -np.linalg.norm(rates, axis=1)
    if obstacle.distance.bend == Bend.CONVEX:
        along = np.einsum("ka,ka->k", arms - feet, rates) / distance
        least = np.maximum(along, least)
    if obstacle.distance.bend == Bend.CONCAVE:
        ends, _ = obstacle.distance.closest(arms + rest[:, None] * rates)
        chord = (ends - distance) / np.maximum(rest, 1e-300)
        least = np.maximum(chord, least)
    return least


def _time(spare: FloatArray, slope: FloatArray, bound: FloatArray) -> FloatArray:
    """Times (k,) at which spare + slope s - bound s^2 / 2 is zero; the spare is positive."""
    root = np.sqrt(slope * slope + 2.0 * bound * spare)
    # 2 spare / (root - slope), without loss of digits for slopes that are positive
    with np.errstate(divide="ignore", invalid="ignore"):
        falling, rising = 2.0 * spare / (root - slope), (root + slope) / bound
    found: FloatArray = np.where(slope > 0.0, rising, falling)
    return np.where(np.isnan(found), np.inf, found)
