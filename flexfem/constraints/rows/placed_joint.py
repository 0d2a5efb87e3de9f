# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints on interface nodes, and the numbers of their rows in the table."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from flexfem._types import FloatArray, IntArray
from flexfem.core.joint import Joint
from flexfem.core.pose import Pose
from flexfem.core.row import Row
from flexfem.layout.lines import RailPoint

__all__ = ["PlacedJoint", "RowLayout"]


@dataclass(frozen=True)
class PlacedJoint:
    """A joint that this rank evaluates.

    Attributes:
        joint: its declaration.
        index: number of the joint in the model.
        poses: poses of its markers at the start.
        interface_nodes: interface numbers of the nodes that carry its markers, -1 for ground, -2 on
            lines.
        offsets: (n, 12) frames of markers relative to their nodes or sections (absolute for
            ground).
        points: points of its markers on lines, None for the others.
        owned: True if this rank owns its multipliers.
        shared: True if another rank evaluates it as well.
    """

    joint: Joint
    index: int
    poses: tuple[Pose, ...]
    interface_nodes: tuple[int, ...]
    offsets: FloatArray
    points: tuple[RailPoint | None, ...]
    owned: bool
    shared: bool

    @cached_property
    def on_lines(self) -> bool:
        """True if a marker is on a line."""
        return any(point is not None for point in self.points)

    @property
    def alike(self) -> bool:
        """True if its rows differ in directions alone from those of the others of its class."""
        return self.joint.alike and not self.on_lines

    @property
    def widths(self) -> list[int]:
        """Number of nodes that each marker depends on."""
        return [
            int(node >= 0) if point is None else point.rail.interface_nodes.shape[1]
            for node, point in zip(self.interface_nodes, self.points, strict=True)
        ]

    @property
    def pairs(self) -> int:
        """Number of pairs of nodes for second derivatives, if it has markers on lines."""
        count = sum(self.widths)
        return count * (count - 1) // 2

    def rows(self, t: float) -> tuple[Row, ...]:
        """Rows at time t."""
        return self.joint.rows(self.poses, t)

    def targets(self, t: float) -> Sequence[float] | None:
        """Targets of its rows at time t, see ``Joint.targets``."""
        return self.joint.targets(self.poses, t)


@dataclass(frozen=True)
class RowLayout:
    """Layout of the rows of joints in the table; the arrays are those of ``RowTable``.

    Attributes:
        joints: the joints.
        start: (n_joints + 1,) first row of each joint.
        marker_start: (n_joints + 1,) first marker of each joint.
        marker_node, marker_offset: (m,) and (m, 12) interface number of a marker's node, frame
            relative to it.
        targets: (r,) prescribed values of the rows' sums.
        term_start: (r + 1,) first term of each row.
        term_nodes: (t, 2) interface numbers of the nodes of both markers of a term.
        pair_nodes: (p, 2) interface nodes of pairs of nodes for second derivatives.
    """

    joints: Sequence[PlacedJoint]
    start: IntArray
    marker_start: IntArray
    marker_node: IntArray
    marker_offset: FloatArray
    targets: FloatArray
    term_start: IntArray
    term_nodes: IntArray
    pair_nodes: IntArray
