# SPDX-License-Identifier: LGPL-3.0-or-later
"""Events: actions when a function of the motion crosses zero."""

from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass
from math import nan
from typing import Any, Protocol

from flexfem import _checks
from flexfem._faults import FAILURES, noted
from flexfem._fields import Given, checked, declared, flag, function, number
from flexfem.core.marker import Observed
from flexfem.model.probes.base import MarkerState, observed, strings

__all__ = ["Action", "Event", "LockJoint", "Mechanism", "Rebound", "ReleaseJoint", "Stop"]


class Mechanism(Protocol):
    """The moving system and its changes by actions; every rank must make the same calls.

    Attributes:
        time: of the event, s.
    """

    time: float

    def set_active(self, joint: str, active: bool, hold: bool = False) -> None:
        """Close or open a joint; ``hold`` keeps the present values of its rows.

        Without it the positions must satisfy the joint as it is defined, see :class:`LockJoint`.
        Velocities jump by the least kinetic energy onto the constraints that hold then.
        """
        ...

    def rebound(self, joint: str, restitution: float, rest_speed: float = 0.0) -> None:
        """Reverse the rates of the rows of an open joint, with impulses along their gradients.

        The class :class:`Rebound` also marks the event as one whose function returns from zero.

        Args:
            joint: name of the joint, open before and after.
            restitution: speed after the impact over that before.
            rest_speed: below this speed (m/s or rad/s) after the impact, the joint closes instead.
        """
        ...

    def stop(self) -> None:
        """End the run at this time."""
        ...

    def happened(self, event: str) -> bool:
        """Return True if an event has happened so far, that of the action included."""
        ...


#: Action of an event: one of the classes below, or a function of the mechanism.
Action = Callable[[Mechanism], None]


@dataclass(frozen=True)
class LockJoint:
    """Closes a joint.

    Attributes:
        joint: its name; with ``Model.release`` it is open from the start.
        hold: its rows (distances, angles) keep their present values, those of a drive as well;
            else they take those of the joint's definition, which the positions must satisfy: the
            run ends where they are off by more than 1e-4 m or rad.
    """

    joint: str
    hold: bool = True

    def __call__(self, mechanism: Mechanism) -> None:
        """Act."""
        mechanism.set_active(self.joint, True, self.hold)


@dataclass(frozen=True)
class ReleaseJoint:
    """Opens a joint.

    Attributes:
        joint: its name.
    """

    joint: str

    def __call__(self, mechanism: Mechanism) -> None:
        """Act."""
        mechanism.set_active(self.joint, False)


def _restitution(owner: str, what: str, value: float) -> None:
    """Check a coefficient of restitution."""
    if _checks.number(owner, what, value, nonnegative=True) > 1.0:
        raise ValueError(f"{owner}: {what} must lie in [0, 1], got {value}")


@declared(eq=True)
class Rebound:
    """Impact at a rigid stop: Newton's law, with an impulse along the gradients of a joint's rows.

    Attributes:
        joint: name of the joint that describes the stop, ``PointOnPlane`` for example; it is to be
            open from the start (``Model.release``).
        restitution: coefficient of restitution, 0 to 1.
        rest_speed: below this speed (m/s or rad/s) after an impact, the stop stays closed as a
            joint and the event does not happen again; without it the impacts of a body that comes
            to rest have no end.

    Raises:
        TypeError: one of them is no number.
        ValueError: the restitution lies outside [0, 1], or the speed is negative.
    """

    joint: str
    restitution: float = checked(_restitution, as_given=True)
    rest_speed: float = number(default=0.0, nonnegative=True, as_given=True)

    @property
    def _owner(self) -> str:
        return f'Rebound of "{self.joint}"'

    def __call__(self, mechanism: Mechanism) -> None:
        """Act."""
        mechanism.rebound(self.joint, self.restitution, self.rest_speed)


@declared(eq=True)
class Stop:
    """Ends the run successfully.

    Attributes:
        after: names of events that must have happened before, else nothing happens.

    Raises:
        TypeError: they are no list of names.
    """

    after: Sequence[str] = checked(strings, default=())

    def __call__(self, mechanism: Mechanism) -> None:
        """Act."""
        if all(mechanism.happened(event) for event in self.after):
            mechanism.stop()


def _actions(owner: str, what: str, value: Any) -> tuple[Action, ...]:
    """Return checked actions, of one or several."""
    acts: tuple[Action, ...] = (value,) if callable(value) else tuple(value)
    for act in acts:
        if not callable(act):
            raise TypeError(f"{owner}: {what} must be callable, got {_checks.show(act)}")
    if not acts:
        raise ValueError(f"{owner}: {what} must hold at least one, got none")
    return acts


def _sign(owner: str, what: str, value: int) -> int:
    """Return a checked direction of crossing."""
    if isinstance(value, bool) or value not in (-1, 0, 1):
        raise ValueError(f"{owner}: {what} must be -1, 0 or 1, got {_checks.show(value)}")
    return int(value)


@declared
class Event:
    """Actions where a function of the motion crosses zero.

    A function that jumps over zero because of another event's action does not fire.

    Attributes:
        name: Unique name in the model.
        markers: Markers whose states the function gets.
        function: `function(t, *states)` with time t (seconds) and one MarkerState per marker;
            returns one number. It is evaluated on every rank and must be continuous.
        actions: One or several, carried out in this order.
        direction: +1 where the function rises through zero, -1 where it falls, 0 for both.
        once: True if only the first crossing counts.
        tolerance: Largest error of the time of the event, seconds.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: No action, a direction other than -1, 0, +1, a tolerance that is not positive.
    """

    name: str
    markers: Given[Observed | Sequence[Observed], tuple[Observed, ...]] = checked(observed)
    function: Callable[..., float] = function()
    actions: Given[Action | Sequence[Action], tuple[Action, ...]] = checked(_actions)
    _: KW_ONLY
    direction: int = checked(_sign, default=0)
    once: bool = flag(default=True)
    tolerance: float = number(default=1e-9, positive=True)

    @property
    def reverses(self) -> bool:
        """True if an impact keeps the function on its side of zero."""
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
