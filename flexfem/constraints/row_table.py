# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows and terms of joints as arrays for the compiled loops."""

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple, Self

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.constraints.lines.joints import LineJoints
from flexfem.constraints.rows.kernels import ON_LINES
from flexfem.constraints.rows.placed_joint import PlacedJoint, RowLayout
from flexfem.constraints.terms.compiled_functions import address, kind_number
from flexfem.core.laws import FRICTION_LAWS, LINEAR_LAWS, LawKind
from flexfem.core.row import Row, RowKind
from flexfem.core.runs import starts

__all__ = ["RowTable"]


class _Shape(NamedTuple):
    """What the rows of one joint or of joints that are alike have in common.

    Attributes:
        counts: number of the terms of each row.
        ends: numbers of both markers of each term within the joint.
        alone: True for terms of one marker, components of its twist.
        calls: True if a row calls a function of the user.
    """

    counts: list[int]
    ends: list[tuple[int, int]]
    alone: list[bool]
    calls: bool

    @classmethod
    def of(cls, rows: Sequence[Row]) -> Self:
        """Look at the rows of a joint."""
        terms = [term for row in rows for term in row.terms]
        return cls(
            [len(row.terms) for row in rows],
            [(term.a, term.b) for term in terms],
            [term.kind is RowKind.TWIST and term.a == term.b for term in terms],
            any(row.calls for row in rows),
        )


class RowTable:
    """Markers, rows, terms and pairs of markers of joints, one after the other.

    Attributes:
        joints: the joints.
        start: (n_joints + 1,) first row of each joint.
        joint_of_row: (r,) its joint.
        marker_start: (n_joints + 1,) first marker of each joint.
        marker_node, marker_offset: (m,) and (m, 12) interface number of a marker's node, frame
            relative to it.
        targets, target_rates: (r,) prescribed values of the rows' sums, and rates for dampers.
        active, switchable: (r,) rows that are not released, and those that may be.
        elastic: (r, 5) law (a ``LawKind``, 0 for rigid), stiffness, damping, two parameters.
        functions: (r,) addresses of the user-defined functions of laws, 0 for none.
        function_data: (r, 9) time (s) and parameters of these functions.
        term_start: (r + 1,) first term of each row.
        row_of_term: (t,) its row.
        kinds, directions, factors: (t,), (t, 3, 3) and (t,) of the terms; a kind is a ``RowKind``
            or the address of a user-defined function.
        angles: (t,) continuous angles at the accepted state.
        term_marker, term_nodes: (t, 2) both markers and the interface numbers of their nodes, -1
            for the second of a term with one marker.
        pair_of_term: (t,) pair of markers of a term, ``pair_nodes`` (p, 2), ``pair_owned`` (p,).
        coupled: (k, 2) rows with friction, and rows whose resultant is the normal force.
        wrapped_rows, wrap_terms, wraps: (w,), (w, 2) and (w, 2) of guides of cables with friction.
        layout: where the rows of each joint are.
        calling: joints whose rows call functions of the user.
        lines: evaluation of the joints with markers on lines; each term here has two nodes of their
            gradients.
    """

    def __init__(self, joints: Sequence[PlacedJoint]) -> None:
        """Tabulate the rows at time 0."""
        self.joints = list(joints)
        listed, alike = self._rows_at_start()
        rows = [row for part in listed for row in part]
        self.start = starts([len(part) for part in listed])
        self.joint_of_row = np.repeat(np.arange(len(listed)), np.diff(self.start))
        distinct = {id(part): part for part in listed}
        shapes = {key: _Shape.of(part) for key, part in distinct.items()}
        found = [shapes[id(part)] for part in listed]
        held = [(sum(j.widths) + 1) // 2 if j.on_lines else 0 for j in self.joints]
        counts = [
            [two] * len(shape.counts) if two else shape.counts
            for two, shape in zip(held, found, strict=True)
        ]
        self.term_start = starts(list(chain.from_iterable(counts)))
        self.row_of_term = np.repeat(np.arange(len(rows)), np.diff(self.term_start))
        self._markers()
        line_rows = np.array([j.on_lines for j in self.joints], dtype=np.bool_)[self.joint_of_row]
        self._connect(found, line_rows[self.row_of_term])
        count, terms = len(rows), len(self.row_of_term)
        self.targets, self.target_rates = np.zeros((2, count))
        self.elastic = np.zeros((count, 5))
        self.functions: IntArray = np.zeros(count, dtype=np.int64)
        self.function_data = np.zeros((count, 9))
        self.switchable: BoolArray = np.array([row.switchable for row in rows], dtype=np.bool_)
        self.active: BoolArray = np.array([row.locked for row in rows], dtype=np.bool_)
        self.kinds: IntArray = np.zeros(terms, dtype=np.int64)
        self.directions = np.zeros((terms, 3, 3))
        self.factors, self.angles = np.zeros(terms), np.zeros(terms)
        self.kinds[line_rows[self.row_of_term]] = ON_LINES
        self.layout = RowLayout(
            self.joints, self.start, self.marker_start, self.marker_node, self.marker_offset,
            self.targets, self.term_start, self.term_nodes, self.pair_nodes,
        )  # fmt: skip
        self.lines = LineJoints(self.layout, listed)
        for i, part in enumerate(listed):
            if not self.joints[i].alike:
                self.write(i, part)
        for numbers in alike.values():
            self._write_alike(numbers, listed[numbers[0]])
        self.calling = [i for i, shape in enumerate(found) if shape.calls]
        self._normals(rows)
        self._wraps(rows)

    def _rows_at_start(self) -> tuple[list[Sequence[Row]], dict[type, list[int]]]:
        """Rows of each joint at time 0, and the numbers of joints whose rows are alike, by class.

        Those have all the rows of the first of them, until their directions are written.
        """
        listed, alike = list[Sequence[Row]](), dict[type, list[int]]()
        for i, placed in enumerate(self.joints):
            if not placed.alike:
                listed.append(placed.rows(0.0))
                continue
            others = alike.setdefault(type(placed.joint), [])
            listed.append(listed[others[0]] if others else placed.rows(0.0))
            others.append(i)
        return listed, alike

    def _markers(self) -> None:
        self.marker_start = starts([len(j.interface_nodes) for j in self.joints])
        nodes = [node for j in self.joints for node in j.interface_nodes]
        self.marker_node: IntArray = np.array(nodes, dtype=np.int64)
        offsets = [j.offsets for j in self.joints]
        self.marker_offset: FloatArray = np.concatenate([np.zeros((0, 12)), *offsets])

    def _connect(self, shapes: Sequence["_Shape"], on_lines: BoolArray) -> None:
        """Markers of every term, and the pairs of markers of every joint that occur.

        Pairs of nodes of joints on lines come last; like these joints' interface nodes they are not
        fixed.
        """
        joint = self.joint_of_row[self.row_of_term]
        ends = np.zeros((len(joint), 2), dtype=np.int64)
        ends[:, 1] = 1
        inner = zip(self.joints, shapes, strict=True)
        listed = [shape for placed, shape in inner if not placed.on_lines]
        markers = list(chain.from_iterable(shape.ends for shape in listed))
        ends[~on_lines] = np.array(markers, dtype=np.int64).reshape(-1, 2)
        self.term_marker: IntArray = self.marker_start[joint][:, np.newaxis] + ends
        self.term_nodes: IntArray = self.marker_node[self.term_marker]
        # components of the twist of one marker, which has its gradients on the first side
        alone = np.zeros(len(joint), dtype=np.bool_)
        alone[~on_lines] = list(chain.from_iterable(shape.alone for shape in listed))
        self.term_nodes[alone, 1] = -1
        simple = np.flatnonzero(~on_lines)
        # one number for both markers of a pair, of which equal ones are found sooner
        a, b = self.term_marker[simple].T
        _, first, number = np.unique(
            a * max(1, len(self.marker_node)) + b, return_index=True, return_inverse=True
        )
        pairs = self.term_marker[simple[first]]
        self.pair_of_term = np.zeros(len(joint), dtype=np.int64)
        self.pair_of_term[simple] = number
        on_line = [(j.pairs, j.owned) for j in self.joints if j.on_lines]
        more = np.full((sum(count for count, _ in on_line), 2), -1, dtype=np.int64)
        self.pair_nodes: IntArray = np.concatenate([self.marker_node[pairs], more])
        owned = np.array([j.owned for j in self.joints], dtype=np.bool_)
        own = [np.full(count, owns, dtype=np.bool_) for count, owns in on_line]
        self.pair_owned: BoolArray = np.concatenate([owned[joint[simple][first]], *own])

    def nodes_of(self, rows: IntArray) -> IntArray:
        """Interface numbers (k,) of the nodes on which some rows act."""
        nodes = np.unique(self.term_nodes[np.isin(self.row_of_term, rows)])
        return nodes[nodes >= 0]

    @property
    def linear(self) -> BoolArray:
        """(r,) rows whose law is linear in value and rate, rigid ones included."""
        return np.isin(self.elastic[:, 0], LINEAR_LAWS)

    @property
    def grounded(self) -> BoolArray:
        """(r,) rows that act on the ground, or on one node alone."""
        held = np.zeros(len(self.active), dtype=np.bool_)
        held[self.row_of_term[(self.term_nodes < 0).any(axis=1)]] = True
        return held

    @property
    def on_lines(self) -> BoolArray:
        """(r,) rows of joints with markers on lines."""
        lines = np.array([placed.on_lines for placed in self.joints], dtype=np.bool_)
        return lines[self.joint_of_row]

    @property
    def frictional(self) -> BoolArray:
        """(r,) rows with a law of friction."""
        return np.isin(self.elastic[:, 0], FRICTION_LAWS)

    def _wraps(self, rows: Sequence[Row]) -> None:
        """Guides of cables with friction, and the terms that give the angles around them."""
        found = [(r, row.wrap) for r, row in enumerate(rows) if row.wrap is not None]
        first = self.start[self.joint_of_row]
        terms = [
            [self.term_start[first[r] + row] + term for row, term in wrap.terms]
            for r, wrap in found
        ]
        self.wrapped_rows: IntArray = np.array([r for r, _ in found], dtype=np.int64)
        self.wrap_terms: IntArray = np.array(terms, dtype=np.int64).reshape(-1, 2)
        starts_at = [(w.coefficient, -1.0 if w.start is None else w.start) for _, w in found]
        self.wraps = np.array(starts_at, dtype=np.float64).reshape(-1, 2)

    def write(self, joint: int, rows: Sequence[Row]) -> None:
        """Set targets, laws and terms of a joint's rows."""
        at = int(self.start[joint])
        t = int(self.term_start[at])
        for i, row in enumerate(rows, start=at):
            self.targets[i], self.target_rates[i] = row.target, row.target_rate
            if row.law is not None:
                law = row.law
                self.elastic[i] = law.kind, law.stiffness, law.damping, law.first, law.second
                if law.function is not None:
                    self.functions[i] = address(law.function)
                    given = law.function.parameters
                    self.function_data[i, 1 : 1 + len(given)] = given
        if self.joints[joint].on_lines:
            self.lines.write(joint, rows)
            return
        for row in rows:
            for term in row.terms:
                self.kinds[t], self.factors[t] = kind_number(term), term.factor
                self.directions[t] = term.data
                t += 1

    def _write_alike(self, joints: Sequence[int], rows: Sequence[Row]) -> None:
        """Set the terms of joints whose rows are alike, those of the first of them."""
        placed = [self.joints[i] for i in joints]
        rotations = np.array([[pose.rotation for pose in one.poses] for one in placed])
        data = type(placed[0].joint).directions([one.joint for one in placed], rotations)
        first = self.term_start[self.start[np.asarray(joints)]]
        at = first[:, np.newaxis] + np.arange(data.shape[1])
        terms = [term for row in rows for term in row.terms]
        self.kinds[at], self.directions[at] = [kind_number(term) for term in terms], data
        self.factors[at] = [term.factor for term in terms]

    def _normals(self, rows: Sequence[Row]) -> None:
        """Rows that friction depends on.

        Their resultant is the normal force: the rigid translational ones of the partner. Their sum
        is the tension of a cable: the whole cable's, and those of the guides after this one.
        """
        around = self.elastic[:, 0] == LawKind.CAPSTAN
        rubbing = np.flatnonzero(around | (self.elastic[:, 0] == LawKind.NORMAL_FRICTION))
        self.coupled: IntArray = np.zeros((0, 2), dtype=np.int64)
        if not len(rubbing):
            return
        number = {id(placed.joint): i for i, placed in enumerate(self.joints)}
        moving = np.array(
            [row.terms[0].kind in (RowKind.INERTIAL, RowKind.ALONG) for row in rows], dtype=np.bool_
        )
        pressing = moving & (self.elastic[:, 0] == LawKind.RIGID)
        pairs = []
        for r in rubbing:
            if around[r]:
                first, last = r, r + 1
                while around[first]:
                    first -= 1
                while last < len(around) and around[last]:
                    last += 1
                found = np.array([first, *range(r + 1, last)])
                pairs.append(np.stack([np.full(len(found), r), found], axis=1))
                continue
            i = number[id(self.joints[self.joint_of_row[r]].joint.partner)]
            found = self.start[i] + np.flatnonzero(pressing[self.start[i] : self.start[i + 1]])
            pairs.append(np.stack([np.full(len(found), r), found], axis=1))
        self.coupled = np.concatenate(pairs)
