# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surfaces that intersect at the start, and bodies inside of others.

Distances of vertices, edges and triangles do not show either: an edge may go through the middle of
a triangle, and a body lie in the middle of another one, far from everything that would repel it.
"""

from collections.abc import Iterator

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.barrier.surface import ContactSurface
from flexfem.contact.obstacles.overlaps import winding_numbers
from flexfem.contact.primitives.candidates import Boxes, Motion
from flexfem.contact.primitives.neighbourhoods import Neighbourhoods
from flexfem.contact.surfaces.surfaces import CollisionSurfaces

__all__ = ["check_intersections"]

#: Number of pairs that are looked at at once, for their arrays.
_AT_ONCE = 2**18


def check_intersections(
    surfaces: CollisionSurfaces, own: ContactSurface, near: Neighbourhoods
) -> None:
    """Check that no edge of a contact goes through a triangle, and no body is inside of another.

    Raises:
        ValueError: one does, with both bodies and the place.
    """
    owner = f'Contact "{own.contact.name}"'
    found = _crossing(own, near, surfaces.start)
    if found is not None:
        numbers = own.surface.label[found[0]].tolist()
        a, b = (surfaces.bodies[number].label for number in numbers)
        raise ValueError(
            f"{owner}: at the start {a} intersects {b if a != b else 'itself'} at "
            f"{_place(found[1])}; move them apart"
        )
    for one, other, row, where in _wrong_sides(surfaces, own):
        raise ValueError(
            f"{owner}: at the start {surfaces.bodies[one].label} is {where} of "
            f"{surfaces.bodies[other].label} at {_place(surfaces.start[row])}; move them apart"
        )


def _crossing(
    own: ContactSurface, near: Neighbourhoods, x: FloatArray
) -> tuple[IntArray, FloatArray] | None:
    """A point of an edge and one of a triangle that it crosses, and where; None without."""
    first, second = Boxes.of(own.surface, own.touching, Motion(x, x)).piercing()
    for k in range(0, len(first), _AT_ONCE):
        part = slice(k, k + _AT_ONCE)
        found = _crossing_of(own, near, x, first[part], second[part])
        if found is not None:
            return found
    return None


def _crossing_of(
    own: ContactSurface, near: Neighbourhoods, x: FloatArray, first: IntArray, second: IntArray
) -> tuple[IntArray, FloatArray] | None:
    """The same of pairs (m,) of edges and triangles, as cells."""
    cells = own.surface.complex
    edges, triangles = cells.points[first, :2], cells.points[second]
    apart = (edges[:, :, np.newaxis] != triangles[:, np.newaxis]).all(axis=(1, 2))
    for end in range(2):
        vertex = np.searchsorted(cells.vertices, edges[:, end])
        apart &= near.vertices.apply(vertex, second, np.ones(len(second))) != 0.0
    edges, triangles = edges[apart], triangles[apart]
    p, q = x[edges[:, 0]], x[edges[:, 1]]
    a, b, c = (x[triangles[:, k]] for k in range(3))
    before, after = _volumes(a, b, c, p), _volumes(a, b, c, q)
    turns = np.array([_volumes(p, q, u, v) for u, v in ((a, b), (b, c), (c, a))])
    through = (turns >= 0.0).all(axis=0) | (turns <= 0.0).all(axis=0)
    through &= before * after < 0.0
    if not through.any():
        return None
    k = int(np.argmax(through))
    part = before[k] / (before[k] - after[k])
    return np.array([edges[k, 0], triangles[k, 0]]), p[k] + part * (q[k] - p[k])


def _volumes(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """Six times the volumes (m,) of tetrahedra with corners (m, 3), with their signs."""
    found: FloatArray = np.einsum("ma,ma->m", np.cross(b - a, c - a), d - a)
    return found


def _wrong_sides(
    surfaces: CollisionSurfaces, own: ContactSurface
) -> Iterator[tuple[int, int, int, str]]:
    """Bodies on the wrong side of closed rigid surfaces: both, a point, "inside" or "outside".

    No edge crosses the surfaces, so that one point of each connected part is enough.
    """
    x, cells = surfaces.start, surfaces.primitives
    rows = _one_of_each_part(own)
    for number in np.unique(cells.triangle_body[surfaces.element < 0]).tolist():
        chosen = rows[own.touching[own.surface.label[rows], number]]
        mine = cells.triangle_body == number
        corners = x[cells.triangles[mine]]
        one_side = bool(surfaces.side[mine].all())
        if not len(chosen) or not (one_side or not surfaces.bodies[number].carried):
            continue
        if not _closed(cells.triangles[mine]):
            continue
        a, b, c = (corners[:, k] for k in range(3))
        hollow = one_side and _volumes(a, b, c, x[:1]).sum() > 0.0
        # -1 inside of what has its normals inwards, as a hollow shape of a body has
        wrong = _turns(x[chosen], corners) > (-0.5 if hollow else 0.5)
        if wrong.any():
            row = int(chosen[np.argmax(wrong)])
            yield int(own.surface.label[row]), number, row, "outside" if hollow else "inside"


def _one_of_each_part(own: ContactSurface) -> IntArray:
    """Rows of one vertex of each connected part of the surfaces."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    cells = own.surface.complex
    count, ends = len(cells.vertices), cells.edges.T
    joined = coo_array((np.ones(len(cells.edges)), (ends[0], ends[1])), shape=(count, count))
    part = connected_components(joined, directed=False)[1]
    part[cells.stations] = -1
    numbers, first = np.unique(part, return_index=True)
    return cells.vertices[first[numbers >= 0]]


def _closed(triangles: IntArray) -> bool:
    """True if every edge is that of two triangles."""
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    return bool((np.unique(sides, axis=0, return_counts=True)[1] == 2).all())


def _turns(points: FloatArray, corners: FloatArray) -> FloatArray:
    """How often triangles with corners (m, 3, 3) are wound around points: (n,)."""
    turns = np.zeros(len(points))
    near = ((points >= corners.min((0, 1))) & (points <= corners.max((0, 1)))).all(axis=1)
    turns[near] = winding_numbers(points[near], corners)
    return turns


def _place(point: FloatArray) -> str:
    return "({:.6g}, {:.6g}, {:.6g}) m".format(*point)
