# SPDX-License-Identifier: LGPL-3.0-or-later
"""Constraint equations of all joints at the start, on nodes and on rigidly moving bodies."""

from collections.abc import Sequence
from functools import cached_property

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.constraints.batch import Constraints
from flexfem.constraints.connect import all_ends, connect_alone
from flexfem.constraints.node_table import NodeTable
from flexfem.core.joint import Joint
from flexfem.core.pose import Pose
from flexfem.kinematics.rigid_parts import RigidParts
from flexfem.la.dependence import NodeRows
from flexfem.layout.node_key import NodeKey, by_kind
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3

__all__ = ["StartRows"]

#: Rates and forces of rows count as they are.
_UNIT = np.array([1.0, 1.0])
#: Singular values below this part of the largest count as zero.
_ZERO = 1e-9


class StartRows:
    """Rows of all joints, evaluated at the start; nothing is distributed over ranks.

    Attributes:
        joints: the joints, those of lines as their parts, with the locks of bodies in floating
            frames.
    """

    def __init__(
        self, serial: NumberedModel, parts: RigidParts, numbers: Sequence[int] | None = None
    ) -> None:
        """Place the joints; with ``numbers`` only some of them.

        Raises:
            ValueError: a slider is not on its line, or a joint has no row.
        """
        self._serial, self._parts = serial, parts
        joints, ends = serial.body_joints, all_ends(serial)
        chosen = range(len(joints)) if numbers is None else numbers
        self.joints: list[Joint] = [joints[i] for i in chosen]
        self._ends = [ends[i] for i in chosen]

    @cached_property
    def rows(self) -> Constraints:
        """Their rows, joint by joint in this order; large, and made when they are asked for."""
        keys = list(dict.fromkeys(key for one in self._ends for key in one.keys))
        table = _table(self._serial, keys)
        placed = connect_alone(self.joints, self._ends, table)
        # a table of nodes is all that the rows need of an interface
        rows = Constraints(MPI.COMM_SELF, placed, table)  # type: ignore[arg-type]
        own = {joint.name for joint in self.joints}
        for name in self._serial.model.released:
            if name in own:
                rows.set_active(name, False)
        _evaluate(rows, 0.0)
        return rows

    @property
    def rigid(self) -> bool:
        """True if each row is a constraint equation: no joint has a law or is released."""
        return not self._serial.model.released and all(ends.rigid for ends in self._ends)

    @property
    def driven(self) -> bool:
        """True if a drive moves some of them."""
        return any(joint.driven for joint in self.joints)

    @property
    def poses(self) -> list[tuple[Pose, ...]]:
        """Poses of the markers of each joint."""
        return [ends.poses for ends in self._ends]

    def at(self, t: float) -> None:
        """Evaluate the rows with the drives of time t (s), bodies at their start."""
        _evaluate(self.rows, t)

    def on_nodes(self, chosen: BoolArray) -> NodeRows:
        """Gradients of chosen rows (r,) with respect to twists of nodes."""
        terms, row = self._chosen(chosen)
        return NodeRows(row, self.rows.term_nodes[terms], self.rows.force_jacobian[terms])

    def on_parts(self, chosen: BoolArray) -> NodeRows:
        """Gradients of chosen rows (r,) with respect to twists of the rigid-body parts."""
        terms, row = self._chosen(chosen)
        nodes = self.rows.term_nodes[terms]
        part, carried = self._carriers(self.rows.interface.keys, self.rows.interface.frames)
        # the ground comes last
        part, carried = np.append(part, -1), np.concatenate([carried, np.zeros((1, 6, 6))])
        gradient = np.einsum("tsi,tsij->tsj", self.rows.force_jacobian[terms], carried[nodes])
        return NodeRows(row, part[nodes], gradient)

    def supports(self) -> NodeRows:
        """Independent rows of the rigid motions that fixed edges and nodes of shells prevent."""
        gradients, parts = [np.zeros((0, 6))], [np.zeros(0, dtype=np.int64)]
        for kind, family in self._serial.families.items():
            nodes, directions = family.supports()
            part, carried = self._carriers(
                [(kind, n) for n in nodes.tolist()], family.frames[nodes]
            )
            gradients.append(np.einsum("ni,nij->nj", directions, carried))
            parts.append(part)
        part, gradient = _independent(np.concatenate(parts), np.concatenate(gradients))
        both = np.stack([gradient, np.zeros_like(gradient)], axis=1)
        ends = np.stack([part, np.full_like(part, -1)], axis=1)
        return NodeRows(np.arange(len(part)), ends, both)

    def lines(self) -> NodeRows:
        """Rows of the rotations that move nothing: of points on one line, without axes, about it.

        A straight net of cables has five rigid motions.
        """
        lines = self._parts.lines
        gradient = np.zeros((len(lines), 2, 6))
        ends = np.full((len(lines), 2), -1, dtype=np.int64)
        for row, (part, axis) in enumerate(lines.items()):
            ends[row, 0], gradient[row, 0, 3:] = part, axis
        return NodeRows(np.arange(len(lines)), ends, gradient)

    def _chosen(self, chosen: BoolArray) -> tuple[IntArray, IntArray]:
        """Terms of chosen rows, and their rows numbered from zero."""
        terms = np.flatnonzero(chosen[self.rows.row_of_term])
        number = np.cumsum(chosen) - 1
        return terms, number[self.rows.row_of_term[terms]]

    def _carriers(self, keys: Sequence[NodeKey], frames: FloatArray) -> tuple[IntArray, FloatArray]:
        """Part (n,) that carries each node, and maps (n, 6, 6) from its twist to the node's."""
        serial, parts = self._serial, self._parts
        part, rest = np.zeros(len(keys), dtype=np.int64), np.zeros(len(keys), dtype=np.bool_)
        for kind, at, nodes in by_kind(keys):
            bodies = serial.families[kind].bodies
            part[at] = [parts.number[bodies[i].name] for i in serial.bodies(kind, nodes).tolist()]
            rest[at] = ~serial.families[kind].placed[nodes]
        relative = se3.compose(se3.inverse(parts.frames[part]), frames)
        carried = se3.adjoint(se3.inverse(relative)).reshape(-1, 6, 6)
        carried[rest] = 0.0  # amplitudes are at rest in the body
        return part, carried


def _evaluate(rows: Constraints, t: float) -> None:
    """Evaluate rows with the drives of time t (s)."""
    rows.set_time(t)
    rows.multipliers[:] = 0.0
    rows.evaluate(_UNIT)


def _independent(part: IntArray, gradient: FloatArray) -> tuple[IntArray, FloatArray]:
    """As many rows for each part as are independent."""
    parts, rows = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 6))]
    for number in np.unique(part):
        _, sizes, right = np.linalg.svd(gradient[part == number], full_matrices=False)
        kept = right[sizes > _ZERO * sizes.max(initial=0.0)]
        rows.append(kept)
        parts.append(np.full(len(kept), number))
    return np.concatenate(parts), np.concatenate(rows)


def _table(serial: NumberedModel, keys: Sequence[NodeKey]) -> NodeTable:
    """The nodes at the start."""
    count = len(keys)
    frames, velocities = np.zeros((count, 12)), np.zeros((count, 6))
    held, width = np.zeros((count, 6), dtype=np.bool_), np.full(count, 6, dtype=np.int64)
    for kind, at, nodes in by_kind(keys):
        family = serial.families[kind]
        frames[at], velocities[at] = family.frames[nodes], family.velocities[nodes]
        own = family.held[nodes]
        width[at] = own.shape[1]
        held[at, : own.shape[1]] = own
    return NodeTable(keys, frames, velocities, held, width)
