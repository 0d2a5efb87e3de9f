# SPDX-License-Identifier: LGPL-3.0-or-later
"""From a model to a system (collective)."""

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI

from flexfem._types import FloatArray, IntArray
from flexfem.core.frame_block import FrameBlock
from flexfem.core.marker import Attachment, Marker
from flexfem.core.pose import Pose
from flexfem.elements.se3_beam import BeamCells, SE3Beams, node_frames
from flexfem.lie import se3, so3
from flexfem.loads.line_load import LineLoad
from flexfem.loads.point_force import PointForce
from flexfem.loads.point_moment import PointMoment
from flexfem.mesh.beam_mesh import create_beam_mesh
from flexfem.mesh.line_mesh import section_frames
from flexfem.mesh.partition import SPLIT_ABOVE
from flexfem.model.bodies import RigidBody
from flexfem.model.model import Model
from flexfem.system.constraints import Constraints, PlacedJoint
from flexfem.system.interface import Interface
from flexfem.system.node_loads import Force, NodeForces, NodeMasses
from flexfem.system.placement import BEAMS, RIGID, NodeKey, Placement, place
from flexfem.system.system import BlockPart, System

__all__ = ["Assembly", "build"]

_IDENTITY = np.array([0.0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1])


class Assembly:
    """Serial data of a model in the order of its nodes, the same on every rank.

    Attributes:
        model: the validated model.
        cells: all beam cells with their frames; node numbers count the nodes used by beams.
        points, frames, velocities: of those nodes, (n, 3), (n, 12), (n, 6).
    """

    def __init__(self, model: Model) -> None:
        """Number the beams' nodes and compute all frames at the start."""
        self.model = model
        self._rigid_index = {b.name: i for i, b in enumerate(model.rigid_bodies)}
        if model.beams:
            self._beams()
        self.rigid_frames = np.array(
            [se3.frame(b.position, b.rotation) for b in model.rigid_bodies]
        ).reshape(-1, 12)

    def _beams(self) -> None:
        model, mesh = self.model, self.model.mesh
        assert mesh is not None  # checked by validate()
        rows = [_along(model, beam) for beam in model.beams]
        used, cells = np.unique(np.concatenate([mesh.cells[r] for r in rows]), return_inverse=True)
        self._node_of_mesh = {int(node): i for i, node in enumerate(used)}
        self.points = mesh.points[used]
        counts = [len(r) for r in rows]
        ends = np.concatenate(
            [
                section_frames(mesh.points, mesh.cells[r], beam.orientation)
                for r, beam in zip(rows, model.beams, strict=True)
            ]
        )
        cells = cells.reshape(-1, 2)
        sections = list({id(b.section): b.section for b in model.beams}.values())
        number = {id(s): i for i, s in enumerate(sections)}
        self.sections = sections
        self.cells = BeamCells(
            cells=cells,
            body=np.repeat(np.arange(len(rows)), counts),
            section=np.repeat([number[id(b.section)] for b in model.beams], counts),
            frames=se3.frame(self.points[cells], ends),
            damping=np.repeat([b.damping for b in model.beams], counts),
        )
        self._body_of_node = np.empty(len(used), dtype=np.int64)
        self._body_of_node[cells] = self.cells.body[:, np.newaxis]
        self.frames = node_frames(cells, self.cells.frames, len(used))
        self.velocities = np.zeros((len(used), 6))
        for body, beam in enumerate(model.beams):
            nodes = np.unique(cells[self.cells.body == body])
            back = np.swapaxes(se3.rotation(self.frames[nodes]), -1, -2)
            speed = beam.velocity + np.cross(beam.angular_velocity, self.points[nodes])
            self.velocities[nodes, :3] = np.einsum("nij,nj->ni", back, speed)
            self.velocities[nodes, 3:] = back @ beam.angular_velocity

    def key(self, marker: Attachment) -> NodeKey | None:
        """Node that carries a marker, None for the ground."""
        if not isinstance(marker, Marker):
            return None
        node = self.model.marker_node(marker)
        if node is None:
            return RIGID, self._rigid_index[marker.body]
        return BEAMS, self._node_of_mesh[node]

    def body(self, key: NodeKey) -> int:
        """Number of the body that a node belongs to."""
        return int(self._body_of_node[key[1]]) if key[0] == BEAMS else int(key[1])

    def node_frame(self, key: NodeKey) -> FloatArray:
        """Frame (12,) of a node at the start."""
        frame: FloatArray = (self.frames if key[0] == BEAMS else self.rigid_frames)[key[1]]
        return frame

    def marker_frame(self, marker: Attachment) -> FloatArray:
        """Frame (12,) of a marker relative to its node; absolute for the ground."""
        key = self.key(marker)
        if key is None:
            return se3.frame(marker.position, marker.rotation)  # type: ignore[union-attr]
        turn = se3.rotation(self.node_frame(key)).T @ marker.rotation
        return se3.frame(marker.offset, turn)  # type: ignore[union-attr]

    def marker_pose(self, marker: Attachment) -> Pose:
        """Pose of a marker at the start."""
        frame, key = self.marker_frame(marker), self.key(marker)
        if key is not None:
            frame = se3.compose(self.node_frame(key), frame)
        return Pose(se3.position(frame), se3.rotation(frame))


def _along(model: Model, beam: object) -> IntArray:
    """Cells of a beam ordered along it, so that neighbours in number are neighbours in space."""
    rows = model.beam_cells(beam)  # type: ignore[arg-type]
    assert model.mesh is not None
    order = model.mesh.order(beam.group)  # type: ignore[attr-defined]
    if order is None:
        return rows
    rank = np.empty(len(model.mesh.points), dtype=np.int64)
    rank[order] = np.arange(len(order))
    return rows[np.argsort(rank[model.mesh.cells[rows]].min(axis=1), kind="stable")]


def build(model: Model, comm: MPI.Intracomm, split_above: int = SPLIT_ABOVE) -> System:
    """Build the system of a model (collective).

    Args:
        model: the model, the same on every rank.
        comm: communicator.
        split_above: beams with more cells than this may be split over ranks.

    Raises:
        ValueError: a mistake in the model; raised alike on every rank before any communication.
    """
    model.validate()
    serial = Assembly(model)
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
                        where[node], frame, half * load.force_per_length, np.zeros(3),
                        load.follower, number,
                    )  # fmt: skip
                )
    return forces
