# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of nodes with the triangles of a surface, one pass.

Two-pass contact is a pair of these with exchanged roles, each with half of the stiffness.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.detection.closest import MEASURES, NEAR
from flexfem.contact.detection.narrow_phase import MOST, find_contacts, normals_into
from flexfem.contact.detection.neighbours import Rows, find_candidates, largest_move
from flexfem.contact.detection.sides import carry_sides, label_candidates, settle_sides
from flexfem.contact.law import penalty
from flexfem.contact.law.closed_contacts import ClosedContacts, ContactLaw
from flexfem.contact.law.data import (
    AREAS,
    FIELDS,
    FORCE,
    NORMAL,
    Candidates,
    Found,
    Masters,
    Slaves,
)
from flexfem.contact.law.stiffening import stiffen
from flexfem.contact.obstacles.contacts import Lagged, ObstacleContacts
from flexfem.kernels.compiled import kernel
from flexfem.kernels.records import Memory, unpack

__all__ = ["TriangleContact"]

#: Largest number of triangles that one node may have passed through.
_THROUGH = 4


class TriangleContact(ObstacleContacts):
    """Contacts of slaves with master triangles at the trial state.

    Attributes:
        slaves, masters: Nodes and triangles.
        skin: Search distance of candidates, m: no node passes through a surface if its relative
            motion in a step is less than half of it.
        candidates: Triangles near the slaves.
        found: Contacts at the trial state.
        version: Number of the present list of candidates.
        closed: Closed contacts, on which friction and damping act.
        lagged: Where they were.
        stiffer: Largest slope of the force over that at contact, see ``stiffening``.
    """

    def __init__(
        self,
        slaves: Slaves,
        masters: Masters,
        skin: float,
        excluded: Rows | None = None,
        law: ContactLaw | None = None,
    ) -> None:
        """Store nodes and triangles; :meth:`update` must be called first."""
        self.slaves, self.masters, self.skin = slaves, masters, skin
        count = len(slaves.nodes)
        self._excluded = Rows.empty(count) if excluded is None else excluded
        self.version, self.stiffer = 0, 1.0
        none, triangles = np.zeros(0, np.int64), len(masters.triangles)
        self.candidates = Candidates(
            starts=np.zeros(count + 1, np.int64), triangles=none, sides=none, labels=none,
            chosen=np.arange(triangles), normals=np.empty((triangles, 3)),
            near=np.empty((0, NEAR), np.int64), measures=np.empty((0, MEASURES)),
        )  # fmt: skip
        self.found = Found(
            closed=np.zeros(1, np.int64), ends=np.empty((MOST * (count + 1), 2), np.int64),
            numbers=np.empty((MOST * (count + 1), FIELDS)),
        )  # fmt: skip
        self._nodes = slaves.nodes
        self._built: FloatArray | None = None
        self._before: FloatArray | None = None
        self._law = ContactLaw() if law is None else law
        self.closed = ClosedContacts.none(self._law)
        self.lagged = Lagged.none(4, 4)

    def update(self, points: FloatArray) -> bool:
        """Update for an accepted state; returns True if the candidates are new."""
        new = self.moved(points)
        if new:
            self.search(points)
        self.settle(points)
        return new

    def moved(self, points: FloatArray) -> bool:
        """Return True if the neighbour lists may be incomplete after two more steps like the last.

        It must be called once for every accepted state.
        """
        last = 0.0
        if self._before is not None:
            last = largest_move(points, self._before, self._nodes)
        self._before = points.copy()
        return self._built is None or (
            largest_move(points, self._built, self._nodes) + 2.0 * last > 0.5 * self.skin
        )

    def search(self, points: FloatArray, chosen: IntArray | None = None) -> None:
        """Find candidates and transfer the sides of those that remain.

        Args:
            points: Positions at an accepted state, shape (n, 3).
            chosen: Numbers of the triangles to be searched, ascending; None for all.
        """
        s, m, c = self.slaves, self.masters, self.candidates
        chosen = np.arange(len(m.triangles)) if chosen is None else chosen
        triangles = m.triangles[chosen]
        starts, values = find_candidates(
            points, s, triangles, m.thickness[chosen], self.skin, self._excluded
        )
        values = chosen[values]
        sides = np.empty(len(values), np.int64)
        carry_sides(c.memory, starts, values, sides)
        np.copyto(sides, m.sides[values], where=m.sides[values] != 0)
        c.starts, c.triangles, c.sides, c.chosen = starts, values, sides, chosen
        c.labels = np.empty(len(values), np.int64)
        label_candidates(m.memory, c.memory)
        longest = c.longest
        if longest > len(c.near):
            c.near, c.measures = np.empty((longest, NEAR), np.int64), np.empty((longest, MEASURES))
        moving = np.zeros(len(points), dtype=np.bool_)
        moving[s.nodes] = moving[triangles] = True
        self._nodes = np.flatnonzero(moving)
        self._built = points.copy()
        self.version += 1

    def settle(self, points: FloatArray) -> None:
        """Find the sides of new candidates, and reset those of nodes at a boundary."""
        masters, candidates = self.masters.memory, self.candidates.memory
        normals_into(points, masters, candidates)
        settle_sides(points, self.slaves.memory, masters, candidates)

    def evaluate(self, points: FloatArray, h: float = 0.0) -> None:
        """Find the contacts at a trial state of a step of ``h`` seconds."""
        masters, candidates = self.masters.memory, self.candidates.memory
        normals_into(points, masters, candidates)
        find_contacts(points, self.slaves.memory, masters, candidates, self.found.memory)
        stiffen(self.found.memory, self.stiffer)
        if len(self.closed.slaves):
            nodes, weights, start = self.lagged
            self.closed.evaluate(_sums(points, nodes, weights) - start, h)

    def accept(self, points: FloatArray) -> None:
        """End a step: friction now acts on the contacts of the last evaluation."""
        if not self._law.elastic:
            self.closed, self.lagged = self.following(points)

    def following(self, points: FloatArray) -> tuple[ClosedContacts, Lagged]:
        """The contacts on which friction acts in the next step, from those of the last evaluation.

        Returns:
            See the attributes ``closed`` and ``lagged``.
        """
        c, (slaves, triangles) = self.contacts, self.ends.T
        stiffness = self.slaves.stiffness[slaves]
        closed = self.closed.follow(
            slaves.copy(), c[:, NORMAL : NORMAL + 3].copy(), -stiffness * c[:, FORCE], stiffness
        )
        nodes = np.column_stack([self.slaves.nodes[slaves], self.masters.triangles[triangles]])
        weights = np.column_stack([np.ones(len(c)), -c[:, AREAS : AREAS + 3]])
        return closed, Lagged(nodes, weights, _sums(points, nodes, weights))

    def memory(self, points: FloatArray) -> FloatArray:
        """State of the contact besides the accepted positions, a row for each slave.

        These are the triangles that a node has passed through, and the closed contacts.
        """
        c = self.candidates
        kept = c.sides.copy()
        c.sides[:] = self.masters.sides[c.triangles]
        self.settle(points)
        fresh, c.sides = c.sides, kept
        rows = np.full((len(self.slaves.nodes), 2 * _THROUGH), -1.0)
        _pack_sides(c.memory, fresh, rows)
        nodes, weights, _ = self.lagged
        extra = np.concatenate([nodes[:, 1:], weights[:, 1:]], axis=1)
        return np.concatenate([rows, self.closed.packed(len(rows), extra)], axis=1)

    def doubts(self, memory: FloatArray, count: int) -> str:
        """Message if :meth:`memory` cannot have returned this for ``count`` points, or ""."""
        _, closed = np.split(memory, [2 * _THROUGH], axis=1)
        _, extra = ClosedContacts.unpacked(self._law, closed, self.slaves.stiffness)
        nodes = extra[:, :3]
        good = (nodes >= 0.0) & (nodes < count) & (nodes % 1.0 == 0.0)
        return "" if good.all() else "a contact belongs to a node that does not exist"

    def recall(self, points: FloatArray, memory: FloatArray) -> None:
        """Restore the return value of :meth:`memory`, at the same positions."""
        self.candidates.sides[:] = self.masters.sides[self.candidates.triangles]
        self.settle(points)
        sides, closed = np.split(memory, [2 * _THROUGH], axis=1)
        _unpack_sides(self.candidates.memory, sides)
        self.closed, extra = ClosedContacts.unpacked(self._law, closed, self.slaves.stiffness)
        slaves = self.slaves.nodes[self.closed.slaves]
        nodes = np.column_stack([slaves, extra[:, :3].astype(np.int64)])
        weights = np.column_stack([np.ones(len(slaves)), extra[:, 3:]])
        self.lagged = Lagged(nodes, weights, _sums(points, nodes, weights))

    @property
    def forces(self) -> FloatArray:
        """Normal forces of the contacts on the slaves, shape (count, 3), newtons."""
        c = self.contacts
        sizes = self.slaves.stiffness[self.ends[:, 0]] * c[:, FORCE]
        return -sizes[:, None] * c[:, NORMAL : NORMAL + 3]

    def add_forces(self, residual: FloatArray, scale: float = 1.0) -> None:
        """Add ``scale`` times the forces to the residual of all nodes (n, 3), inertial axes."""
        slaves, masters, found = self.slaves.memory, self.masters.memory, self.found.memory
        penalty.add_forces(slaves, masters, found, scale, residual)
        if len(self.closed.slaves):
            _spread(self.closed.forces, *self.lagged[:2], scale, residual)

    def add_actions(self, steps: FloatArray, residual: FloatArray, scale: float = 1.0) -> None:
        """Add ``scale`` times the tangent applied to steps (n, 3) to the residual (n, 3)."""
        slaves, masters, found = self.slaves.memory, self.masters.memory, self.found.memory
        penalty.add_actions(slaves, masters, found, scale, steps, residual)
        if len(self.closed.slaves):
            slips = _sums(steps, *self.lagged[:2])
            forces = np.einsum("cij,cj->ci", self.closed.tangents, slips)
            _spread(forces, *self.lagged[:2], scale, residual)

    def blocks(self, scale: float = 1.0) -> tuple[IntArray, FloatArray]:
        """Nodes (c, 4), slave first, and ``scale`` times the tangents (c, 12, 12)."""
        count, closed = self.count, self.closed.tangents
        nodes, blocks = np.empty((count, 4), np.int64), np.empty((count, 12, 12))
        slaves, masters, found = self.slaves.memory, self.masters.memory, self.found.memory
        penalty.blocks_into(slaves, masters, found, scale, nodes, blocks)
        if not len(closed):
            return nodes, blocks
        of_closed, w, _ = self.lagged
        rest = scale * np.einsum("cp,cq,cab->cpaqb", w, w, closed).reshape(-1, 12, 12)
        return np.concatenate([nodes, of_closed]), np.concatenate([blocks, rest])


def _sums(values: FloatArray, nodes: IntArray, weights: FloatArray) -> FloatArray:
    """Weighted sums (c, 3) of values (n, 3) at nodes (c, 4)."""
    found = np.empty((len(nodes), 3))
    _slips_into(values, nodes, weights, found)
    return found


@kernel
def _slips_into(steps: FloatArray, nodes: IntArray, weights: FloatArray, slips: FloatArray) -> None:
    """Write the weighted sums (c, 3) of steps of nodes."""
    for c in range(len(nodes)):
        for a in range(3):
            slips[c, a] = 0.0
            for k in range(4):
                slips[c, a] += weights[c, k] * steps[nodes[c, k], a]


@kernel
def _spread(
    forces: FloatArray, nodes: IntArray, weights: FloatArray, scale: float, residual: FloatArray
) -> None:
    """Add ``scale`` times weighted forces to the residual of nodes."""
    for c in range(len(nodes)):
        for k in range(4):
            for a in range(3):
                residual[nodes[c, k], a] += scale * weights[c, k] * forces[c, a]


@kernel
def _pack_sides(candidates: Memory, fresh: IntArray, rows: FloatArray) -> None:
    """Write triangle and side where the side differs from a newly found one, pair after pair."""
    own = unpack(Candidates, candidates)
    for i in range(len(rows)):
        count = 0
        for c in range(own.starts[i], own.starts[i + 1]):
            side = own.sides[c]
            if side != fresh[c] and 2 * count < rows.shape[1]:
                rows[i, 2 * count], rows[i, 2 * count + 1] = own.triangles[c], side
                count += 1


@kernel
def _unpack_sides(candidates: Memory, rows: FloatArray) -> None:
    """Set the sides that ``_pack_sides`` wrote."""
    own = unpack(Candidates, candidates)
    for i in range(len(rows)):
        for c in range(own.starts[i], own.starts[i + 1]):
            for k in range(0, rows.shape[1], 2):
                if rows[i, k] == own.triangles[c]:
                    own.sides[c] = int(rows[i, k + 1])
