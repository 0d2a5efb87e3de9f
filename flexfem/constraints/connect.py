# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints of a model on a rank: interface nodes and points on lines of their markers."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple
from weakref import WeakKeyDictionary

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.constraints.function_checks import check_functions
from flexfem.constraints.interface import Interface
from flexfem.constraints.lines.data import ON_LINE
from flexfem.constraints.node_table import NodeTable
from flexfem.constraints.rows.checks import rows_at_start
from flexfem.constraints.rows.placed_joint import PlacedJoint
from flexfem.core.joint import Joint
from flexfem.core.marker import Attachment, Carrier, Marker
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.places.line_points import BODY, FIXED, SIDES, find_jacobian, turn_frames
from flexfem.core.pose import Pose, computed_poses
from flexfem.core.row import Row
from flexfem.layout.lines import Line, LinePoint, Rail, RailPoint
from flexfem.layout.node_key import NodeKey
from flexfem.layout.numbered_model import NumberedModel
from flexfem.layout.placement import Placement
from flexfem.layout.surface_places import SurfacePlace, carrier_frame, turning
from flexfem.lie import se3

__all__ = ["JointEnds", "all_ends", "connect", "connect_alone", "joint_ends"]

#: Distance of a slider from its line, relative to the line's length, that counts as zero.
_GAP = 1e-6
_STEPS, _SMALL = 50, 1e-13
#: Frame at the origin, with inertial axes.
_INERTIAL = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
#: An element lies within this multiple of the distance of its nodes from their middle.
_BENT = 1.5


@dataclass(frozen=True)
class JointEnds:
    """Carriers and poses of the markers of a joint at the start.

    Attributes:
        nodes: the node that carries each marker, None on the ground and on lines.
        points: the point of each marker on a line; None for the others.
        frames: (n, 12) markers relative to their nodes or sections; absolute on the ground.
        poses: poses of the markers.
        rows: number of the joint's rows.
        rigid: True if they are all constraint equations at the start.
    """

    nodes: tuple[NodeKey | None, ...]
    points: tuple[LinePoint | None, ...]
    frames: FloatArray
    poses: tuple[Pose, ...]
    rows: int
    rigid: bool

    @property
    def keys(self) -> list[NodeKey]:
        """All nodes that the markers may depend on."""
        keys = [key for key in self.nodes if key is not None]
        for point in self.points:
            if point is not None:
                keys += point.keys
        return keys


_ENDS: WeakKeyDictionary[NumberedModel, list["JointEnds"]] = WeakKeyDictionary()


def all_ends(serial: NumberedModel) -> list[JointEnds]:
    """Markers of all joints of a model, each joint evaluated once.

    Raises:
        ValueError: as of :func:`joint_ends`.
    """
    if serial not in _ENDS:
        placed = _at_nodes(serial, [m for joint in serial.joints for m in joint.markers])
        alike = dict[type, Sequence[Row]]()
        _ENDS[serial] = [
            _at_node_ends(joint, placed, alike) or _joint_ends(serial, joint, placed)
            for joint in serial.joints
        ]
    return _ENDS[serial]


def joint_ends(serial: NumberedModel, joint: Joint) -> JointEnds:
    """Find the markers of a joint.

    Raises:
        ValueError: as of :func:`all_ends`.
    """
    return _joint_ends(serial, joint, _at_nodes(serial, joint.markers))


class _Placed(NamedTuple):
    """A marker at a node, or on the ground: its node, its frame there, and its pose."""

    key: NodeKey | None
    frame: FloatArray
    pose: Pose


def _at_nodes(serial: NumberedModel, markers: Sequence[Attachment]) -> dict[int, _Placed]:
    """The markers that are on the ground or at one node with axes, by their ``id``."""
    found: dict[int, tuple[Attachment, NodeKey | None]] = {}
    carriers = []
    for marker in markers:
        if id(marker) in found or isinstance(marker, Carrier):
            continue
        if serial.surface_place(marker) is None and serial.point(marker) is None:
            key = serial.key(marker)
            found[id(marker)] = marker, key
            carriers.append(_INERTIAL if key is None else serial.node_frames(key[0])[key[1]])
    if not found:
        return {}
    own = [marker for marker, _ in found.values()]
    carrier = np.array(carriers)
    turns = np.array([marker.rotation for marker in own])
    turns = np.swapaxes(se3.rotation(carrier), -1, -2) @ turns
    frames = se3.frame([m.offset if isinstance(m, Marker) else m.position for m in own], turns)
    poses = computed_poses(se3.compose(carrier, frames))
    return {
        number: _Placed(key, frame, pose)
        for (number, (_, key)), frame, pose in zip(found.items(), frames, poses, strict=True)
    }


def _at_node_ends(
    joint: Joint, placed: dict[int, _Placed], alike: dict[type, Sequence[Row]]
) -> JointEnds | None:
    """Markers of a joint that are all placed, if its rows are as those of others of its class.

    None for all other joints. Numbers of rows are found once for each class, in ``alike``.
    """
    found = [placed.get(id(marker)) for marker in joint.markers] if joint.alike else [None]
    known = [one for one in found if one is not None]
    if len(known) < len(found):
        return None
    keys, frames, poses = zip(*known, strict=True)
    rows = alike.get(type(joint))
    if rows is None:
        rows = alike[type(joint)] = rows_at_start(joint, poses)
    return JointEnds(keys, (None,) * len(keys), np.array(frames), poses, len(rows), rigid=True)


def _joint_ends(serial: NumberedModel, joint: Joint, placed: dict[int, _Placed]) -> JointEnds:
    """Find the markers of a joint, of which some are placed.

    Raises:
        ValueError: a slider is not on its line at the start, or a joint has no rows, e.g. a spring
            between coincident markers.
    """
    nodes: list[NodeKey | None] = []
    points: list[LinePoint | None] = []
    frames, poses, surfaces = [], [], dict[int, SurfacePlace]()
    for number, marker in enumerate(joint.markers):
        point, key, frame = None, None, _INERTIAL
        if id(marker) in placed:
            key, frame, pose = placed[id(marker)]
        elif isinstance(marker, Carrier):
            point, pose = _slider(serial, joint, marker)
        elif (place := serial.surface_place(marker)) is not None:
            surfaces[number], pose = place, serial.marker_pose(marker)
        else:
            point = serial.point(marker)
            frame, pose = serial.marker_frame(marker), serial.marker_pose(marker)
        nodes.append(key)
        points.append(point)
        frames.append(frame)
        poses.append(pose)
    rows = rows_at_start(joint, poses)
    if any(row.wrap is not None for row in rows) and any((*surfaces, *filter(None, points))):
        raise ValueError(f"{joint.owner}: friction needs guides at nodes, not between them")
    check_functions(rows, poses)
    for number, place in surfaces.items():
        nodes[number], points[number], frames[number] = _on_surface(
            serial, joint.markers[number], place, poses[number], turning(rows, number)
        )
    rigid = all(row.law is None and row.locked for row in rows)
    return JointEnds(tuple(nodes), tuple(points), np.array(frames), tuple(poses), len(rows), rigid)


def _on_surface(
    serial: NumberedModel, marker: Attachment, place: SurfacePlace, pose: Pose, axes: bool
) -> tuple[NodeKey | None, LinePoint | None, FloatArray]:
    """Carrier of a marker on a shell, a node or a point of several, and its frame there."""
    assert isinstance(marker, Marker)
    axes = axes or bool(marker.offset.any())
    frame = se3.frame(pose.position, pose.rotation)
    if len(place.nodes) == 1 and not axes:
        key = place.kind, place.nodes[0]
        carrier = serial.node_frames(place.kind)[key[1]]
        return key, None, se3.compose(se3.inverse(carrier), frame)
    point = (serial.with_axes(marker, place) if axes else place).carrier(axes)
    carrier = carrier_frame(point, serial.node_frames(place.kind)[:, :3])
    return None, point, se3.compose(se3.inverse(carrier), frame)


def _slider(serial: NumberedModel, joint: Joint, carrier: Carrier) -> tuple[LinePoint, Pose]:
    """Initial point of a slider on a line, and the pose of the section there."""
    try:
        line = serial.carrier_line(carrier)
    except ValueError as error:
        raise ValueError(f"{joint.owner}: {error}") from None
    x = serial.marker_pose(joint.markers[1]).position
    element, xi, frame = _closest(serial, line, x)
    gap = float(np.linalg.norm(x - frame[:3]))
    if gap > _GAP * line.length:
        raise ValueError(
            f"{joint.owner}: the slider at {_checks.show(x.tolist())} is {gap:.3g} m away from "
            f'the line of "{carrier.body}"'
        )
    return LinePoint(line, element, xi, slides=True), Pose(se3.position(frame), se3.rotation(frame))


def _closest(serial: NumberedModel, line: Line, x: FloatArray) -> tuple[int, float, FloatArray]:
    """Element, coordinate and frame of the section nearest to x."""
    ends = np.array([serial.node_frames(line.kind)[nodes] for nodes in line.nodes])
    middle = ends[:, :, :3].mean(axis=1)
    reach = np.linalg.norm(ends[:, :, :3] - middle[:, np.newaxis], axis=2).max(axis=1)
    if line.element == BODY:
        reach[:] = np.inf  # its elements need not be near its nodes
    beside = np.linalg.norm(middle - x, axis=1) - _BENT * reach
    best, found = np.inf, (0, 0.0, np.empty(12))
    for e in np.argsort(beside, kind="stable"):
        if beside[e] > best:
            break
        frames = np.ascontiguousarray(ends[e])
        shape = np.zeros((1, 1)) if line.shape is None else line.shape[e]
        if line.turns is not None:
            turn_frames(frames, line.turns[e], frames)
        xi, frame = _in_plane(line.element, frames, shape, x)
        gap = float(np.linalg.norm(x - frame[:3]))
        if gap < best:
            best, found = gap, (int(e), xi, frame)
    return found


def _in_plane(
    kind: int, frames: FloatArray, shape: FloatArray, x: FloatArray
) -> tuple[float, FloatArray]:
    """Coordinate, 0 to 1, of the section whose plane is nearest to x, and its frame (Newton)."""
    frame, J, xi = np.empty(12), np.empty((6, 6 * len(frames) + 1)), 0.5
    for _ in range(_STEPS):
        find_jacobian(kind, frames, shape, xi, frame, J)
        p = se3.rotation(frame).T @ (x - frame[:3])
        step = p[0] / (J[0, -1] + J[4, -1] * p[2] - J[5, -1] * p[1])
        xi = min(max(xi + step, -1.0), 2.0)
        if abs(step) < _SMALL:
            break
    xi = min(max(xi, 0.0), 1.0)
    find_jacobian(kind, frames, shape, xi, frame, J)
    return xi, frame


def connect(
    joints: Sequence[Joint], found: Sequence[JointEnds], comm: MPI.Intracomm,
    placement: Placement, blocks: Sequence[FrameBlock | None],
) -> tuple[Interface, list[PlacedJoint]]:  # fmt: skip
    """Interface nodes of all joints and the joints that this rank evaluates (collective).

    Args:
        joints: joints of the model.
        found: their markers.
        comm: communicator.
        placement: distribution of the model.
        blocks: the blocks by kind.
    """
    needed: dict[NodeKey, set[int]] = {}
    for joint, ends in zip(joints, found, strict=True):
        ranks = placement.joint_ranks(joint)
        for key in ends.keys:
            needed.setdefault(key, set()).update(ranks)
    keys = list(needed)
    interface = Interface(comm, blocks, keys, [sorted(needed[k]) for k in keys])
    placed: list[PlacedJoint] = []
    rails: dict[int, Rail] = {}
    for index, (joint, ends) in enumerate(zip(joints, found, strict=True)):
        ranks = placement.joint_ranks(joint)
        if comm.rank not in ranks:
            continue
        owned, shared = ranks[0] == comm.rank, len(ranks) > 1
        placed.append(_placed(joint, index, ends, interface, rails, owned=owned, shared=shared))
    return interface, placed


def connect_alone(
    joints: Sequence[Joint], found: Sequence[JointEnds], table: NodeTable
) -> list[PlacedJoint]:
    """The joints of a model whose nodes are all on this process, without distribution."""
    rails: dict[int, Rail] = {}
    return [
        _placed(joint, index, ends, table, rails, owned=True, shared=False)
        for index, (joint, ends) in enumerate(zip(joints, found, strict=True))
    ]


def _placed(
    joint: Joint, index: int, ends: JointEnds, interface: Interface | NodeTable,
    rails: dict[int, Rail], *, owned: bool, shared: bool,
) -> PlacedJoint:  # fmt: skip
    """A joint between interface nodes."""
    nodes, points = _interface_nodes(ends, interface), _rail_points(ends, interface, rails)
    return PlacedJoint(
        joint, index, ends.poses, nodes, ends.frames, points, owned=owned, shared=shared
    )


def _rail_points(
    ends: JointEnds, interface: Interface | NodeTable, rails: dict[int, Rail]
) -> tuple[RailPoint | None, ...]:
    """Points of the markers of a joint on lines; ``rails`` are those of the lines so far.

    Places on surfaces have rails of their own.
    """
    points: list[RailPoint | None] = []
    for point in ends.points:
        if point is None:
            points.append(None)
            continue
        if point.line.element in (SIDES, FIXED):
            rail = _rail(interface, point.line)
        else:
            rail = rails.setdefault(id(point.line), _rail(interface, point.line))
        points.append(RailPoint(rail, point.element, point.xi, point.slides))
    return tuple(points)


def _rail(interface: Interface | NodeTable, line: Line) -> Rail:
    """A line with the interface nodes of its nodes, -1 for those without joints."""
    nodes = [
        [interface.node_of.get(key, -1) for key in line.keys(e)] for e in range(len(line.nodes))
    ]
    return Rail(line, np.array(nodes, dtype=np.int64))


def _interface_nodes(ends: JointEnds, interface: Interface | NodeTable) -> tuple[int, ...]:
    """Numbers of the markers' interface nodes, -1 on the ground, -2 on lines."""
    return tuple(
        ON_LINE if point is not None else -1 if key is None else interface.node_of[key]
        for key, point in zip(ends.nodes, ends.points, strict=True)
    )
