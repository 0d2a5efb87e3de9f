# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints with markers that lie on lines between nodes, or slide on them.

They are evaluated by the loops of ``kernels``, which write their gradients into the terms of the
table of rows, two nodes a term. These nodes change when a slider passes from element to element.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.constraints.lines.data import JointsOnLines
from flexfem.constraints.lines.hessians import add_line_hessians
from flexfem.constraints.lines.kernels import (
    add_line_wrenches,
    evaluate_lines,
    place_lines,
    put_interface_nodes,
    slider_motions,
    update_line_angles,
)
from flexfem.constraints.rows.placed_joint import RowLayout
from flexfem.constraints.terms.compiled_functions import kind_number
from flexfem.core.row import Row, RowKind
from flexfem.core.runs import starts
from flexfem.layout.lines import Line, Rail

__all__ = ["LineJoints"]


class LineJoints:
    """The joints of this rank with markers on lines.

    Attributes:
        joints: (n,) numbers of the joints in the table.
        own: lines, markers and rows in the format of the compiled loops.
        version: number of times that a slider has passed from one element to another.
    """

    def __init__(self, table: RowLayout, rows: Sequence[Sequence[Row]]) -> None:
        """Collect lines, markers and rows; ``rows`` are those of all joints of the table."""
        self._table = table
        self.joints = [i for i, joint in enumerate(table.joints) if joint.on_lines]
        self._number = {joint: c for c, joint in enumerate(self.joints)}
        self.version = 0
        found = {
            id(point.rail): point.rail
            for i in self.joints
            for point in table.joints[i].points
            if point is not None
        }
        numbers = {key: n for n, key in enumerate(found)}
        lines = _lines(list(found.values()))
        points = self._points(numbers, lines["first_element"])
        self.own = JointsOnLines(
            **lines, **points, **self._rows(rows), **self._work(points, lines["nodes"].shape[1]),
            sums=np.zeros(int(table.start[-1])),
        )  # fmt: skip
        self._connect()

    def _points(self, numbers: dict[int, int], first_element: IntArray) -> dict[str, Any]:
        """Markers of the joints and the number of nodes that each depends on.

        Args:
            numbers: numbers of the lines.
            first_element: of each line.
        """
        table = self._table
        markers: list[int] = []
        columns: list[int] = []
        line, slides, places = [], [], []
        joints = [table.joints[i] for i in self.joints]
        for i, joint in zip(self.joints, joints, strict=True):
            markers += range(table.marker_start[i], table.marker_start[i + 1])
            columns += starts(joint.widths)[:-1].tolist()
            for point in joint.points:
                number = 0 if point is None else numbers[id(point.rail)]
                line.append(number)
                slides.append(point is not None and point.slides)
                place = (0.0, 0.0) if point is None else (point.element, point.xi)
                places.append((first_element[number] + place[0], place[1]))
        accepted = np.array(places, dtype=np.float64).reshape(-1, 2)
        index = np.array(markers, dtype=np.int64)
        width = np.array([sum(joint.widths) for joint in joints], dtype=np.int64)
        pairs = width * (width - 1) // 2
        return {
            "first_marker": starts([len(joint.interface_nodes) for joint in joints]),
            "marker": index,
            "interface_node": table.marker_node[index],
            "offset": table.marker_offset[index],
            "line": np.array(line, dtype=np.int64),
            "slides": np.array(slides, dtype=np.bool_),
            "column": np.array(columns, dtype=np.int64),
            "accepted": accepted,
            "places": accepted.copy(),
            "width": width,
            "first_pair": len(table.pair_nodes) - int(pairs.sum()) + np.cumsum(pairs) - pairs,
        }

    def _rows(self, rows: Sequence[Sequence[Row]]) -> dict[str, Any]:
        """Rows of the joints with their own terms."""
        table = self._table
        own = [row for i in self.joints for row in rows[i]]
        terms = [term for row in own for term in row.terms]
        numbers = [np.arange(table.start[i], table.start[i + 1]) for i in self.joints]
        index = np.concatenate([np.empty(0, dtype=np.int64), *numbers]).astype(np.int64)
        return {
            "first_row": starts([len(rows[i]) for i in self.joints]),
            "row": index,
            "entry": table.term_start[index],
            "first_term": starts([len(row.terms) for row in own]),
            "kinds": np.array([kind_number(term) for term in terms], dtype=np.int64),
            "directions": np.zeros((len(terms), 3, 3)),
            "factors": np.zeros(len(terms)),
            "angles": np.zeros(len(terms)),
            "ends": np.array([(t.a, t.b) for t in terms], dtype=np.int64).reshape(-1, 2),
        }

    @staticmethod
    def _work(points: dict[str, Any], k: int) -> dict[str, Any]:
        """Work space for these markers on elements of k nodes at most."""
        nodes = int(points["width"].max(initial=0))
        markers = int(np.diff(points["first_marker"]).max(initial=0))
        size = 6 * nodes + 1
        return {
            "sections": np.zeros((k, 12)),
            "section": np.zeros(6 * (6 * k + 1)),
            "block": np.zeros((6 * k + 1) ** 2),
            "point": np.zeros((len(points["width"]), markers, 6, size)),
            "forces": np.zeros(6 * markers),
            "hessian": np.zeros((6 * markers, 6 * markers)),
            "slide": np.zeros((len(points["width"]), size)),
            "gradient": np.zeros(size),
            "second": np.zeros((size, size)),
            "space": np.zeros((6 * nodes) ** 2),
            "term": np.zeros(12),
            "term_second": np.zeros((12, 12)),
            "scratch": np.zeros((5, 3)),
        }

    def write(self, joint: int, rows: Sequence[Row]) -> None:
        """Set the terms of a joint's rows; ``joint`` is its number in the table.

        Rows locked at the start are locked at the initial place of their slider.
        """
        c = self._number[joint]
        own = self.own
        t = int(own.first_term[own.first_row[c]])
        for number, row in enumerate(rows, start=int(self._table.start[joint])):
            for term in row.terms:
                own.factors[t] = term.factor
                own.directions[t] = term.data
                t += 1
                if row.switchable and term.kind is RowKind.ARC:
                    at = int(own.first_marker[c]) + term.a
                    zeta = float(self._arcs(own.accepted[at : at + 1])[0])
                    self._table.targets[number] += term.factor * zeta

    @property
    def directions(self) -> FloatArray:
        """(t, 3, 3) directions of the terms of these joints, see ``RowTable``."""
        return self.own.directions

    def _arcs(self, places: FloatArray) -> FloatArray:
        """Arc lengths (n,) from the starts of lines to places (n, 2) on them, m."""
        element, xi = places.T
        line = element.astype(np.int64)
        along = np.zeros(len(places))
        for coefficients in self.own.arc[line].T[::-1]:
            along = along * xi + coefficients
        along += self.own.start[line]
        return along

    def accepted_places(self) -> FloatArray:
        """(m, 2) accepted places of all markers: element counted on its line, and xi in it."""
        return self.own.accepted - self._offsets()

    def doubts(self, places: FloatArray) -> str:
        """Message that places are not on their lines; empty if they are."""
        counts = np.diff(self.own.first_element)[self.own.line]
        inside = (places[:, 0] >= 0.0) & (places[:, 0] < counts) & (places[:, 0] % 1.0 == 0.0)
        return "" if inside.all() else '"places/places" has one that is not on its line'

    def restore_places(self, places: FloatArray) -> None:
        """Restore a result of :meth:`accepted_places`."""
        self.own.accepted[:] = places + self._offsets()

    def _offsets(self) -> FloatArray:
        """Offsets (m, 2) from elements of lines to their numbers on this rank."""
        first = self.own.first_element[self.own.line]
        return np.stack([first, np.zeros_like(first)], axis=1).astype(np.float64)

    @property
    def angles(self) -> FloatArray:
        """(t,) continuous angles of the joints' terms at the accepted state."""
        return self.own.angles

    def angles_of(self, joint: int) -> FloatArray:
        """Those of one joint, by its number in the table."""
        c, own = self._number[joint], self.own
        terms = own.first_term[own.first_row[c : c + 2]]
        return own.angles[terms[0] : terms[1]]

    @property
    def sums(self) -> FloatArray:
        """(r,) sums of terms of all rows, zero for those of other joints."""
        return self.own.sums

    @property
    def places(self) -> FloatArray:
        """(m, 2) element (among those of all lines) and coordinate of all markers.

        They are those of the last evaluation.
        """
        return self.own.places

    def counts(self, what: str) -> IntArray:
        """Number of "places" or of "line_terms" of every joint of the table."""
        result = np.zeros(len(self._table.joints), dtype=np.int64)
        own = self.own
        first = own.first_marker if what == "places" else own.first_term[own.first_row]
        result[self.joints] = np.diff(first)
        return result

    @property
    def nodes(self) -> IntArray:
        """Interface numbers of all nodes of the lines."""
        nodes = np.unique(self.own.nodes)
        return nodes[nodes >= 0]

    @property
    def sliding(self) -> bool:
        """True if a marker slides."""
        return bool(self.own.slides.any())

    def numbers(self, joints: Sequence[int]) -> IntArray:
        """Numbers (n,) among the joints on lines of joints of the table."""
        return np.array([self._number[joint] for joint in joints], dtype=np.int64)

    def arcs(self, numbers: IntArray) -> FloatArray:
        """Arc lengths (n,) of the sliders of joints at the last evaluation, m.

        Args:
            numbers: (n,) of the joints, see :meth:`numbers`.
        """
        return self._arcs(self.own.places[self.own.first_marker[numbers]])

    def motions(
        self, joints: Sequence[int], frames: FloatArray, velocities: FloatArray
    ) -> FloatArray:
        """Sections at the sliders of joints, (n, 20).

        Args:
            joints: their numbers in the table.
            frames: (n, 12) of all interface nodes.
            velocities: (n, 6) their local twists.

        Returns:
            Frame and local twist of the section, arc length of the slider (m) and its rate (m/s).
        """
        out = np.empty((len(joints), 20))
        if len(joints):
            places, poses = self.places.copy(), np.zeros((len(self._table.marker_node), 12))
            numbers = self.numbers(joints)
            for c in numbers.tolist():
                place_lines(self.own.memory, c, c + 1, frames, poses, places)
            slider_motions(self.own.memory, numbers, velocities, poses, places, out)
        return out

    def evaluate(self, frames: FloatArray, poses: FloatArray, gradients: FloatArray) -> None:
        """Sums, gradients and poses of markers at the given frames of all interface nodes.

        Args:
            frames: (n, 12); also those of later calls of the other methods.
            poses: (m, 12) of all markers; those of these joints are set.
            gradients: (t, 2, 6) of all terms; those of these joints are set.
        """
        if not self.joints:
            return
        self._frames, self._poses = frames, poses
        elements = self.places[:, 0].copy()
        self._place()
        evaluate_lines(self.own.memory, poses, gradients)
        if (elements != self.places[:, 0]).any():
            self._connect()
            self.version += 1

    def _place(self) -> None:
        """Place all markers at the frames of the last evaluation."""
        own = self.own
        place_lines(own.memory, 0, len(self.joints), self._frames, self._poses, own.places)

    def _connect(self) -> None:
        """Write the interface nodes of the nodes that terms and pairs of nodes refer to."""
        table = self._table
        if self.joints:
            put_interface_nodes(self.own.memory, table.term_nodes, table.pair_nodes)

    def accept(self) -> None:
        """Accept the state of the last evaluation."""
        if self.joints:
            self.own.accepted[:] = self.own.places
            update_line_angles(self.own.memory, self._poses)

    def _hessian(self, c: int, weights: FloatArray) -> FloatArray:
        """(6 n, 6 n) second derivative of a weighted sum of the rows of the c-th of the joints."""
        size, own = 6 * int(self.own.width[c]), self.own
        place_lines(own.memory, c, c + 1, self._frames, self._poses, own.places)
        nothing = np.empty((0, 12, 12))
        add_line_hessians(own.memory, c, c + 1, weights, self._frames, self._poses, nothing)
        return own.space[: size * size].reshape(size, size).copy()

    def add_hessians(self, factor: FloatArray, out: FloatArray) -> None:
        """Add ``sum_rows factor d(gradient)`` to the blocks (12, 12) of the pairs of nodes."""
        if self.joints:
            self._place()
            add_line_hessians(
                self.own.memory, 0, len(self.joints), factor, self._frames, self._poses, out
            )

    def _interface_nodes(self, c: int) -> IntArray:
        """(n,) interface nodes of the c-th of the joints, in the order of its rows' terms."""
        first = self.own.entry[self.own.first_row[c]]
        count = int(self.own.width[c])
        return self._table.term_nodes[first : first + (count + 1) // 2].reshape(-1)[:count]

    def add_second_rates(self, velocities: FloatArray, out: FloatArray) -> None:
        """Add the second time derivatives (r,) of all rows at constant local velocities."""
        for c, i in enumerate(self.joints):
            v = velocities[self._interface_nodes(c)].ravel()
            for r in range(self._table.start[i], self._table.start[i + 1]):
                out[r] += v @ self._hessian(c, np.eye(1, len(out), r)[0]) @ v

    def add_dampers(
        self, slopes: FloatArray, velocities: FloatArray, by_step: FloatArray,
        force_jacobian: FloatArray, step_jacobian: FloatArray,
    ) -> None:  # fmt: skip
        """Add the dependence of rates on positions, see ``constraints.rows.hessians.add_dampers``.

        Args:
            slopes: (r,) derivatives of the rows' values by their rates.
            velocities: (n, 6) of the interface nodes.
            by_step: (n, 6, 6) derivatives of these velocities by the interface nodes' steps.
            force_jacobian: (t, 2, 6) gradients.
            step_jacobian: (t, 2, 6) array to which is added.
        """
        for c, i in enumerate(self.joints):
            nodes, count = self._interface_nodes(c), int(self.own.width[c])
            for r in range(self._table.start[i], self._table.start[i + 1]):
                if slopes[r] == 0.0:
                    continue
                weights = np.eye(1, len(slopes), r)[0]
                change = velocities[nodes].ravel() @ self._hessian(c, weights)
                first = self._table.term_start[r]
                last = first + (count + 1) // 2
                gradient = force_jacobian[first:last].reshape(-1, 6)[:count]
                change = change.reshape(-1, 6) + np.einsum("ni,nij->nj", gradient, by_step[nodes])
                step_jacobian[first:last].reshape(-1, 6)[:count] += slopes[r] * change

    def add_wrenches(self, forces: FloatArray, out: FloatArray) -> None:
        """Add the wrenches (m, 6) on the bodies at all markers, see ``Constraints.reactions``."""
        if self.joints:
            self._place()
            add_line_wrenches(self.own.memory, forces, self._poses, out)


def _lines(rails: Sequence[Rail]) -> dict[str, Any]:
    """All elements of lines, one line after the other."""
    width = max((rail.interface_nodes.shape[1] for rail in rails), default=1)
    powers = max((rail.line.arc.shape[1] for rail in rails), default=1)
    first = starts([len(rail.interface_nodes) for rail in rails])
    total = int(first[-1])
    nodes = np.full((total, width), -1, dtype=np.int64)
    sizes = [(0, 0) if r.line.shape is None else r.line.shape.shape[1:] for r in rails]
    size = np.array(sizes, dtype=np.int64).reshape(-1, 2)
    shape = np.zeros((total, int(size.prod(axis=1).max(initial=0))))
    turns = np.zeros((total, 2, 9))
    arc, start = np.zeros((total, powers)), np.zeros(total)
    for rail, a, b, (p, q) in zip(rails, first[:-1], first[1:], sizes, strict=True):
        line, k = rail.line, rail.interface_nodes.shape[1]
        nodes[a:b, :k] = rail.interface_nodes
        if line.shape is not None:
            shape[a:b, : p * q] = line.shape.reshape(-1, p * q)
        if line.turns is not None:
            turns[a:b] = line.turns
        arc[a:b, : line.arc.shape[1]], start[a:b] = line.arc, line.starts
    return {
        "element": np.array([rail.line.element for rail in rails], dtype=np.int64),
        "count": np.array([rail.interface_nodes.shape[1] for rail in rails], dtype=np.int64),
        "size": size,
        "turned": np.array([_turned(rail.line) for rail in rails], dtype=np.bool_),
        "first_element": first,
        "nodes": nodes,
        "shape": shape,
        "turns": turns,
        "start": start,
        "arc": arc,
    }


def _turned(line: Line) -> bool:
    """True if a section of a line is rotated relative to its node."""
    if line.turns is None:
        return False
    return bool(np.abs(line.turns - np.eye(3).ravel()).max() > 1e-12)
