# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells of the bodies of one contact, and who touches whom."""

from dataclasses import dataclass

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.contact.fields.obstacles import Obstacle, Obstacles
from flexfem.contact.fields.search import Stations
from flexfem.contact.primitives.complexes import Complex, Surface
from flexfem.contact.surfaces.surfaces import CollisionSurfaces, Sides
from flexfem.model.contact import Contact

__all__ = ["ContactSurface", "contact_surface"]

#: Gap below which surfaces repel, in parts of their radius, and, of those without, of the size of
#: their body.
_REACH, _REACH_OF_SIZE = 0.1, 1e-3
#: Speed of impacts that barriers are made for where nothing moves or falls: sizes of the largest
#: body that moves per second, and per time step.
_SLOW, _SLOW_STEPS = 0.1, 1e-3


@dataclass(frozen=True)
class ContactSurface:
    """Everything that touches in one contact.

    Attributes:
        contact: of the model.
        surface: the cells, without stiffness until it is known.
        obstacles: that their points touch.
        first: bodies of the first side, (b,).
        touching: bodies that touch each other, (b, b).
        through: stiffness through the thickness of the body of each point, N/m^3, or infinite.
        density: its mass per area, kg/m^2, or infinite.
        size: of the largest body that moves, m.
    """

    contact: Contact
    surface: Surface
    obstacles: Obstacles
    first: BoolArray
    touching: BoolArray
    through: FloatArray
    density: FloatArray
    size: float

    @property
    def reach(self) -> float:
        """Largest gap below which something that moves repels, m."""
        moves = np.isfinite(self.density) & (self.surface.label < len(self.first) - 1)
        return float(self.surface.dhat[moves].max(initial=0.0))

    def speed(self, fastest: float, gravity: float, h: float) -> float:
        """Speed of the impacts that the barrier is made for, m/s.

        Args:
            fastest: largest speed of points at the start, m/s.
            gravity: acceleration, m/s^2.
            h: size of the first step, s; infinite in equilibria.
        """
        slow = max(_SLOW, _SLOW_STEPS / h) * self.size
        return max(fastest, float(np.sqrt(gravity * self.size)), slow)

    def stiffness(self, speed: float) -> FloatArray:
        """Stiffness of the barrier at each point (n,), N/m^3.

        With it the barrier stores the energy of an impact of a ``speed`` (m/s) within its reach;
        that through the thickness of flexible bodies is an upper bound.
        """
        if self.contact.stiffness is not None:
            return np.full(len(self.through), self.contact.stiffness)
        dhat = np.maximum(self.surface.dhat, 1e-100)  # of points that touch nothing
        found = np.minimum(self.through, self.density * (speed / dhat) ** 2)
        return np.where(np.isfinite(found), found, 0.0)

    def stations(self, here: BoolArray) -> Stations:
        """Points that touch obstacles, of those marked in (n,), without stiffness."""
        own, bodies = self.surface, [one.body for one in self.obstacles.every]
        rows = own.complex.vertices
        touching = self.touching[own.label[rows]][:, bodies]
        chosen = here[rows] & (own.area[rows] > 0.0) & touching.any(axis=1)
        rows, touching = rows[chosen], touching[chosen]
        area, none = own.area[rows], np.zeros(len(rows))
        return Stations(rows, own.radius[rows], own.dhat[rows], none, area, touching)


def contact_surface(surfaces: CollisionSurfaces, sides: Sides) -> ContactSurface:
    """Cells of the bodies on both sides of a contact."""
    own, bodies = surfaces.primitives, len(surfaces.bodies)
    first, second = sides.first.members, sides.second.members
    members = first | second
    carried = np.array([body.carried for body in surfaces.bodies], dtype=np.bool_)
    cells = own.complex(members, rods=carried)
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
    sizes = _sizes(surfaces)
    dhat = _reach(surfaces, sides.contact, sizes)
    edge = _usual_edges(surfaces, cells)
    surface = Surface(cells, label, own.radius, dhat, np.zeros(len(area)), area, edge)
    moving = np.flatnonzero(np.isfinite([body.density for body in surfaces.bodies]) & members)
    size = max((float(sizes[b] + 2.0 * own.radius[own.body == b].max()) for b in moving),
               default=1.0)  # fmt: skip
    obstacles = Obstacles([Obstacle.of(field) for field in sides.fields])
    return ContactSurface(
        sides.contact, surface, obstacles, np.append(first, False), wide, surfaces.through,
        surfaces.density, size,
    )  # fmt: skip


def _sizes(surfaces: CollisionSurfaces) -> FloatArray:
    """Diagonal (b,) of the box around the points of each body, m."""
    own = surfaces.primitives
    points = [own.start[own.body == b] for b in range(len(surfaces.bodies))]
    return np.array([float(np.linalg.norm(np.ptp(p, axis=0))) if len(p) else 0.0 for p in points])


def _usual_edges(surfaces: CollisionSurfaces, cells: Complex) -> FloatArray:
    """Median length (b + 1,) of the edges of each body at the start, infinite without any, m."""
    own, ends = surfaces.primitives, cells.vertices[cells.edges]
    lengths = np.linalg.norm(own.start[ends[:, 1]] - own.start[ends[:, 0]], axis=1)
    found, body = np.full(len(surfaces.bodies) + 1, np.inf), own.body[ends[:, 0]]
    for b in np.unique(body).tolist():
        found[b] = np.median(lengths[body == b])
    return found


def _reach(surfaces: CollisionSurfaces, contact: Contact, sizes: FloatArray) -> FloatArray:
    """Gap (n,) below which each point repels, m."""
    own = surfaces.primitives
    if contact.reach is not None:
        return np.full(len(own.body), contact.reach)
    of_size = np.append(_REACH_OF_SIZE * sizes, 0.0)[own.body]
    found: FloatArray = np.where(own.radius > 0.0, _REACH * own.radius, of_size)
    # of what is fixed, such as a plane, not more than that of the others
    moves = np.append(np.isfinite([body.density for body in surfaces.bodies]), False)[own.body]
    return np.minimum(found, found[moves].max(initial=0.0)) if moves.any() else found
