# SPDX-License-Identifier: LGPL-3.0-or-later
"""Collision surfaces of a model and who touches whom, the same on every rank."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.detection.neighbours import Rows
from flexfem.contact.surfaces.bodies import ContactBodies, connections, contact_bodies
from flexfem.contact.surfaces.collected import Collected, CollisionBody
from flexfem.contact.surfaces.flexible import add_beam, add_surfaces
from flexfem.contact.surfaces.near import joint_links, near_points
from flexfem.contact.surfaces.primitives import Primitives, Side, edges_of
from flexfem.contact.surfaces.rigid import DistanceField, add_rigid_body, add_surface
from flexfem.layout.numbered_model import NumberedModel
from flexfem.model.bodies.basic import Beam
from flexfem.model.contact import Contact
from flexfem.model.rigid_surface import (
    RigidCylinder,
    RigidObstacle,
    RigidSphere,
    RigidSurface,
)

__all__ = ["CollisionSurfaces", "Sides", "collision_surfaces"]

#: Sag of a chord over a curved obstacle, relative to the radius of the beam, for its stations.
_SAG = 0.1


@dataclass(frozen=True)
class Sides:
    """Both sides of one contact.

    A station of one side touches the cells of the other; where both are the same, bodies touch
    themselves as well.

    Attributes:
        contact: of the model.
        first, second: ``bodies``, and ``against`` and the rigid surfaces.
        fields: surfaces that the stations of the first side touch by their signed distance.
        excluded: (p, 2) pairs of bodies that do not touch, the lower number first, ascending.
    """

    contact: Contact
    first: Side
    second: Side
    fields: list[DistanceField]
    excluded: IntArray

    def touch(self, first: int, second: int) -> bool:
        """Return True unless two bodies are excluded."""
        pair = sorted((first, second))
        return not bool((self.excluded == pair).all(axis=1).any())


@dataclass(frozen=True)
class CollisionSurfaces:
    """Points and primitives of everything that touches.

    Points are fixed to nodes, or to the ground; those after them are means of fixed points: of the
    control points of curves, and of the ends of elements.

    Attributes:
        kind: kind of block of the node of each fixed point, ``GROUND`` for none, (n,).
        node: number of the node in its family, (n,).
        arms: positions in the axes of the nodes, m, (n, 3); on the ground zero.
        held: fixed unknowns of the nodes, (n, 6).
        parents, weights: fixed points that each of the others is a mean of, and their weights,
            (d, q); those of fewer repeat the last one with the weight zero.
        primitives: all n + d points with their radii, edges and triangles at the start.
        element: element of each triangle in its family, -1 for rigid ones, (m,).
        side: 1 for triangles that touch on the side of their normals only, else 0, (m,).
        bodies: all bodies; :attr:`Primitives.body` and others are numbers in it.
        contacts: both sides of each contact, in the order of the model.
        near: points near each point along its body: primitives that contain a point and one near
            it do not touch.
    """

    kind: IntArray
    node: IntArray
    arms: FloatArray
    held: BoolArray
    parents: IntArray
    weights: FloatArray
    primitives: Primitives
    element: IntArray
    side: IntArray
    bodies: list[CollisionBody]
    contacts: list[Sides]
    near: Rows

    @property
    def carried(self) -> int:
        """Number of points fixed to nodes, the first ones."""
        return len(self.kind)

    @property
    def start(self) -> FloatArray:
        """Positions of all points at the start, m, (n + d, 3)."""
        return self.primitives.start

    @cached_property
    def links(self) -> IntArray:
        """Pairs (l, 2) of points of different bodies that joints connect, in both orders."""
        first = np.repeat(np.arange(len(self.start)), np.diff(self.near.starts))
        second, body = self.near.values, self.primitives.body
        across = body[first] != body[second]
        return np.column_stack([first[across], second[across]])

    @cached_property
    def density(self) -> FloatArray:
        """Mass per area of the body of each point, kg/m^2, infinite where nothing gives it."""
        return self._of_points([body.density for body in self.bodies])

    @cached_property
    def through(self) -> FloatArray:
        """Stiffness through the thickness of the body of each point, N/m^3, or infinite."""
        return self._of_points([body.through for body in self.bodies])

    def _of_points(self, values: Sequence[float]) -> FloatArray:
        """Values of bodies at their points."""
        found: FloatArray = np.append(values, np.inf)[self.primitives.body]
        return found


def collision_surfaces(
    serial: NumberedModel, contacts: Sequence[Contact] | None = None
) -> CollisionSurfaces:
    """Describe everything that touches in a model.

    Args:
        serial: serial data of a validated model.
        contacts: some of its contacts; None for all.

    Raises:
        ValueError: nothing is left that touches, a body without thickness, or a shape whose
            triangles make no mesh, in one line.
    """
    contacts = serial.model.contacts if contacts is None else contacts
    connected = connections(serial)
    who = [contact_bodies(serial, contact, connected) for contact in contacts]
    builder = _Builder(serial, who)
    made = builder.made
    kind, node, arms, held, start, parents, weights = made.all_carried()
    primitives = made.primitives(start)
    _, _, element, side = made.all_triangles()
    sides = [builder.sides(one, primitives) for one in who]
    links = joint_links(primitives, made.bodies, connected)
    return CollisionSurfaces(
        kind, node, arms, held, parents, weights, primitives, element, side, made.bodies, sides,
        near_points(primitives, made.bodies, links),
    )  # fmt: skip


class _Builder:
    """Adds all bodies and surfaces of some contacts, each once."""

    def __init__(self, serial: NumberedModel, contacts: Sequence[ContactBodies]) -> None:
        self.made = Collected()
        self._serial = serial
        self._fields: dict[int, DistanceField] = {}
        self._surfaces: dict[int, int] = {}
        self._numbers: dict[str, int] = {}
        self._beams: dict[tuple[str, float], int] = {}
        names = {name for one in contacts for name in (*one.bodies, *one.against)}
        for family in serial.families.values():
            self._numbers |= add_surfaces(self.made, family, names)
        for body in serial.model.rigid_bodies:
            if body.name in names:
                self._numbers[body.name] = add_rigid_body(self.made, serial, body.name)
        for one in contacts:
            for k, surface in enumerate(one.contact.surfaces):
                if id(surface) not in self._surfaces:
                    label = f'{type(surface).__name__} {k} of Contact "{one.contact.name}"'
                    number, field = add_surface(self.made, serial, surface, label)
                    self._surfaces[id(surface)] = number
                    if field is not None:
                        self._fields[id(surface)] = field
        every = [surface for one in contacts for surface in one.contact.surfaces]
        self._curvature = min(map(_curved, every), default=np.inf)
        spacing = self._edge()
        for one in contacts:
            for name in dict.fromkeys((*one.bodies, *one.against)):
                self._add_beam(one.contact, name, spacing)

    def _edge(self) -> float:
        """Median edge of all triangles, infinite without any."""
        triangles = self.made.all_triangles()[0]
        if not len(triangles):
            return np.inf
        edges = edges_of(triangles)[0]
        ends = self.made.all_carried()[4][edges]
        return float(np.median(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)))

    def _add_beam(self, contact: Contact, name: str, edge: float) -> None:
        """Add a beam with its radius in a contact, unless it is there."""
        body = self._serial.model[name]
        if not isinstance(body, Beam):
            return
        radius = contact.beam_radius(body)
        sag = np.sqrt(8.0 * _SAG * radius * self._curvature)
        if (name, radius) not in self._beams:
            family = self._serial.family_of(name)
            self._beams[name, radius] = add_beam(
                self.made, family, body, name, radius, min(edge, sag)
            )

    def _number(self, contact: Contact, name: str) -> int:
        """Number of a body in a contact."""
        body = self._serial.model[name]
        if isinstance(body, Beam):
            return self._beams[name, contact.beam_radius(body)]
        return self._numbers[name]

    def sides(self, who: ContactBodies, primitives: Primitives) -> Sides:
        """Both sides of a contact.

        Raises:
            ValueError: nothing is left that touches.
        """
        contact = who.contact
        of = {
            name: self._number(contact, name) for name in dict.fromkeys((*who.bodies, *who.against))
        }
        surfaces = [self._surfaces[id(surface)] for surface in contact.surfaces]
        numbers = [of[name] for name in who.bodies], [of[name] for name in who.against] + surfaces
        pairs = sorted(set(self._excluded(who, of, surfaces)))
        excluded = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        self._check_left(contact, numbers, excluded)
        every = np.arange(len(self.made.bodies))
        one, other = (np.isin(every, chosen) for chosen in numbers)
        first = Side.of(primitives, one)
        second = first if np.array_equal(one, other) else Side.of(primitives, other)
        fields = [self._fields[id(s)] for s in contact.surfaces if id(s) in self._fields]
        return Sides(contact, first, second, fields, excluded)

    def _excluded(
        self, who: ContactBodies, of: dict[str, int], surfaces: list[int]
    ) -> Iterator[tuple[int, int]]:
        """Pairs of numbers of bodies that do not touch, the lower one first."""
        by_owner = dict[str, list[int]]()
        for number in (*of.values(), *surfaces):
            by_owner.setdefault(self.made.bodies[number].owner, []).append(number)
        for pair in who.excluded:
            first, *rest = sorted(pair)
            second = rest[0] if rest else first
            for a in by_owner.get(first, ()):
                for b in by_owner.get(second, ()):
                    yield min(a, b), max(a, b)
        # a surface touches neither its carrier nor others on it
        for number in surfaces:
            for other in by_owner[self.made.bodies[number].owner]:
                yield min(number, other), max(number, other)

    def _check_left(
        self, contact: Contact, numbers: tuple[list[int], list[int]], excluded: IntArray
    ) -> None:
        """Raise if every pair of bodies is excluded."""
        first, second = map(np.array, numbers)
        out = {(a, b) for a, b in excluded.tolist()}
        if len(first) * len(second) <= len(out) + len(first) and all(
            (min(a, b), max(a, b)) in out for a in first.tolist() for b in second.tolist()
        ):
            raise ValueError(
                f'Contact "{contact.name}": nothing is left that touches: every pair of bodies is '
                "excluded"
            )


def _curved(surface: RigidSurface) -> float:
    """Radius of a surface; infinite for planes and what is made of vertices and triangles."""
    if isinstance(surface, RigidCylinder) or (
        isinstance(surface, RigidSphere) and surface.inside
    ):  # fmt: skip
        return surface.radius
    if isinstance(surface, RigidObstacle):
        return 0.5 * float(np.ptp(surface.box, axis=0).min())
    return np.inf
