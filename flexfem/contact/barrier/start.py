# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts at the start: no two surfaces touch or overlap, and none repel."""

from dataclasses import dataclass, replace

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.barrier.intersections import check_intersections
from flexfem.contact.barrier.surface import ContactSurface, contact_surface
from flexfem.contact.fields.search import find_pairs as find_field_pairs
from flexfem.contact.primitives.candidates import Motion
from flexfem.contact.primitives.closest import closest_pairs
from flexfem.contact.primitives.data import EDGE_EDGE, Pairs
from flexfem.contact.primitives.neighbourhoods import Neighbourhoods
from flexfem.contact.primitives.search import find_pairs
from flexfem.contact.surfaces.rigid import DistanceField
from flexfem.contact.surfaces.surfaces import CollisionSurfaces
from flexfem.model.rigid_surface import RigidCylinder

__all__ = ["start_apart"]

#: Gap at the start, in parts of that below which surfaces repel, at which they touch.
_TOUCH = 1e-3
#: Least reach in parts of the size of the largest body: gaps are known to 1e-16 of it.
_LEAST = 1e-8


def start_apart(surfaces: CollisionSurfaces) -> list[tuple[ContactSurface, Neighbourhoods]]:
    """Surfaces of all contacts of a model, with the pairs that are left out.

    Where gaps at the start are smaller than those at which surfaces repel, these are reduced, so
    that no energy is stored at the start: of rigid bodies that move all around, of others there.

    Raises:
        ValueError: two bodies touch, overlap or intersect, with the place; one is inside of another
            one; a rigid body with long edges touches a cylinder with ends; a reach is too small.
    """
    made = []
    for sides in surfaces.contacts:
        own = contact_surface(surfaces, sides)
        _check_reach(own)
        for field in sides.fields:
            _check_edges(surfaces, own, field)
        made.append(_apart(surfaces, own))
    return made


def _check_reach(own: ContactSurface) -> None:
    """Raise for a reach in which forces would be round-off."""
    reach = own.contact.reach
    if reach is not None and reach < _LEAST * own.size:
        raise ValueError(
            f'Contact "{own.contact.name}": reach must be at least 1e-8 of the size {own.size:g} m '
            f"of its bodies, got {reach:g} m"
        )


def _check_edges(surfaces: CollisionSurfaces, own: ContactSurface, field: DistanceField) -> None:
    """Raise for a rigid body that a cylinder with ends would meet between its corners."""
    cylinder = field.surface
    if not isinstance(cylinder, RigidCylinder) or cylinder.inside:
        return
    cells, x = surfaces.primitives, surfaces.start
    rigid = np.array([body.rigid for body in surfaces.bodies], dtype=np.bool_)
    touching = rigid & own.touching[field.body, : len(rigid)]
    edges = cells.edges[touching[cells.edge_body]]
    lengths = np.linalg.norm(x[edges[:, 1]] - x[edges[:, 0]], axis=1)
    if lengths.max(initial=0.0) > cylinder.radius:
        worst = int(np.argmax(lengths))
        one, other = (surfaces.bodies[k].label for k in (cells.body[edges[worst, 0]], field.body))
        raise ValueError(
            f'Contact "{own.contact.name}": {one} has triangles or edges of {lengths[worst]:.4g} m '
            f"and touches {other}, whose radius is {cylinder.radius:g} m, with its corners only: "
            "give a RigidMesh, or a cylinder without ends"
        )


def _apart(
    surfaces: CollisionSurfaces, own: ContactSurface
) -> tuple[ContactSurface, Neighbourhoods]:
    """Surface of a contact."""
    x = surfaces.start
    near = Neighbourhoods.of(own.surface, x, own.touching, surfaces.links)
    dhat = own.surface.dhat.copy()
    here = np.ones(len(x), dtype=np.bool_)
    moving = np.array([one.rigid and np.isfinite(one.density) for one in surfaces.bodies])
    flexible = np.array([not one.rigid for one in surfaces.bodies])
    for found in (_cells(own, near, x, here, moving, flexible), _obstacles(own, x, here)):
        _check(surfaces, own, found)
        # a function of the user's that has failed says so when the run begins
        pair, column = np.nonzero(found.reduced)
        np.fmin.at(dhat, found.points[pair, column], found.gaps[pair])
    _reduce_all_around(own, dhat, moving)
    check_intersections(surfaces, own, near)
    return replace(own, surface=replace(own.surface, dhat=dhat)), near


def _reduce_all_around(own: ContactSurface, dhat: FloatArray, moving: BoolArray) -> None:
    """Reduce all points of rigid bodies that move to their least ``dhat`` (n,) so far, in place.

    A wheel whose lowest points alone repel from nearer would roll into a hollow, and stay there.
    """
    reduced = dhat < own.surface.dhat
    for body in np.unique(own.surface.label[reduced]).tolist():
        if moving[body]:
            points = own.surface.label == body
            least = dhat[points & reduced].min()
            dhat[points] = np.minimum(dhat[points], least)


@dataclass(frozen=True)
class _Gaps:
    """Gaps of pairs at the start.

    Attributes:
        gaps: (m,), m.
        dhat: (m,) gap below which they repel, m.
        points: (m, k) their points.
        reduced: (m, k) True for those that it reduces.
        bodies: (m, 2) bodies of both sides.
    """

    gaps: FloatArray
    dhat: FloatArray
    points: IntArray
    reduced: BoolArray
    bodies: IntArray


def _cells(
    own: ContactSurface, near: Neighbourhoods, x: FloatArray, here: BoolArray, moving: BoolArray,
    flexible: BoolArray,
) -> _Gaps:  # fmt: skip
    """Gaps of pairs of cells."""
    pairs = find_pairs(own.surface, near, Motion(x, x), own.touching, here)
    weights, distances = np.empty((pairs.count, 4)), np.empty(pairs.count)
    closest_pairs(x, pairs.kind, pairs.points, np.zeros(pairs.count), weights, distances)
    bodies = own.surface.label[pairs.points[:, [0, 3]]]
    reduced = _reduced(own, pairs, bodies, moving, flexible)
    return _Gaps(distances - pairs.touch, pairs.dhat, pairs.points, reduced, bodies)


def _reduced(
    own: ContactSurface, pairs: Pairs, bodies: IntArray, moving: BoolArray, flexible: BoolArray
) -> BoolArray:
    """Points (m, 4) of the two ``bodies`` (m, 2) of each pair whose reach is reduced.

    They are those of a rigid one that moves, or else of the one with more points: a small gap at
    one place does not reduce the reach of a sphere or a plane that stays everywhere. Beside nothing
    rigid that moves they are those of flexible bodies as well: what slides away from where it has
    been near would climb a step otherwise, onto parts that repel from farther away.

    Args:
        own: surface of the contact.
        pairs: all of them.
        bodies: of their sides.
        moving: True for rigid bodies that move.
        flexible: True for bodies that are not rigid.
    """
    size, rolls = np.bincount(own.surface.label)[bodies], moving[bodies]
    middle = np.where(pairs.kind >= EDGE_EDGE, 2, 1)[:, np.newaxis]
    second = np.where(
        rolls[:, 0] != rolls[:, 1], rolls[:, 1], size[:, 1] >= size[:, 0]
    )[:, np.newaxis]  # fmt: skip
    side = (np.arange(4) >= middle).astype(np.int64)
    slides = flexible[bodies] & ~moving[bodies[:, ::-1]]
    chosen: BoolArray = (side == second) | np.take_along_axis(slides, side, axis=1)
    return chosen


def _obstacles(own: ContactSurface, x: FloatArray, here: BoolArray) -> _Gaps:
    """Gaps of points and obstacles."""
    every, at = own.obstacles, own.obstacles.placed(x)
    found = find_field_pairs(every, own.stations(here), at, np.zeros(len(x)))
    pairs, numbers = found.pairs, np.array([one.body for one in every.every], dtype=np.int64)
    distances = every.state(found, at).distance
    bodies = np.column_stack([own.surface.label[pairs.points[:, 0]], numbers[found.fields]])
    first = pairs.points[:, :1]
    every_one = np.ones(first.shape, dtype=np.bool_)
    return _Gaps(distances - pairs.touch, pairs.dhat, first, every_one, bodies)


def _check(surfaces: CollisionSurfaces, own: ContactSurface, found: _Gaps) -> None:
    """Raise if two bodies touch."""
    spare = found.gaps - _TOUCH * found.dhat
    if not (spare <= 0.0).any():
        return
    worst = int(np.argmin(spare))
    depth = -float(found.gaps[worst])
    owner, reach = f'Contact "{own.contact.name}"', own.contact.reach
    a, b = (surfaces.bodies[int(body)].label for body in found.bodies[worst])
    place = "({:.6g}, {:.6g}, {:.6g}) m".format(*surfaces.start[found.points[worst, 0]])
    if reach is not None and depth < 0.0:
        raise ValueError(
            f"{owner}: at the start the gap of {a} and {b} is {-depth:g} m at {place}, less than a "
            f"thousandth of reach {reach:g} m: move them apart, or make it smaller"
        )
    deep = depth > _TOUCH * found.dhat[worst]
    what = f"overlaps {b} by {depth:g} m" if deep else f"touches {b}"
    raise ValueError(
        f"{owner}: at the start {a} {what} at {place}; move them apart, or make the contact thinner"
    )
