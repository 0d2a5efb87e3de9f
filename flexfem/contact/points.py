# SPDX-License-Identifier: LGPL-3.0-or-later
"""Serial data of the points and triangles of all contacts, the same on every rank.

Points are fixed to nodes: those of shells and beams, and the corners of rigid meshes, fixed to a
rigid body or the ground. Further points are between two of them, along beams.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.law.data import Masters
from flexfem.contact.obstacles.surface_data import mean_edge, rim_bits
from flexfem.contact.surfaces.collected import GROUND
from flexfem.core.marker import Ground
from flexfem.layout.family import ContactSurface, Family
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.mesh.triangles.topology import connected_parts, match_sides, surface_topology
from flexfem.model.contact import Contact
from flexfem.model.rigid_surface import RigidMesh

__all__ = ["GROUND", "RINGS", "ContactPoints", "contact_points"]

#: Number of edges up to which points and edges near a triangle are excluded from its contacts.
RINGS = 2
#: Largest number of parts of a beam element.
_MOST_PARTS = 10


@dataclass(frozen=True)
class ContactPoints:
    """Points and triangles of all contact surfaces.

    Attributes:
        kind: kind of block of each carrier, GROUND for none, (n,).
        node: number of each carrier in its block, (n,).
        arms: positions in the axes of the carriers, m, (n, 3).
        held: fixed unknowns of the carriers, (n, 6).
        start: positions at the start of all points, those between others last, m, (n + d, 3).
        parents: nodes at both ends of the last ones, (d, 2); weights: their weights, (d, 2).
        masters: all triangles.
        edges: of the triangles, (e, 2).
        joined: pairs of points that joints connect, near which there is no contact, (k, 2).
        element: number of the element of each triangle in its family, -1 for rigid meshes, (m,).
        body: number of each triangle's body in ``names``, (m,); owner: that of each point, (n + d,)
        names: names of the bodies in messages.
        triangles_of: triangles of shells by name and of rigid meshes by their ``id``.
        points_of: points of beams by name; lengths: of beam that each of them represents, m.
    """

    kind: IntArray
    node: IntArray
    arms: FloatArray
    held: BoolArray
    start: FloatArray
    parents: IntArray
    weights: FloatArray
    masters: Masters
    edges: IntArray
    joined: IntArray
    element: IntArray
    body: IntArray
    owner: IntArray
    names: list[str]
    triangles_of: dict[str | int, IntArray]
    points_of: dict[str, IntArray]
    lengths: dict[str, FloatArray]

    @property
    def carried(self) -> int:
        """Number of points fixed to nodes, the first ones."""
        return len(self.kind)


@dataclass
class _Collected:
    """Points and triangles as they are added."""

    kind: list[IntArray] = field(default_factory=list)
    node: list[IntArray] = field(default_factory=list)
    arms: list[FloatArray] = field(default_factory=list)
    held: list[BoolArray] = field(default_factory=list)
    start: list[FloatArray] = field(default_factory=list)
    owner: list[IntArray] = field(default_factory=list)
    triangles: list[IntArray] = field(default_factory=list)
    thickness: list[FloatArray] = field(default_factory=list)
    sides: list[IntArray] = field(default_factory=list)
    element: list[IntArray] = field(default_factory=list)
    body: list[IntArray] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    count: int = 0
    faces: int = 0

    def add_points(
        self, kind: int, node: IntArray, start: FloatArray, owner: IntArray,
        arms: FloatArray | None = None, held: BoolArray | None = None,
    ) -> IntArray:  # fmt: skip
        """Add points; returns their numbers."""
        count, first = len(node), self.count
        mask = np.zeros((count, 6), dtype=np.bool_)
        if held is not None:
            mask[:, : held.shape[1]] = held
        self.kind.append(np.full(count, kind))
        self.node.append(np.asarray(node, dtype=np.int64))
        self.arms.append(np.zeros((count, 3)) if arms is None else arms)
        self.held.append(mask)
        self.start.append(start)
        self.owner.append(np.asarray(owner, dtype=np.int64))
        self.count += count
        return np.arange(first, self.count)

    def add_triangles(
        self, triangles: IntArray, thickness: FloatArray, body: IntArray, side: int = 0,
        element: IntArray | None = None,
    ) -> IntArray:  # fmt: skip
        """Add triangles between numbered points; returns their numbers."""
        first = self.faces
        self.triangles.append(triangles)
        self.thickness.append(thickness)
        self.sides.append(np.full(len(triangles), side))
        self.element.append(np.full(len(triangles), -1) if element is None else element)
        self.body.append(np.asarray(body, dtype=np.int64))
        self.faces += len(triangles)
        return np.arange(first, self.faces)


def contact_points(
    serial: NumberedModel, contacts: Sequence[Contact], joined: IntArray
) -> ContactPoints:
    """Collect the points and triangles of the contacts of a model.

    Args:
        serial: serial data of the model.
        contacts: contacts of the model.
        joined: pairs of nodes of shells that joints connect, (k, 2).
    """
    made, triangles_of = _Collected(), dict[str | int, IntArray]()
    for kind, family in serial.families.items():
        touching = family.contact_surface()
        if touching is not None:
            _add_surface(made, kind, touching, triangles_of)
    for contact in contacts:
        for k, surface in enumerate(contact.surfaces):
            if isinstance(surface, RigidMesh) and id(surface) not in triangles_of:
                name = f'RigidMesh {k} of Contact "{contact.name}"'
                triangles_of[id(surface)] = _add_mesh(made, serial, surface, name)
    points_of, lengths = dict[str, IntArray](), dict[str, FloatArray]()
    parents, weights, between = [np.zeros((0, 2), np.int64)], [np.zeros((0, 2))], []
    names = dict.fromkeys(name for contact in contacts for name in contact.bodies or ())
    chains = {}
    for name in names:
        family = serial.family_of(name)
        if (cells := family.contact_chain(name)) is not None:
            chains[name] = _add_chain(made, family, serial.model[name], cells)
    start = np.concatenate([np.zeros((0, 3)), *made.start])
    count = made.count
    for name, (cells, own, owner) in chains.items():
        parts = _parts(start, cells, name, contacts, made, triangles_of)
        rows, lengths[name] = _divide(start, cells, own, parts)
        parents.append(np.repeat(cells, parts - 1, axis=0))
        inner = np.tile(np.arange(1, parts) / parts, len(cells))
        weights.append(np.column_stack([1.0 - inner, inner]))
        points_of[name] = np.concatenate([own, count + np.arange(rows)])
        between.append(np.full(rows, owner))
        count += rows
    pairs, shares = np.concatenate(parents), np.concatenate(weights)
    inside = np.einsum("dp,dpa->da", shares, start[pairs])
    return _finished(
        made, np.concatenate([start, inside]), (pairs, shares), joined,
        np.concatenate([np.zeros(0, np.int64), *made.owner, *between]),
        triangles_of, points_of, lengths,
    )  # fmt: skip


def _finished(
    made: _Collected, start: FloatArray, means: tuple[IntArray, FloatArray], joined: IntArray,
    owner: IntArray, triangles_of: dict[str | int, IntArray], points_of: dict[str, IntArray],
    lengths: dict[str, FloatArray],
) -> ContactPoints:  # fmt: skip
    """All points and triangles, with neighbours and boundaries of the triangles."""
    triangles = np.concatenate([np.zeros((0, 3), np.int64), *made.triangles])
    body, element = (np.concatenate([np.zeros(0, np.int64), *k]) for k in (made.body, made.element))
    topology = surface_topology(triangles, match_sides(triangles, body, max(made.count, 1)))
    masters = Masters(
        triangles=triangles,
        thickness=np.concatenate([np.zeros(0), *made.thickness]),
        rims=rim_bits(triangles, topology.neighbours, len(start)),
        parts=connected_parts(topology.neighbours),
        sides=np.concatenate([np.zeros(0, np.int64), *made.sides]),
    )
    kind, node = (np.concatenate([np.zeros(0, np.int64), *k]) for k in (made.kind, made.node))
    return ContactPoints(
        kind, node, np.concatenate([np.zeros((0, 3)), *made.arms]),
        np.concatenate([np.zeros((0, 6), np.bool_), *made.held]), start, *means, masters,
        topology.edges, joined, element, body, owner, made.names, triangles_of, points_of, lengths,
    )  # fmt: skip


def _add_surface(
    made: _Collected, kind: int, surface: ContactSurface, triangles_of: dict[str | int, IntArray]
) -> None:
    """Nodes and triangles of all bodies of a family."""
    first = len(made.names)
    made.names += [f'{type(body).__name__} "{body.name}"' for body in surface.bodies]
    nodes, start = surface.nodes, surface.start
    rows = made.add_points(kind, nodes, start, first + surface.owner, held=surface.held)
    number = np.full(nodes.max(initial=-1) + 1, -1)
    number[nodes] = rows
    found = made.add_triangles(
        number[surface.triangles], surface.radius, first + surface.body, element=surface.element
    )
    for k, body in enumerate(surface.bodies):
        triangles_of[body.name] = found[surface.body == k]


def _add_mesh(made: _Collected, serial: NumberedModel, surface: RigidMesh, name: str) -> IntArray:
    """Corners and triangles of a rigid mesh; returns the numbers of the latter."""
    mesh, offset = surface.mesh, serial.marker_frame(surface.place)
    arms = se3.position(offset) + mesh.points @ se3.rotation(offset).T
    number = len(made.names)
    made.names.append(name)
    count = len(arms)
    owner = np.full(count, number)
    if isinstance(surface.place, Ground):
        rows = made.add_points(GROUND, np.arange(count), arms, owner)
    else:
        key, frame = serial.key(surface.place), serial.carrier_frame(surface.place)
        assert key is not None
        start = se3.position(frame) + arms @ se3.rotation(frame).T
        rows = made.add_points(key[0], np.full(count, key[1]), start, owner, arms)
    side = 0 if surface.two_sided else 1
    m = len(mesh.triangles)
    return made.add_triangles(rows[mesh.triangles], np.zeros(m), np.full(m, number), side)


def _add_chain(
    made: _Collected, family: Family, body: Any, cells: IntArray
) -> tuple[IntArray, IntArray, int]:
    """Nodes of a body of lines; returns its elements between points, the points and its number."""
    number = len(made.names)
    made.names.append(f'{type(body).__name__} "{body.name}"')
    nodes, at = np.unique(cells, return_inverse=True)
    start = family.frames[nodes, :3]
    rows = made.add_points(family.kind, nodes, start, np.full(len(nodes), number))
    return rows[at.reshape(-1, 2)], rows, number


def _parts(
    start: FloatArray, cells: IntArray, name: str, contacts: Sequence[Contact], made: _Collected,
    triangles_of: dict[str | int, IntArray],
) -> int:  # fmt: skip
    """Parts of each element of a beam: about as long as the edges of the masters."""
    lengths = np.linalg.norm(start[cells[:, 1]] - start[cells[:, 0]], axis=1)
    wanted, triangles = 1, np.concatenate([np.zeros((0, 3), np.int64), *made.triangles])
    for contact in contacts:
        if name not in (contact.bodies or ()):
            continue
        keys = [*(contact.against or ()), *map(id, contact.surfaces)]
        for key in keys:
            if key in triangles_of:
                edge = mean_edge(start, triangles[triangles_of[key]])
                wanted = max(wanted, int(np.ceil(float(lengths.mean()) / edge)))
    return min(wanted, _MOST_PARTS)


def _divide(
    start: FloatArray, cells: IntArray, own: IntArray, parts: int
) -> tuple[int, FloatArray]:
    """Number of points inside elements, and the length that each point represents."""
    lengths = np.linalg.norm(start[cells[:, 1]] - start[cells[:, 0]], axis=1) / parts
    at = np.searchsorted(own, cells)
    ends = np.bincount(at.ravel(), np.repeat(0.5 * lengths, 2), len(own))
    return (parts - 1) * len(cells), np.concatenate([ends, np.repeat(lengths, parts - 1)])
