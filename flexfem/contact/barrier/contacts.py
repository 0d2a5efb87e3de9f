# SPDX-License-Identifier: LGPL-3.0-or-later
"""All contacts of a system on this rank.

A group of pairs belongs to the rank of its first point, which receives the points of other ranks
near its own: ranks exchange boxes around their cells, and send the points of cells that overlap
these. Positions are received in every evaluation, and forces are sent back. Arrays have one row for
every point of the model; only those of points here or nearby are used.

In motions the forces are means over the step, of the discrete derivative of the potential, and act
by impulses (``integrators.split``); elsewhere they are its derivative at the trial state.
"""

from collections.abc import Mapping, Sequence

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.barrier.pairs import ContactPairs, PointMotion
from flexfem.contact.barrier.restitution import Pulls, Solve
from flexfem.contact.barrier.rows import GroupRows
from flexfem.contact.barrier.spins import Spins
from flexfem.contact.barrier.surface import ContactSurface
from flexfem.contact.barrier.ways import farthest, leaves, moves, short_part
from flexfem.contact.carriers import Carriers
from flexfem.contact.detection.broad_phase import enclosing, touching
from flexfem.contact.primitives.candidates import Boxes, Motion
from flexfem.contact.primitives.neighbourhoods import Neighbourhoods
from flexfem.contact.surfaces.surfaces import CollisionSurfaces
from flexfem.contact.tangent_entries import ContactEntries, Triplets
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.nodes.halo import send_numbers
from flexfem.core.state import Numbering, State

__all__ = ["BarrierContacts"]

#: Motion for which pairs are found: that of so many steps like the last one, and to all sides a
#: part of the largest gap below which they repel, and of the way of the last step, or of that of
#: the fastest point, which may hit another one.
_STEPS, _SKIN, _ASIDE, _HIT = 4.0, 0.25, 2.0, 0.25
#: Largest way to all sides outside of motions, in parts of the largest edge of the cells.
_NARROW = 0.25
#: Part of the largest edge of the cells by which points move at most in one correction.
_STRIDE = 1.0
#: Relative change of forces, and way of points in parts of the gap at which they repel, at which an
#: iteration ends.
_SETTLED, _NEAR = 1e-8, 1e-3
#: Way of points, in the same parts, below which the last correction was close to the solution.
_CLOSE = 0.5


class BarrierContacts:
    """All contacts of a system.

    Attributes:
        contacts: in the order of the model, with the pairs of this rank; every: these pairs.
        carriers: of the points; spins: these of the points, where there is friction.
        kinds: kinds of the blocks on which they act, ascending.
        rubs: True if there is friction.
        time: time of the trial state, s.
        factor: factor of the forces in the equations: 1 in equilibria, that of impulses in motions,
            0 at the accepted states of these.
        cayley: True if nodes rotate by Cayley vectors in the present step.
        evaluated: True if the response is that of the trial state.
        cut: True if the last correction was not taken as a whole.
    """

    def __init__(
        self, comm: MPI.Intracomm, surfaces: CollisionSurfaces,
        made: Sequence[tuple[ContactSurface, Neighbourhoods]], blocks: Mapping[int, FrameBlock],
        gravity: float,
    ) -> None:  # fmt: skip
        """Exchange the owners of nodes (collective).

        Args:
            comm: communicator.
            surfaces: serial data of everything that touches.
            made: of ``start.start_apart``.
            blocks: blocks of the system, by kind.
            gravity: acceleration, m/s^2.
        """
        self._comm, count = comm, len(surfaces.start)
        carrying = {k: blocks[k] for k in np.unique(surfaces.kind).tolist() if k >= 0}
        self.kinds = sorted(carrying)
        self.carriers = Carriers(comm, surfaces, carrying)
        here = self.carriers.home == comm.rank
        # to the trial state
        self._motion = PointMotion.of(surfaces.start)
        self.contacts = [ContactPairs(own, near, here, self._motion, gravity) for own, near in made]
        self.rubs = any(one.rubs for one in self.contacts)
        self.spins = Spins(
            self.carriers, self._motion, surfaces.primitives.triangles, used=self.rubs
        )  # fmt: skip
        self.every = [pairs for one in self.contacts for pairs in one.every]
        self._rows = GroupRows(self.carriers, self.spins, self.every)
        self._pulls = Pulls(comm, self.carriers, self.spins, self.every)
        # of obstacles: far from where they touch
        self._axes = np.unique(np.concatenate([one.own.obstacles.points.ravel() for one in
                                               self.contacts]))  # fmt: skip
        self._reach = max(one.own.reach for one in self.contacts)
        self._stride = _STRIDE * max(_longest_edge(surfaces, one) for one in self.contacts)
        self._speed: FloatArray | None = None
        self._gravity = gravity
        self._points, self._before = self._motion.after, self._motion.before
        # positions at which the last correction has begun
        self._last = surfaces.start.copy()
        self._forces, self._couples, self._steps = np.zeros((3, count, 3))
        # boxes of the points in which no other pairs are found
        self._low = np.full((count, 3), np.inf)
        self._high = -self._low
        self._still = np.zeros((count, 3))
        self._over_step, self.factor, self.cayley = False, 1.0, False
        self._ahead = 0.0
        # of all pairs in the last correction, by contact; empty where it is not known
        self._ways: list[float] = []
        self._evaluated = np.full((count, 3), np.nan)
        self._moves = np.ones(count)
        self._moves[: surfaces.carried] = surfaces.kind >= 0
        self.evaluated, self.cut, self.time = False, False, 0.0
        self._entries: tuple[float, dict[tuple[int, int], Triplets]] | None = None
        self._know(here)

    # -- Stiffness ------------------------------------------------------------------------------

    def start(self, h: float) -> None:
        """Choose the stiffness of the barriers, once, for a first step of size h, s (collective).

        It depends on the speeds at the start.
        """
        if self._speed is not None:
            return
        rates, spins = np.zeros((2, *self._points.shape))
        self.carriers.rates(rates, spins)
        fastest = float(np.linalg.norm(rates, axis=1).max(initial=0.0))
        if self._comm.size > 1:
            fastest = self._comm.allreduce(fastest, op=MPI.MAX)
        speeds = [one.own.speed(fastest, self._gravity, h) for one in self.contacts]
        self._set_speed(np.array(speeds))

    def prepare(self, inertia: float) -> None:
        """Choose it for an equilibrium, where the factor of the mass in the matrix is zero."""
        if self._speed is None and inertia == 0.0:
            self.start(np.inf)

    def _set_speed(self, speeds: FloatArray) -> None:
        """Set the speeds of impacts that the barriers are made for, (c,), m/s."""
        self._speed = speeds
        for one, speed in zip(self.contacts, speeds.tolist(), strict=True):
            one.stiffen(one.own.stiffness(speed))
        self._low[:], self._high[:] = np.inf, -np.inf

    # -- Relaxation -----------------------------------------------------------------------------

    def look_ahead(self, steps: float) -> None:
        """Search pairs for so many steps as long as the last one, also outside of motions."""
        self._ahead = steps

    def mark_unsafe(self, keep: float) -> float:
        """Part of the motion from the marked to the trial state without contact (collective).

        It is that of :meth:`safe_part`; the points of all pairs that are cut are marked.
        """
        self._place()
        self._search()
        self._forces[:] = 0.0
        way = farthest(self._last, self._points, self._known)
        part = short_part(self._last, self._points, self._touching, self._stride)
        for one in self.every:
            part = min(part, one.mark_unsafe(self._last, self._points, way, keep, self._forces))
        part = self._least(part)
        if part < 1.0:
            self.carriers.gather(self._forces)
        return part

    def unsafe(self, kind: int) -> BoolArray:
        """Nodes (n_owned,) of a block with points that are marked."""
        return self.carriers.at_nodes(kind, self._forces[:, 0])[:, 0] > 0.0

    # -- Motion ---------------------------------------------------------------------------------

    def begin_step(self, h: float, weight: float, *, cayley: bool = False) -> None:
        """Start a step of size ``h`` (s) at the accepted state (collective).

        Forces have the factor ``weight`` in its equations. ``cayley`` is True where nodes rotate by
        Cayley vectors.
        """
        self._place()
        self._before[:] = self._last[:] = self._points
        self._ways = []
        self._over_step, self.factor, self.cayley, self.cut = True, weight, cayley, False
        self.start(h)
        self.spins.begin()
        for one in self.contacts:
            one.begin(h)

    def end_step(self, factor: float) -> None:
        """End a step; forces have a factor in the accelerations of the accepted state."""
        self.factor = factor
        for one in self.contacts:
            one.end()

    def begin_row(self) -> None:
        """Begin the steps of one row of the history, over which measured forces are means."""
        for one in self.contacts:
            one.impulse, one.span = np.zeros(4), 0.0

    @property
    def restitutes(self) -> bool:
        """True if a contact dissipates energy by restitution."""
        return self._pulls.wanted

    def pull(self, h: float, solve: Solve) -> bool | None:
        """Find the pulls of restitution at the end of a step of size h (s), see ``Pulls.find``."""
        return self._pulls.find(self._points, h, solve)

    @property
    def pressing(self) -> bool:
        """True if the accepted accelerations have contact forces in them, on this rank."""
        return not self._over_step and self.factor != 0.0 and any(c.count for c in self.contacts)

    def mark(self) -> None:
        """Remember the trial state: corrections begin at it (collective)."""
        self._ways = []
        self._place()
        self._last[:] = self._points

    def safe_part(self, keep: float) -> float:
        """Part of the motion from the marked to the trial state without contact (collective).

        Every pair keeps a part of its gap, and no point moves farther than the cells are long. Of a
        longer motion no pairs are searched: a wild correction would bring all near each other.
        """
        self._place()
        part = self._least(short_part(self._last, self._points, self._touching, self._stride))
        if part < 1.0:
            return part
        self._search()
        if self._short(keep):
            return self._least(1.0)
        parts = [one.safe_part(self._last, self._points, keep) for one in self.every]
        return self._least(min([1.0, *parts]))

    def _short(self, keep: float) -> bool:
        """True if the motion since the last evaluation is too short for gaps to lose their part.

        On this rank, where obstacles rest.
        """
        if not self.evaluated or not np.array_equal(self._last, self._evaluated):
            return False
        if moves(self._last, self._points, self._axes):
            return False
        way = 2.0 * farthest(self._last, self._points, self._known)
        return all(way < (1.0 - keep) * one.shortest() for one in self.every)

    def _least(self, part: float) -> float:
        """Smallest of all ranks' numbers (collective)."""
        return float(self._comm.allreduce(part, op=MPI.MIN)) if self._comm.size > 1 else part

    def safe_part_of_step(self, keep: float) -> float:
        """Part of the motion from the step's start to the trial state without contact."""
        self._last[:] = self._before
        return self.safe_part(keep)

    def unsettled(self) -> float:
        """How much the last correction changes forces, over what ends an iteration (collective).

        Corrections are small enough where forces change by 1e-8 of the largest one, and points
        move by a thousandth of the gap at which they repel. The largest one is that of all ranks:
        a rank whose own forces are all small must not ask for more than one rank alone would.
        """
        steps = self._points - self._last
        change = largest = 0.0
        for one in self.every:
            if one.closed:
                largest = max(largest, one.pushes.max())
                moved = one.slopes * one.motions(steps, self._still)
                change = max(change, float(np.abs(moved).max()))
        change, largest, *self._ways = self._largest([change, largest, *self._own_ways()])
        way = max(self._ways)
        return max(change / (_SETTLED * largest) if largest > 0.0 else 0.0, way / _NEAR)

    def _own_ways(self) -> list[float]:
        """Ways of this rank's pairs in the last correction, by contact, see ``ContactPairs``."""
        return [one.way(self._last, self._points) for one in self.contacts]

    def _largest(self, values: list[float]) -> list[float]:
        """Largest of each number on all ranks (collective)."""
        if self._comm.size == 1:
            return values
        found = np.array(values)
        self._comm.Allreduce(MPI.IN_PLACE, found, op=MPI.MAX)
        every: list[float] = found.tolist()
        return every

    def _place(self) -> None:
        """Positions of the trial state (collective)."""
        self.carriers.place(self._points)

    def _know(self, known: BoolArray) -> None:
        """Store the known points (n,), and which of them are not those of obstacles."""
        self._known, self._touching = known, known.copy()
        self._touching[self._axes] = False

    def _search(self) -> None:
        """Find all pairs near the present motion, unless those found include them (collective)."""
        known = self._known
        out = leaves(self._points, self._low, self._high, known) or leaves(
            self._last, self._low, self._high, known
        )
        if self._over_step:
            out = out or leaves(self._before, self._low, self._high, known)
        if self._comm.size > 1:
            out = self._comm.allreduce(out, op=MPI.LOR)
        if not out:
            return
        if self._comm.size > 1:
            self._bring()
        self._low, self._high = self._boxes()
        motion = Motion(self._low, self._high, known=self._known)
        for one in self.contacts:
            one.search(motion)
        self.evaluated = False

    @property
    def _sets(self) -> list[FloatArray]:
        """Positions (n, 3) between which pairs are to be known."""
        return [self._last, self._points, *([self._before] if self._over_step else [])]

    def _boxes(self) -> tuple[FloatArray, FloatArray]:
        """Corners (n, 3) of boxes in which points stay for some steps (collective)."""
        sets, aside = self._sets, np.full((len(self._points), 1), _SKIN * self._reach)
        if self._over_step:
            way = self._points - self._before
            size = np.linalg.norm(way, axis=1, keepdims=True)
            steps = np.minimum(_STEPS, self._stride / np.maximum(size, 1e-300))
            sets = [*sets, self._before + steps * way]
            fastest = farthest(self._before, self._points, self._touching)
            if self._comm.size > 1:
                fastest = self._comm.allreduce(fastest, op=MPI.MAX)
            aside += np.minimum(np.maximum(_ASIDE * size, _HIT * fastest), self._stride)
        elif self._ahead:
            longest = np.array([farthest(self._last, self._points, self._touching)])
            if self._comm.size > 1:
                self._comm.Allreduce(MPI.IN_PLACE, longest, op=MPI.MAX)
            aside += min(0.5 * self._ahead * longest[0], _NARROW * self._stride)
        return np.minimum.reduce(sets) - aside, np.maximum.reduce(sets) + aside

    def _bring(self) -> None:
        """Ask for the points near those of this rank (collective)."""
        sets = self._sets
        carriers, comm = self.carriers, self._comm
        mine = [_own_cells(one, carriers.home == comm.rank) for one in self.contacts]
        corners = [one.own.surface.complex.points[cells] for one, cells in
                   zip(self.contacts, mine, strict=True)]  # fmt: skip
        own = np.concatenate([self._axes, *(c.ravel() for c in corners)])
        carriers.ask(own)
        self._bring_all(sets)
        boxes = []
        low, high = self._boxes()
        for one, cells in zip(self.contacts, mine, strict=True):
            found = Boxes.of(one.own.surface, one.own.touching, Motion(low, high))
            boxes.append((found.low[cells], found.high[cells]))
        everyone = np.empty((comm.size, 2, 3))
        comm.Allgather(enclosing(boxes), everyone)
        lists = []
        for other in everyone:
            inside = [
                c[touching(a, b, other)].ravel() for c, (a, b) in zip(corners, boxes, strict=True)
            ]
            lists.append(np.unique(np.concatenate(inside)))
        received = np.concatenate(send_numbers(comm, lists))
        wanted = np.concatenate([own, received])
        carriers.ask(wanted)
        known = carriers.home == comm.rank
        known[wanted] = True
        self._know(known)
        self._bring_all(sets)

    def _bring_all(self, sets: list[FloatArray]) -> None:
        """Receive positions and steps' histories of the points asked for (collective)."""
        for values in sets:
            self.carriers.bring(values)

    # -- Forces ---------------------------------------------------------------------------------

    def evaluate(self) -> None:
        """Evaluate all pairs at the trial state (collective)."""
        self._place()
        if not self._over_step:
            way = farthest(self._last, self._points, self._known)
            for pairs in self.every:
                pairs.went(way)
            self._last[:] = self._points
        self._search()
        if self._over_step:
            self.spins.update()
        near = [False] * len(self.contacts)
        if self._over_step and not self.cut:
            # of all ranks: which tangent a contact takes is no matter of who has its pairs
            ways = self._ways or self._largest(self._own_ways())
            near = [way < _CLOSE for way in ways]
        for one, close in zip(self.contacts, near, strict=True):
            one.evaluate(over_step=self._over_step, near=close)
        self.evaluated, self._entries = True, None
        self._evaluated[:] = self._points

    def forget(self) -> None:
        """Find all pairs anew at the next evaluation, as where positions have jumped."""
        self._low[:], self._high[:] = np.inf, -np.inf
        self.evaluated = False

    def refresh(self) -> None:
        """Evaluate at the accepted state, unless it has been (collective)."""
        if not self.evaluated:
            self.evaluate()

    def collect(self, scale: float) -> None:
        """Evaluate, and gather ``scale`` times minus the forces for the blocks (collective)."""
        self.evaluate()
        self._gather(scale * self.factor)

    def _gather(self, scale: float) -> None:
        self._forces[:] = self._couples[:] = 0.0
        for one in self.every:
            one.add_forces(-scale, self._forces, self._couples)
        self.spins.gather(self._couples, self._forces)
        self.carriers.gather(self._forces)

    def hand_out(self, kind: int, scale: float) -> None:
        """Add the forces gathered last, with the same scale, to the residual of a block."""
        if self._over_step:
            self.carriers.add_over_step(kind, self._forces, scale, cayley=self.cayley)
        else:
            self.carriers.add_loads(kind, self._forces, scale)
        self.spins.add_couples(kind, self._couples)

    def subtract_means(self) -> None:
        """Evaluate, and subtract the forces from the blocks' residuals (collective)."""
        self.evaluate()
        self._gather(1.0)
        for kind in self.kinds:
            self.hand_out(kind, 1.0)

    def act(self, scale: float) -> None:
        """Gather ``scale`` times the tangent applied to the blocks' steps (collective)."""
        self.carriers.move(self._steps)
        spins = self.spins.of_steps(self._steps)
        self._forces[:] = self._couples[:] = 0.0
        for one in self.every:
            one.add_actions(
                scale * self.factor, self._steps, spins, self._forces, self._couples
            )  # fmt: skip
        self.spins.gather(self._couples, self._forces)
        self.carriers.gather(self._forces)

    def hand_out_action(self, kind: int, scale: float) -> None:
        """Add the action gathered last to the residual of a block."""
        self.carriers.add_changes(kind, self._forces, scale)
        self.spins.add_couples(kind, self._couples)

    def entries(self, scale: float) -> dict[tuple[int, int], Triplets]:
        """Rows, columns and values of ``scale`` times the tangent (collective).

        One entry for each pair of kinds of blocks; kept until contacts are evaluated again.
        """
        if self._entries is None or self._entries[0] != scale:
            found = ContactEntries(self.carriers)
            for one in self.every:
                found.add(*one.blocks(scale * self.factor))
            found.add_turning(scale)
            self._entries = scale, found.entries()
        return self._entries[1]

    def rows(self) -> GroupRows:
        """Normal parts of the tangents of the contacts that are closed at the last evaluation."""
        self._rows.take(self.factor)
        return self._rows

    def nearby(self, kind: int) -> FloatArray:
        """Bounds (n_owned, 6) of the sums of rows that closed contacts add at a block's nodes.

        They are in N/m, and N m for rotations (collective).
        """
        self.refresh()
        self._forces[:] = 0.0
        for one in self.every:
            one.add_stiffness(self._moves, self._forces)
        self.carriers.gather(self._forces)
        return self.carriers.at_nodes(kind, self.factor * self._forces[:, 0])

    # -- Accepted states ------------------------------------------------------------------------

    def accept(self) -> None:
        """End a step (collective)."""
        return

    def update(self) -> None:
        """Begin again at the accepted state of an equilibrium (collective).

        Forces are those of states at rest from now on, also after a motion.
        """
        self._over_step, self.factor, self.evaluated = False, 1.0, False

    def numberings(self) -> dict[str, Numbering]:
        """Numberings of the rows of :meth:`state`; there are none."""
        return {}

    def state(self) -> State:
        """Stiffness, and whether forces are in the impulses."""
        speeds = np.full(len(self.contacts), np.nan) if self._speed is None else self._speed
        return State({"contact_speeds": speeds, "contact_factor": np.array([self.factor])})

    def doubts(self, state: State) -> str:
        """Return this rank's objection to its rows; there are none."""
        return ""

    def restore(self, state: State) -> None:
        """Restore the return value of :meth:`state`, after the blocks have (collective)."""
        speeds = state.values["contact_speeds"].copy()
        if np.isfinite(speeds).all():
            self._set_speed(speeds)
        self.factor = float(state.values["contact_factor"][0])
        self._over_step = self.factor == 0.0
        self._place()
        self._before[:] = self._last[:] = self._points
        self.evaluated = False

    # -- Measures -------------------------------------------------------------------------------

    @property
    def longest_step(self) -> float:
        """Largest motion of nodes (m) for which nothing passes through: corrections are cut."""
        return np.inf

    @property
    def closed(self) -> int:
        """Number of pairs that act on this rank (collective)."""
        self.refresh()
        return sum(one.closed for one in self.contacts)

    @property
    def energy(self) -> float:
        """Energy stored by the contacts of this rank, J (collective)."""
        self.refresh()
        return sum(one.energy for one in self.every)

    @property
    def lost(self) -> float:
        """Energy dissipated on this rank, J."""
        return sum(one.lost for one in self.every)

    def least_gap(self, name: str) -> float:
        """Least gap of a contact on all ranks, m; its reach if no pair is nearer (collective)."""
        one = next(one for one in self.contacts if one.contact.name == name)
        return self._least(one.least_gap())

    def measure(self, name: str) -> FloatArray:
        """This rank's share in gap, penetration, forces and number, (7,) (collective)."""
        self.refresh()
        least = self.least_gap(name)
        one = next(one for one in self.contacts if one.contact.name == name)
        forces = one.impulse / one.span if one.span > 0.0 else one.total()
        return np.array([least * float(self._comm.rank == 0), 0.0, *forces, one.closed])


def _own_cells(one: ContactPairs, own: BoolArray) -> IntArray:
    """Cells of a contact with points of this rank."""
    return np.flatnonzero(own[one.own.surface.complex.points].any(axis=1))


def _longest_edge(surfaces: CollisionSurfaces, one: ContactPairs) -> float:
    """Longest edge of what moves at the start, or the largest radius if there are none, m."""
    cells, x = one.own.surface.complex, surfaces.start
    ends = cells.vertices[cells.edges]
    ends = ends[np.isfinite(one.own.density[ends]).all(axis=1)]
    lengths = np.linalg.norm(x[ends[:, 1]] - x[ends[:, 0]], axis=1)
    moving = cells.vertices[np.isfinite(one.own.density[cells.vertices])]
    radius = float(one.own.surface.radius[moving].max(initial=0.0))
    return max(float(lengths.max(initial=0.0)), radius)
