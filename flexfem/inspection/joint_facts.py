# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints of a model: bodies that they connect, and numbers of constraint equations."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.core.joint import Joint
from flexfem.core.row import RowKind
from flexfem.joints.elastic_lock import ElasticLock
from flexfem.kinematics.start_rows import StartRows

__all__ = ["ROLES", "JointFacts", "joint_facts", "turning_rows"]

#: Functions of joints, in the order of the summary.
ROLES = ("joints", "drives", "forces", "locks")


@dataclass(frozen=True)
class JointFacts:
    """A joint in numbers.

    Attributes:
        name: of the joint.
        kind: its class.
        role: "joints"; "drives", which move; "forces": springs, stops, friction, actuators;
            "locks" that bodies in one plane have.
        ends: connected markers.
        constraints: rows that hold at the start.
        laws: rows with a force law.
        open: rows that may hold later.
        gap: violation of its rows in position, m, and
        tilt: in direction, rad.
    """

    name: str
    kind: str
    role: str
    ends: tuple[str, ...]
    constraints: int
    laws: int
    open: int
    gap: float
    tilt: float


def joint_facts(rows: StartRows, declared: Sequence[Joint]) -> list[JointFacts]:
    """Joints as they are declared in the model, then the locks of its bodies in one plane."""
    table, turning = rows.rows, turning_rows(rows)
    locks = [joint for joint in rows.joints if isinstance(joint, ElasticLock)]
    # joints of lines are several under one name
    of_name: dict[tuple[str, bool], list[int]] = {}
    for i, joint in enumerate(rows.joints):
        of_name.setdefault((joint.name, isinstance(joint, ElasticLock)), []).append(i)
    gaps = _lengths(rows, turning)
    facts = []
    for joint in (*declared, *locks):
        placed = of_name[joint.name, isinstance(joint, ElasticLock)]
        own = np.concatenate([np.arange(table.start[i], table.start[i + 1]) for i in placed])
        held = int(table.rigid[own].sum())
        laws = int((table.elastic[own, 0] > 0.0).sum())
        turns, gap = turning[own], gaps[own]
        facts.append(
            JointFacts(
                joint.name, type(joint).__name__, _role(joint, held, len(own) - laws),
                tuple(str(marker) for marker in joint.markers), held, laws,
                len(own) - held - laws, float(gap[~turns].max(initial=0.0)),
                float(gap[turns].max(initial=0.0)),
            )
        )  # fmt: skip
    return facts


def turning_rows(rows: StartRows) -> BoolArray:
    """(r,) rows that are about directions, not positions."""
    table = rows.rows
    turning = np.isin(table.kinds[table.term_start[:-1]], (RowKind.AXES, RowKind.ANGLE))
    for i in table.lines.joints:  # whose terms in the table are of all nodes of a line
        terms = [row.terms[0] for row in table.joints[i].rows(0.0)]
        turning[table.start[i] : table.start[i + 1]] = [
            term.kind in (RowKind.AXES, RowKind.ANGLE) for term in terms
        ]
    return turning


def _lengths(rows: StartRows, turning: BoolArray) -> FloatArray:
    """(r,) violations of rows, together with the others of the same pair of markers."""
    table = rows.rows
    first = table.term_start[:-1]
    pair = np.column_stack([table.term_marker[first], turning])
    _, number = np.unique(pair, axis=0, return_inverse=True)
    squares = np.bincount(number.reshape(-1), (table.values * table.rigid) ** 2)
    lengths: FloatArray = np.sqrt(squares)[number.reshape(-1)] * table.rigid
    return lengths


def _role(joint: Joint, held: int, rigid: int) -> str:
    if isinstance(joint, ElasticLock):
        return "locks"
    if not (held or rigid):
        return "forces"
    return "drives" if joint.driven else "joints"
