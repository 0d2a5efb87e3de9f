# SPDX-License-Identifier: LGPL-3.0-or-later
"""Build of the system of a model (collective)."""

from collections.abc import Callable
from itertools import combinations

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._types import IntArray
from flexfem.constraints.batch import Constraints
from flexfem.constraints.connect import all_ends, connect
from flexfem.constraints.interface import Interface
from flexfem.contact.barrier.contacts import BarrierContacts
from flexfem.contact.barrier.start import start_apart
from flexfem.contact.contacts import Contacts
from flexfem.contact.initial_overlaps import check_start
from flexfem.contact.pairs import contact_surfaces
from flexfem.contact.penalty_contact import penalty_contacts
from flexfem.contact.points import contact_points
from flexfem.contact.surfaces.bodies import check_pairs
from flexfem.contact.surfaces.surfaces import collision_surfaces
from flexfem.core.marker import SurfaceMarker
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.forms.beam_law import law_expressions
from flexfem.la.counting_comm import CountingComm
from flexfem.la.linear_solver import LinearSolver
from flexfem.layout.elements import ElementFamily
from flexfem.layout.family import Family
from flexfem.layout.node_key import by_kind
from flexfem.layout.node_loads import NodeForces, NodeMasses
from flexfem.layout.numbered_model import NumberedModel
from flexfem.layout.placed_loads import marker_forces
from flexfem.layout.placement import Placement, place
from flexfem.lie import se3, so3
from flexfem.materials.section import Section
from flexfem.materials.shell_section import ShellSection
from flexfem.model.bodies.basic import Beam, PointMass
from flexfem.model.bodies.shell import Shell
from flexfem.system.contact_share import ContactShare
from flexfem.system.system import BlockPart, System

__all__ = ["build"]


def build(
    serial: NumberedModel, comm: MPI.Intracomm, split_above: int,
    linear: LinearSolver | None = None,
) -> System:  # fmt: skip
    """Build the system of a model (collective).

    Args:
        serial: serial data of a validated model, the same on every rank.
        comm: communicator.
        split_above: beams with more cells than this may be split over ranks.
        linear: choice between factors and iterative solvers; None for factors.

    Raises:
        ValueError: a mistake in the model; raised on every rank before any communication.
    """
    model, comm = serial.model, CountingComm(comm)
    gravity = np.zeros(3) if model.gravity is None else np.array(model.gravity.acceleration)
    ends = all_ends(serial)
    joints_of_rows = [(joint, end.rows) for joint, end in zip(serial.joints, ends, strict=True)]
    placement = place(list(serial.families.values()), joints_of_rows, comm.size, split_above)
    _check_laws(serial)
    for mass in model.point_masses:
        _check_node(serial, mass)
    contacts = _contacts(serial, comm, placement, float(np.linalg.norm(gravity)))
    families = serial.families
    blocks: list[FrameBlock | None] = [None for _ in range(1 + max(families))]
    elements: dict[int, ElementFamily | None] = {}
    for kind, family in families.items():
        blocks[kind], elements[kind] = family.block(comm, placement.elements[kind])
    interface, joints = connect(serial.joints, ends, comm, placement, blocks)
    constraints = Constraints(comm, joints, interface)
    for name in model.released:
        constraints.set_active(name, False)
    parts = [
        _part(serial, families[kind], block, interface, elements[kind])
        for kind, block in enumerate(blocks)
        if block is not None
    ]
    if contacts is not None:
        _add_contacts(contacts, parts)
    bodies, clusters = np.zeros((2, len(interface.keys)), dtype=np.int64)
    for kind, at, nodes in by_kind(interface.keys):
        bodies[at], clusters[at] = serial.bodies(kind, nodes), serial.clusters(kind, nodes)
    system = System(
        comm, parts, interface, constraints, bodies, clusters, model.loads, gravity, linear
    )
    interface.update()
    return system


#: Makes the contacts of a system from its blocks, by kind (collective).
type _Make = Callable[[dict[int, FrameBlock]], Contacts | BarrierContacts]


def _contacts(
    serial: NumberedModel, comm: MPI.Intracomm, placement: Placement, gravity: float
) -> _Make | None:
    """Contacts of a model, None without any; raises for surfaces that touch or intersect."""
    if not serial.model.contacts:
        return None
    check_pairs(serial)
    laws = {contact.law for contact in serial.model.contacts}
    barriers = [contact.name for contact in serial.model.contacts if contact.needs_barrier]
    if barriers:
        if "penalty" in laws:
            other = next(one.name for one in serial.model.contacts if one.law == "penalty")
            raise ValueError(
                f'Contact "{other}": it has the law penalty, and Contact "{barriers[0]}" the '
                "barrier: all contacts of a model have the same law"
            )
        return _barrier(serial, comm, gravity)
    try:
        contacts = penalty_contacts(serial)
    except ValueError:
        if "penalty" in laws:
            raise
        return _barrier(serial, comm, gravity)
    points = contact_points(serial, contacts, _joined(serial))
    described = contact_surfaces(serial, points, contacts)
    check_start(points, described)
    return lambda blocks: Contacts(comm, described, points, blocks, placement.elements)


def _barrier(serial: NumberedModel, comm: MPI.Intracomm, gravity: float) -> _Make:
    """Contacts by barriers."""
    surfaces = collision_surfaces(serial)
    made = start_apart(surfaces)
    return lambda blocks: BarrierContacts(comm, surfaces, made, blocks, gravity)


def _add_contacts(make: _Make, parts: list[BlockPart]) -> None:
    """Give each block its share of the contacts (collective)."""
    contacts = make({part.kind: part.block for part in parts})
    for part in parts:
        if part.kind in contacts.kinds:
            part.contacts = ContactShare(contacts, part.kind)


def _part(
    serial: NumberedModel, family: Family, block: FrameBlock, interface: Interface,
    elements: ElementFamily | None,
) -> BlockPart:  # fmt: skip
    """A block with its elements, masses and forces on this rank."""
    node_body = family.bodies_of(block.node_ids)
    at_nodes, inside = family.forces(block, elements, node_body)
    of_markers = marker_forces(serial, family.kind, block, turning=family.axes)
    return BlockPart(
        family=family,
        block=block,
        masses=_masses(serial, family, block),
        forces=NodeForces([*of_markers, *at_nodes]),
        line_forces=inside,
        elements=elements,
        node_body=node_body,
        node_cluster=family.clusters_of(block.node_ids),
        interface_nodes=np.where(interface.kind == family.kind, interface.local, -1),
    )


def _joined(serial: NumberedModel) -> IntArray:
    """Pairs (k, 2) of nodes of shells that joints of lines connect."""
    pairs = [
        (a, b)
        for joint in serial.body_joints
        for first, second in combinations(joint.markers, 2)
        if isinstance(first, SurfaceMarker) and isinstance(second, SurfaceMarker)
        for a in first.nodes
        for b in second.nodes
    ]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _check_laws(serial: NumberedModel) -> None:
    """Raise for laws of sections whose functions fail, and for damping without a stiffness."""
    bodies: list[Beam | Shell] = [*serial.model.beams, *serial.model.shells]
    for body in bodies:
        section, owner = body.section, f'{type(body).__name__} "{body.name}"'
        law = section.law if isinstance(section, Section | ShellSection) else None
        if law is None:
            continue
        try:
            law_expressions(law)
        except ValueError as error:
            raise ValueError(f"{owner}: {error}") from None
        if np.any(body.damping):
            given = _checks.show(np.asarray(body.damping).tolist())
            raise ValueError(
                f"{owner}: damping {given} s is proportional to a stiffness, give the "
                f"dissipation of its {law.owner} instead"
            )


def _check_node(serial: NumberedModel, mass: PointMass) -> None:
    """Raise for a point mass inside an element, which is not supported."""
    try:
        serial.key(mass.marker)
    except ValueError as error:
        raise ValueError(f'PointMass "{mass.name}": {error}') from None


def _masses(serial: NumberedModel, family: Family, block: FrameBlock) -> NodeMasses:
    """Rigid bodies and point masses on the nodes of a block that this rank owns."""
    nodes, matrices = family.masses(block)
    for mass in serial.model.point_masses:
        local = serial.local_node(mass.marker, family.kind, block)
        if local >= 0:
            arm = so3.skew(se3.position(serial.marker_frame(mass.marker)))
            nodes.append(local)
            matrices.append(mass.mass * np.block([[np.eye(3), -arm], [arm, -arm @ arm]]))
    return NodeMasses(nodes, matrices)
