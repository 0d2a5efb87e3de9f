# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodes of director shells: midside nodes of curved edges, directors and axes at the start."""

from dataclasses import dataclass

import numpy as np

from flexfem import _checks
from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.mesh.geometry.normals import any_normal
from flexfem.mesh.geometry.topology import edge_keys
from flexfem.mesh.shells.vertex_normals import vertex_normals
from flexfem.mesh.surface_mesh import SurfaceMesh
from flexfem.mesh.triangles.topology import side_nodes

__all__ = ["KINK", "DirectorNodes", "director_nodes"]

#: Triangles that meet at a larger angle, rad, meet at a kink.
KINK = np.pi / 6.0

# Relative singular value of normals that are taken as parallel: of two at the kink angle 0.27
_PARALLEL = 0.25


@dataclass(frozen=True)
class DirectorNodes:
    """Nodes of the triangles of director shells: their corners, then the midside nodes.

    All shells with an edge share one node there and rotate with it, also at kinks and where many
    meet.

    Attributes:
        corners: nodes of the surface mesh that are corners, ascending, (c,).
        edges: nodes of the surface mesh that the edges join, the lower one first, (e, 2).
        nodes: nodes of each triangle, corners, then midside nodes of the opposite edges, (t, 6).
        frames: at the start, (c + e, 12); e3 of a midside node is the director of its first
            triangle.
        directors: at the start, inertial axes, (t, 3, 3).
        turning: nodes whose frames rotate the directors, (t, 3): the midside nodes.
        held: fixed unknowns without stiffness, (c + e, 6): rotations of corners, and those about
            the director where all directors of an edge are parallel.
    """

    corners: IntArray
    edges: IntArray
    nodes: IntArray
    frames: FloatArray
    directors: FloatArray
    turning: IntArray
    held: BoolArray

    @property
    def all(self) -> IntArray:
        """Nodes of each triangle, then those that rotate its directors, (t, 9)."""
        return np.concatenate([self.nodes, self.turning], 1)


def director_nodes(
    surface: SurfaceMesh, rows: IntArray, planes: FloatArray | None = None, kink: float = KINK
) -> DirectorNodes:
    """Place the nodes of director shells.

    The midpoint of an edge is that of ``surface.midpoints``; elsewhere it is off the chord such
    that the edge continues the tangent planes at both ends. A director is the normal at the
    midpoint of an edge, the mean of those of all triangles whose normals there are parallel but for
    the kink angle; triangles that meet at a kink have directors of their own.

    Args:
        surface: the mesh.
        rows: triangles of the director shells, (t,).
        planes: unit normals of planes of symmetry at edges, in which directors are, zero at others,
            (t, 3, 3).
        kink: angle between normals beyond which surfaces are not smooth, rad.

    Raises:
        ValueError: The midpoints of edges invert a triangle.
    """
    triangles = surface.triangles[rows]
    corners, own = np.unique(triangles, return_inverse=True)
    start, end = side_nodes(triangles)
    keys, number = np.unique(
        edge_keys(np.column_stack([start, end]), len(surface.points)), return_inverse=True
    )
    edges = np.column_stack(np.divmod(keys, len(surface.points)))
    midpoints = surface.points[edges].mean(1)
    midpoints += _offsets(number, len(edges), *_heights(surface, rows, kink), np.cos(kink))
    given = surface.midpoints
    if given is not None:
        known = given[rows].reshape(-1, 3)
        there = np.isfinite(known).all(1)
        midpoints[number[there]] = known[there]
    nodes = np.concatenate([own.reshape(-1, 3), len(corners) + number.reshape(-1, 3)], 1)
    places = np.concatenate([surface.points[corners], midpoints])
    normals = _edge_normals(surface, rows, places[nodes])
    if planes is not None:
        normals -= np.einsum("tka,tka->tk", normals, planes)[..., None] * planes
        normals /= np.linalg.norm(normals, axis=2)[..., None]
    directors, parallel = _smoothed(number, normals.reshape(-1, 3), len(edges), np.cos(kink))
    first = np.zeros((len(edges), 3))
    first[number[::-1]] = directors[::-1]
    held = np.zeros((len(places), 6), dtype=bool)
    held[: len(corners), 3:] = True
    held[len(corners) :, 5] = parallel
    frames = _frames(places, first)
    return DirectorNodes(
        corners, edges, nodes, frames, directors.reshape(-1, 3, 3), nodes[:, 3:].copy(), held
    )


def _heights(surface: SurfaceMesh, rows: IntArray, kink: float) -> tuple[FloatArray, FloatArray]:
    """Heights (3 t,) of smooth edges over their chords, and along which normals, (3 t, 3)."""
    ends = vertex_normals(surface, kink)[rows]
    first, last = (np.roll(ends, -k, 1).reshape(-1, 3) for k in (1, 2))
    start, end = side_nodes(surface.triangles[rows])
    chords = surface.points[end] - surface.points[start]
    # the cubic through both ends with the chord's projections onto both tangent planes as slopes
    rise = np.einsum("sa,sa->s", chords, last)[:, None] * last
    rise -= np.einsum("sa,sa->s", chords, first)[:, None] * first
    mean = first + last
    mean /= np.linalg.norm(mean, axis=1)[:, None]
    return np.einsum("sa,sa->s", rise, mean) / 8.0, mean


def _offsets(
    number: IntArray, count: int, heights: FloatArray, normals: FloatArray, limit: float
) -> FloatArray:
    """Vectors (count, 3) from the chords of edges to their midpoints.

    They are the means over both sides of an edge. Where surfaces meet at a kink, their common edge
    is on both: the shortest vector with all these heights.
    """
    result, sides = np.zeros((count, 3)), np.bincount(number, minlength=count)
    np.add.at(result, number, heights[:, None] * normals)
    result /= sides[:, None]
    lead = np.empty(count, np.int64)
    lead[number[::-1]] = np.arange(len(number))[::-1]
    bent = abs(np.einsum("sa,sa->s", normals, normals[lead[number]])) < limit
    order, firsts = np.argsort(number, kind="stable"), np.concatenate([[0], np.cumsum(sides)])
    for edge in np.unique(number[bent]):
        own = order[firsts[edge] : firsts[edge + 1]]
        result[edge] = np.linalg.pinv(normals[own], rcond=_PARALLEL) @ heights[own]
    return result


def _edge_normals(surface: SurfaceMesh, rows: IntArray, places: FloatArray) -> FloatArray:
    """Unit normals (t, 3, 3) of the curved triangles at the midpoints of their edges."""
    corners, midpoints = places[:, :3], places[:, 3:]
    following, last = np.roll(corners, -1, 1), np.roll(corners, -2, 1)
    # along the edge, and from it towards the opposite corner
    inward = 2.0 * (np.roll(midpoints, -1, 1) + np.roll(midpoints, -2, 1) - midpoints)
    inward -= corners + 0.5 * (following + last)
    normals = np.cross(last - following, inward)
    turned = np.einsum("tka,ta->tk", normals, surface.normals[rows])
    if (turned <= 0.0).any():
        row = int(rows[np.argmax((turned <= 0.0).any(1))])
        at = _checks.show(surface.points[surface.triangles[row]].mean(0).tolist())
        raise ValueError(f"SurfaceMesh: the midpoints of its edges invert triangle {row} at {at}")
    unit: FloatArray = normals / np.linalg.norm(normals, axis=2)[..., None]
    return unit


def _smoothed(
    number: IntArray, normals: FloatArray, count: int, limit: float
) -> tuple[FloatArray, BoolArray]:
    """Directors (3 t, 3) of all sides, and whether those of an edge (count,) are parallel.

    Normals parallel to the first one of an edge, but for the kink angle and their sense, are
    replaced by their mean, then those of the rest that are parallel to the first of them.
    """
    directors, left = normals.copy(), np.ones(len(normals), dtype=bool)
    parallel = np.ones(count, dtype=bool)
    while left.any():
        sides = np.flatnonzero(left)
        lead = np.full(count, -1)
        lead[number[sides[::-1]]] = sides[::-1]
        cosine = np.einsum("sa,sa->s", normals[sides], normals[lead[number[sides]]])
        chosen = sides[abs(cosine) >= limit]
        sign = np.sign(cosine[abs(cosine) >= limit])[:, None]
        mean = np.zeros((count, 3))
        np.add.at(mean, number[chosen], sign * normals[chosen])
        own = mean[number[chosen]]
        directors[chosen] = sign * own / np.linalg.norm(own, axis=1)[:, None]
        left[chosen] = False
        parallel[number[left]] = False
    return directors, parallel


def _frames(places: FloatArray, directors: FloatArray) -> FloatArray:
    """Frames (n, 12): inertial axes, at the last nodes axes whose third is the director."""
    turns = np.tile(np.eye(3), (len(places), 1, 1))
    e1 = any_normal(directors)
    turns[-len(directors) :] = np.stack([e1, np.cross(directors, e1), directors], 2)
    return np.concatenate([places, turns.reshape(-1, 9)], 1)
