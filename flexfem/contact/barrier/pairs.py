# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pairs of one contact on this rank, and what they do."""

from dataclasses import dataclass

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.contact.barrier.grouped import GroupedPairs, PairKind
from flexfem.contact.barrier.kinds import OfCells, OfFields
from flexfem.contact.barrier.surface import ContactSurface
from flexfem.contact.dissipation.data import Law, StepMotion, slow_speed
from flexfem.contact.primitives.candidates import Motion
from flexfem.contact.primitives.neighbourhoods import Neighbourhoods
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
        every: pairs of cells, then those with obstacles if there are any.
        impulse: integral (4,) of :meth:`total` over the steps of a row of the history, N s, and the
            span of these, s.
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
        self.own, law = own, _law(own, gravity)
        self.impulse, self.span = np.zeros(4), 0.0
        self._motion = StepMotion(
            before=motion.before, after=motion.after, spins=motion.spins, rates=motion.rates,
            spin_rates=motion.spin_rates, radius=own.surface.radius, dt=1.0,
        )  # fmt: skip
        kinds: list[PairKind] = [OfCells(own, near, here)]
        if len(own.obstacles):
            kinds.append(OfFields(own, here))
        e = own.contact.restitution
        self.every = [GroupedPairs(kind, law, self._motion, e) for kind in kinds]
        self.rubs = law.static_friction > 0.0

    @property
    def contact(self) -> Contact:
        """The contact of the model."""
        return self.own.contact

    def stiffen(self, kappa: FloatArray) -> None:
        """Set the stiffness of the barrier at each point (n,), N/m^3."""
        for one in self.every:
            one.kind.stiffen(kappa)

    def search(self, motion: Motion) -> None:
        """Find the pairs that may touch during a motion."""
        for one in self.every:
            one.search(motion)

    def begin(self, dt: float) -> None:
        """Begin a step of size ``dt``, s."""
        self._motion.dt = dt
        for one in self.every:
            one.begin()

    def end(self) -> None:
        """End a step that has been evaluated at its end."""
        for one in self.every:
            one.end()
        self.impulse += self._motion.dt * self.total()
        self.span += self._motion.dt

    def evaluate(self, *, over_step: bool, near: bool = False) -> None:
        """Evaluate the step to the trial state, or the trial state alone.

        The tangent is the whole one of a step when the trial state is ``near`` the last one.
        """
        for one in self.every:
            one.evaluate(over_step=over_step, near=near)

    def way(self, before: FloatArray, after: FloatArray) -> float:
        """Largest way of points of all pairs in a motion, in parts of the gap of repulsion."""
        return max(one.way(before, after) for one in self.every)

    @property
    def count(self) -> int:
        """Number of pairs that act."""
        return sum(one.count for one in self.every)

    @property
    def closed(self) -> int:
        """Number of groups that act."""
        return sum(one.closed for one in self.every)

    def total(self) -> FloatArray:
        """Force on the first side, and sum of the normal forces (4,), at the last evaluation, N."""
        if not self.count:
            return np.zeros(4)
        sums, couples = np.zeros((2, *self._motion.after.shape))
        for one in self.every:
            one.add_all_forces(sums, couples)
        normal = sum(float(one.pushes.sum() - one.pulls.sum()) for one in self.every)
        return np.append(sums[self.own.first[self.own.surface.label]].sum(axis=0), normal)

    def least_gap(self) -> float:
        """Least gap, m, its reach if no pair is nearer."""
        gaps = (float(one.gaps().min(initial=np.inf)) for one in self.every)
        return min(self.own.reach, *gaps)


def _law(own: ContactSurface, gravity: float) -> Law:
    """Laws of dissipation of a contact."""
    contact = own.contact
    reach = own.surface.dhat[own.surface.complex.vertices]
    slow = slow_speed(gravity, float(np.median(reach)))
    slip = slow if contact.slip_speed is None else contact.slip_speed
    static = contact.friction if contact.static_friction is None else contact.static_friction
    return Law(
        damping=contact.damping, friction=contact.friction, static_friction=static,
        stribeck_speed=10.0 * slip, slip_speed=slip,
    )  # fmt: skip
