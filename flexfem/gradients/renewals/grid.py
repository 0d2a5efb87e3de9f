# SPDX-License-Identifier: LGPL-3.0-or-later
"""The steps that a motion took: which states they lead to, how large they are, and what is between.

A gradient goes over the same steps, whose sizes count as given: those of parts of a step between
kinks of loads, of steps that were halved after a failure, and of adaptive ones. Where a load jumps,
or an event happens, states follow one another at the same time. Times of events do not count as
given: sizes of steps that end or begin at one depend on the motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.gradients.renewals.hold import Hold
from flexfem.gradients.renewals.renewal import Projection, Renewal
from flexfem.integrators.generalized_alpha import GeneralizedAlpha
from flexfem.integrators.integrator import Integrator
from flexfem.simulation.motion.journal import Journal

__all__ = ["Grid", "Lead", "Move", "Step"]


@dataclass(frozen=True)
class Step:
    """A step from one state to the next.

    Attributes:
        scheme: its coefficients.
        h: its size, s.
        kicked: True if velocities have changed by impulses in it.
        acting: True if there were forces of contacts or stops in it.
    """

    scheme: Integrator
    h: float
    kicked: bool
    acting: bool


#: What leads to a state: a step, or one of the parts of a renewal at the same time.
Move = Step | type[Renewal]


@dataclass(frozen=True)
class Lead:
    """A change of the acceleration-like variable a of a state, after the step to it.

    It becomes ``w + part (w - w_before)`` with the accelerations w there and at an earlier state,
    where the last step began; the factor is inverse to its size.

    Attributes:
        part: factor.
        before: number of the earlier state.
    """

    part: float
    before: int


@dataclass
class Grid(Journal):
    """All steps of a motion.

    Attributes:
        add: called for each new state.
        change: called where the last state changes.
        allow: called for each state that is made consistent or at which an event happens, to
            refuse it.
        locked: called where joints are switched; refuses it, or returns True if some rows are held
            at new values.
        ahead: part of a whole step by which the acceleration-like variable is ahead of the
            accelerations; None for integrators without one.
        parts: returns those of the renewal that has been made.
        ends: numbers of the states with which renewals end.
        moves: what leads to each state but the first.
        leads: changes of states by their numbers.
        events: numbers of the events that happen at states, by the numbers of these.
        restitutions: (r,) factors by which rates of rows are reversed by a projection to a state.
    """

    add: Callable[[], None]
    change: Callable[[], None]
    allow: Callable[[], None]
    locked: Callable[[], bool]
    ahead: float | None
    parts: Callable[[], Sequence[type[Renewal]]]
    ends: set[int] = field(default_factory=set)
    moves: list[Move] = field(default_factory=list)
    leads: dict[int, Lead] = field(default_factory=dict)
    events: dict[int, int] = field(default_factory=dict)
    restitutions: dict[int, FloatArray] = field(default_factory=dict)

    def step(self, state: int) -> Step:
        """The step to a state."""
        found = self.moves[state - 1]
        assert isinstance(found, Step)
        return found

    @property
    def steps(self) -> list[int]:
        """Numbers of the states that are ends of steps."""
        return [k for k, move in enumerate(self.moves, start=1) if isinstance(move, Step)]

    def renewal(self, state: int) -> type[Renewal] | None:
        """The part of a renewal that leads to a state; None for a step."""
        found = self.moves[state - 1]
        return None if isinstance(found, Step) else found

    def event(self, state: int) -> int | None:
        """Number of the event whose time is that of a state; None if that is given."""
        while state > 0 and state not in self.events and self.renewal(state) is not None:
            state -= 1
        return self.events.get(state)

    def free(self, state: int) -> bool:
        """True if the time of a state is that of an event."""
        return self.event(state) is not None

    def stepped(self, scheme: Integrator, h: float) -> None:
        """See :class:`Journal`."""
        split = scheme.split if isinstance(scheme, GeneralizedAlpha) else None
        kicked, acting = (False, False) if split is None else (split.kicking, split.acting)
        self.moves.append(Step(scheme, h, kicked, acting))
        self.add()

    def happened(self, events: Sequence[int]) -> None:
        """See :class:`Journal`.

        Raises:
            InputError: there are several.
        """
        if len(events) > 1:
            self.at_once()
        self.events[len(self.moves)] = events[0]
        self.allow()

    def at_once(self) -> None:
        """See :class:`Journal`.

        Raises:
            InputError: always.
        """
        raise InputError(
            "gradient: several events happen at the same time, or one at the end of a step, which "
            "has no derivatives"
        )

    def switched(self) -> None:
        """See :class:`Journal`."""
        if self.locked():
            self.moves.append(Hold)
            self.add()

    def rebounded(self, restitution: FloatArray) -> None:
        """See :class:`Journal`."""
        self.moves.append(Projection)
        self.restitutions[len(self.moves)] = restitution.copy()
        self.add()

    def renewed(self) -> None:
        """See :class:`Journal`; accelerations of the states between have no effect."""
        self.allow()
        for part in self.parts():
            self.moves.append(part)
            self.add()
        self.ends.add(len(self.moves))

    def measured(self) -> None:
        """See :class:`Journal`."""
        self.change()

    def began_parts(self) -> None:
        """See :class:`Journal`."""
        if self.ahead is not None:
            self._lead(0.0)

    def ended_parts(self, ratio: float) -> None:
        """See :class:`Journal`."""
        if self.ahead is not None:
            self._lead(self.ahead * ratio)

    def _lead(self, part: float) -> None:
        last = len(self.moves)
        before = last
        if part:  # the start of the last step
            while self.renewal(before) is not None:
                before -= 1
            before -= 1
        self.leads[last] = Lead(part, before)
        self.change()
