# SPDX-License-Identifier: LGPL-3.0-or-later
"""The contacts of a system on this rank.

A rank evaluates the contacts of the slaves that it owns. It receives the triangles of other ranks
near them: ranks exchange the boxes of their slaves, and send the triangles that overlap these.
Positions of their points are received in every evaluation, and forces are sent back. Arrays have
one row for every point of the model; only those of points here or nearby are used.
"""

from collections.abc import Iterator, Mapping, Sequence

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.carriers import Carriers
from flexfem.contact.detection.broad_phase import enclosing, touching, triangle_boxes
from flexfem.contact.frames import SurfaceFrames
from flexfem.contact.group import ContactGroup
from flexfem.contact.nearby import stiffness_nearby
from flexfem.contact.normal_rows import NormalRows
from flexfem.contact.obstacles.rigid_surface import RigidContact
from flexfem.contact.obstacles.triangles import TriangleContact
from flexfem.contact.pairs import ContactPass, ContactSurfaces
from flexfem.contact.points import ContactPoints
from flexfem.contact.tangent_entries import ContactEntries, Triplets
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.nodes.halo import send_numbers
from flexfem.core.state import Numbering, State

__all__ = ["Contacts"]


class Contacts:
    """All contacts of a system.

    Attributes:
        groups: the contacts in the order of the model.
        carriers: of their points; frames: of rigid surfaces of simple shapes.
        time, accepted: times of the trial state and of the accepted one, s.
        stiffness: force per penetration and area of each, N/m^3; zero, where it is not given, until
            the first step; inertia: factor of the mass in the matrix by which it was chosen, 1/s^2,
            None before that, and where all are given.
        kinds: kinds of the blocks on which contacts act, ascending.
        points: positions of all points at the last evaluation, (n, 3), m.
        lagging: True if friction or damping act on contacts of the accepted state.
        evaluated: True if the forces are those of the trial state.
        cut: True if the last correction was not taken as a whole.
        rubs: False: matrices have what there is of friction.
    """

    rubs = False

    def __init__(
        self, comm: MPI.Intracomm, described: Sequence[ContactSurfaces], points: ContactPoints,
        blocks: Mapping[int, FrameBlock], element_ranks: Mapping[int, IntArray],
    ) -> None:  # fmt: skip
        """Exchange the owners of nodes and triangles (collective).

        Args:
            comm: communicator.
            described: serial data of the contacts.
            points: serial data of their points.
            blocks: blocks of the system, by kind.
            element_ranks: rank of every element of the blocks, by kind.
        """
        self._comm, count = comm, len(points.start)
        places = [place for one in described for place in one.rigid]
        self.frames = SurfaceFrames(comm, places, blocks)
        carrying = {kind: blocks[kind] for kind in np.unique(points.kind).tolist() if kind >= 0}
        self.carriers = Carriers(comm, points, carrying)
        self._ranks = _triangle_ranks(points, self.carriers.home, element_ranks)
        moving = self.frames.kind[self.frames.moving].tolist()
        self.kinds = sorted({*carrying, *moving})
        self.points, self._forces = points.start.copy(), np.zeros((count, 3))
        self._steps = np.zeros((count, 3))
        self._rows = NormalRows(self.carriers, self.frames)
        own = self.carriers.home == comm.rank
        self.groups = [ContactGroup.of(one, own) for one in described]
        every = [group.surfaces.contact for group in self.groups]
        self.lagging = any(one.friction > 0.0 or one.damping > 0.0 for one in every)
        given = [one.stiffness or 0.0 for one in every]
        self.inertia: float | None = None
        self.set_stiffness(np.array(given))
        self.time = self.accepted = 0.0
        self.evaluated = self.cut = False
        self._entries: tuple[float, dict[tuple[int, int], Triplets]] | None = None
        self.update()

    def start(self, h: float) -> None:
        """Do nothing: the stiffness is that of the first matrix."""

    def mark(self) -> None:
        """Do nothing: corrections of the trial state are not cut."""

    def safe_part(self, keep: float) -> float:
        """Part of a correction of the trial state that may be taken: all of it."""
        return 1.0

    def safe_part_of_step(self, keep: float) -> float:
        """Part of a predicted motion that may be taken: all of it."""
        return 1.0

    def unsettled(self) -> float:
        """Return zero: the size of corrections tells when an iteration ends."""
        return 0.0

    def prepare(self, inertia: float) -> None:
        """Choose the stiffness from the first matrix; see ``ContactSurfaces.stiffness``.

        It is the same one again after a return to the start, also where the first step that was
        tried was not that taken.
        """
        if not self.stiffness.all():
            self.inertia = inertia if self.inertia is None else self.inertia
            chosen = [group.surfaces.stiffness(self.inertia) for group in self.groups]
            self.set_stiffness(np.array(chosen))

    def set_stiffness(self, stiffness: FloatArray) -> None:
        """Set the force per penetration and area of each contact, N/m^3."""
        self.stiffness = stiffness
        for group, value in zip(self.groups, stiffness.tolist(), strict=True):
            group.set_stiffness(value)

    def triangles(self) -> list[tuple[TriangleContact, ContactPass]]:
        """All contacts with triangles, and their passes."""
        return [p for g in self.groups for p in zip(g.triangles, g.passes, strict=True)]

    def rigid(self) -> Iterator[tuple[ContactGroup, RigidContact, int]]:
        """All contacts with rigid surfaces of simple shapes, and the numbers of these."""
        number = 0
        for group in self.groups:
            for made in group.rigid:
                yield group, made, number
                number += 1

    def update(self) -> None:
        """Update the neighbour lists for the accepted positions (collective)."""
        self.carriers.place(self.points, ghosts=True)
        self.frames.update()
        passes = self.triangles()
        moved = [made.moved(self.points) for made, _ in passes]
        if self._comm.allreduce(any(moved), op=MPI.LOR):
            self._search()
        for made, _ in passes:
            made.settle(self.points)
        self.evaluated = False

    def _search(self) -> None:
        """Update the neighbour lists, also those of other ranks' triangles (collective)."""
        passes = self.triangles()
        chosen = [one.chosen for _, one in passes]
        if self._comm.size > 1:
            chosen = [self._nearby(made, one) for made, one in passes]
            wanted = [
                made.masters.triangles[c].ravel()
                for (made, _), c in zip(passes, chosen, strict=True)
            ]
            self.carriers.ask(np.concatenate(wanted))
            self.carriers.bring(self.points)
        for (made, _), triangles in zip(passes, chosen, strict=True):
            made.search(self.points, triangles)

    def _nearby(self, made: TriangleContact, one: ContactPass) -> IntArray:
        """Master triangles near the slaves of this rank, ascending (collective)."""
        mine = one.chosen[self._ranks[one.chosen] == self._comm.rank]
        triangles, thickness = made.masters.triangles[mine], made.masters.thickness[mine]
        low, high = np.empty((len(mine), 3)), np.empty((len(mine), 3))
        triangle_boxes(self.points, triangles, thickness + made.skin, low, high)
        at, reach = self.points[made.slaves.nodes], made.slaves.offsets[:, np.newaxis]
        boxes = np.empty((self._comm.size, 2, 3))
        self._comm.Allgather(enclosing([(at - reach, at + reach)]), boxes)
        lists = [mine[touching(low, high, one)] for one in boxes]
        return np.sort(np.concatenate(send_numbers(self._comm, lists)))

    def evaluate(self) -> None:
        """Find the contacts at the trial state (collective)."""
        self.carriers.place(self.points)
        self.frames.update()
        h = self.time - self.accepted
        for made, _ in self.triangles():
            made.evaluate(self.points, h)
        for _, rigid, number in self.rigid():
            rigid.evaluate(self.points, self.frames.frames[number], h)
        self.evaluated, self._entries = True, None

    def forget(self) -> None:
        """Find the contacts anew when they are asked for, as where positions have jumped."""
        self.evaluated = False

    def refresh(self) -> None:
        """Find the contacts at the accepted state, unless known (collective)."""
        if not self.evaluated:
            self.evaluate()

    def accept(self) -> None:
        """End a step (collective)."""
        if self.lagging:
            self.evaluate()
            for group in self.groups:
                for made in group.every:
                    made.accept(self.points)
        self.accepted = self.time
        self.update()

    def collect(self, scale: float) -> None:
        """Evaluate, and gather ``scale`` times the forces for the blocks (collective)."""
        self.evaluate()
        self.evaluated = False
        self._forces[:] = self.frames.wrenches[:] = 0.0
        for made, _ in self.triangles():
            made.add_forces(self._forces, scale)
        for _, rigid, number in self.rigid():
            rigid.add_forces(self._forces, self.frames.wrenches[number], scale)
        self.carriers.gather(self._forces)
        self.frames.gather()

    def hand_out(self, kind: int, scale: float) -> None:
        """Add the forces gathered last, with the same scale, to the residual of a block."""
        if kind in self.carriers.by_kind:
            self.carriers.add_loads(kind, self._forces, scale)
        self.frames.add_wrenches(kind)

    def act(self, scale: float) -> None:
        """Gather ``scale`` times the tangent applied to the blocks' steps (collective)."""
        self.carriers.move(self._steps)
        twists = self.frames.twists()
        self._forces[:] = self.frames.wrenches[:] = 0.0
        for made, _ in self.triangles():
            made.add_actions(self._steps, self._forces, scale)
        for _, rigid, number in self.rigid():
            rigid.add_actions(
                self._steps, twists[number], self._forces, self.frames.wrenches[number], scale
            )
        self.carriers.gather(self._forces)
        self.frames.gather()

    def hand_out_action(self, kind: int, scale: float) -> None:
        """Add the action gathered last to the residual of a block."""
        if kind in self.carriers.by_kind:
            self.carriers.add_changes(kind, self._forces, scale)
        self.frames.add_wrenches(kind)

    def entries(self, scale: float) -> dict[tuple[int, int], Triplets]:
        """Rows, columns and values of ``scale`` times the tangent (collective).

        One entry for each pair of kinds of blocks; kept until contacts are evaluated again.
        """
        if self._entries is None or self._entries[0] != scale:
            found = ContactEntries(self.carriers, self.frames)
            for made, _ in self.triangles():
                found.add(*made.blocks(scale))
            for _, rigid, number in self.rigid():
                found.add_surface(*rigid.blocks(scale), number)
            found.add_turning(scale)
            self._entries = scale, found.entries()
        return self._entries[1]

    def rows(self) -> NormalRows:
        """Normal parts of the tangents of the contacts that are closed at the last evaluation."""
        rows = self._rows
        rows.clear()
        for made, _ in self.triangles():
            rows.add_triangles(made)
        for _, rigid, number in self.rigid():
            rows.add_surface(rigid, number)
        return rows

    def nearby(self, kind: int) -> FloatArray:
        """Stiffness (n_owned, 6) at the nodes of a block of contacts that are or may be closed.

        Those are slaves within the skin of a rigid surface, or with candidates (collective). For
        rotations it is that of the arms, N m.
        """
        self.carriers.place(self.points)
        self.frames.update()
        return stiffness_nearby(
            self.groups, self.points, self.carriers, self.frames, kind
        )  # fmt: skip

    def numberings(self) -> dict[str, Numbering]:
        """Numberings of the rows of :meth:`state`."""
        here = self.carriers.here
        owned = np.ones(len(here), dtype=np.bool_)
        return {"contacts": Numbering(here, owned, len(self.points))}

    def state(self) -> State:
        """Stiffness, and the history of the points here (collective)."""
        self.update()
        values = {"contact_stiffness": self.stiffness}
        rows: dict[str, FloatArray] = {}
        for name, made, _ in self._named():
            if isinstance(made, TriangleContact):
                memory = made.memory(self.points)
            else:
                memory = made.memory()
            rows[name] = np.zeros((len(self.carriers.here), memory.shape[1]))
            rows[name][self._at(made)] = memory
        return State(values, {"contacts": rows})

    def doubts(self, state: State) -> str:
        """Return this rank's objection to its rows; empty if there is none."""
        found = (
            made.doubts(state.rows["contacts"][name][self._at(made)], len(self.points))
            for name, made, _ in self._named()
            if isinstance(made, TriangleContact)
        )
        return next(filter(None, found), "")

    def restore(self, state: State) -> None:
        """Restore the return value of :meth:`state`, after the blocks have (collective)."""
        self.set_stiffness(state.values["contact_stiffness"].copy())
        self.update()
        self.accepted = self.time
        for name, made, number in self._named():
            memory = state.rows["contacts"][name][self._at(made)]
            if isinstance(made, TriangleContact):
                made.recall(self.points, memory)
            else:
                made.recall(self.points, self.frames.frames[number], memory)

    def _named(self) -> Iterator[tuple[str, TriangleContact | RigidContact, int]]:
        """All contacts with unique names, and the numbers of rigid surfaces."""
        number = 0
        for group in self.groups:
            for k, made in enumerate(group.every):
                yield f"{group.surfaces.contact.name}_{k}", made, number
                number += isinstance(made, RigidContact)

    def _at(self, made: TriangleContact | RigidContact) -> IntArray:
        """Rows of a contact's slaves among the points here."""
        return np.searchsorted(self.carriers.here, made.slaves.nodes)

    @property
    def longest_step(self) -> float:
        """Largest motion of nodes (m) until :meth:`update` for which none passes through."""
        return min(group.surfaces.longest_step for group in self.groups)

    @property
    def closed(self) -> int:
        """Number of closed contacts on this rank (collective)."""
        self.refresh()
        return sum(made.count for g in self.groups for made in g.every)

    @property
    def energy(self) -> float:
        """Energy stored by the contacts of this rank, J (collective)."""
        self.refresh()
        return sum(made.energy + made.closed.stored for g in self.groups for made in g.every)

    @property
    def lost(self) -> float:
        """Energy dissipated by friction and damping on this rank, J."""
        return sum(made.closed.lost for g in self.groups for made in g.every)

    def measure(self, name: str) -> FloatArray:
        """This rank's share in gap, penetration, forces and number, (7,) (collective)."""
        self.refresh()
        group = next(g for g in self.groups if g.surfaces.contact.name == name)
        deepest = max([made.deepest for made in group.every], default=0.0)
        deepest = self._comm.allreduce(deepest, op=MPI.MAX)
        closed = sum(made.count for made in group.every)
        deepest *= float(self._comm.rank == 0)
        return np.array([-deepest, deepest, *group.forces, closed])


def _triangle_ranks(
    points: ContactPoints, home: IntArray, element_ranks: Mapping[int, IntArray]
) -> IntArray:
    """Rank that searches the neighbours of each triangle, (m,)."""
    first = points.masters.triangles[:, 0]
    ranks: IntArray = home[first].copy()
    for kind, own in element_ranks.items():
        mine = np.flatnonzero((points.kind[first] == kind) & (points.element >= 0))
        ranks[mine] = own[points.element[mine]]
    return ranks
