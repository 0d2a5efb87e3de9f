# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points that may touch obstacles during a motion, and those that do at the start."""

from dataclasses import dataclass

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.fields.data import FieldPairs
from flexfem.contact.fields.motion import Paths
from flexfem.contact.fields.obstacles import Obstacles, Placed, arms_of

__all__ = ["Overlap", "Stations", "deepest_overlap", "find_pairs"]


@dataclass(frozen=True)
class Stations:
    """Points that touch obstacles.

    Attributes:
        rows: Among all points, shape (k,).
        radius: Distance at which they touch, shape (k,), metres.
        dhat: Gap below which they repel, shape (k,), metres.
        kappa: Stiffness of the barrier, shape (k,), N/m^3.
        weight: Area, shape (k,), square metres.
        touching: Obstacles that each touches, shape (k, f).
    """

    rows: IntArray
    radius: FloatArray
    dhat: FloatArray
    kappa: FloatArray
    weight: FloatArray
    touching: BoolArray


@dataclass(frozen=True)
class Overlap:
    """A point that touches an obstacle.

    Attributes:
        row: of the point.
        field: number of the obstacle.
        depth: by which the point, with its radius, lies inside, m.
        place: closest point of the obstacle, inertial axes, m, (3,).
    """

    row: int
    field: int
    depth: float
    place: FloatArray


def find_pairs(
    obstacles: Obstacles, stations: Stations, before: Placed, after: Placed, skin: float = 0.0
) -> FieldPairs:
    """Find the pairs that may act during a motion, also of points inside of obstacles.

    Args:
        obstacles: the obstacles.
        stations: points that touch them.
        before: positions at the start.
        after: those at the end of the motion.
        skin: way by which point and obstacle may approach farther, m.
    """
    found = []
    for f in range(len(obstacles)):
        own = np.flatnonzero(stations.touching[:, f])
        numbers = np.full(len(own), f)
        ways = Paths.of(stations.rows[own], numbers, before, after).ways()
        reach = stations.radius[own] + stations.dhat[own] + skin + ways
        found.append((own[_near(obstacles, f, before, stations.rows[own], reach)], f))
    who = np.concatenate([np.zeros(0, np.int64), *(own for own, _ in found)])
    fields = np.concatenate([np.zeros(0, np.int64), *(np.full(len(own), f) for own, f in found)])
    return FieldPairs(
        points=stations.rows[who].astype(np.int64), fields=fields, touch=stations.radius[who],
        dhat=stations.dhat[who], kappa=stations.kappa[who], weight=stations.weight[who],
    )  # fmt: skip


def _near(obstacles: Obstacles, f: int, at: Placed, rows: IntArray, reach: FloatArray) -> IntArray:
    """Numbers of points that may be nearer to an obstacle than ``reach`` (k,)."""
    obstacle = obstacles.every[f]
    arms = arms_of(at.points[rows], np.broadcast_to(at.frames[f], (len(rows), 12)))
    near = np.flatnonzero(obstacle.distance.near(obstacle.local(arms), reach))
    distance, _ = obstacle.closest(arms[near])
    return near[~(distance > reach[near])]


def deepest_overlap(obstacles: Obstacles, stations: Stations, at: Placed) -> Overlap | None:
    """Return the point that lies deepest in an obstacle, None if none touches one."""
    pairs = find_pairs(obstacles, stations, at, at)
    state = obstacles.state(pairs, at)
    depth = pairs.touch - state.distance
    if not (depth >= 0.0).any():
        return None
    p = int(np.nanargmax(depth))
    frame, foot = at.frames[pairs.fields[p]], state.arms[p]
    place = frame[:3] + frame[3:].reshape(3, 3) @ foot
    return Overlap(int(pairs.points[p]), int(pairs.fields[p]), float(depth[p]), place)
