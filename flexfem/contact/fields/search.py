# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points that may touch obstacles during a motion, and gaps at the start."""

from dataclasses import dataclass

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.fields.data import FieldPairs
from flexfem.contact.fields.obstacles import Obstacles, Placed, arms_of, weights_of

__all__ = ["Stations", "find_pairs"]


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


def find_pairs(
    obstacles: Obstacles, stations: Stations, at: Placed, slack: FloatArray
) -> FieldPairs:
    """Find the pairs that may act during a motion, also of points inside of obstacles.

    Args:
        obstacles: the obstacles.
        stations: points that touch them.
        at: positions at some instant of the motion.
        slack: largest way (n,) of each point from there, m.
    """
    found = [_near(obstacles, f, stations, at, slack) for f in range(len(obstacles))]
    who = np.concatenate([np.zeros(0, np.int64), *found])
    fields = np.repeat(np.arange(len(found)), [len(own) for own in found])
    points = np.column_stack([stations.rows[who], obstacles.points[fields]])
    return FieldPairs.of(
        points, fields, stations.weight[who], stations.radius[who], stations.dhat[who],
        stations.kappa[who],
    )  # fmt: skip


def _near(
    obstacles: Obstacles, f: int, stations: Stations, at: Placed, slack: FloatArray
) -> IntArray:
    """Numbers of the stations that may come near an obstacle.

    Where the four points of the obstacle move by d_i at most, the place that is now with the point,
    with the weights w_i, moves by sum |w_i| d_i.
    """
    obstacle, own = obstacles.every[f], np.flatnonzero(stations.touching[:, f])
    rows = stations.rows[own]
    arms = arms_of(at.points[rows], np.broadcast_to(at.frames[f], (len(own), 12)))
    reach = stations.radius[own] + stations.dhat[own] + slack[rows]
    if not obstacle.fixed:
        reach += np.abs(weights_of(arms / obstacle.size)) @ slack[obstacle.points]
    near: IntArray = own[~(obstacle.distance.closest(arms, reach)[0] > reach)]
    return near
