# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts at the start: no two surfaces touch or overlap, and none repel."""

from dataclasses import replace

import numpy as np

from flexfem.contact.barrier.surface import ContactSurface, contact_surface
from flexfem.contact.primitives.candidates import Motion
from flexfem.contact.primitives.closest import closest_pairs
from flexfem.contact.primitives.data import Pairs
from flexfem.contact.primitives.neighbourhoods import Neighbourhoods
from flexfem.contact.primitives.search import find_pairs
from flexfem.contact.surfaces.surfaces import CollisionSurfaces

__all__ = ["start_apart"]

#: Gap at the start, in parts of that below which surfaces repel, at which they touch.
_TOUCH = 1e-3


def start_apart(surfaces: CollisionSurfaces) -> list[tuple[ContactSurface, Neighbourhoods]]:
    """Surfaces of all contacts of a model, with the pairs that are left out.

    Where gaps at the start are smaller than those at which surfaces repel, these are reduced, so
    that no energy is stored at the start.

    Raises:
        ValueError: two bodies touch or overlap, with the place and the depth.
    """
    return [_apart(surfaces, contact_surface(surfaces, sides)) for sides in surfaces.contacts]


def _apart(
    surfaces: CollisionSurfaces, own: ContactSurface
) -> tuple[ContactSurface, Neighbourhoods]:
    """Surface of a contact."""
    x = surfaces.start
    near = Neighbourhoods.of(own.surface, x, own.touching, surfaces.links)
    here = np.ones(len(x), dtype=np.bool_)
    pairs = find_pairs(own.surface, near, Motion(x, x), own.touching, here)
    if not pairs.count:
        return own, near
    weights, distances = np.empty((pairs.count, 4)), np.empty(pairs.count)
    closest_pairs(x, pairs.kind, pairs.points, np.zeros(pairs.count), weights, distances)
    gaps = distances - pairs.touch
    worst = int(np.argmin(gaps - _TOUCH * pairs.dhat))
    if gaps[worst] <= _TOUCH * pairs.dhat[worst]:
        raise ValueError(_overlap(surfaces, own, pairs, worst, -float(gaps[worst])))
    dhat = own.surface.dhat.copy()
    np.minimum.at(dhat, pairs.points.ravel(), np.repeat(gaps, 4))
    return replace(own, surface=replace(own.surface, dhat=dhat)), near


def _overlap(
    surfaces: CollisionSurfaces, own: ContactSurface, pairs: Pairs, worst: int, depth: float
) -> str:
    """Text for two bodies that overlap."""
    first, second = pairs.points[worst, [0, 3]].tolist()
    a, b = (surfaces.bodies[int(own.surface.label[p])].label for p in (first, second))
    x, y, z = surfaces.start[first].tolist()
    what = f"overlaps {b} by {depth:g} m" if depth > 0.0 else f"touches {b}"
    return (
        f'Contact "{own.contact.name}": at the start {a} {what} at ({x:.6g}, {y:.6g}, {z:.6g}) m; '
        "move them apart, or make the contact thinner"
    )
