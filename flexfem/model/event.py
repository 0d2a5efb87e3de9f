# SPDX-License-Identifier: LGPL-3.0-or-later
"""Events: what happens when a function of the motion crosses zero."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import nan
from typing import Protocol

from flexfem import _checks
from flexfem._faults import FAILURES, noted
from flexfem.core.marker import OBSERVED, Observed
from flexfem.model.probe import MarkerState, strings

__all__ = ["Action", "Event", "LockJoint", "Mechanism", "Rebound", "ReleaseJoint", "Stop"]


class Mechanism(Protocol):
    """What an action can do to the moving system; the same calls must be made on every rank.

    Attributes:
        time: of the event, s.
    """

    time: float

    def set_active(self, joint: str, active: bool, hold: bool = False) -> None:
        """Make a joint hold, or not; ``hold`` keeps what its rows measure at their present values.

        Velocities jump by the least kinetic energy onto the constraints that hold then.
        """
        ...

    def rebound(self, joint: str, restitution: float, rest_speed: float = 0.0) -> None:
        """Reverse what the rows of an open joint measure, with forces along their gradients.

        The class :class:`Rebound` tells the event too that its function turns back at zero.

        Args:
            joint: name of the joint, open before and after.
            restitution: speed after the impact as a part of that before.
            rest_speed: below this speed (m/s or rad/s) after the impact, the joint closes instead.
        """
        ...

    def stop(self) -> None:
        """End the run at this time."""
        ...

    def happened(self, event: str) -> bool:
        """Whether an event has happened so far, that of the action included."""
        ...


#: What an event does: one of the classes below, or a function of the mechanism.
Action = Callable[[Mechanism], None]


@dataclass(frozen=True)
class LockJoint:
    """A joint holds from now on.

    Attributes:
        joint: its name; with ``Model.release`` it is open from the start.
        hold: its rows (distances, angles) keep their present values, those of a drive as well;
            else they take those of the joint's definition, which the positions must satisfy.
    """

    joint: str
    hold: bool = True

    def __call__(self, mechanism: Mechanism) -> None:
        """Act."""
        mechanism.set_active(self.joint, True, self.hold)


@dataclass(frozen=True)
class ReleaseJoint:
    """A joint does not hold any more.

    Attributes:
        joint: its name.
    """

    joint: str

    def __call__(self, mechanism: Mechanism) -> None:
        """Act."""
        mechanism.set_active(self.joint, False)


@dataclass(frozen=True)
class Rebound:
    """Impact at a rigid stop: Newton's law, with an impulse along the gradients of a joint's rows.

    Attributes:
        joint: name of the joint that describes the stop, ``PointOnPlane`` for example; it is to be
            open from the start (``Model.release``).
        restitution: coefficient of restitution, 0 to 1.
        rest_speed: below this speed (m/s or rad/s) after an impact, the stop stays closed as a
            joint and the event does not happen again; without it the impacts of a body that comes
            to rest have no end.
    """

    joint: str
    restitution: float
    rest_speed: float = 0.0

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            TypeError: one of them is no number.
            ValueError: the restitution lies outside [0, 1], or the speed is negative.
        """
        owner = f'Rebound of "{self.joint}"'
        if _checks.number(owner, "restitution", self.restitution, nonnegative=True) > 1.0:
            raise ValueError(f"{owner}: restitution must lie in [0, 1], got {self.restitution}")
        _checks.number(owner, "rest_speed", self.rest_speed, nonnegative=True)

    def __call__(self, mechanism: Mechanism) -> None:
        """Act."""
        mechanism.rebound(self.joint, self.restitution, self.rest_speed)


@dataclass(frozen=True)
class Stop:
    """The run ends, with success.

    Attributes:
        after: names of events that must have happened before, else nothing happens.
    """

    after: Sequence[str] = ()

    def __post_init__(self) -> None:
        """Check the names.

        Raises:
            TypeError: they are no list of names.
        """
        object.__setattr__(self, "after", strings("Stop", "after", self.after))

    def __call__(self, mechanism: Mechanism) -> None:
        """Act."""
        if all(mechanism.happened(event) for event in self.after):
            mechanism.stop()


@dataclass(frozen=True, eq=False, init=False)
class Event:
    """Actions where a function of the motion crosses zero.

    A function that jumps over zero because of another event's action does not fire.

    Attributes:
        name: Unique name in the model.
        markers: Markers whose states the function gets.
        function: `function(t, *states)` with time t (seconds) and one MarkerState per marker;
            returns one number. It is evaluated on every rank and must be continuous.
        actions: What happens, in this order.
        direction: +1 where the function rises through zero, -1 where it falls, 0 for both.
        once: Whether only the first crossing counts.
        tolerance: How closely the time of the event is located, seconds.
    """

    name: str
    markers: tuple[Observed, ...]
    function: Callable[..., float]
    actions: tuple[Action, ...]
    direction: int
    once: bool
    tolerance: float

    def __init__(
        self,
        name: str,
        markers: Observed | Sequence[Observed],
        function: Callable[..., float],
        actions: Action | Sequence[Action],
        *,
        direction: int = 0,
        once: bool = True,
        tolerance: float = 1e-9,
    ) -> None:
        """Create an event.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: No action, a direction other than -1, 0, +1, a tolerance that is not
                positive.
        """
        owner = _checks.named(self, name)
        places = (markers,) if isinstance(markers, OBSERVED) else tuple(markers)
        for marker in places:
            _checks.instance(owner, "markers", marker, OBSERVED)
        acts = (actions,) if callable(actions) else tuple(actions)
        for what, value in [("function", function), *(("actions", a) for a in acts)]:
            if not callable(value):
                raise TypeError(f"{owner}: {what} must be callable, got {_checks.show(value)}")
        if not acts:
            raise ValueError(f"{owner}: actions must hold at least one, got none")
        if isinstance(direction, bool) or direction not in (-1, 0, 1):
            raise ValueError(
                f"{owner}: direction must be -1, 0 or 1, got {_checks.show(direction)}"
            )
        _checks.instance(owner, "once", once, bool)
        _checks.assign(
            self,
            name=name, markers=places, function=function, actions=acts,
            direction=int(direction), once=once,
            tolerance=_checks.number(owner, "tolerance", tolerance, positive=True),
        )  # fmt: skip

    @property
    def reverses(self) -> bool:
        """Whether an impact keeps the function on its side of zero."""
        return any(isinstance(action, Rebound) for action in self.actions)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints that the actions name."""
        return tuple(
            a.joint for a in self.actions if isinstance(a, (LockJoint, ReleaseJoint, Rebound))
        )

    @property
    def awaits(self) -> tuple[str, ...]:
        """Names of the events that the actions wait for."""
        return tuple(name for a in self.actions if isinstance(a, Stop) for name in a.after)

    def evaluate(self, t: float, states: Sequence[MarkerState]) -> float:
        """Return the function's value at time `t`; nan in a run where it fails.

        Raises:
            FunctionError: Outside of a run, where it fails or returns something else.
        """
        try:
            return _checks.returned_number("function", self.function(t, *states))
        except FAILURES as error:
            noted(f'Event "{self.name}"', self.function, error)
            return nan
