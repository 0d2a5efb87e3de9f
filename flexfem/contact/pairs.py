# SPDX-License-Identifier: LGPL-3.0-or-later
"""Serial data of all contacts: pairs of slave and master surfaces, the same on every rank."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.detection.neighbours import Rows, rings
from flexfem.contact.law.data import DISTANCE, Masters, Slaves
from flexfem.contact.law.stiffening import STIFFER
from flexfem.contact.obstacles.overlaps import contact_at_start
from flexfem.contact.obstacles.rigid_surface import Shape
from flexfem.contact.obstacles.shapes import ShapeKind
from flexfem.contact.obstacles.surface_data import automatic_stiffness, mean_edge, node_areas
from flexfem.contact.points import RINGS, ContactPoints
from flexfem.core.marker import Ground
from flexfem.layout.node_key import NodeKey
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.model.bodies.basic import Beam
from flexfem.model.contact import Contact
from flexfem.model.rigid_surface import (
    RigidCylinder,
    RigidMesh,
    RigidPlane,
    RigidSphere,
    RigidSurface,
)

__all__ = ["ContactPass", "ContactSurfaces", "RigidPlace", "contact_surfaces"]

#: Skin in mean lengths of edges.
_SKIN = 0.4
#: Part of their distance at the start at which bodies that a joint connects touch at the latest.
_NEARER = 0.5


@dataclass(frozen=True)
class ContactPass:
    """Nodes of some shells against triangles of some shells.

    Attributes:
        slaves: with the stiffness zero; areas: (s,) of their shells' triangles, m^2, times the part
            of the stiffness that this pass has.
        masters: all triangles; chosen: numbers of those of the masters, ascending.
        excluded: nodes whose triangles each slave does not touch.
        sign: sign of the forces on its slaves among those on the slaves of the contact.
        deep: admissible penetration at the start, relative to the contact distance.
    """

    slaves: Slaves
    areas: FloatArray
    masters: Masters
    chosen: IntArray
    excluded: Rows
    sign: float
    deep: float

    def restricted(self, own: BoolArray) -> "ContactPass":
        """The pass with the slaves that are marked in (n,) only."""
        kept, old = np.flatnonzero(own[self.slaves.nodes]), self.excluded
        slaves = self.slaves.restricted(own[self.slaves.nodes])
        lengths = np.diff(old.starts)[kept]
        starts = np.concatenate([[0], np.cumsum(lengths)])
        at = np.repeat(old.starts[kept] - starts[:-1], lengths) + np.arange(starts[-1])
        rows = Rows(starts=starts.astype(np.int64), values=old.values[at])
        return ContactPass(
            slaves, self.areas[kept], self.masters, self.chosen, rows, self.sign, self.deep
        )


@dataclass(frozen=True)
class RigidPlace:
    """A rigid surface of a simple shape.

    Attributes:
        shape: its shape.
        carrier: node that carries it, None for the ground.
        frame: relative to that node, absolute on the ground, (12,); start: at the start, (12,).
    """

    shape: Shape
    carrier: NodeKey | None
    frame: FloatArray
    start: FloatArray


@dataclass(frozen=True)
class ContactSurfaces:
    """All surfaces of one contact.

    Attributes:
        contact: the contact of the model.
        passes: nodes against triangles.
        slaves, areas: nodes against rigid surfaces of simple shapes, see ``ContactPass``.
        rigid: these surfaces.
        skin: search distance, m.
    """

    contact: Contact
    passes: list[ContactPass]
    slaves: Slaves
    areas: FloatArray
    rigid: list[RigidPlace]
    skin: float
    _numbers: tuple[float, float] | None

    @property
    def longest_step(self) -> float:
        """Largest motion of nodes (m) with the same neighbour lists for which none passes through.

        It is the lesser of half of the skin and half of the radius of a rigid surface.
        """
        limits = [0.5 * place.shape.radius for place in self.rigid if place.shape.radius > 0.0]
        if self.passes:
            limits.append(0.5 * self.skin)
        return min(limits, default=inf)

    def stiffness(self, inertia: float) -> float:
        """Force per penetration and area, N/m^3.

        ``inertia`` is the factor of the mass in the iteration matrix, 1/s^2, 0 at rest.
        """
        if self._numbers is None:
            assert self.contact.stiffness is not None
            return self.contact.stiffness
        through, density = self._numbers
        return automatic_stiffness(through, density, inertia)

    def stiffer(self, stiffness: float) -> float:
        """Return the largest stiffening factor, limited by the stiffness through the thickness."""
        if self._numbers is None or stiffness == 0.0:
            return 1.0
        return min(max(self._numbers[0] / stiffness, 1.0), STIFFER)


def contact_surfaces(
    serial: NumberedModel, points: ContactPoints, contacts: Sequence[Contact]
) -> list[ContactSurfaces]:
    """Describe all contacts of a model, in which all bodies are named."""
    return [_describe(serial, points, contact) for contact in contacts]


def _describe(serial: NumberedModel, points: ContactPoints, contact: Contact) -> ContactSurfaces:
    """Surfaces of one contact."""
    slaves, areas = _slaves(serial, points, contact)
    rigid = [
        _rigid_place(serial, one) for one in contact.surfaces if not isinstance(one, RigidMesh)
    ]
    slave_names, master_names = contact.bodies or (), contact.against or ()
    names = list(dict.fromkeys([*slave_names, *master_names]))
    keys: list[str | int] = [*names, *(id(surface) for surface in contact.surfaces)]
    used = _triangles(points, keys)
    skin = contact.skin
    if skin is None:
        triangles = points.masters.triangles[used]
        skin = _SKIN * mean_edge(points.start, triangles) if len(used) else 0.0
    return ContactSurfaces(
        contact, list(_passes(points, contact, (slaves, areas))), slaves, areas, rigid, skin,
        _numbers(serial, contact, names) if contact.stiffness is None else None,
    )  # fmt: skip


def _passes(
    points: ContactPoints, contact: Contact, everything: tuple[Slaves, FloatArray]
) -> Iterator[ContactPass]:
    """Passes of one contact: its slaves against triangles, then with exchanged roles."""
    slave_names, master_names = contact.bodies or (), contact.against or ()
    first, second = (_triangles(points, names) for names in (slave_names, master_names))
    meshes = _triangles(points, [id(surface) for surface in contact.surfaces])
    itself = np.array_equal(first, second)
    shells, beams = _surface_slaves(points, first), _beam_slaves(points, everything)
    for master, deep, both in (
        (second, 0.5, itself or contact.two_pass), (meshes, 1.0, contact.two_pass)
    ):  # fmt: skip
        if not len(master):
            continue
        share = 0.5 if both else 1.0
        if len(first):
            yield _pass(points, shells, share, master, 1.0, deep)
        if both and len(first) and not (itself and master is second):
            yield _pass(points, _surface_slaves(points, master), share, first, -1.0, deep)
        if len(beams[0].nodes):
            yield _pass(points, beams, 1.0, master, 1.0, deep)


def _pass(
    points: ContactPoints, slaves: tuple[Slaves, FloatArray], share: float, master: IntArray,
    sign: float, deep: float,
) -> ContactPass:  # fmt: skip
    """One pass, with its own stiffness of the slaves."""
    one, areas = slaves
    excluded = rings(points.masters.triangles, one.nodes, RINGS, points.joined)
    offsets = _offsets_at_folds(points, one, master, excluded)
    own = _without_stiffness(one.nodes, offsets)
    return ContactPass(own, share * areas, points.masters, master, excluded, sign, deep)


def _offsets_at_folds(
    points: ContactPoints, slaves: Slaves, master: IntArray, excluded: Rows
) -> FloatArray:
    """Contact distances (s,) with which bodies that a joint connects are apart at the start.

    Panels that are folded at a hinge are nearer beside it than their thickness, at as many nodes as
    the mesh has there. Half of the distance at the start counts if that is less.
    """
    bodies = points.owner[points.joined]
    if not len(bodies):
        return slaves.offsets
    thickness = points.masters.thickness
    wide = (slaves.offsets + thickness[master].max(initial=0.0)) / _NEARER
    made = contact_at_start(
        points.start, _without_stiffness(slaves.nodes, wide), points.masters, master, excluded
    )
    at, triangles = made.ends.T
    pairs = np.column_stack([points.owner[slaves.nodes[at]], points.body[triangles]])
    joined, found = (np.sort(one, axis=1) @ [len(points.names), 1] for one in (bodies, pairs))
    held = np.isin(found, joined)
    distances, offsets = made.contacts[held, DISTANCE], slaves.offsets.copy()
    np.minimum.at(offsets, at[held], _NEARER * distances - thickness[triangles[held]])
    return offsets


def _without_stiffness(nodes: IntArray, offsets: FloatArray) -> Slaves:
    """Slaves whose stiffness is to be set later."""
    return Slaves(nodes=nodes, offsets=offsets, stiffness=np.zeros(len(nodes)))


def _triangles(points: ContactPoints, keys: Sequence[str | int]) -> IntArray:
    """Triangles of some shells and rigid meshes, ascending."""
    found = [points.triangles_of[key] for key in keys if key in points.triangles_of]
    return np.unique(np.concatenate([np.zeros(0, np.int64), *found]))


def _surface_slaves(points: ContactPoints, chosen: IntArray) -> tuple[Slaves, FloatArray]:
    """Nodes of some triangles, with half of the thickness as contact distance, and their areas."""
    masters = points.masters
    triangles = masters.triangles[chosen]
    offsets = np.zeros(len(points.start))
    np.maximum.at(offsets, triangles.ravel(), np.repeat(masters.thickness[chosen], 3))
    nodes = np.unique(triangles)
    areas = node_areas(points.start, triangles)[nodes]
    return _without_stiffness(nodes, offsets[nodes]), areas


def _slaves(
    serial: NumberedModel, points: ContactPoints, contact: Contact
) -> tuple[Slaves, FloatArray]:
    """All slaves of a contact: nodes of shells, then points of beams with length times diameter."""
    made, areas = _surface_slaves(points, _triangles(points, contact.bodies or ()))
    nodes, offsets, every = [made.nodes], [made.offsets], [areas]
    for name in contact.bodies or ():
        body = serial.model[name]
        if isinstance(body, Beam):
            radius = contact.beam_radius(body)
            nodes.append(points.points_of[name])
            offsets.append(np.full(len(nodes[-1]), radius))
            every.append(2.0 * radius * points.lengths[name])
    rows = np.concatenate(nodes)
    return _without_stiffness(rows, np.concatenate(offsets)), np.concatenate(every)


def _beam_slaves(
    points: ContactPoints, everything: tuple[Slaves, FloatArray]
) -> tuple[Slaves, FloatArray]:
    """Points of beams among the slaves."""
    slaves, areas = everything
    of_beams = np.concatenate([np.zeros(0, np.int64), *points.points_of.values()])
    kept = np.isin(slaves.nodes, of_beams)
    return slaves.restricted(kept), areas[kept]


def _numbers(serial: NumberedModel, contact: Contact, names: Sequence[str]) -> tuple[float, float]:
    """Least stiffness through the thickness, N/m^3, and mass per area, kg/m^2, of bodies."""
    through, mass = [], []
    for name in names:
        family = serial.family_of(name)
        both = family.contact_numbers(serial.model[name], contact)
        through.append(both[0])
        mass.append(both[1])
    return min(through), min(mass)


def _rigid_place(serial: NumberedModel, surface: RigidSurface) -> RigidPlace:
    """Place of a rigid surface of a simple shape."""
    frame = serial.marker_frame(surface.place)
    if isinstance(surface.place, Ground):
        return RigidPlace(_shape(surface), None, frame, frame)
    carrier = serial.carrier_frame(surface.place)
    start = se3.compose(carrier, frame)
    return RigidPlace(_shape(surface), serial.key(surface.place), frame, start)


def _shape(surface: RigidSurface) -> Shape:
    """Shape of a rigid surface of the model."""
    match surface:
        case RigidPlane():
            return Shape(ShapeKind.PLANE)
        case RigidSphere(radius=radius, inside=inside):
            return Shape(ShapeKind.HOLLOW_SPHERE if inside else ShapeKind.SPHERE, radius)
        case RigidCylinder(radius=radius, length=length, inside=inside):
            return Shape(ShapeKind.TUBE if inside else ShapeKind.CYLINDER, radius, length)
    raise TypeError(f"unknown rigid surface {surface!r}")
