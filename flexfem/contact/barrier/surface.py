# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells of the bodies of one contact, and who touches whom."""

from dataclasses import dataclass, replace

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.contact.primitives.complexes import Complex, Surface
from flexfem.contact.surfaces.surfaces import CollisionSurfaces, Sides
from flexfem.model.contact import Contact

__all__ = ["ContactSurface", "contact_surface"]

#: Gap below which surfaces repel, in parts of their radius, and, of those without, of the size of
#: their body.
_REACH, _REACH_OF_SIZE = 0.1, 1e-3
#: Speed, in sizes of the model per time step, at which rigid bodies may meet: their barrier stores
#: the energy of impacts at this speed within a part of its reach.
_FAST = 0.1


@dataclass(frozen=True)
class ContactSurface:
    """Everything that touches in one contact.

    Attributes:
        contact: of the model.
        surface: the cells, without stiffness until it is known.
        first: bodies of the first side, (b,).
        touching: bodies that touch each other, (b, b).
        through: stiffness through the thickness of the body of each point, N/m^3, or infinite.
        density: its mass per area, kg/m^2, or infinite.
        size: of all bodies together, m.
    """

    contact: Contact
    surface: Surface
    first: BoolArray
    touching: BoolArray
    through: FloatArray
    density: FloatArray
    size: float

    def stiffness(self, h: float) -> FloatArray:
        """Stiffness of the barrier at each point (n,), N/m^3.

        It is that through the thickness of flexible bodies. Rigid bodies have that with which they
        store the energy of impacts at a tenth of the model's size in a step of size ``h`` (s).
        """
        if self.contact.stiffness is not None:
            return np.full(len(self.through), self.contact.stiffness)
        speed = _FAST * self.size / h
        heavy = self.density * (speed / self.surface.dhat) ** 2
        found = np.where(np.isfinite(self.through), self.through, heavy)
        return np.where(np.isfinite(found), found, 0.0)

    def stiff(self, kappa: FloatArray) -> Surface:
        """The cells with a stiffness of the barrier at each point (n,), N/m^3."""
        return replace(self.surface, kappa=kappa)


def contact_surface(surfaces: CollisionSurfaces, sides: Sides) -> ContactSurface:
    """Cells of the bodies on both sides of a contact."""
    own, bodies = surfaces.primitives, len(surfaces.bodies)
    first, second = sides.first.members, sides.second.members
    members = first | second
    there = (own.body >= 0) & members[own.body]
    cells = Complex.of(
        own.triangles[members[own.triangle_body]],
        own.edges[: own.lines][members[own.edge_body[: own.lines]]],
        np.flatnonzero(there & own.vertex), np.flatnonzero(there & ~own.vertex & (own.areas > 0.0)),
    )  # fmt: skip
    rigid = np.array([body.rigid for body in surfaces.bodies], dtype=np.bool_)
    cells = cells.flattened(own.start, rigid[own.triangle_body[members[own.triangle_body]]])
    area = np.zeros(len(own.body))
    for side in (sides.first, sides.second):
        area[side.stations] = np.maximum(area[side.stations], side.areas)
    touching = first[:, np.newaxis] & second
    touching |= touching.T
    for pair in (sides.excluded, sides.excluded[:, ::-1]):
        touching[pair[:, 0], pair[:, 1]] = False
    label = np.where(own.body >= 0, own.body, bodies)
    wide = np.zeros((bodies + 1, bodies + 1), dtype=np.bool_)
    wide[:bodies, :bodies] = touching
    dhat = _reach(surfaces, sides.contact)
    surface = Surface(cells, label, own.radius, dhat, np.zeros(len(area)), area)
    points = own.start[cells.vertices]
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    return ContactSurface(
        sides.contact, surface, np.append(first, False), wide, surfaces.through, surfaces.density, size
    )  # fmt: skip


def _reach(surfaces: CollisionSurfaces, contact: Contact) -> FloatArray:
    """Gap (n,) below which each point repels, m."""
    own = surfaces.primitives
    if contact.reach is not None:
        return np.full(len(own.body), contact.reach)
    sizes = np.array([
        np.linalg.norm(np.ptp(own.start[own.body == b], axis=0)) if (own.body == b).any() else 0.0
        for b in range(len(surfaces.bodies))
    ])  # fmt: skip
    of_size = np.append(_REACH_OF_SIZE * sizes, 0.0)[own.body]
    found: FloatArray = np.where(own.radius > 0.0, _REACH * own.radius, of_size)
    return found
