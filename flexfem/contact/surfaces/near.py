# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points that are near along their bodies, across joints too: what contains them does not touch."""

from collections.abc import Sequence

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.detection.neighbours import Rows
from flexfem.contact.surfaces.bodies import Connection
from flexfem.contact.surfaces.collected import CollisionBody
from flexfem.contact.surfaces.primitives import Primitives

__all__ = ["joint_links", "near_points"]

#: A rod that is bent as far as its own thickness allows touches itself at this distance along its
#: axis, relative to its diameter: half a circle of its radius.
_BENT = 0.5 * np.pi


def near_points(primitives: Primitives, bodies: Sequence[CollisionBody], links: IntArray) -> Rows:
    """Return the points that each point is near to, itself included, ascending.

    Along edges and links the distance is less than pi/2 times the sum of their radii; links have no
    length.

    Args:
        primitives: points and edges at the start.
        bodies: all bodies that touch; rigid ones do not touch themselves.
        links: (k, 2) pairs of points that joints connect.
    """
    x, radius = primitives.start, primitives.radius
    flexible = ~np.array([body.rigid for body in bodies], dtype=np.bool_)
    edges = primitives.edges[flexible[primitives.edge_body]]
    largest = float(radius[np.concatenate([edges, links])].max(initial=0.0))
    lengths = np.linalg.norm(np.diff(x[edges], axis=1)[:, 0], axis=1)
    lengths = np.tile(np.concatenate([lengths, np.zeros(len(links))]), 2)
    ends = np.concatenate([edges, links, edges[:, ::-1], links[:, ::-1]])
    short = lengths < 2.0 * _BENT * largest
    ends, lengths, count = ends[short], lengths[short], len(x)
    order = np.argsort(ends[:, 0], kind="stable")
    ends, lengths = ends[order], lengths[order]
    starts = np.searchsorted(ends[:, 0], np.arange(count + 1))
    every = np.arange(count)
    keys, far = every * count + every, np.zeros(count)
    front, gone = keys, far
    reach = _BENT * (radius + largest)
    while len(front):
        source, at = np.divmod(front, count)
        times = np.diff(starts)[at]
        row = np.repeat(np.arange(len(front)), times)
        step = np.arange(len(row)) - np.repeat(np.cumsum(times) - times, times) + starts[at[row]]
        reached, length = source[row] * count + ends[step, 1], gone[row] + lengths[step]
        allowed = length <= reach[source[row]]
        front, gone = _nearest(reached[allowed], length[allowed])
        new = _shorter(keys, far, front, gone)
        front, gone = front[new], gone[new]
        keys, far = _nearest(np.concatenate([keys, front]), np.concatenate([far, gone]))
    first, second = np.divmod(keys, count)
    # a link of two points without thickness counts, other ways must be short
    kept = (far < _BENT * (radius[first] + radius[second])) | (far == 0.0)
    starts = np.searchsorted(first[kept], np.arange(count + 1))
    return Rows(starts=starts, values=second[kept])


def _nearest(keys: IntArray, far: FloatArray) -> tuple[IntArray, FloatArray]:
    """Each key once, ascending, with its least distance."""
    if not len(keys):
        return keys, far
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    first = np.concatenate([[0], np.flatnonzero(keys[1:] != keys[:-1]) + 1])
    return keys[first], np.minimum.reduceat(far[order], first)


def _shorter(keys: IntArray, far: FloatArray, found: IntArray, length: FloatArray) -> BoolArray:
    """True for the keys found that are new, or nearer than they were."""
    at = np.minimum(np.searchsorted(keys, found), len(keys) - 1)
    shorter: BoolArray = (keys[at] != found) | (length < far[at])
    return shorter


def joint_links(
    primitives: Primitives, bodies: Sequence[CollisionBody], connected: Sequence[Connection]
) -> IntArray:
    """Return the pairs (k, 2) of points nearest to the markers of joints between flexible bodies.

    Args:
        primitives: points at the start.
        bodies: all bodies that touch.
        connected: joints.
    """
    order = np.argsort(primitives.body, kind="stable")
    cuts = np.searchsorted(primitives.body[order], np.arange(len(bodies) + 1))
    points = dict[str, IntArray]()
    for number, body in enumerate(bodies):
        if not body.carried:
            own = order[cuts[number] : cuts[number + 1]]
            points[body.owner] = np.concatenate([points.get(body.owner, own[:0]), own])
    pairs = []
    for one in connected:
        if one.whole or any(name not in points for name in one.bodies):
            continue
        pair = []
        for name, place in zip(one.bodies, one.places, strict=True):
            away = np.linalg.norm(primitives.start[points[name]] - place, axis=1)
            pair.append(int(points[name][np.argmin(away)]))
        pairs.append(pair)
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)
