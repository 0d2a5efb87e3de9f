# SPDX-License-Identifier: LGPL-3.0-or-later
"""Force laws of rows: what a row carries for its value and its rate, as data."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple, Protocol

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.user_function import FunctionKind, UserFunction

__all__ = [
    "APPLIED",
    "DAMPED_BY_COEFFICIENT",
    "FRICTION_LAWS",
    "LINEAR_LAWS",
    "STORING_FUNCTIONS",
    "ElementLaw",
    "ElementMotion",
    "Ends",
    "Law",
    "LawKind",
    "applied",
    "capstan",
    "curve",
    "custom",
    "element",
    "friction",
    "limit",
    "press",
    "spring",
]


class LawKind(IntEnum):
    """Laws of the force F that a row carries for its value x and its rate v."""

    #: none; the value is zero and the force whatever this takes
    RIGID = 0
    #: F = k x + c v + F_0
    SPRING = 1
    #: zero within lower <= x <= upper; beyond by d, F = k d (1 + tanh(c v / (k d))) against it
    LIMIT = 2
    #: F(x, v, t), a user's function
    FUNCTION = 3
    #: F = F_c tanh(v / v_0) + c v; F_c may be a user's function of abs(v)
    FRICTION = 4
    #: the same with F_c = mu N, N the resultant of other rows
    NORMAL_FRICTION = 5
    #: forces of all rows of a joint together, see `ElementLaw`
    ELEMENT = 6
    #: F(y, v), a user's function that stores ``F(y, 0)``; zero within lower <= x <= upper, beyond
    #: by y, which is x where both are zero
    CURVE = 7
    #: the same function of the depth d > 0 and its rate on either side, which presses only
    PRESS = 8
    #: F = T (exp(mu theta tanh(v / v_0)) - 1), T the sum of other rows, theta see ``Row.wrap``
    CAPSTAN = 9
    #: F = F_0, whose energy is F_0 x; of a row whose value x is an energy, with F_0 = 1
    POTENTIAL = 10


#: Laws that are linear in value and rate.
LINEAR_LAWS = (LawKind.RIGID, LawKind.SPRING, LawKind.POTENTIAL)
#: Laws without a force at rest, which statics leave out; theirs depends on the iterate.
FRICTION_LAWS = (LawKind.FRICTION, LawKind.NORMAL_FRICTION, LawKind.CAPSTAN)
#: Column of ``first`` in arrays of laws: the force of ``applied``.
APPLIED = 3
#: Laws by functions that store energy.
STORING_FUNCTIONS = (LawKind.CURVE, LawKind.PRESS)
#: Laws whose force changes with the rate only if there is a damping coefficient.
DAMPED_BY_COEFFICIENT = (LawKind.RIGID, LawKind.SPRING, LawKind.LIMIT, LawKind.POTENTIAL)


@dataclass(frozen=True)
class ElementMotion:
    """Motion of e elements with m markers at an instant.

    Attributes:
        time: s.
        poses: (e, m, 12) position and rotation of the markers, row by row, in inertial axes.
        twists: (e, m, 6) velocity and angular velocity of the markers, in their own axes.
    """

    time: float
    poses: FloatArray
    twists: FloatArray


class Ends(NamedTuple):
    """Motion of the m markers of a `Force`, in inertial axes.

    Attributes:
        positions: (m, 3) of their origins, m.
        rotations: (m, 3, 3) their axes, as columns.
        velocities: (m, 3) of their origins, m/s.
        angular_velocities: (m, 3) of their axes, rad/s.
        numbers: (m,) their numbers in ``Force.markers``: all of them on one process, those of a
            rank's elements on several.
    """

    positions: FloatArray
    rotations: FloatArray
    velocities: FloatArray
    angular_velocities: FloatArray
    numbers: IntArray


class ElementLaw(Protocol):
    """Law of the forces of all rows of a joint by the motion of markers and by states of its own.

    Several joints may have one law, and are its elements: it is called once for all of them. It
    knows nothing of time steps: ``dz/dt`` is integrated by the scheme of the motion.
    """

    @property
    def owner(self) -> str:
        """Class and name of its owner, with which messages begin."""
        ...

    @property
    def function(self) -> Callable[..., Any]:
        """The user's function, for messages."""
        ...

    @property
    def size(self) -> int:
        """Number m of markers whose motion it depends on: the first ones of the joint."""
        ...

    @property
    def states(self) -> int:
        """Number n of states z of an element."""
        ...

    @property
    def explicit(self) -> bool:
        """True if forces are those of the last accepted state throughout a step."""
        ...

    def place(self, *, at_nodes: bool) -> None:
        """Learn, before it is called, whether all its markers are at nodes.

        Others depend on the twists of several nodes, which the gradients of six rows a marker give.
        """
        ...

    def initial(self, elements: IntArray) -> FloatArray:
        """States (e, n) of elements at the start."""
        ...

    def forces(
        self, elements: IntArray, motion: ElementMotion, z: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Forces (e, r) that rows carry (N or N m) and rates (e, n) of the states.

        Args:
            elements: (e,) their numbers.
            motion: their motion.
            z: (e, n) their states.

        Raises:
            Exception: whatever the user's function raises.
        """
        ...

    def derivatives(
        self, elements: IntArray, motion: ElementMotion, z: FloatArray
    ) -> FloatArray | None:
        """Derivatives (e, r + n, 12 m + n) of forces and rates of the states.

        By displacements of the markers along their axes and rotations about these, by their twists,
        and by the states; None to have them found by differences.
        """
        ...


@dataclass(frozen=True)
class Law:
    """Force law of a row.

    Attributes:
        kind: number of the law, `LawKind`.
        stiffness: k, N/m or N m/rad.
        damping: c, N s/m or N m s/rad.
        first, second: ``SPRING``: F_0 (N or N m) and nothing; ``LIMIT``, ``CURVE`` and ``PRESS``:
            lower and upper limit;
            ``FRICTION``: F_c (N or N m) and v_0 (m/s or rad/s); ``NORMAL_FRICTION``: mu (1, or m
            for a moment) and v_0; ``CAPSTAN``: mu theta at the start (rad) and v_0.
        function: user's function of the force, or of a factor of F_c or mu; None for the laws above
            alone.
    """

    kind: LawKind
    stiffness: float = 0.0
    damping: float = 0.0
    first: float = 0.0
    second: float = 0.0
    function: UserFunction | None = None


def spring(
    stiffness: float, damping: float = 0.0, *, backlash: float = 0.0, tension_only: bool = False
) -> Law:
    """Spring and damper, linear unless it is slack in a range of its value about rest.

    Args:
        stiffness: N/m or N m/rad.
        damping: N s/m or N m s/rad.
        backlash: width of the range, m or rad.
        tension_only: True if it is slack below rest.
    """
    if tension_only:
        return limit(None, 0.0, stiffness, damping)
    if backlash:
        return limit(-0.5 * backlash, 0.5 * backlash, stiffness, damping)
    return Law(LawKind.SPRING, stiffness, damping)


def applied(force: float) -> Law:
    """A force (N or N m), whatever the row's value and rate."""
    return Law(LawKind.SPRING, first=force)


def limit(lower: float | None, upper: float | None, stiffness: float, damping: float) -> Law:
    """Stop below ``lower`` and above ``upper``, None for none.

    Damping never makes it pull, and acts softly where it begins to press: the force stays between
    none and twice that of the spring.
    """
    low, high = -np.inf if lower is None else lower, np.inf if upper is None else upper
    return Law(LawKind.LIMIT, stiffness, damping, low, high)


def friction(
    force: float,
    velocity: float,
    viscous: float,
    normal: bool = False,
    function: UserFunction | None = None,
) -> Law:
    """Regularised Coulomb friction and a viscous part; ``normal``: ``force`` is a coefficient.

    ``function`` of the absolute velocity multiplies ``force``.
    """
    kind = LawKind.NORMAL_FRICTION if normal else LawKind.FRICTION
    return Law(kind, 0.0, viscous, force, velocity, function)


def capstan(coefficient: float, velocity: float, angle: float) -> Law:
    """Friction of a cable around a guide, of Euler and Eytelwein, regularised.

    Args:
        coefficient: mu.
        velocity: v_0, m/s, below which it creeps.
        angle: around the guide at the start, rad; later it is that of ``Row.wrap``.
    """
    return Law(LawKind.CAPSTAN, first=coefficient * angle, second=velocity)


def custom(owner: str, force: Callable[..., float], parameters: Sequence[float] = ()) -> Law:
    """A function of the user's, see ``CustomForce``; its work counts as that of applied forces.

    Args:
        owner: owner of the function in messages.
        force: ``force(x, v)``, ``force(x, v, t)`` or ``force(x, v, t, parameters)``; N or N m.
        parameters: up to eight numbers that it is given.

    Raises:
        TypeError: it is no function, or parameters are no numbers.
        ValueError: a function of other arguments, or too many parameters.
    """
    user = UserFunction.checked(owner, "force", force, FunctionKind.FORCE, parameters)
    return Law(LawKind.FUNCTION, function=user)


def curve(owner: str, what: str, force: object, *, backlash: float = 0.0) -> Law:
    """A force ``F(x)`` or ``F(x, v)`` of value and rate, slack in a range of the value about rest.

    ``F(x, 0)`` is elastic, and its integral is stored energy; what the rate adds is dissipated.

    Args:
        owner: owner of the function in messages.
        what: field of the owner that holds it.
        force: a function made by def or lambda, or a `Curve`; N or N m.
        backlash: width of the range, m or rad.

    Raises:
        TypeError: it is neither.
        ValueError: a function of other arguments.
    """
    user = UserFunction.checked(owner, what, force, FunctionKind.CURVE)
    return Law(LawKind.CURVE, first=-0.5 * backlash, second=0.5 * backlash, function=user)


def press(owner: str, what: str, force: object, lower: float | None, upper: float | None) -> Law:
    """A force ``F(d)`` or ``F(d, v)`` against the depth d below ``lower`` or above ``upper``.

    It never pulls; v is the rate of the depth. ``F(d, 0)`` is elastic as that of :func:`curve`.

    Raises:
        TypeError: the force is neither a function nor a `Curve`.
        ValueError: a function of other arguments.
    """
    user = UserFunction.checked(owner, what, force, FunctionKind.CURVE)
    low, high = -np.inf if lower is None else lower, np.inf if upper is None else upper
    return Law(LawKind.PRESS, first=low, second=high, function=user)


def element() -> Law:
    """Forces of all rows of a joint together, by its `ElementLaw`."""
    return Law(LawKind.ELEMENT)
