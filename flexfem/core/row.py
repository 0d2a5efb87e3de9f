# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rows: scalar constraints between the markers of a joint, or forces there, as data."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.laws import Law
from flexfem.core.user_function import UserFunction

__all__ = ["START_GAP", "Row", "RowKind", "Term", "Wrap"]

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
    #: ``|x_b - x_a|``
    DISTANCE = 3
    #: angle about R_a u from R_a p to R_b v; continuous over any number of turns
    ANGLE = 4
    #: arc length of the place of marker a on its line, in the undeformed state
    ARC = 5
    #: no position, but the twist of a marker in its own axes (m/s, rad/s) as rate: component 0 to
    #: 5 of (V, Omega) of marker a, 6 to 11 of those of b
    TWIST = 6
    #: length of a straight part of a cable from a sheave or point a to one b
    SPAN = 7
    #: angle about R_a u from R_a p to where this part touches a; continuous as ``ANGLE``
    TOUCH = 8
    #: energy of an elastic cable that hangs under its weight from a to b
    CATENARY = 9
    #: a user's function of R_a^T (x_b - x_a) and R_a^T R_b
    FUNCTION = 10

    @property
    def axes(self) -> tuple[bool, bool]:
        """Dependence on the axes of markers a and b, two flags; else on positions alone."""
        positions = (RowKind.INERTIAL, RowKind.ALONG, RowKind.DISTANCE, RowKind.ARC)
        both = self not in (*positions, RowKind.CATENARY)
        return both or self is RowKind.ALONG, both


@dataclass(frozen=True)
class Term:
    """One elementary function of two markers of a joint, times a factor.

    Attributes:
        kind: kind of the function, `RowKind`.
        u: direction in the axes of marker a (inertial axes for ``INERTIAL``); for ``SPAN`` and
            ``TOUCH`` the axis of a sheave times its radius (m), about which the cable runs from a
            to b; zero for a point; for ``CATENARY`` the weight per length (N/m) upwards, inertial.
        v: direction in the axes of marker b; such an axis, too; for ``CATENARY`` the unstretched
            length (m) and the axial stiffness (N).
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

        For a twist its component, for a user's function that and its parameters.
        """
        if self.kind not in (RowKind.TWIST, RowKind.FUNCTION):
            return np.array([self.u, self.v, self.p])
        out = np.zeros(9)
        out[0] = self.component
        if self.function is not None:
            out[1 : 1 + len(self.function.parameters)] = self.function.parameters
        return out.reshape(3, 3)


@dataclass(frozen=True)
class Wrap:
    """The part of a cable around a guide, whose angle a row of the law ``CAPSTAN`` needs.

    Attributes:
        coefficient: of friction.
        terms: places of the two terms of the straight parts before and after an eyelet, or of
            their touching angles at a sheave: numbers of the row within the joint, and of the term.
        start: angle around the sheave at the start, rad; None for an eyelet.
    """

    coefficient: float
    terms: tuple[tuple[int, int], tuple[int, int]]
    start: float | None = None


@dataclass(frozen=True)
class Row:
    """A scalar constraint, or a force law where there is one.

    Its value is the sum of its terms less the target.

    Attributes:
        terms: the functions that are summed.
        target: value that the sum takes (m, rad or 1).
        law: force that the row carries as a function of its value, and of the rate of its terms,
            less ``target_rate``; None for a rigid row.
        switchable: the row can be locked and released during a run.
        locked: it holds at the start; a row that is released carries no force.
        target_rate: rate (m/s or rad/s) at which a damper of the law counts the target as moving.
        wrap: of a row with the law ``CAPSTAN``; its tension is that of the next row before it with
            another law, and of all such rows between it and the next row with another law.
    """

    terms: tuple[Term, ...]
    target: float = 0.0
    law: Law | None = None
    switchable: bool = False
    locked: bool = True
    target_rate: float = 0.0
    wrap: Wrap | None = None

    @property
    def calls(self) -> bool:
        """True if a term or the law calls a user-defined function."""
        own = self.law is not None and self.law.function is not None
        return own or any(term.function is not None for term in self.terms)
