# SPDX-License-Identifier: LGPL-3.0-or-later
"""The contacts of a system's shells on this rank.

A rank looks after the slaves that it owns. Of other ranks it gets the triangles near them: ranks
tell each other the box of their slaves, and send the triangles that overlap it. Positions of the
nodes of these come with every evaluation, and their forces go back. Arrays have one row for every
node of the surface mesh; only those of nodes here or nearby are used.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.held_contacts import ContactLaw
from flexfem.contact.search import triangle_boxes
from flexfem.contact.surfaces import RigidContact
from flexfem.contact.triangles import TriangleContact
from flexfem.core.frame_block import FrameBlock
from flexfem.core.state import Numbering, State
from flexfem.elements.shell_nodes import add_to_nodes, inertial_into, positions_into
from flexfem.la.nest import block_indices
from flexfem.system.contact_surfaces import ContactPass, ContactSurfaces
from flexfem.system.node_exchange import NodeExchange, send_numbers

__all__ = ["ContactGroup", "Contacts"]


@dataclass
class ContactGroup:
    """One contact of the model on this rank.

    Attributes:
        surfaces: its serial data.
        passes: their data for the slaves of this rank.
        triangles: contacts of the passes; rigid: those with rigid surfaces.
        areas: of the slaves against rigid surfaces.
    """

    surfaces: ContactSurfaces
    passes: list[ContactPass]
    triangles: list[TriangleContact]
    rigid: list[RigidContact]
    areas: FloatArray

    @classmethod
    def of(cls, surfaces: ContactSurfaces, own: BoolArray) -> "ContactGroup":
        """Keep the slaves that are marked in (n,)."""
        contact = surfaces.contact
        law = ContactLaw(contact.friction, contact.damping)
        passes = [one.restricted(own) for one in surfaces.passes]
        triangles = [
            TriangleContact(one.slaves, one.masters, surfaces.skin, one.excluded, law)
            for one in passes
        ]
        kept = own[surfaces.slaves.nodes]
        slaves = surfaces.slaves.restricted(kept)
        rigid = [RigidContact(slaves, shape, law) for shape, _ in surfaces.rigid]
        return cls(surfaces, passes, triangles, rigid, surfaces.areas[kept])

    def set_stiffness(self, stiffness: float) -> None:
        """Set the force per penetration and area, N/m^3."""
        for one, made in zip(self.passes, self.triangles, strict=True):
            made.slaves.stiffness[:] = stiffness * one.areas
        for rigid in self.rigid:
            rigid.slaves.stiffness[:] = stiffness * self.areas

    @property
    def every(self) -> list[TriangleContact | RigidContact]:
        """All contacts."""
        return [*self.triangles, *self.rigid]

    @property
    def forces(self) -> FloatArray:
        """Force on the slaves (3,) and sum of the sizes of normal forces, N, of this rank: (4,)."""
        signs = [one.sign for one in self.passes] + [1.0] * len(self.rigid)
        total = np.zeros(4)
        for sign, made in zip(signs, self.every, strict=True):
            normal = made.forces
            total[3] += np.linalg.norm(normal, axis=1).sum()
            held = made.held.forces
            total[:3] += sign * (normal.sum(0) - held.sum(0))
        return total


class Contacts:
    """All contacts of the shells of a system.

    Attributes:
        groups: in the order of the model.
        time: of the trial state, s.
        stiffness: force per penetration and area of each, N/m^3; zero, where it is not given, until
            the first step.
    """

    def __init__(
        self, comm: MPI.Intracomm, described: Sequence[ContactSurfaces], block: FrameBlock,
        held: BoolArray, ranks: IntArray,
    ) -> None:  # fmt: skip
        """Find out who owns what (collective).

        Args:
            comm: communicator.
            described: serial data.
            block: nodes of the shells.
            held: (n, 3) unknowns that are held.
            ranks: (m,) rank of every triangle.
        """
        self._comm, self._block, self._held, count = comm, block, held, len(held)
        self._own = block.node_ids[: block.owned]
        known = np.full((2, count), -1, dtype=np.int64)
        known[0, self._own] = comm.rank
        known[1, self._own] = block.global_ids[: block.owned]
        comm.Allreduce(MPI.IN_PLACE, known, op=MPI.MAX)
        self._owner, self._numbers = known
        self._mine = ranks == comm.rank
        self._points, self._forces = np.zeros((count, 3)), np.zeros((count, 3))
        self._steps, self._local = np.zeros((count, 3)), np.zeros((block.owned, 3))
        own = self._owner == comm.rank
        self.groups = [ContactGroup.of(one, own) for one in described]
        given = [group.surfaces.contact.stiffness or 0.0 for group in self.groups]
        self.set_stiffness(np.array(given))
        self.time = self._accepted = 0.0
        self._exchange: NodeExchange | None = None
        self._evaluated = False
        self.update()

    def prepare(self, inertia: float) -> None:
        """Choose the stiffness by the first matrix; see ``ContactSurfaces.stiffness``."""
        if not self.stiffness.all():
            self.set_stiffness(np.array([g.surfaces.stiffness(inertia) for g in self.groups]))

    def set_stiffness(self, stiffness: FloatArray) -> None:
        """Set the force per penetration and area of each contact, N/m^3."""
        self.stiffness = stiffness
        for group, value in zip(self.groups, stiffness.tolist(), strict=True):
            group.set_stiffness(value)

    def _triangles(self) -> list[tuple[TriangleContact, ContactPass]]:
        """All contacts with triangles, and their passes."""
        return [p for g in self.groups for p in zip(g.triangles, g.passes, strict=True)]

    def update(self) -> None:
        """Take in the accepted positions (collective)."""
        self._read()
        self._points[self._block.node_ids] = self._block.frames[:, :3]
        passes = self._triangles()
        moved = [made.moved(self._points) for made, _ in passes]
        if self._comm.allreduce(any(moved), op=MPI.LOR):
            self._search()
        for made, _ in passes:
            made.settle(self._points)
        self._evaluated = False

    def _search(self) -> None:
        """Find candidates anew, those of other ranks' triangles as well (collective)."""
        passes = self._triangles()
        chosen = [one.chosen for _, one in passes]
        if self._comm.size > 1:
            chosen = [self._nearby(made, one) for made, one in passes]
            wanted = [
                made.masters.triangles[c].ravel()
                for (made, _), c in zip(passes, chosen, strict=True)
            ]
            nodes = np.unique(np.concatenate(wanted))
            self._exchange = NodeExchange(self._comm, self._owner, nodes)
            self._exchange.bring(self._points)
        for (made, _), triangles in zip(passes, chosen, strict=True):
            made.search(self._points, triangles)

    def _nearby(self, made: TriangleContact, one: ContactPass) -> IntArray:
        """Master triangles near the slaves of this rank, ascending (collective)."""
        mine = one.chosen[self._mine[one.chosen]]
        triangles, thickness = made.masters.triangles[mine], made.masters.thickness[mine]
        low, high = np.empty((len(mine), 3)), np.empty((len(mine), 3))
        triangle_boxes(self._points, triangles, thickness + made.skin, low, high)
        box = np.array([[np.inf] * 3, [-np.inf] * 3])
        if len(made.slaves.nodes):
            at, reach = self._points[made.slaves.nodes], made.slaves.offsets[:, np.newaxis]
            box[:] = (at - reach).min(0), (at + reach).max(0)
        boxes = np.empty((self._comm.size, 2, 3))
        self._comm.Allgather(box, boxes)
        lists = [mine[((low <= upper) & (high >= lower)).all(axis=1)] for lower, upper in boxes]
        return np.sort(np.concatenate(send_numbers(self._comm, lists)))

    def _read(self) -> None:
        """Positions of the nodes here, and of those near them (collective)."""
        block = self._block
        positions_into(block.frames[: block.owned], self._local)
        self._points[self._own] = self._local
        if self._exchange is not None:
            self._exchange.bring(self._points)

    def evaluate(self) -> None:
        """Find the contacts at the trial state (collective)."""
        self._read()
        h = self.time - self._accepted
        for group in self.groups:
            for made in group.triangles:
                made.evaluate(self._points, h)
            for rigid, (_, frame) in zip(group.rigid, group.surfaces.rigid, strict=True):
                rigid.evaluate(self._points, frame, h)
        self._evaluated = True

    def refresh(self) -> None:
        """Find the contacts at the accepted state, unless known (collective)."""
        if not self._evaluated:
            self.evaluate()

    def accept(self) -> None:
        """End a step (collective)."""
        if any(g.surfaces.contact.friction or g.surfaces.contact.damping for g in self.groups):
            self.evaluate()
            for group in self.groups:
                for made in group.every:
                    made.accept(self._points)
        self._accepted = self.time
        self.update()

    def add_residual(self, scale: float) -> None:
        """Evaluate, and add ``scale`` times the forces to the block's residual (collective)."""
        self.evaluate()
        self._evaluated = False
        self._forces[:] = 0.0
        wrench = np.zeros(6)
        for group in self.groups:
            for made in group.triangles:
                made.add_forces(self._forces, scale)
            for rigid in group.rigid:
                rigid.add_forces(self._forces, wrench, scale)
        self._hand_over()

    def add_action(self, scale: float) -> None:
        """Add ``scale`` times the tangent applied to the block's steps (collective)."""
        block = self._block
        inertial_into(block.frames[: block.owned], block.step[: block.owned], self._local)
        self._steps[self._own] = self._local
        if self._exchange is not None:
            self._exchange.bring(self._steps)
        self._forces[:] = 0.0
        nothing, wrench = np.zeros(6), np.zeros(6)
        for group in self.groups:
            for made in group.triangles:
                made.add_actions(self._steps, self._forces, scale)
            for rigid in group.rigid:
                rigid.add_actions(self._steps, nothing, self._forces, wrench, scale)
        self._hand_over()

    def _hand_over(self) -> None:
        """Add the forces on all nodes to the owners' residuals (collective)."""
        if self._exchange is not None:
            self._exchange.add_back(self._forces)
        block = self._block
        add_to_nodes(
            block.frames[: block.owned], self._forces[self._own], 1.0,
            block.residual[: block.owned],
        )  # fmt: skip

    def entries(self, scale: float) -> tuple[IntArray, IntArray, FloatArray]:
        """Rows, columns and values of ``scale`` times the tangent (collective)."""
        block = self._block
        turns = np.zeros((len(self._points), 9))
        turns[self._own] = block.frames[: block.owned, 3:]
        if self._exchange is not None:
            self._exchange.bring(turns)
        none = np.zeros(0, np.int64)
        rows, columns, values = [none], [none], [np.zeros(0)]
        for group in self.groups:
            found = [made.blocks(scale) for made in group.triangles]
            for rigid in group.rigid:
                nodes, blocks = rigid.blocks(scale)
                found.append((nodes[:, np.newaxis], np.ascontiguousarray(blocks[:, :3, :3])))
            for nodes, blocks in found:
                count, width = nodes.shape
                R = turns[nodes].reshape(count, width, 3, 3)
                K = blocks.reshape(count, width, 3, width, 3)
                K = np.einsum("cpia,cpiqj,cqjb->cpaqb", R, K, R, optimize=True)
                held = self._held[nodes].reshape(count, 3 * width)
                K = K.reshape(count, 3 * width, 3 * width)
                K[held[:, :, np.newaxis] | held[:, np.newaxis]] = 0.0
                places = self._numbers[nodes]
                i, j = block_indices(places, places, (3, 3))
                rows.append(i)
                columns.append(j)
                values.append(K.ravel())
        return np.concatenate(rows), np.concatenate(columns), np.concatenate(values)

    def numberings(self) -> dict[str, Numbering]:
        """Of the rows of :meth:`state`."""
        return {"contacts": self._block.numbering()}

    def state(self) -> State:
        """Stiffness, and what the accepted positions do not tell of the nodes here (collective)."""
        self.update()
        values = {"contact_stiffness": self.stiffness}
        rows: dict[str, FloatArray] = {}
        for name, made, _ in self._named():
            if isinstance(made, TriangleContact):
                memory = made.memory(self._points)
            else:
                memory = made.memory()
            rows[name] = np.zeros((len(self._block.frames), memory.shape[1]))
            rows[name][self._at(made)] = memory
        return State(values, {"contacts": rows})

    def restore(self, state: State) -> None:
        """Take back what :meth:`state` returned, after the block has (collective)."""
        self.set_stiffness(state.values["contact_stiffness"].copy())
        self.update()
        self._accepted = self.time
        for name, made, frame in self._named():
            memory = state.rows["contacts"][name][self._at(made)]
            if isinstance(made, TriangleContact):
                made.recall(self._points, memory)
            else:
                made.recall(self._points, frame, memory)

    def _named(self) -> Iterator[tuple[str, TriangleContact | RigidContact, FloatArray]]:
        """All contacts with names of their own, and the frames of rigid surfaces."""
        for group in self.groups:
            frames = [np.zeros(12)] * len(group.triangles)
            frames += [frame for _, frame in group.surfaces.rigid]
            for k, (made, frame) in enumerate(zip(group.every, frames, strict=True)):
                yield f"{group.surfaces.contact.name}_{k}", made, frame

    def _at(self, made: TriangleContact | RigidContact) -> IntArray:
        """Rows of a contact's slaves among the nodes of the block."""
        return self._block.owned_index(made.slaves.nodes)

    def nearby(self) -> FloatArray:
        """Stiffness (n_owned,) of contacts at nodes that are closed or may close soon (collective).

        Those are nodes within the skin of a rigid surface, or with candidates.
        """
        self._read()
        self._forces[:] = 0.0
        total = self._forces[:, 0]
        for group in self.groups:
            for rigid, (_, frame) in zip(group.rigid, group.surfaces.rigid, strict=True):
                close = rigid.distances(self._points, frame) < group.surfaces.skin
                total[rigid.slaves.nodes[close]] += rigid.slaves.stiffness[close]
            for made in group.triangles:
                rows, slaves = made.rows, made.slaves
                row = np.repeat(np.arange(len(slaves.nodes)), np.diff(rows.starts))
                most = np.zeros(len(total))
                most[slaves.nodes[row]] = slaves.stiffness[row]
                corners = made.masters.triangles[rows.values]
                np.maximum.at(most, corners, slaves.stiffness[row][:, np.newaxis])
                total += most
        if self._exchange is not None:
            self._exchange.add_back(self._forces)
        found: FloatArray = total[self._own].copy()
        return found

    @property
    def energy(self) -> float:
        """Energy stored by the contacts of this rank, J (collective)."""
        self.refresh()
        return sum(made.energy + made.held.stored for g in self.groups for made in g.every)

    @property
    def lost(self) -> float:
        """Energy lost by friction and damping on this rank, J."""
        return sum(made.held.lost for g in self.groups for made in g.every)

    def measure(self, name: str) -> FloatArray:
        """Share of this rank in penetration and forces of a contact, (5,) (collective)."""
        self.refresh()
        group = next(g for g in self.groups if g.surfaces.contact.name == name)
        deepest = max([made.deepest for made in group.every], default=0.0)
        deepest = self._comm.allreduce(deepest, op=MPI.MAX)
        return np.array([deepest * float(self._comm.rank == 0), *group.forces])
