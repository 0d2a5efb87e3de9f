# SPDX-License-Identifier: LGPL-3.0-or-later
"""From a model to a system (collective)."""

from collections.abc import Sequence

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.frame_block import FrameBlock
from flexfem.elements.se3_beam import BeamCells, SE3Beams
from flexfem.lie import se3, so3
from flexfem.loads.line_load import LineLoad
from flexfem.loads.point_force import PointForce
from flexfem.loads.point_moment import PointMoment
from flexfem.mesh.beam_mesh import create_beam_mesh
from flexfem.model.bodies import RigidBody
from flexfem.system.assembly import Assembly
from flexfem.system.constraints import Constraints, PlacedJoint
from flexfem.system.interface import Interface
from flexfem.system.node_loads import Force, NodeForces, NodeMasses
from flexfem.system.placement import BEAMS, RIGID, NodeKey, Placement, place
from flexfem.system.system import BlockPart, System

__all__ = ["build"]


def build(serial: Assembly, comm: MPI.Intracomm, split_above: int) -> System:
    """Build the system of a model (collective).

    Args:
        serial: serial data of a validated model, the same on every rank.
        comm: communicator.
        split_above: beams with more cells than this may be split over ranks.

    Raises:
        ValueError: a mistake in the model; raised alike on every rank before any communication.
    """
    model = serial.model
    placement = place(model, comm.size, split_above)
    gravity = np.zeros(3) if model.gravity is None else np.array(model.gravity.acceleration)
    _check_joints(serial)
    blocks: list[FrameBlock | None] = [None, None]
    beams = None
    if model.beams:
        blocks[BEAMS], beams = _beam_block(serial, comm, placement)
    if model.rigid_bodies:
        blocks[RIGID] = _rigid_block(serial, comm, placement)
    interface, joints = _connect(serial, comm, placement, blocks)
    constraints = Constraints(comm, joints, interface)
    parts = [
        _part(serial, kind, block, interface, beams)
        for kind, block in enumerate(blocks)
        if block is not None
    ]
    bodies = np.array([serial.body(key) for key in interface.keys], dtype=np.int64)
    return System(comm, parts, interface, constraints, bodies, model.loads, gravity)


def _part(
    serial: Assembly, kind: int, block: FrameBlock, interface: Interface, beams: SE3Beams | None
) -> BlockPart:
    """A block with what acts on its nodes of this rank."""
    where = {int(n): i for i, n in enumerate(block.node_ids[: block.owned])}
    return BlockPart(
        kind=kind,
        block=block,
        masses=_masses(serial, kind, where),
        forces=NodeForces(_forces(serial, kind, where)),
        beams=beams if kind == BEAMS else None,
        node_body=np.array([serial.body((kind, n)) for n in block.node_ids], dtype=np.int64),
        slots=np.where(interface.block == kind, interface.local, -1),
    )


def _check_joints(serial: Assembly) -> None:
    """Raise for joints that are not satisfied at the start."""
    for joint in serial.model.joints:
        poses = serial.marker_pose(joint.a), serial.marker_pose(joint.b)
        joint.rows(*poses, 0.0)


def _beam_block(
    serial: Assembly, comm: MPI.Intracomm, placement: Placement
) -> tuple[FrameBlock, SE3Beams]:
    destination = np.concatenate(placement.cells)
    mesh = create_beam_mesh(comm, serial.points, serial.cells.cells, destination)
    data, ids = serial.cells, mesh.cell_ids
    mine = BeamCells(
        mesh.cells, data.body[ids], data.section[ids], data.frames[ids], data.damping[ids]
    )
    frames = serial.frames[mesh.node_ids]
    block = FrameBlock(
        "beams", comm, frames, serial.velocities[mesh.node_ids], mesh.node_ids, mesh.index_map
    )
    return block, SE3Beams(comm, mine, serial.sections, frames)


def _rigid_block(serial: Assembly, comm: MPI.Intracomm, placement: Placement) -> FrameBlock:
    from dolfinx.common import IndexMap

    mine = np.flatnonzero(placement.rigid == comm.rank)
    velocity = np.zeros((len(mine), 6))
    for i, number in enumerate(mine):
        body = serial.model.rigid_bodies[number]
        velocity[i, :3] = body.rotation.T @ body.velocity
        velocity[i, 3:] = body.angular_velocity
    frames = serial.rigid_frames[mine]
    return FrameBlock("rigid_bodies", comm, frames, velocity, mine, IndexMap(comm, len(mine)))


def _connect(
    serial: Assembly, comm: MPI.Intracomm, placement: Placement,
    blocks: Sequence[FrameBlock | None],
) -> tuple[Interface, list[PlacedJoint]]:  # fmt: skip
    """Interface nodes of all joints and the joints that this rank evaluates."""
    needed: dict[NodeKey, set[int]] = {}
    for joint in serial.model.joints:
        ranks = placement.joint_ranks(joint)
        for marker in (joint.a, joint.b):
            key = serial.key(marker)
            if key is not None:
                needed.setdefault(key, set()).update(ranks)
    keys = list(needed)
    interface = Interface(comm, blocks, keys, [sorted(needed[k]) for k in keys])
    joints = []
    for index, joint in enumerate(serial.model.joints):
        ranks = placement.joint_ranks(joint)
        if comm.rank not in ranks:
            continue
        ends = [serial.key(m) for m in (joint.a, joint.b)]
        slots = [-1 if k is None else interface.slot_of[k] for k in ends]
        joints.append(
            PlacedJoint(
                joint,
                index,
                (serial.marker_pose(joint.a), serial.marker_pose(joint.b)),
                (slots[0], slots[1]),
                np.array([serial.marker_frame(m) for m in (joint.a, joint.b)]),
                owned=ranks[0] == comm.rank,
                shared=len(ranks) > 1,
            )
        )
    return interface, joints


def rigid_inertia(body: RigidBody) -> FloatArray:
    """Inertia matrix (6, 6) about the reference point in body axes, translation first."""
    first = body.mass * so3.skew(body.centre)
    about_point = body.inertia - first @ so3.skew(body.centre)
    return np.block([[body.mass * np.eye(3), -first], [first, about_point]])


def _masses(serial: Assembly, kind: int, where: dict[int, int]) -> NodeMasses:
    nodes: list[int] = []
    matrices: list[FloatArray] = []
    if kind == RIGID:
        for number, local in where.items():
            nodes.append(local)
            matrices.append(rigid_inertia(serial.model.rigid_bodies[number]))
    for mass in serial.model.point_masses:
        key = serial.key(mass.marker)
        if key is not None and key[0] == kind and key[1] in where:
            arm = so3.skew(se3.position(serial.marker_frame(mass.marker)))
            nodes.append(where[key[1]])
            matrices.append(mass.mass * np.block([[np.eye(3), -arm], [arm, -arm @ arm]]))
    return NodeMasses(nodes, matrices)


def _forces(serial: Assembly, kind: int, where: dict[int, int]) -> list[Force]:
    forces = []
    for number, load in enumerate(serial.model.loads):
        if isinstance(load, LineLoad):
            if kind == BEAMS:
                forces += _line_forces(serial, load, number, where)
            continue
        key = serial.key(load.markers[0])
        if key is None or key[0] != kind or key[1] not in where:
            continue
        force = load.force if isinstance(load, PointForce) else np.zeros(3)
        moment = load.moment if isinstance(load, PointMoment) else np.zeros(3)
        frame = serial.marker_frame(load.markers[0])
        forces.append(Force(where[key[1]], frame, force, moment, load.follower, number))
    return forces


def _line_forces(
    serial: Assembly, load: LineLoad, number: int, where: dict[int, int]
) -> list[Force]:
    """Half of each cell's load at either end: exact for the linear positions of the element."""
    body = [b.name for b in serial.model.beams].index(load.body)
    cells = np.flatnonzero(serial.cells.body == body)
    ends = serial.cells.frames[cells]
    length = np.linalg.norm(
        se3.log(se3.compose(se3.inverse(ends[:, 0]), ends[:, 1]))[:, :3], axis=1
    )
    forces = []
    for cell, half in zip(cells, 0.5 * length, strict=True):
        for side in range(2):
            node = int(serial.cells.cells[cell, side])
            if node in where:
                turn = se3.rotation(serial.frames[node]).T @ se3.rotation(
                    serial.cells.frames[cell, side]
                )
                frame = se3.frame(np.zeros(3), turn)
                forces.append(
                    Force(
                        where[node],
                        frame,
                        half * load.force_per_length,
                        np.zeros(3),
                        load.follower,
                        number,
                    )  # fmt: skip
                )
    return forces
