# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of nodes with the triangles of a surface, one pass.

Two passes are two of these with the roles exchanged, each with half of the stiffness.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact import penalty
from flexfem.contact.candidates import Rows, find_candidates, largest_move
from flexfem.contact.find import FIELDS, MOST, find_contacts, normals_into
from flexfem.contact.held_contacts import ContactLaw, HeldContacts
from flexfem.contact.sides import carry_sides, label_candidates, settle_sides
from flexfem.contact.stiffening import stiffen
from flexfem.lie.compiled import kernel

__all__ = ["Masters", "Slaves", "TriangleContact"]


#: Triangles of one node that it may have got through, at most.
_THROUGH = 4


@dataclass(frozen=True)
class Slaves:
    """Nodes that touch.

    Attributes:
        nodes: Rows of the positions, shape (s,).
        offsets: Distance at which each touches a surface of no thickness, shape (s,), metres.
        stiffness: Force per penetration, shape (s,), N/m.
    """

    nodes: IntArray
    offsets: FloatArray
    stiffness: FloatArray

    def restricted(self, kept: BoolArray) -> Self:
        """Those that are marked in (s,)."""
        return type(self)(self.nodes[kept], self.offsets[kept], self.stiffness[kept])


@dataclass(frozen=True)
class Masters:
    """Triangles that are touched.

    Attributes:
        triangles: Rows of the positions, shape (m, 3).
        thickness: Half of the thickness, shape (m,), metres.
        rims: Which edges (bits 0 to 2, opposite to the nodes) and nodes (bits 3 to 5) are on the
            rim of the surface, shape (m,).
        parts: Number of the connected part, in which all normals point to one side, shape (m,).
        sides: The only side that acts, 1 or -1, of closed surfaces; 0 where both do, shape (m,).
    """

    triangles: IntArray
    thickness: FloatArray
    rims: IntArray
    parts: IntArray
    sides: IntArray


class TriangleContact:
    """Contacts of slaves with master triangles at the trial state.

    Attributes:
        slaves, masters: What touches.
        skin: How far candidates are looked for, m: nothing gets through a surface that moves by
            less than half of it, relative to the surface, in a step.
        rows: Candidates of each slave.
        sides: On which side of each it belongs: 1, -1 or 0 for none.
        version: Number of the present list of candidates.
        count: Contacts at the trial state.
        ends: Slave and triangle of each, shape (count, 2) used.
        contacts: Numbers of each, see ``find``, shape (count, FIELDS) used.
        held: What friction and damping act on.
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
        """Describe what touches; call :meth:`update` before anything else."""
        self.slaves, self.masters, self.skin = slaves, masters, skin
        count = len(slaves.nodes)
        self._excluded = Rows.empty(count) if excluded is None else excluded
        self.rows, self.sides = Rows.empty(count), np.zeros(0, np.int64)
        self._labels = np.zeros(0, np.int64)
        self.version, self.count, self.stiffer = 0, 0, 1.0
        self.ends = np.empty((MOST * (count + 1), 2), np.int64)
        self.contacts = np.empty((MOST * (count + 1), FIELDS))
        self._normals = np.empty((len(masters.triangles), 3))
        self._chosen = np.arange(len(masters.triangles))
        self._nodes = slaves.nodes
        self._built: FloatArray | None = None
        self._before: FloatArray | None = None
        self._work = np.empty((0, 9), np.int64), np.empty((0, 7))
        self._law = ContactLaw() if law is None else law
        self.held = HeldContacts.none(self._law)
        self._held_nodes, self._held_weights = np.zeros((0, 4), np.int64), np.zeros((0, 4))
        self._start = np.zeros((0, 3))

    def update(self, points: FloatArray) -> bool:
        """Take in an accepted state; returns whether the candidates are new."""
        new = self.moved(points)
        if new:
            self.search(points)
        self.settle(points)
        return new

    def moved(self, points: FloatArray) -> bool:
        """Return True if the neighbour lists may fail for two more steps like the last.

        Call it once for every accepted state.
        """
        last = 0.0
        if self._before is not None:
            last = largest_move(points, self._before, self._nodes)
        self._before = points.copy()
        return self._built is None or (
            largest_move(points, self._built, self._nodes) + 2.0 * last > 0.5 * self.skin
        )

    def search(self, points: FloatArray, chosen: IntArray | None = None) -> None:
        """Look for candidates and carry over the sides of those that stay.

        Args:
            points: Positions at an accepted state, shape (n, 3).
            chosen: Numbers of the triangles to look at, ascending; None for all.
        """
        s, m, old, sides = self.slaves, self.masters, self.rows, self.sides
        self._chosen = np.arange(len(m.triangles)) if chosen is None else chosen
        rows = find_candidates(
            points, s.nodes, s.offsets, m.triangles[self._chosen], m.thickness[self._chosen],
            self.skin, self._excluded,
        )  # fmt: skip
        self.rows = rows = Rows(rows.starts, self._chosen[rows.values])
        self.sides = np.empty(len(rows.values), np.int64)
        carry_sides(old.starts, old.values, sides, rows.starts, rows.values, self.sides)
        np.copyto(self.sides, m.sides[rows.values], where=m.sides[rows.values] != 0)
        self._labels = np.empty(len(rows.values), np.int64)
        label_candidates(m.triangles, m.parts, m.sides, rows.starts, rows.values, self._labels)
        if rows.longest > len(self._work[0]):
            self._work = (np.empty((rows.longest, 9), np.int64), np.empty((rows.longest, 7)))
        moving = np.zeros(len(points), dtype=np.bool_)
        moving[s.nodes] = moving[m.triangles[self._chosen]] = True
        self._nodes = np.flatnonzero(moving)
        self._built = points.copy()
        self.version += 1

    def settle(self, points: FloatArray) -> None:
        """Find the sides of new candidates, and forget those of nodes at a rim."""
        m = self.masters
        normals_into(points, m.triangles, self._chosen, self._normals)
        settle_sides(
            points, self.slaves.nodes, m.triangles, m.rims, self._labels, self._normals,
            self.rows.starts, self.rows.values, self.sides, *self._work,
        )  # fmt: skip

    def evaluate(self, points: FloatArray, h: float = 0.0) -> None:
        """Find the contacts at a trial state of a step of ``h`` seconds."""
        s, m = self.slaves, self.masters
        normals_into(points, m.triangles, self._chosen, self._normals)
        self.count = find_contacts(
            points, s.nodes, s.offsets, m.triangles, m.thickness, m.rims, self._normals,
            self.rows.starts, self.rows.values, self.sides, self._labels, *self._work,
            self.ends, self.contacts,
        )  # fmt: skip
        slaves, triangles = self.ends[: self.count].T
        stiffen(
            self.count, self.contacts, 3, 22, slaves, s.offsets, triangles, m.thickness,
            self.stiffer,
        )  # fmt: skip
        if len(self.held.slaves):
            slips = np.empty((len(self.held.slaves), 3))
            _slips_into(points - self._start, self._held_nodes, self._held_weights, slips)
            self.held.evaluate(slips, h)

    def accept(self, points: FloatArray) -> None:
        """End a step: the contacts evaluated last are those that friction acts on now."""
        if self._law.elastic:
            return
        c, ends = self.contacts[: self.count], self.ends[: self.count]
        stiffness = self.slaves.stiffness[ends[:, 0]]
        self.held = self.held.follow(
            ends[:, 0].copy(), c[:, 5:8].copy(), -stiffness * c[:, 22], stiffness
        )
        self._held_nodes = np.column_stack(
            [self.slaves.nodes[ends[:, 0]], self.masters.triangles[ends[:, 1]]]
        )
        self._held_weights = np.column_stack([np.ones(self.count), -c[:, :3]])
        self._start = points.copy()

    def memory(self, points: FloatArray) -> FloatArray:
        """Memory of the contact beyond the accepted state, a row for each slave.

        These are the triangles that a node has got through, and the contacts that are held.
        """
        kept = self.sides.copy()
        self.sides[:] = self.masters.sides[self.rows.values]
        self.settle(points)
        fresh, self.sides = self.sides, kept
        rows = np.full((len(self.slaves.nodes), 2 * _THROUGH), -1.0)
        _pack_sides(self.rows.starts, self.rows.values, kept, fresh, rows)
        extra = np.concatenate([self._held_nodes[:, 1:], self._held_weights[:, 1:]], axis=1)
        return np.concatenate([rows, self.held.packed(len(rows), extra)], axis=1)

    def doubts(self, memory: FloatArray, count: int) -> str:
        """Says that :meth:`memory` never returned this, with ``count`` points; empty if it may."""
        _, held = np.split(memory, [2 * _THROUGH], axis=1)
        _, extra = HeldContacts.unpacked(self._law, held, self.slaves.stiffness)
        nodes = extra[:, :3]
        good = (nodes >= 0.0) & (nodes < count) & (nodes % 1.0 == 0.0)
        return "" if good.all() else "a contact is held by a node that is not there"

    def recall(self, points: FloatArray, memory: FloatArray) -> None:
        """Take back what :meth:`memory` returned, at the same positions."""
        self.sides[:] = self.masters.sides[self.rows.values]
        self.settle(points)
        sides, held = np.split(memory, [2 * _THROUGH], axis=1)
        _unpack_sides(self.rows.starts, self.rows.values, sides, self.sides)
        self.held, extra = HeldContacts.unpacked(self._law, held, self.slaves.stiffness)
        nodes = self.slaves.nodes[self.held.slaves]
        self._held_nodes = np.column_stack([nodes, extra[:, :3].astype(np.int64)])
        self._held_weights = np.column_stack([np.ones(len(nodes)), extra[:, 3:]])
        self._start = points.copy()

    @property
    def energy(self) -> float:
        """Energy stored, J."""
        value: float = penalty.energy(self.count, self.ends, self.contacts, self.slaves.stiffness)
        return value

    @property
    def deepest(self) -> float:
        """Largest penetration, m."""
        return float(-self.contacts[: self.count, 3].min(initial=0.0))

    @property
    def forces(self) -> FloatArray:
        """Normal forces of the contacts on the slaves, shape (count, 3), newtons."""
        c = self.contacts[: self.count]
        return -(self.slaves.stiffness[self.ends[: self.count, 0]] * c[:, 22])[:, None] * c[:, 5:8]

    def add_forces(self, residual: FloatArray, scale: float = 1.0) -> None:
        """Add ``scale`` times the forces to the residual of all nodes (n, 3), inertial axes."""
        s, m = self.slaves, self.masters
        penalty.add_forces(
            self.count, s.nodes, m.triangles, self.ends, self.contacts, s.stiffness, scale, residual
        )
        if len(self.held.slaves):
            _spread(self.held.forces, self._held_nodes, self._held_weights, scale, residual)

    def add_actions(self, steps: FloatArray, residual: FloatArray, scale: float = 1.0) -> None:
        """Add ``scale`` times the tangent applied to steps (n, 3) to the residual (n, 3)."""
        s, m = self.slaves, self.masters
        penalty.add_actions(
            self.count, s.nodes, m.triangles, self.ends, self.contacts, s.stiffness, scale, steps,
            residual,
        )  # fmt: skip
        if len(self.held.slaves):
            slips = np.empty((len(self.held.slaves), 3))
            _slips_into(steps, self._held_nodes, self._held_weights, slips)
            forces = np.einsum("cij,cj->ci", self.held.tangents, slips)
            _spread(forces, self._held_nodes, self._held_weights, scale, residual)

    def blocks(self, scale: float = 1.0) -> tuple[IntArray, FloatArray]:
        """Nodes (c, 4), slave first, and ``scale`` times the tangents (c, 12, 12)."""
        s, m, held = self.slaves, self.masters, self.held.tangents
        nodes, blocks = np.empty((self.count, 4), np.int64), np.empty((self.count, 12, 12))
        penalty.blocks_into(
            self.count, s.nodes, m.triangles, self.ends, self.contacts, s.stiffness, scale, nodes,
            blocks,
        )  # fmt: skip
        if not len(held):
            return nodes, blocks
        w = self._held_weights
        rest = scale * np.einsum("cp,cq,cab->cpaqb", w, w, held).reshape(-1, 12, 12)
        return np.concatenate([nodes, self._held_nodes]), np.concatenate([blocks, rest])


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
def _pack_sides(
    starts: IntArray, candidates: IntArray, sides: IntArray, fresh: IntArray, rows: FloatArray
) -> None:
    """Write triangle and side where the latter is not the fresh one, pair after pair."""
    for i in range(len(rows)):
        count = 0
        for c in range(starts[i], starts[i + 1]):
            if sides[c] != fresh[c] and 2 * count < rows.shape[1]:
                rows[i, 2 * count], rows[i, 2 * count + 1] = candidates[c], sides[c]
                count += 1


@kernel
def _unpack_sides(
    starts: IntArray, candidates: IntArray, rows: FloatArray, sides: IntArray
) -> None:
    """Set the sides that ``_pack_sides`` wrote."""
    for i in range(len(rows)):
        for c in range(starts[i], starts[i + 1]):
            for k in range(0, rows.shape[1], 2):
                if rows[i, k] == candidates[c]:
                    sides[c] = int(rows[i, k + 1])
