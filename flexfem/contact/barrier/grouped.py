# SPDX-License-Identifier: LGPL-3.0-or-later
"""Groups of pairs of one kind on this rank, and what they do."""

from typing import Protocol

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.dissipation.coupling import vectors_of_rows
from flexfem.contact.dissipation.data import (
    ACROSS,
    ALONG,
    FORCE,
    PUSH,
    Groups,
    Law,
    StepMotion,
)
from flexfem.contact.dissipation.rows import (
    add_friction,
    add_friction_actions,
    add_stiffness,
    motions_into,
    spread,
)
from flexfem.contact.dissipation.steps import dissipate
from flexfem.contact.primitives.candidates import Motion
from flexfem.contact.primitives.data import GAP, POTENTIAL, Pairs, Response
from flexfem.contact.primitives.tangents import add_forces, potential
from flexfem.kernels.compiled import kernel
from flexfem.kernels.records import Memory, unpack

__all__ = ["GroupedPairs", "PairKind"]


class PairKind(Protocol):
    """Kernels of pairs of one kind: cells with each other, or points with obstacles."""

    def stiffen(self, kappa: FloatArray) -> None:
        """Set the stiffness of the barrier at each point (n,), N/m^3."""

    def search(self, motion: Motion, at: FloatArray) -> tuple[Pairs, Response]:
        """Find the pairs that may act during a motion, and memory for what they do.

        ``at`` (n, 3) are positions in it.
        """

    def begin(self) -> None:
        """Begin a step at the positions of the last one's end."""

    def respond(self, motion: StepMotion, *, over_step: bool) -> None:
        """Write the response of the pairs to a step, or at its end alone."""

    def turn(self, motion: StepMotion) -> None:
        """Add to the tangents of a step how forces turn, where it is known."""

    def response_of(self, copies: Pairs) -> Response:
        """Memory for what copies of pairs do."""

    def respond_alone(
        self, copies: Pairs, chosen: IntArray, motion: StepMotion, response: Response
    ) -> None:
        """Write the response to a step of copies of pairs, whose numbers are ``chosen`` (m,).

        Their points are those of the motion.
        """

    def add_actions(self, scale: float, steps: FloatArray, sums: FloatArray) -> None:
        """Add ``scale`` times the tangent's action on steps (n, 3) to (n, 3)."""

    def blocks(self, scale: float) -> FloatArray:
        """``scale`` times the tangents (c, 3 q, 3 q) of the pairs that act."""

    def safe_part(self, before: FloatArray, after: FloatArray, keep: float) -> float:
        """Part of a motion during which all pairs keep a part of their gap."""

    def mark_unsafe(
        self, before: FloatArray, after: FloatArray, way: float, keep: float, marks: FloatArray
    ) -> float:
        """The same, and add one to the marks (n, 3) of all points of pairs that it cuts.

        No point moves by more than ``way``, m.
        """

    def went(self, way: float) -> None:
        """Take note that points have moved by at most ``way``, m."""

    def place_ends(self, groups: Groups, points: FloatArray, ends: Groups) -> None:
        """Write points, weights and normals of the groups at the end of a step, at (n, 3)."""


class GroupedPairs:
    """Pairs of one kind whose groups belong to this rank.

    Attributes:
        kind: their kernels.
        law: laws of dissipation.
        motion: of all points.
        pairs: those that may touch near the present motion.
        response: at the last evaluation; groups: the same by groups of pairs.
        rubs: True if there is friction.
        lost: energy dissipated in all steps, J.
        restitution: e.
        pulls: pulls of the groups at the end of the last step, by restitution, (g,), N, or none;
            pulled: the energy that they dissipate, J.
    """

    def __init__(self, kind: PairKind, law: Law, motion: StepMotion, restitution: float) -> None:
        """Begin without pairs.

        Args:
            kind: kernels.
            law: laws of dissipation.
            motion: of all points.
            restitution: part of the speed of approach with which bodies separate.
        """
        self.restitution, self.pulls, self.pulled = restitution, np.zeros(0), 0.0
        self.kind, self.law, self.motion = kind, law, motion
        self.rubs, self.lost = law.static_friction > 0.0, 0.0
        nothing = np.zeros(0, np.int64)
        pairs = Pairs(
            kind=nothing, points=np.zeros((0, 4), np.int64), weight=np.zeros(0), touch=np.zeros(0),
            dhat=np.zeros(0), kappa=np.zeros(0), starts=np.zeros(1, np.int64),
            keys=nothing,
        )  # fmt: skip
        self._use(pairs, Response.of(pairs))

    def _use(self, pairs: Pairs, response: Response) -> None:
        self.pairs, self.response, self.groups = pairs, response, Groups.of(pairs)
        self.response.count[0] = 0
        self._least = float(pairs.dhat.min(initial=np.inf))
        if self.restitution < 1.0:
            self._ends = Groups.of(pairs)

    def search(self, motion: Motion) -> None:
        """Find the pairs that may touch during a motion."""
        self._use(*self.kind.search(motion, self.motion.after))

    def begin(self) -> None:
        """Begin a step."""
        self.groups.forget()
        self.kind.begin()
        self.pulls, self.pulled = np.zeros(0), 0.0

    def end(self) -> None:
        """End a step that has been evaluated at its end."""
        self.lost += float(self.groups.losses.sum()) + self.pulled

    def evaluate(self, *, over_step: bool, near: bool = False) -> None:
        """Evaluate the step to the trial state, or the trial state alone.

        The tangent is the whole one of a step when the trial state is ``near`` the last one.
        """
        self.kind.respond(self.motion, over_step=over_step)
        dissipate(
            self.pairs.memory, self.response.memory, (self.law if over_step else _ELASTIC).memory,
            self.motion.memory, self.groups.memory,
        )  # fmt: skip
        if over_step and near:
            self.kind.turn(self.motion)

    def act_alone(
        self, copies: Pairs, chosen: IntArray, motion: StepMotion, work: tuple[Response, Groups]
    ) -> FloatArray:
        """Forces (n, 3) without friction on the points of a motion by copies of pairs over a step.

        Args:
            copies: the pairs, between points of the motion.
            chosen: their numbers (m,) among ``pairs``.
            motion: of their points.
            work: what they do, the slips of groups included.
        """
        response, groups = work
        self.kind.respond_alone(copies, chosen, motion, response)
        dissipate(
            copies.memory, response.memory, self.law.memory, motion.memory, groups.memory
        )  # fmt: skip
        sums = np.zeros(motion.after.shape)
        add_forces(copies.memory, response.memory, 1.0, sums)
        return sums

    def add_forces(self, scale: float, sums: FloatArray, couples: FloatArray) -> None:
        """Add ``scale`` times the forces and couples on all points to (n, 3) each."""
        add_forces(self.pairs.memory, self.response.memory, scale, sums)
        if self.rubs:
            add_friction(self.groups.memory, scale, sums, couples)

    def add_actions(
        self, scale: float, steps: FloatArray, spins: FloatArray, sums: FloatArray,
        couples: FloatArray,
    ) -> None:  # fmt: skip
        """Add ``scale`` times the tangent's action on steps and spins (n, 3) to (n, 3) each."""
        self.kind.add_actions(scale, steps, sums)
        if self.rubs:
            add_friction_actions(self.groups.memory, scale, steps, spins, sums, couples)

    def blocks(self, scale: float) -> tuple[IntArray, FloatArray]:
        """Points (c, q) of the pairs that act, and ``scale`` times their tangents (c, 3 q, 3 q).

        Friction is left out.
        """
        return self.points, self.kind.blocks(scale)

    def safe_part(self, before: FloatArray, after: FloatArray, keep: float) -> float:
        """Part of a motion during which all pairs keep a part of their gap."""
        return self.kind.safe_part(before, after, keep) if self.pairs.count else 1.0

    def mark_unsafe(
        self, before: FloatArray, after: FloatArray, way: float, keep: float, marks: FloatArray
    ) -> float:
        """See ``PairKind``."""
        if not self.pairs.count:
            return 1.0
        return self.kind.mark_unsafe(before, after, way, keep, marks)

    def went(self, way: float) -> None:
        """See ``PairKind``."""
        self.kind.went(way)

    @property
    def count(self) -> int:
        """Number of pairs that act."""
        return int(self.response.count[0])

    @property
    def points(self) -> IntArray:
        """Points (c, q) of the pairs that act."""
        return self.pairs.points[self.response.pairs[: self.count]]

    @property
    def closed(self) -> int:
        """Number of groups that act."""
        return int(self.groups.count[0])

    @property
    def keys(self) -> IntArray:
        """Numbers (g,) of the groups that act, the same in every search."""
        return self.pairs.keys[self.groups.every[: self.closed]]

    @property
    def pushes(self) -> FloatArray:
        """Normal forces (g,) of the groups that act, N."""
        return self.groups.numbers[: self.closed, PUSH]

    @property
    def energy(self) -> float:
        """Potential of the pairs, J."""
        return float(potential(self.response.memory))

    @property
    def slopes(self) -> FloatArray:
        """Stiffness (g, 1 or 3) of the groups that act along their rows, N/m."""
        return self.groups.slopes[: self.closed, : 3 if self.rubs else 1]

    def add_stiffness(self, moves: FloatArray, sums: FloatArray) -> None:
        """Add bounds of the sums of rows of the stiffness at all points to (n, 3), N/m.

        ``moves`` is 1 for points that move, 0 for others, (n,).
        """
        add_stiffness(self.groups.memory, moves, sums)

    def motions(self, steps: FloatArray, spins: FloatArray) -> FloatArray:
        """Motions (g, 1 or 3) of the rows of the groups for steps and spins (n, 3)."""
        found = np.zeros(self.slopes.shape)
        motions_into(self.groups.memory, steps, spins, found)
        return found

    def push(self, forces: FloatArray, sums: FloatArray, couples: FloatArray) -> None:
        """Add forces (g, 1 or 3) along the rows to those on all points (n, 3)."""
        spread(self.groups.memory, forces, sums, couples)

    def vectors_of_rows(self, first: int) -> tuple[IntArray, IntArray, FloatArray]:
        """Points (k,) on which rows of motion act, these, counted from ``first``, and (k, 3) along.

        Spins are left out.
        """
        width = 3 if self.rubs else 1
        count = width * int(self.groups.starts[self.closed]) if self.closed else 0
        points, rows = np.empty((2, count), np.int64)
        vectors = np.empty((count, 3))
        vectors_of_rows(self.groups.memory, width, points, rows, vectors)
        return points, rows + first, vectors

    # -- Restitution ----------------------------------------------------------------------------

    def place_ends(self, points: FloatArray) -> None:
        """Write the rows of the groups at the end of a step, with points (n, 3)."""
        self.kind.place_ends(self.groups, points, self._ends)

    def end_motions(self, steps: FloatArray) -> FloatArray:
        """Separation (g,) at the end of a step by steps of points (n, 3)."""
        found = np.zeros((self.closed, 1))
        motions_into(self._ends.memory, steps, np.zeros_like(steps), found)
        return found[:, 0]

    def slips(self, steps: FloatArray, spins: FloatArray) -> FloatArray:
        """Motions (g, 3) along the normals and slips for steps and spins (n, 3)."""
        found = np.zeros((self.closed, 3))
        if self.rubs:
            motions_into(self.groups.memory, steps, spins, found)
        return found

    def eased(self, pulls: FloatArray) -> FloatArray:
        """Forces (g, 1 or 3) along the rows by which pulls (g,) reduce friction, N.

        Friction is that of the forces less the pulls.
        """
        rows, numbers = np.zeros(self.slopes.shape), self.groups.numbers[: self.closed]
        if self.rubs:
            friction, push = numbers[:, FORCE : FORCE + 3], numbers[:, PUSH]
            size = np.linalg.norm(friction, axis=1)
            most = np.maximum(self.law.friction * push, size) * (1.0 - pulls / push)
            part = np.maximum(1.0 - most / np.maximum(size, 1e-300), 0.0)
            for k, at in ((1, ALONG), (2, ACROSS)):
                rows[:, k] = part * (friction * numbers[:, at : at + 3]).sum(axis=1)
        return rows

    def push_ends(self, forces: FloatArray, sums: FloatArray, couples: FloatArray) -> None:
        """Add forces (g,) along the normals at the end of a step to those on all points (n, 3)."""
        rows = np.ascontiguousarray(forces)[:, np.newaxis]
        spread(self._ends.memory, rows, sums, couples)

    def add_all_forces(self, sums: FloatArray, couples: FloatArray) -> None:
        """Add the forces over the last step, with pulls, to those on all points (n, 3)."""
        self.add_forces(1.0, sums, couples)
        if len(self.pulls):
            self.push_ends(-self.pulls, sums, couples)
            if self.rubs:
                self.push(-self.eased(self.pulls), sums, couples)

    # -- Measures -------------------------------------------------------------------------------

    def gaps(self) -> FloatArray:
        """Gaps of the pairs that act, m."""
        acting = self.response.numbers[: self.count]
        found: FloatArray = acting[acting[:, POTENTIAL] != 0.0, GAP]
        return found

    def shortest(self) -> float:
        """Least gap of the pairs at the end, or that below which they repel if it is less, m."""
        acting = self.response.numbers[: self.count, GAP]
        return min(float(acting.min(initial=np.inf)), self._least)

    def way(self, before: FloatArray, after: FloatArray) -> float:
        """Largest way of points of all pairs in a motion, in parts of the gap of repulsion."""
        return float(_way(self.pairs.memory, before, after))


#: Law without dissipation.
_ELASTIC = Law(
    damping=0.0, friction=0.0, static_friction=0.0, stribeck_speed=1.0, slip_speed=1.0,
)  # fmt: skip


@kernel
def _way(pairs: Memory, before: FloatArray, after: FloatArray) -> float:
    """See :meth:`GroupedPairs.way`."""
    own, largest, ways = unpack(Pairs, pairs), 0.0, np.empty(len(before))
    for i in range(len(before)):
        square = 0.0
        for a in range(3):
            square += (after[i, a] - before[i, a]) ** 2
        ways[i] = np.sqrt(square)
    for p in range(len(own.kind)):
        for i in range(own.points.shape[1]):
            largest = max(largest, ways[own.points[p, i]] / own.dhat[p])
    return largest
