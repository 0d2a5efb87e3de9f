# SPDX-License-Identifier: LGPL-3.0-or-later
"""Serial data of the contacts of a model: what touches what, the same on every rank."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.candidates import Rows, rings
from flexfem.contact.describe import automatic_stiffness, mean_edge, node_areas, rim_bits
from flexfem.contact.rigid import ShapeKind
from flexfem.contact.start import deepest_start, first_crossing
from flexfem.contact.surfaces import RigidContact, Shape
from flexfem.contact.triangles import Masters, Slaves, TriangleContact
from flexfem.lie import se3
from flexfem.mesh.surface_topology import connected_parts
from flexfem.model.contact import Contact, RigidCylinder, RigidPlane, RigidSphere, RigidSurface
from flexfem.system.shell_surface import ShellSurface

__all__ = ["ContactPass", "ContactSurfaces", "contact_surfaces"]

#: Nodes up to this many edges away do not touch a triangle's nodes.
_RINGS = 2
#: Skin in mean lengths of edges.
_SKIN = 0.4
#: Part of the sum of half thicknesses up to which shells may penetrate at the start.
_DEEP = 0.5


@dataclass(frozen=True)
class ContactPass:
    """Nodes of some shells against triangles of some shells.

    Attributes:
        slaves: with the stiffness zero; areas: (s,) of their shells' triangles, m^2, times the part
            of the stiffness that this pass has.
        masters: all triangles; chosen: numbers of those of the masters, ascending.
        excluded: nodes whose triangles each slave does not touch.
        sign: of the forces on its slaves in those on the slaves of the contact.
    """

    slaves: Slaves
    areas: FloatArray
    masters: Masters
    chosen: IntArray
    excluded: Rows
    sign: float

    def restricted(self, own: BoolArray) -> "ContactPass":
        """With those slaves only that are marked in (n,)."""
        kept, old = np.flatnonzero(own[self.slaves.nodes]), self.excluded
        slaves = self.slaves.restricted(own[self.slaves.nodes])
        lengths = np.diff(old.starts)[kept]
        starts = np.concatenate([[0], np.cumsum(lengths)])
        at = np.repeat(old.starts[kept] - starts[:-1], lengths) + np.arange(starts[-1])
        rows = Rows(starts.astype(np.int64), old.values[at])
        return ContactPass(slaves, self.areas[kept], self.masters, self.chosen, rows, self.sign)


@dataclass(frozen=True)
class ContactSurfaces:
    """All that one contact brings together.

    Attributes:
        contact: the model's.
        passes: nodes against triangles.
        slaves, areas: nodes against rigid surfaces, see ``ContactPass``.
        rigid: shapes and frames (12,) of the rigid surfaces.
        skin: m.
    """

    contact: Contact
    passes: list[ContactPass]
    slaves: Slaves
    areas: FloatArray
    rigid: list[tuple[Shape, FloatArray]]
    skin: float
    _numbers: tuple[float, float, float]

    def stiffness(self, inertia: float) -> float:
        """Force per penetration and area, N/m^3.

        ``inertia`` is the factor of the mass in the iteration matrix, 1/s^2, 0 at rest.
        """
        if self.contact.stiffness is not None:
            return self.contact.stiffness
        return automatic_stiffness(*self._numbers, inertia)


def contact_surfaces(
    surface: ShellSurface, contacts: Sequence[Contact], joined: IntArray
) -> list[ContactSurfaces]:
    """Describe all contacts of a model.

    Args:
        surface: the shells.
        contacts: the model's.
        joined: (k, 2) pairs of nodes that joints hold together: near them nothing touches.

    Raises:
        ValueError: surfaces that intersect or lie too deep in each other at the start.
    """
    mesh = surface.mesh
    thickness = np.array([shell.section.thickness for shell in surface.shells])
    masters = Masters(
        mesh.triangles,
        0.5 * thickness[surface.body],
        rim_bits(mesh.triangles, mesh.topology.neighbours, len(mesh.points)),
        connected_parts(mesh.topology.neighbours),
    )
    described = [_describe(surface, contact, masters, joined) for contact in contacts]
    for one in described:
        _check_start(surface, one, joined)
    return described


def _describe(
    surface: ShellSurface, contact: Contact, masters: Masters, joined: IntArray
) -> ContactSurfaces:
    """One contact."""
    points, triangles = surface.mesh.points, surface.mesh.triangles
    first, second = (_triangles(surface, names) for names in (contact.slaves, contact.masters))
    passes = []
    if len(second):
        itself = set(contact.slaves) == set(contact.masters)
        both = itself or contact.two_pass
        pairs = [(first, second, 1.0)]
        if both and not itself:
            pairs.append((second, first, -1.0))
        for slave, master, sign in pairs:
            slaves, areas = _slaves(points, masters, slave)
            excluded = rings(triangles, slaves.nodes, _RINGS, joined)
            share = (0.5 if both else 1.0) * areas
            passes.append(ContactPass(slaves, share, masters, master, excluded, sign))
    names = {*contact.slaves, *contact.masters}
    sections = [shell.section for shell in surface.shells if shell.name in names]
    numbers = (
        min(float(np.diag(s.stiffness)[:2].min()) for s in sections),
        max(s.thickness for s in sections),
        min(s.mass for s in sections),
    )
    used = np.union1d(first, second)
    skin = _SKIN * mean_edge(points, triangles[used]) if contact.skin is None else contact.skin
    slaves, areas = _slaves(points, masters, first)
    rigid = [
        (_shape(one), se3.frame(one.place.position, one.place.rotation)) for one in contact.surfaces
    ]
    return ContactSurfaces(contact, passes, slaves, areas, rigid, skin, numbers)


def _triangles(surface: ShellSurface, names: Sequence[str]) -> IntArray:
    """Triangles of some shells, ascending."""
    chosen = np.array([shell.name in names for shell in surface.shells], dtype=np.bool_)
    return np.flatnonzero(chosen[surface.body])


def _slaves(points: FloatArray, masters: Masters, chosen: IntArray) -> tuple[Slaves, FloatArray]:
    """Nodes of some triangles, which touch at half of the thickness, and their areas."""
    triangles = masters.triangles[chosen]
    offsets = np.zeros(len(points))
    np.maximum.at(offsets, triangles.ravel(), np.repeat(masters.thickness[chosen], 3))
    nodes = np.unique(triangles)
    areas = node_areas(points, triangles)[nodes]
    return Slaves(nodes, offsets[nodes], np.zeros(len(nodes))), areas


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


def _check_start(surface: ShellSurface, described: ContactSurfaces, joined: IntArray) -> None:
    """Raise where surfaces intersect, or lie too deep in each other."""
    owner, points = f'Contact "{described.contact.name}"', surface.mesh.points
    edges = surface.mesh.topology.edges
    for one in described.passes:
        _check_crossing(surface, owner, one, edges, joined)
        made = TriangleContact(one.slaves, one.masters, described.skin, one.excluded)
        made.search(points, one.chosen)
        made.settle(points)
        made.evaluate(points)
        part, node = deepest_start(made)
        if part > _DEEP:
            raise ValueError(
                f"{owner}: at the start {_shell_at(surface, node)} penetrates "
                f"{_names(described.contact.masters)} by {made.deepest:g} m at node {node}, more "
                f"than half of the distance at which they touch"
            )
    for shape, frame in described.rigid:
        gaps = RigidContact(described.slaves, shape).distances(points, frame)
        worst = int(np.argmin(gaps))
        if gaps[worst] < -described.slaves.offsets[worst]:
            node = int(described.slaves.nodes[worst])
            raise ValueError(
                f"{owner}: at the start {_shell_at(surface, node)} penetrates a rigid "
                f"{shape.kind.name.lower()} by {-gaps[worst]:g} m at node {node}, more than half "
                "of its thickness"
            )


def _check_crossing(
    surface: ShellSurface, owner: str, one: ContactPass, edges: IntArray, joined: IntArray
) -> None:
    """Raise where an edge of the slaves goes through a master triangle."""
    mesh = surface.mesh
    slave = np.zeros(len(mesh.points), dtype=np.bool_)
    slave[one.slaves.nodes] = True
    own = edges[slave[edges].all(axis=1)]
    near = rings(mesh.triangles, own[:, 0], _RINGS, joined)
    edge, triangle = first_crossing(mesh.points, own, mesh.triangles[one.chosen], near)
    if edge >= 0:
        a, b = own[edge].tolist()
        other = surface.shells[surface.body[one.chosen[triangle]]].name
        raise ValueError(
            f"{owner}: at the start {_shell_at(surface, a)} goes through Shell "
            f'"{other}" between nodes {a} and {b}'
        )


def _shell_at(surface: ShellSurface, node: int) -> str:
    return f'Shell "{surface.shells[int(surface.body_of_node[node])].name}"'


def _names(names: Sequence[str]) -> str:
    return " or ".join(f'Shell "{name}"' for name in names)
