# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows of joints with markers on means of points, over a step of the energy-momentum scheme.

Such a marker has the mean position of some nodes, with constant weights, and inertial axes. It is
treated as a node of its own, whose discrete gradients are those of all nodes; its force acts on the
points by their weights, which does the same work, since means of positions move by means of moves.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.constraints.batch import Constraints
from flexfem.constraints.lines.data import ON_LINE
from flexfem.constraints.rows.data import RowArrays
from flexfem.constraints.rows.kernels import marker_poses
from flexfem.core.places.line_points import FIXED
from flexfem.integrators.energy_momentum.rows import (
    StepTerms,
    add_step_hessians,
    at_start,
    evaluate_step,
    exchanged,
)
from flexfem.lie import se3

__all__ = ["StepPointRows", "other_lines"]


def other_lines(rows: Constraints) -> list[int]:
    """Joints of this rank with markers on lines, or with axes of points, by their numbers."""
    own = rows.lines.own
    other = (own.interface_node == ON_LINE) & (own.element[own.line] != FIXED)
    return [
        joint
        for c, joint in enumerate(rows.lines.joints)
        if other[own.first_marker[c] : own.first_marker[c + 1]].any()
    ]


class StepPointRows:
    """Rows of these joints between two states.

    Attributes:
        values0, values: (r,) sums of their terms at both ends, zero of all other rows.
    """

    def __init__(self, rows: Constraints) -> None:
        """Tabulate the terms, and the nodes of each of their sides."""
        self._rows, own = rows, rows.lines.own
        self._row_of_term, joint = self._tabulate()
        self.values0, self.values = np.zeros(rows.size), np.zeros(rows.size)
        nodes, markers, terms = len(rows.interface.frames), len(own.marker), len(own.kinds)
        ends = own.first_marker[joint][:, np.newaxis] + own.ends
        on_points = own.interface_node == ON_LINE
        self._first = nodes
        self._points: IntArray = np.flatnonzero(on_points).astype(np.int64)
        still = se3.frame(np.zeros(3), np.eye(3))
        self._pairs, number = np.unique(ends, axis=0, return_inverse=True)
        pair_joint = np.zeros(len(self._pairs), dtype=np.int64)
        pair_joint[number.reshape(-1)] = joint
        self._pair_joint = pair_joint
        frames, poses, poses0 = (np.zeros((k, 12)) for k in (nodes + markers, markers, markers))
        frames[nodes:] = own.offset
        changed = {
            "marker_node": np.where(on_points, nodes + np.arange(markers), own.interface_node),
            "marker_offset": np.where(on_points[:, np.newaxis], still, own.offset),
            "poses": poses, "term_marker": ends, "pair_of_term": number.reshape(-1),
            "kinds": own.kinds, "directions": own.directions, "angles": own.angles,
            "row_of_term": self._row_of_term, "factors": own.factors,
        }  # fmt: skip
        names = RowArrays.__annotations__
        self._own = RowArrays(**{name: getattr(rows.own, name) for name in names} | changed)
        self._step = StepTerms(
            frames0=frames.copy(), frames=frames, poses0=poses0, poses=poses,
            values0=np.zeros(terms), values=np.zeros(terms), gradient=np.zeros((terms, 2, 6)),
        )  # fmt: skip
        self._end = StepTerms(
            frames0=frames, frames=frames, poses0=poses, poses=poses, values0=np.zeros(terms),
            values=np.zeros(terms), gradient=np.zeros((terms, 2, 6)),
        )  # fmt: skip
        self._back, self._start = exchanged(self._step), at_start(self._step)
        self._spread()

    def _tabulate(self) -> tuple[IntArray, IntArray]:
        """Number of the row among all, and of the joint among these, of each term."""
        own = self._rows.lines.own
        row = np.repeat(np.arange(len(own.row)), np.diff(own.first_term))
        joint = np.repeat(np.arange(len(own.width)), np.diff(own.first_row))
        self._local_row = row
        return own.row[row], joint[row]

    def _weights(self, marker: int) -> tuple[IntArray, FloatArray]:
        """Interface nodes and weights of a marker on points."""
        own = self._rows.lines.own
        line, e = int(own.line[marker]), int(own.places[marker, 0])
        rows, columns = own.size[line]
        count = int(own.count[line])
        weights = own.shape[e, : rows * columns].reshape(rows, columns)[:count, 0]
        return own.nodes[e, :count], weights

    def _spread(self) -> None:
        """List what each side of each term is for the nodes of its marker."""
        own, found = self._rows.lines.own, list[tuple[float, ...]]()
        for t, ends in enumerate(self._own.term_marker.tolist()):
            entry = int(own.entry[self._local_row[t]])
            for side, marker in enumerate(ends):
                column, node = int(own.column[marker]), int(own.interface_node[marker])
                if node == ON_LINE:
                    nodes, weights = self._weights(marker)
                    found += [
                        (t, side, entry + (column + i) // 2, (column + i) % 2, n, w, marker)
                        for i, (n, w) in enumerate(zip(nodes, weights, strict=True))
                    ]
                elif node >= 0:
                    found.append((t, side, entry + column // 2, column % 2, node, 0.0, -1))
        table = np.array(found, dtype=np.float64).reshape(-1, 7)
        self._at: IntArray = table[:, :5].astype(np.int64)
        self._factor, self._marker = table[:, 5], table[:, 6].astype(np.int64)
        entries = [np.arange(len(self._rows.kinds))[self._rows.on_lines[self._rows.row_of_term]]]
        self._entries: IntArray = np.concatenate(entries)

    def _place(self, frames: FloatArray, out: FloatArray, poses: FloatArray) -> None:
        """Frames of nodes and of means of points, and the markers on them."""
        out[: self._first] = frames
        for marker in self._points.tolist():
            nodes, weights = self._weights(marker)
            place = weights @ frames[nodes, :3] + self._rows.lines.own.offset[marker, :3]
            out[self._first + marker, :3] = place
        marker_poses(self._own.memory, out, poses)

    def begin(self) -> None:
        """Start a step at the interface's state."""
        self._place(self._rows.interface.frames, self._step.frames0, self._step.poses0)

    def evaluate(self) -> None:
        """Evaluate values and gradients of the rows at the interface's state."""
        rows = self._rows
        self._place(rows.interface.frames, self._step.frames, self._step.poses)
        for step, jacobian in (
            (self._end, rows.step_jacobian), (self._step, rows.force_jacobian),
        ):  # fmt: skip
            evaluate_step(self._own.memory, step.memory)
            self._write(step, jacobian)
        for out, terms in ((self.values0, self._step.values0), (self.values, self._step.values)):
            values = self._own.factors * terms
            out[:] = np.bincount(self._row_of_term, values, minlength=rows.size)

    def write_start(self, jacobian: FloatArray) -> None:
        """Write the derivatives of the rows' values at the start of the step by twists there."""
        evaluate_step(self._own.memory, self._start.memory)
        self._write(self._start, jacobian)

    def _write(self, step: StepTerms, jacobian: FloatArray) -> None:
        """Write gradients (t, 2, 6) of terms to those of the rows' nodes."""
        gradients = step.gradient * self._own.factors[:, np.newaxis, np.newaxis]
        jacobian[self._entries] = 0.0
        term, side, entry, column, node = self._at.T
        own = gradients[term, side]
        points = self._marker >= 0
        frames = step.frames
        force = _turned(frames[self._first + self._marker[points]], own[points, :3])
        own[points] = 0.0
        own[points, :3] = self._factor[points, np.newaxis] * _turned_back(
            frames[node[points]], force
        )
        np.add.at(jacobian, (entry, column), own)

    def add_hessians(self, factor: FloatArray, out: FloatArray, *, by_start: bool) -> None:
        """Add ``sum_rows factor d(gradient)`` to the blocks (12, 12) of the pairs of nodes.

        Args:
            factor: (r,) of the rows.
            out: (n_pairs, 12, 12) in the axes of the nodes at the end of the step.
            by_start: in those at the start, by twists there.
        """
        own, step = self._rows.lines.own, self._back if by_start else self._step
        if by_start:
            evaluate_step(self._own.memory, step.memory)
        weights = factor[self._row_of_term] * self._own.factors
        blocks = np.zeros((len(self._pairs), 12, 12))
        add_step_hessians(self._own.memory, step.memory, weights, blocks)
        for c in range(len(own.width)):
            width, total = int(own.width[c]), 0.0
            for pair in np.flatnonzero(self._pair_joint == c).tolist():
                if blocks[pair].any():
                    motion = np.concatenate(
                        [self._motion(step, marker, width) for marker in self._pairs[pair].tolist()]
                    )
                    total = total + motion.T @ blocks[pair] @ motion
            if np.ndim(total):
                _add_blocks(np.asarray(total).reshape(width, 6, width, 6), own.first_pair[c], out)

    def _motion(self, step: StepTerms, marker: int, width: int) -> FloatArray:
        """Local twist of a marker's node, (6, 6 n), by those of the joint's nodes."""
        own, motion = self._rows.lines.own, np.zeros((6, width, 6))
        column, frames = int(own.column[marker]), step.frames
        if own.interface_node[marker] >= 0:
            motion[:, column] = np.eye(6)
        elif own.interface_node[marker] == ON_LINE:
            nodes, weights = self._weights(marker)
            axes = se3.rotation(frames[self._first + marker])
            turns = axes.T @ se3.rotation(frames[nodes])
            motion[:3, column : column + len(nodes), :3] = np.einsum("i,iab->aib", weights, turns)
        return motion.reshape(6, 6 * width)


def _turned(frames: FloatArray, vectors: FloatArray) -> FloatArray:
    found: FloatArray = np.einsum("kab,kb->ka", frames[:, 3:].reshape(-1, 3, 3), vectors)
    return found


def _turned_back(frames: FloatArray, vectors: FloatArray) -> FloatArray:
    found: FloatArray = np.einsum("kba,kb->ka", frames[:, 3:].reshape(-1, 3, 3), vectors)
    return found


def _add_blocks(H: FloatArray, first: int, out: FloatArray) -> None:
    """Add a joint's matrix (n, 6, n, 6) to its pairs, that of a node at its pair with the next."""
    count = len(H)
    if count < 2:
        return
    a, b = np.triu_indices(count, 1)
    pairs = out[first : first + len(a)]
    pairs[:, :6, 6:] += H[a, :, b]
    pairs[:, 6:, :6] += H[b, :, a]
    nodes, next_to = np.arange(count - 1), b == a + 1
    pairs[next_to, :6, :6] += H[nodes, :, nodes]
    pairs[-1, 6:, 6:] += H[count - 1, :, count - 1]
