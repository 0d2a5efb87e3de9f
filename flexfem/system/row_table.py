# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows and terms of joints as arrays, as the compiled loops read them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.joint import Joint
from flexfem.core.pose import Pose
from flexfem.core.row import LawKind, Row, RowKind

__all__ = ["PlacedJoint", "RowTable"]


@dataclass(frozen=True)
class PlacedJoint:
    """A joint that this rank evaluates.

    Attributes:
        joint: its declaration.
        index: number of the joint in the model.
        poses: poses of its markers at the start.
        slots: interface slots of the nodes that carry its markers, -1 for ground.
        offsets: (n, 12) markers relative to their nodes (absolute frames for ground).
        owned: this rank owns its multipliers.
        shared: another rank evaluates it too.
    """

    joint: Joint
    index: int
    poses: tuple[Pose, ...]
    slots: tuple[int, ...]
    offsets: FloatArray
    owned: bool
    shared: bool

    def rows(self, t: float) -> tuple[Row, ...]:
        """Rows at time t."""
        return self.joint.rows(self.poses, t)


class RowTable:
    """Markers, rows, terms and pairs of markers of joints, one after the other.

    Attributes:
        joints: the joints.
        start: (n_joints + 1,) first row of each joint.
        joint_of_row: (r,) its joint.
        marker_start: (n_joints + 1,) first marker of each joint.
        marker_slot, marker_offset: (m,) and (m, 12) slot of its node, frame relative to it.
        targets: (r,) values that the rows' sums take.
        active, switchable: (r,) rows that are not released, and those that may be.
        elastic: (r, 5) law (a ``LawKind``, 0 for rigid), stiffness, damping, two parameters.
        term_start: (r + 1,) first term of each row.
        row_of_term: (t,) its row.
        kinds, directions, factors: (t,), (t, 3, 3) and (t,) of the terms.
        angles: (t,) continuous angles at the accepted state.
        term_marker, term_slots: (t, 2) both markers and the slots of their nodes.
        pair_of_term: (t,) pair of markers of a term, ``pair_slots`` (p, 2), ``pair_owned`` (p,).
        coupled: (k, 2) rows with friction, and rows whose resultant presses on them.
    """

    def __init__(self, joints: Sequence[PlacedJoint]) -> None:
        """Tabulate the rows at time 0."""
        self.joints = list(joints)
        listed = [j.rows(0.0) for j in self.joints]
        rows = [row for part in listed for row in part]
        self.start = _starts([len(part) for part in listed])
        self.joint_of_row = np.repeat(np.arange(len(listed)), np.diff(self.start))
        self.term_start = _starts([len(row.terms) for row in rows])
        self.row_of_term = np.repeat(np.arange(len(rows)), np.diff(self.term_start))
        self._markers()
        self._connect(rows)
        count, terms = len(rows), len(self.row_of_term)
        self.targets, self.elastic = np.zeros(count), np.zeros((count, 5))
        self.switchable: BoolArray = np.array([row.switchable for row in rows], dtype=np.bool_)
        self.active: BoolArray = np.array([row.locked for row in rows], dtype=np.bool_)
        self.kinds: IntArray = np.zeros(terms, dtype=np.int64)
        self.directions = np.zeros((terms, 3, 3))
        self.factors, self.angles = np.zeros(terms), np.zeros(terms)
        self.write(0, rows)
        self._normals()

    def _markers(self) -> None:
        self.marker_start = _starts([len(j.slots) for j in self.joints])
        slots = [slot for j in self.joints for slot in j.slots]
        self.marker_slot: IntArray = np.array(slots, dtype=np.int64)
        offsets = [j.offsets for j in self.joints]
        self.marker_offset: FloatArray = np.concatenate([np.zeros((0, 12)), *offsets])

    def _connect(self, rows: Sequence[Row]) -> None:
        """Markers of every term, and the pairs of markers of every joint that occur."""
        ends = np.array([(t.a, t.b) for row in rows for t in row.terms], dtype=np.int64)
        joint = self.joint_of_row[self.row_of_term]
        self.term_marker: IntArray = self.marker_start[joint][:, np.newaxis] + ends.reshape(-1, 2)
        self.term_slots: IntArray = self.marker_slot[self.term_marker]
        pairs, first, self.pair_of_term = np.unique(
            self.term_marker, axis=0, return_index=True, return_inverse=True
        )
        self.pair_of_term = self.pair_of_term.reshape(-1)
        self.pair_slots: IntArray = self.marker_slot[pairs]
        owned = np.array([j.owned for j in self.joints], dtype=np.bool_)
        self.pair_owned: BoolArray = owned[joint[first]]

    def write(self, at: int, rows: Sequence[Row]) -> None:
        """Set targets, laws and terms of consecutive rows."""
        t = int(self.term_start[at])
        for i, row in enumerate(rows, start=at):
            self.targets[i] = row.target
            if row.law is not None:
                law = row.law
                self.elastic[i] = law.kind, law.stiffness, law.damping, law.first, law.second
            for term in row.terms:
                self.kinds[t], self.factors[t] = term.kind, term.factor
                self.directions[t] = term.u, term.v, term.p
                t += 1

    def _normals(self) -> None:
        """Rows whose resultant presses: the rigid translational ones of the partner."""
        number = {id(placed.joint): i for i, placed in enumerate(self.joints)}
        moving = np.isin(self.kinds[self.term_start[:-1]], (RowKind.INERTIAL, RowKind.ALONG))
        pressing = moving & (self.elastic[:, 0] == LawKind.RIGID)
        pairs = [np.zeros((0, 2), dtype=np.int64)]
        for r in np.flatnonzero(self.elastic[:, 0] == LawKind.NORMAL_FRICTION):
            i = number[id(self.joints[self.joint_of_row[r]].joint.partner)]
            found = self.start[i] + np.flatnonzero(pressing[self.start[i] : self.start[i + 1]])
            pairs.append(np.stack([np.full(len(found), r), found], axis=1))
        self.coupled: IntArray = np.concatenate(pairs)


def _starts(counts: Sequence[int]) -> IntArray:
    """Where each of several consecutive runs begins, and the end."""
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
