# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows: scalar constraints and force laws between the markers of a joint, as data."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.user_function import UserFunction

__all__ = [
    "DAMPED_BY_COEFFICIENT",
    "FRICTION_LAWS",
    "LINEAR_LAWS",
    "START_GAP",
    "Law",
    "LawKind",
    "Row",
    "RowKind",
    "Term",
    "applied",
    "friction",
    "limit",
    "spring",
]

#: Largest violation of a constraint at the start (m or rad): more is a mistake in the model.
START_GAP = 1e-6

_ZERO = np.zeros(3)


class RowKind(IntEnum):
    """Elementary functions of marker a (pose x_a, R_a) and marker b (x_b, R_b).

    See ``constraints.terms``.

    ``FUNCTION`` is the last one: compiled loops take larger numbers for addresses of functions.
    """

    #: u . (x_b - x_a), u in inertial axes
    INERTIAL = 0
    #: R_a u . (x_b - x_a)
    ALONG = 1
    #: R_a u . R_b v
    AXES = 2
    #: |x_b - x_a|
    DISTANCE = 3
    #: angle about R_a u from R_a p to R_b v; continuous over any number of turns
    ANGLE = 4
    #: arc length of the place of marker a on its line, in the undeformed state
    ARC = 5
    #: a user's function of R_a^T (x_b - x_a) and R_a^T R_b
    FUNCTION = 6

    @property
    def axes(self) -> tuple[bool, bool]:
        """Dependence on the axes of markers a and b, two flags; else on positions alone."""
        both = self in (RowKind.AXES, RowKind.ANGLE, RowKind.FUNCTION)
        return both or self is RowKind.ALONG, both


class LawKind(IntEnum):
    """Laws of the force F that a row carries for its value x and its rate v."""

    #: none: the value is zero and the force whatever this takes
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


#: Laws that are linear in value and rate.
LINEAR_LAWS = (LawKind.RIGID, LawKind.SPRING)
#: Laws without a force at rest, which statics leave out; theirs depends on the iterate.
FRICTION_LAWS = (LawKind.FRICTION, LawKind.NORMAL_FRICTION)
#: Laws whose force changes with the rate only if there is a damping coefficient.
DAMPED_BY_COEFFICIENT = (LawKind.RIGID, LawKind.SPRING, LawKind.LIMIT)


@dataclass(frozen=True)
class Law:
    """Force law of a row.

    Attributes:
        kind: number of the law, `LawKind`.
        stiffness: k, N/m or N m/rad.
        damping: c, N s/m or N m s/rad.
        first, second: ``SPRING``: F_0 (N or N m) and nothing; ``LIMIT``: lower and upper limit;
            ``FRICTION``: F_c (N or N m) and v_0 (m/s or rad/s); ``NORMAL_FRICTION``: mu (1, or m
            for a moment) and v_0.
        function: user's function of the force, or of a factor of F_c or mu; None for the laws above
            alone.
    """

    kind: LawKind
    stiffness: float = 0.0
    damping: float = 0.0
    first: float = 0.0
    second: float = 0.0
    function: UserFunction | None = None


def spring(stiffness: float, damping: float) -> Law:
    """Linear spring and damper."""
    return Law(LawKind.SPRING, stiffness, damping)


def sprung(stiffness: float, damping: float, backlash: float, *, tension_only: bool = False) -> Law:
    """Spring and damper that is slack in a range of its value about rest.

    Args:
        stiffness: N/m or N m/rad.
        damping: N s/m or N m s/rad.
        backlash: width of the range, m or rad.
        tension_only: True if it is slack below rest, whatever the backlash.
    """
    if tension_only:
        return limit(None, 0.0, stiffness, damping)
    if backlash:
        return limit(-0.5 * backlash, 0.5 * backlash, stiffness, damping)
    return spring(stiffness, damping)


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


@dataclass(frozen=True)
class Term:
    """One elementary function of two markers of a joint, times a factor.

    Attributes:
        kind: kind of the function, `RowKind`.
        u: direction in the axes of marker a (inertial axes for ``INERTIAL``).
        v: direction in the axes of marker b.
        p: zero direction of an angle, in the axes of marker a, perpendicular to ``u``.
        a, b: numbers of the two markers within the joint.
        factor: coefficient in the row's sum.
        function: of ``FUNCTION``; None for the others.
        component: index of the component used.
    """

    kind: RowKind
    u: FloatArray = field(default_factory=lambda: _ZERO)
    v: FloatArray = field(default_factory=lambda: _ZERO)
    p: FloatArray = field(default_factory=lambda: _ZERO)
    a: int = 0
    b: int = 1
    factor: float = 1.0
    function: UserFunction | None = None
    component: int = 0

    @property
    def data(self) -> FloatArray:
        """(3, 3) data of the function besides the markers: u, v and p.

        For a user's function its component and its parameters.
        """
        if self.function is None:
            return np.array([self.u, self.v, self.p])
        out = np.zeros(9)
        out[0] = self.component
        out[1 : 1 + len(self.function.parameters)] = self.function.parameters
        return out.reshape(3, 3)


@dataclass(frozen=True)
class Row:
    """A scalar constraint, or a force law where there is one.

    Its value is the sum of its terms less the target.

    Attributes:
        terms: the functions that are summed.
        target: value that the sum takes (m, rad or 1).
        law: force that the row carries as a function of its value; None for a rigid row.
        switchable: the row can be locked and released during a run.
        locked: it holds at the start; a row that is released carries no force.
    """

    terms: tuple[Term, ...]
    target: float = 0.0
    law: Law | None = None
    switchable: bool = False
    locked: bool = True
