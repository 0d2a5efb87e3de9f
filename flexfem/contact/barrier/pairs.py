# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pairs of cells of one contact on this rank, and what they do."""

from dataclasses import dataclass

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.barrier.surface import ContactSurface
from flexfem.contact.dissipation.data import Groups, Law, StepMotion, slow_speed
from flexfem.contact.dissipation.rows import (
    add_friction,
    add_friction_actions,
    motions_into,
    spread,
)
from flexfem.contact.dissipation.steps import dissipate, remember
from flexfem.contact.primitives.candidates import Motion
from flexfem.contact.primitives.ccd import safe_part
from flexfem.contact.primitives.data import GAP, POTENTIAL, Pairs, Response
from flexfem.contact.primitives.neighbourhoods import Neighbourhoods
from flexfem.contact.primitives.search import find_pairs
from flexfem.contact.primitives.statics import forces_at_rest
from flexfem.contact.primitives.steps import forces_of_step
from flexfem.contact.primitives.tangents import add_actions, add_forces, blocks_into, potential
from flexfem.kernels.compiled import kernel
from flexfem.kernels.records import Memory, unpack
from flexfem.model.contact import Contact

__all__ = ["ContactPairs", "PointMotion"]


@dataclass(frozen=True)
class PointMotion:
    """Motion of all points over a step, each (n, 3), see ``dissipation.data.StepMotion``.

    Attributes:
        before, after: positions, m; ``after`` are those of the trial state, of any motion.
        spins, rates, spin_rates: of the step, and before it, where there is friction.
    """

    before: FloatArray
    after: FloatArray
    spins: FloatArray
    rates: FloatArray
    spin_rates: FloatArray

    @classmethod
    def of(cls, start: FloatArray) -> "PointMotion":
        """Points at rest at positions (n, 3)."""
        return cls(start.copy(), start.copy(), *np.zeros((3, *start.shape)))


class ContactPairs:
    """Pairs of one contact whose groups belong to this rank.

    Attributes:
        own: the contact's surface.
        surface: with the stiffness of the barrier.
        pairs: those that may touch near the present motion.
        response: at the last evaluation; groups: the same by groups of pairs.
        impacts: speed of impact of closed contacts at their first points, (n,), m/s.
        lost: energy dissipated in all steps, J.
        rubs: True if there is friction.
    """

    def __init__(
        self, own: ContactSurface, near: Neighbourhoods, here: BoolArray, motion: PointMotion,
        gravity: float,
    ) -> None:  # fmt: skip
        """Begin without pairs.

        Args:
            own: the contact's surface.
            near: its pairs that are left out.
            here: points of this rank, (n,).
            motion: of all points.
            gravity: acceleration, m/s^2.
        """
        self.own, self.surface, self._near, self._here = own, own.surface, near, here
        self._law = _law(own, gravity)
        self.impacts, self.lost = np.zeros(len(here)), 0.0
        self._motion = StepMotion(
            before=motion.before, after=motion.after, spins=motion.spins, rates=motion.rates,
            spin_rates=motion.spin_rates, impacts=np.zeros(len(here)),
            radius=own.surface.radius, dt=1.0, blur=1.0,
        )  # fmt: skip
        nothing = np.zeros(0, np.int64)
        self._use(Pairs(
            kind=nothing, points=np.zeros((0, 4), np.int64), weight=np.zeros(0), touch=np.zeros(0),
            dhat=np.zeros(0), kappa=np.zeros(0), starts=np.zeros(1, np.int64),
        ))  # fmt: skip

    @property
    def contact(self) -> Contact:
        """The contact of the model."""
        return self.own.contact

    @property
    def rubs(self) -> bool:
        """True if there is friction."""
        return self._law.static_friction > 0.0

    def _use(self, pairs: Pairs) -> None:
        self.pairs, self.response, self.groups = pairs, Response.of(pairs), Groups.of(pairs)
        self.response.count[0] = 0

    def stiffen(self, kappa: FloatArray) -> None:
        """Set the stiffness of the barrier at each point (n,), N/m^3."""
        self.surface = self.own.stiff(kappa)

    def search(self, motion: Motion) -> None:
        """Find the pairs that may touch during a motion."""
        self._use(find_pairs(self.surface, self._near, motion, self.own.touching, self._here))

    def begin(self, dt: float) -> None:
        """Begin a step of size ``dt``, s."""
        self.groups.forget()
        self._motion.impacts[:], self._motion.dt = self.impacts, dt

    def end(self) -> None:
        """End a step that has been evaluated at its end."""
        self.lost += float(self.groups.losses.sum())
        if self._law.restitution < 1.0:
            remember(self.groups.memory, self._motion.memory, self.impacts)

    def evaluate(self, *, over_step: bool, blur: float = 1.0) -> None:
        """Evaluate the step to the trial state, or the trial state alone.

        Friction is that of Coulomb's law from a multiple ``blur`` of the slip speed on.
        """
        pairs, response, motion = self.pairs.memory, self.response.memory, self._motion
        law, motion.blur = self._law, blur
        if over_step:
            forces_of_step(pairs, motion.before, motion.after, response)
        else:
            forces_at_rest(pairs, motion.after, response)
            law = _ELASTIC
        dissipate(pairs, response, law.memory, motion.memory, self.groups.memory)

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
        add_actions(self.pairs.memory, self.response.memory, scale, steps, sums)
        if self.rubs:
            add_friction_actions(self.groups.memory, scale, steps, spins, sums, couples)

    def blocks(self, scale: float) -> tuple[IntArray, FloatArray]:
        """Points (c, 4) of the pairs that act, and ``scale`` times their tangents (c, 12, 12).

        Friction is left out.
        """
        blocks = np.empty((self.count, 12, 12))
        blocks_into(self.response.memory, scale, blocks)
        return self.pairs.points[self.response.pairs[: self.count]], blocks

    def safe_part(self, before: FloatArray, after: FloatArray, keep: float) -> float:
        """Part of a motion during which all pairs keep a part of their gap."""
        return float(safe_part(self.pairs.memory, before, after, keep))

    @property
    def count(self) -> int:
        """Number of pairs that act."""
        return int(self.response.count[0])

    @property
    def closed(self) -> int:
        """Number of groups that act."""
        return int(self.groups.count[0])

    @property
    def energy(self) -> float:
        """Potential of the pairs, J."""
        return float(potential(self.response.memory))

    @property
    def slopes(self) -> FloatArray:
        """Stiffness (g, 1 or 3) of the groups that act along their rows, N/m."""
        return self.groups.slopes[: self.closed, : 3 if self.rubs else 1]

    def motions(self, steps: FloatArray, spins: FloatArray) -> FloatArray:
        """Motions (g, 1 or 3) of the rows of the groups for steps and spins (n, 3)."""
        found = np.zeros(self.slopes.shape)
        motions_into(self.groups.memory, steps, spins, found)
        return found

    def push(self, forces: FloatArray, sums: FloatArray, couples: FloatArray) -> None:
        """Add forces (g, 1 or 3) along the rows to those on all points (n, 3)."""
        spread(self.groups.memory, forces, sums, couples)

    def gaps(self) -> FloatArray:
        """Gaps of the pairs that act, m."""
        acting = self.response.numbers[: self.count]
        found: FloatArray = acting[acting[:, POTENTIAL] != 0.0, GAP]
        return found

    def way(self, before: FloatArray, after: FloatArray) -> float:
        """Largest way of points of all pairs in a motion, in parts of the gap of repulsion."""
        return float(_way(self.pairs.memory, before, after))


def _law(own: ContactSurface, gravity: float) -> Law:
    """Laws of dissipation of a contact."""
    contact = own.contact
    reach = own.surface.dhat[own.surface.complex.vertices]
    slow = slow_speed(gravity, float(np.median(reach)))
    slip = slow if contact.slip_speed is None else contact.slip_speed
    static = contact.friction if contact.static_friction is None else contact.static_friction
    return Law(
        restitution=contact.restitution, damping=contact.damping, friction=contact.friction,
        static_friction=static, stribeck_speed=10.0 * slip, slip_speed=slip, rest_speed=slow,
    )  # fmt: skip


#: Law without dissipation.
_ELASTIC = Law(
    restitution=1.0, damping=0.0, friction=0.0, static_friction=0.0, stribeck_speed=1.0,
    slip_speed=1.0, rest_speed=1.0,
)  # fmt: skip


@kernel
def _way(pairs: Memory, before: FloatArray, after: FloatArray) -> float:
    """See :meth:`ContactPairs.way`."""
    own, largest = unpack(Pairs, pairs), 0.0
    for p in range(len(own.kind)):
        for i in range(4):
            square = 0.0
            for a in range(3):
                square += (after[own.points[p, i], a] - before[own.points[p, i], a]) ** 2
            largest = max(largest, np.sqrt(square) / own.dhat[p])
    return largest
