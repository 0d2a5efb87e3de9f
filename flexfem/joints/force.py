# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces at markers by a function of the user's, with states of its own."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import checked, choice, declared, flag, function, whole_number
from flexfem._types import FloatArray
from flexfem.core.joint import Joint
from flexfem.core.laws import ElementLaw, Ends, element
from flexfem.core.marker import Attachment, Ground, Marker
from flexfem.core.node_row import NodeRow
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term
from flexfem.joints.marker_law import MarkerLaw

__all__ = ["Ends", "Force"]

#: Most markers of an element: its derivatives couple all of them with one another.
_MOST = 12


def _markers(owner: str, what: str, value: Any) -> tuple[Attachment, ...]:
    """Check a list of markers."""
    if isinstance(value, (Marker, Ground)):
        return (value,)
    _checks.instance(owner, what, value, (list, tuple))
    if not value:
        raise ValueError(f"{owner}: {what} must hold at least one marker, got none")
    for k, marker in enumerate(value):
        _checks.instance(owner, f"{what}[{k}]", marker, (Marker, Ground))
    return tuple(value)


def _derivatives(owner: str, what: str, value: Any) -> Callable[..., Any] | str:
    """Check a function of the arguments of the law, or "ufl"."""
    if value == "ufl":
        return "ufl"
    if not callable(value):
        raise TypeError(
            f'{owner}: {what} must be a function of t, ends, z, or "ufl", got {_checks.show(value)}'
        )
    _arguments(owner, what, value)
    found: Callable[..., Any] = value
    return found


def _numbers(owner: str, what: str, value: Any) -> FloatArray:
    """Check numbers in one or two dimensions, kept as an array that cannot be written."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.full(1, np.nan)
    if array.ndim not in (1, 2) or not np.isfinite(array).all():
        raise ValueError(
            f"{owner}: {what} must be finite numbers in one or two dimensions, got "
            f"{_checks.show(value)}"
        )
    return _checks.freeze(array)


@declared
class Force(Joint):
    """Forces and moments at markers by any law of their motion, of time and of states of its own.

    ``law(t, ends, z)`` or ``law(t, ends, z, parameters)`` is given the time (s), the motion of all
    markers as arrays (`Ends`) and the states z, and returns the forces (m, 3) on the bodies in N,
    or a tuple of forces, moments (m, 3) about the markers' origins in N m (None for none, then
    always), and rates dz/dt of the states: all in inertial axes. It is Python with NumPy, and is
    called once for all markers.

    It acts implicitly: steps of every integrator but ``energy_momentum``, statics, equilibria,
    modes and relaxation solve for forces and states together with the motion, so that it may be as
    stiff as a hydraulic cylinder. States are integrated by the scheme of the motion, have steady
    values in equilibria, are unknowns of linearised equations, and are in checkpoints. The forces'
    work counts as that of applied forces in energy probes. A law must depend on nothing but its
    arguments: it is called several times a step, and on every rank that has one of its markers.

    Attributes:
        markers: on bodies or the ground, one or several; twelve at most where ``each`` is None.
        law: see above; smooth, or with corners that the step resolves.
        states: number of states of an element.
        initial: their values at the start, shape (states,) or (elements, states); zero by default.
        parameters: numbers for the law, shape (p,), or (elements, p) for those of each element.
        each: number of consecutive markers that are an element: its forces and states depend on
            them alone. None if all markers are one element. With ``each`` the states of the law
            have the shape (elements, states) and else (states,); elements may lie on several ranks,
            of which each calls the law for its own ones (``Ends.numbers``).
        every: "iteration" for an implicit law; "step" for one that is called at accepted states
            alone and acts unchanged through the next step. It is explicit then, of first order and
            stable only for soft forces, and meant for costly laws.
        compiled: True to have the law compiled by numba.
        jacobian: function of the same arguments that returns the derivatives, shape
            (elements, 6 k + states, 12 k + states) for elements of k markers: of forces and moments
            of each marker, then of the rates of the states, by position, rotation vector, velocity
            and angular velocity of each marker, all in inertial axes, then by the states. None to
            have them found by differences; "ufl" for a law that is written in UFL, which is
            differentiated exactly and compiled by FFCx. It is called once then, for the markers of
            one element, with UFL vectors and tensors in place of the rows of arrays
            (``ends.positions[k]``), by which ``ufl.diff`` differentiates energies, and returns a
            list of m vectors each for forces and moments.

    Raises:
        TypeError: the law is no function, or a marker is none.
        ValueError: no markers, too many, a number that does not fit them, or a law of other
            arguments.
    """

    a: Attachment = field(init=False)
    b: Attachment = field(init=False)
    markers: tuple[Attachment, ...] = checked(_markers)
    law: Callable[..., Any] = function("t, ends, z", default=None)
    states: int = whole_number(default=0)
    initial: npt.ArrayLike | None = checked(_numbers, default=None)
    parameters: npt.ArrayLike | None = checked(_numbers, default=None)
    each: int | None = whole_number(least=1, default=None)
    every: str = choice(("iteration", "step"), default="iteration")
    compiled: bool = flag(default=False)
    jacobian: Callable[..., Any] | str | None = checked(_derivatives, default=None)

    def __post_init__(self) -> None:
        """Check the arguments against one another."""
        _checks.assign(self, a=self.markers[0], b=self.markers[-1])
        super().__post_init__()
        count = len(self.markers)
        if self.each is None and count > _MOST:
            raise ValueError(
                f"{self.owner}: markers must be at most {_MOST} that all depend on one another, "
                f"got {count}; give each, the number of those that do"
            )
        if self.each is not None and (self.each > _MOST or count % self.each):
            raise ValueError(
                f"{self.owner}: each must be a number from 1 to {_MOST} that divides the "
                f"{count} markers, got {self.each}"
            )
        if self.jacobian == "ufl" and self.compiled:
            raise ValueError(
                f'{self.owner}: compiled must be False where jacobian is "ufl", got True: FFCx '
                "compiles the law"
            )
        self._check_numbers("initial", self.states)
        self._check_numbers("parameters", None)
        _ = self.arguments

    def _check_numbers(self, what: str, length: int | None) -> None:
        values: FloatArray | None = getattr(self, what)
        if values is None:
            return
        fits = length is None or values.shape[-1] == length
        if not fits or (values.ndim == 2 and len(values) != self.elements):
            last = "p" if length is None else length
            raise ValueError(
                f"{self.owner}: {what} must have the shape ({last},) or ({self.elements}, {last}), "
                f"got {values.shape}"
            )

    @cached_property
    def arguments(self) -> int:
        """Number of arguments of the law.

        Raises:
            ValueError: it takes others than it is given.
        """
        return _arguments(self.owner, "law", self.law)

    @property
    def elements(self) -> int:
        """Number of elements."""
        return 1 if self.each is None else len(self.markers) // self.each

    @property
    def size(self) -> int:
        """Number of markers of an element."""
        return len(self.markers) // self.elements

    @property
    def places(self) -> tuple[tuple[str, Attachment], ...]:
        """See :attr:`Joint.places`."""
        return tuple((f"markers[{k}]", marker) for k, marker in enumerate(self.markers))

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """See :attr:`Joint.pairs`; its markers may be anywhere."""
        return ()

    @cached_property
    def element_law(self) -> MarkerLaw:
        """The law as the solver calls it."""
        given = np.zeros(self.states) if self.initial is None else np.asarray(self.initial)
        parameters = np.zeros(0) if self.parameters is None else np.asarray(self.parameters)
        return MarkerLaw(
            self.owner, self.law, self.states, self.every == "step", self.size,
            np.broadcast_to(given, (self.elements, self.states)), self.each is None,
            parameters if self.arguments == 4 else None, self.compiled, self.jacobian,
        )  # fmt: skip

    def parts(self, lines: Sequence[NodeRow | None]) -> Sequence[Joint]:
        """See :meth:`Joint.parts`."""
        size = self.size
        return [
            ForcePart(self.name, part[0], part[-1], self, number, part)
            for number in range(self.elements)
            for part in (self.markers[number * size : (number + 1) * size],)
        ]


@dataclass(frozen=True, eq=False)
class ForcePart(Joint):
    """One element of a force.

    Attributes:
        whole: the force.
        number: of the element.
        chosen: its markers.
    """

    whole: Force
    number: int
    chosen: tuple[Attachment, ...]

    @property
    def places(self) -> tuple[tuple[str, Attachment], ...]:
        """See :attr:`Joint.places`."""
        first = self.number * len(self.chosen)
        return tuple((f"markers[{first + k}]", marker) for k, marker in enumerate(self.chosen))

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """See :attr:`Joint.pairs`."""
        return ()

    @property
    def second(self) -> int:
        """See :attr:`Joint.second`."""
        return len(self.chosen) - 1

    @property
    def owner(self) -> str:
        """See :attr:`Joint.owner`."""
        return self.whole.owner

    @property
    def element(self) -> tuple[ElementLaw, int]:
        """See :attr:`Joint.element`."""
        return self.whole.element_law, self.number

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`; raises ValueError where the law fails at the start.

        Each row is a component of the force or moment at a marker, in its axes. All have the same
        terms, two markers each, so that derivatives by all of them have room.
        """
        self.whole.element_law.tried(self.number, poses, t)
        count, law = len(self.chosen), element()
        components = 3 * self.whole.element_law.kinds
        pairs = [(a, min(a + 1, count - 1)) for a in range(0, count, 2)]
        rows = []
        for marker in range(count):
            for axis in range(components):
                terms = tuple(
                    Term(
                        RowKind.TWIST, a=a, b=b, component=axis + 6 * (marker % 2),
                        factor=float(k == marker // 2),
                    )
                    for k, (a, b) in enumerate(pairs)
                )  # fmt: skip
                rows.append(Row(terms, law=law))
        return tuple(rows)


def _arguments(owner: str, what: str, law: Callable[..., Any]) -> int:
    """Number of arguments of a function: three or four.

    Raises:
        ValueError: another number.
    """
    parameters = inspect.signature(law).parameters.values()
    needed = [p for p in parameters if p.default is p.empty and p.kind is not p.VAR_POSITIONAL]
    count = len(needed)
    if count not in (3, 4):
        raise ValueError(
            f"{owner}: {what} must be a function of (t, ends, z) or (t, ends, z, parameters), got "
            f"one of {count} arguments"
        )
    return count
