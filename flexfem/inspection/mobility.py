# SPDX-License-Identifier: LGPL-3.0-or-later
"""Degrees of freedom, constraints, and the motions that joints leave."""

from dataclasses import dataclass

import numpy as np

from flexfem._fields import Renamed
from flexfem._types import BoolArray, IntArray
from flexfem.inspection.inspection import Inspection
from flexfem.joints.elastic_lock import ElasticLock
from flexfem.kinematics.start_rows import StartRows
from flexfem.la.dependence import NodeRows, dependence_count

__all__ = ["Mobility", "free_motions", "holding", "mobility", "part_rows"]

#: Bodies up to which all their motions are computed.
_FEW = 100
#: Singular values that are zero; component of a motion of length one that is none.
_ZERO, _PART = 1e-9, 1e-6


@dataclass(frozen=True)
class Mobility:
    """Counts of degrees of freedom and constraints at the start.

    Attributes:
        unknowns: of all nodes.
        fixed: fixed unknowns: edges of shells, and unused components of amplitudes.
        constraints: rows of joints that hold.
        redundant: constraints that follow from the others.
        bodies: rigid-body parts; bodies with common nodes are one.
        supports: motions of such bodies that fixed edges and nodes of shells prevent.
        whole_constraints: rows of joints between them.
        motions: of the rigid-body parts that joints and supports leave, by rank.
    """

    unknowns: int
    fixed: int
    constraints: int
    redundant: int
    bodies: int
    supports: int
    whole_constraints: int
    motions: int

    @property
    def degrees_of_freedom(self) -> int:
        """Degrees of freedom that are left: unknowns less independent constraints."""
        return self.unknowns - self.fixed - self.constraints + self.redundant

    freedoms = Renamed("degrees_of_freedom")
    held = Renamed("fixed")

    @property
    def grubler(self) -> int:
        """Mobility of the rigid-body parts by counting (Gruebler, Kutzbach)."""
        return 6 * self.bodies - self.supports - self.whole_constraints


def mobility(inspection: Inspection) -> Mobility:
    """Count the degrees of freedom of a model at the start."""
    rows = inspection.rows
    rigid = rows.rows.rigid
    of_nodes = rows.on_nodes(rigid)
    whole = part_rows(inspection, rows, rigid)
    count = int(_between(rows, rigid).sum())
    supports, lines = len(rows.supports().row), len(inspection.parts.lines)
    bodies = len(inspection.parts)
    facts = inspection.bodies
    return Mobility(
        unknowns=sum(one.unknowns for one in facts),
        fixed=sum(one.fixed for one in facts),
        constraints=int(rigid.sum()),
        redundant=dependence_count(of_nodes),
        bodies=bodies,
        supports=supports,
        whole_constraints=count,
        motions=6 * bodies - (count + supports + lines - dependence_count(whole)),
    )


def part_rows(inspection: Inspection, joints: StartRows, chosen: BoolArray) -> NodeRows:
    """Chosen rows (r,) of joints and the supports of shells, on the rigid-body parts.

    Behind them are those of rotations that move nothing. Rotations count as displacements of
    points one characteristic length away.
    """
    of_joints = joints.on_parts(_between(joints, chosen))
    supports, lines = joints.supports(), joints.lines()
    first = int(of_joints.row.max(initial=-1)) + 1
    last = first + len(supports.row)
    gradient = np.concatenate([of_joints.gradient, supports.gradient, lines.gradient])
    gradient[..., 3:] /= inspection.scale
    return NodeRows(
        np.concatenate([of_joints.row, first + supports.row, last + lines.row]),
        np.concatenate([of_joints.nodes, supports.nodes, lines.nodes]),
        gradient,
    )


def holding(inspection: Inspection) -> BoolArray:
    """(r,) rows that hold a value or resist like springs."""
    rows = inspection.rows.rows
    return rows.rigid | rows.pulling


def _between(joints: StartRows, chosen: BoolArray) -> BoolArray:
    """The chosen rows (r,) but for the locks inside bodies in floating frames."""
    outer = np.array([not isinstance(j, ElasticLock) for j in joints.joints], dtype=np.bool_)
    kept: BoolArray = chosen & outer[joints.rows.joint_of_row]
    return kept


def free_motions(inspection: Inspection, chosen: BoolArray) -> tuple[int, IntArray]:
    """Number of motions of the rigid-body parts that rows leave, and the parts that move.

    The parts that move are named for models with few bodies only, from singular values of all rows.
    """
    rows, count = part_rows(inspection, inspection.rows, chosen), len(inspection.parts)
    total = int(rows.row.max(initial=-1)) + 1
    if count > _FEW:
        return 6 * count - (total - dependence_count(rows)), np.arange(count)
    matrix = np.zeros((total, count + 1, 6))  # the ground comes last
    for side in range(2):
        np.add.at(matrix, (rows.row, rows.nodes[:, side]), rows.gradient[:, side])
    _, sizes, right = np.linalg.svd(matrix[:, :-1].reshape(total, 6 * count), full_matrices=True)
    motions = right[int((sizes > _ZERO).sum()) :].reshape(-1, count, 6)
    moving = np.abs(motions).max(axis=(0, 2), initial=0.0) > _PART
    return len(motions), np.flatnonzero(moving)
