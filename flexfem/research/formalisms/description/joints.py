# SPDX-License-Identifier: LGPL-3.0-or-later
"""Constraints and forces between bodies, written in UFL.

A joint is a function of its ends that returns numbers: constraints that vanish, or displacements
on which given forces work. An end is the floating frame of a body, or a node of its mesh. UFL
differentiates the function: Jacobian G, the part of its second time derivative without
accelerations, and the change of G^T lambda.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.research.formalisms.description.frame_motion import Motion, values_of
from flexfem.research.formalisms.description.frames import Frame
from flexfem.research.formalisms.description.matter import Matter

__all__ = [
    "AppliedForce", "Constraint", "End", "EndState", "Motion", "coincidence", "end_angle",
    "end_position", "evaluate_motion", "on_line", "parallel",
]  # fmt: skip

Expr = Any


@dataclass(frozen=True)
class End:
    """Point of a body at which a joint acts.

    Args:
        body: name of the body.
        point: local coordinates of a node of its mesh (m), or None for the frame alone.
    """

    body: str
    point: tuple[float, ...] | None = None

    def __str__(self) -> str:
        """Return body and node."""
        return self.body if self.point is None else f"{self.body}:{self.point}"


@dataclass(frozen=True)
class EndState:
    """An end in UFL.

    Attributes:
        frame: kind of the floating frame.
        g: its coordinates.
        matter: of the body.
        x: local coordinates of the node, three; zero for the frame alone.
        u: elastic displacement of the node, None for the frame alone.
    """

    frame: Frame
    g: Expr
    matter: Matter
    x: Expr
    u: Expr | None

    @property
    def position(self) -> Expr:
        """Position in inertial axes, two components for plane bodies in plane frames."""
        import ufl

        if self.u is not None:
            return self.frame.place(self.g, self.matter.place(self.x, self.u))
        return self.frame.place(self.g, ufl.zero(self.frame.dimension))

    def direction(self, e: Expr) -> Expr:
        """A vector fixed to the end, given in local components, in inertial axes."""
        turned = e if self.u is None else self.matter.direction(self.u, e)
        return self.frame.turn(self.g, turned)

    @property
    def angle(self) -> Expr:
        """Angle of a frame in the plane, plus the rotation of a plane beam's node (rad)."""
        if self.u is None or self.matter.cell != "interval" or self.u.ufl_shape[0] != 3:
            return self.g[2]
        return self.g[2] + self.u[2]


Function = Callable[..., Sequence[Expr]]


@dataclass(frozen=True)
class Constraint:
    """Numbers that vanish, or follow a prescribed motion.

    Args:
        name: of the joint.
        ends: connected points.
        function: called with an `EndState` for each end and ``data`` in UFL, returns the numbers.
        data: numbers of the function; changing them recompiles nothing.
        motion: function of time (s) returning value, rate and second rate; None for zero.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: a value is not admissible.
    """

    name: str
    ends: Sequence[End]
    function: Function
    data: Sequence[float] = ()
    motion: Motion | None = None

    part_of: ClassVar[str] = "flexfem.research.Mechanism"

    def __post_init__(self) -> None:
        """Check the arguments."""
        _check_joint(self)
        if self.motion is not None and not callable(self.motion):
            raise TypeError(f"{self.owner}: motion must be a function, got {self.motion!r}")

    @property
    def owner(self) -> str:
        """Name in messages."""
        return f'Constraint "{self.name}"'


@dataclass(frozen=True)
class AppliedForce:
    """Forces that work on the numbers a function of the ends returns, positive with them.

    Args:
        name: of the force.
        ends: points of action.
        function: as for `Constraint`; an angle makes the force a moment.
        force: function of time (s) returning one force (N or N m) for each number.
        data: numbers of the function.

    Raises:
        TypeError: an argument has the wrong type.
    """

    name: str
    ends: Sequence[End]
    function: Function
    force: Callable[[float], Any]
    data: Sequence[float] = field(default=())

    part_of: ClassVar[str] = "flexfem.research.Mechanism"

    def __post_init__(self) -> None:
        """Check the arguments."""
        _check_joint(self)
        if not callable(self.force):
            raise TypeError(f"{self.owner}: force must be a function, got {self.force!r}")

    @property
    def owner(self) -> str:
        """Name in messages."""
        return f'AppliedForce "{self.name}"'


def coincidence(first: EndState, second: EndState, data: Expr) -> list[Expr]:
    """The distance vector of two ends: a revolute joint in the plane, a spherical one in space."""
    gap = second.position - first.position
    return [gap[i] for i in range(gap.ufl_shape[0])]


def end_position(end: EndState, data: Expr) -> list[Expr]:
    """Position of an end relative to the inertial point ``data``."""
    r = end.position
    return [r[i] - data[i] for i in range(r.ufl_shape[0])]


def on_line(end: EndState, data: Expr) -> list[Expr]:
    """Height of an end over the line or plane with a point and a normal, both in ``data``."""
    r = end.position
    n = r.ufl_shape[0]
    return [sum((r[i] - data[i]) * data[n + i] for i in range(n))]


def end_angle(end: EndState, data: Expr) -> list[Expr]:
    """Angle of an end in the plane."""
    return [end.angle]


def parallel(first: EndState, second: EndState, data: Expr) -> list[Expr]:
    """Two components by which an axis of the second end leaves that of the first.

    ``data`` holds the axis in the second end's components and two vectors normal to it in the
    first end's. With `coincidence` it makes a revolute joint in space.
    """
    import ufl

    parts = [ufl.as_vector([data[3 * k + i] for i in range(3)]) for k in range(3)]
    axis = second.direction(parts[0])
    return [ufl.dot(axis, first.direction(parts[k])) for k in (1, 2)]


def _check_joint(joint: Any) -> None:
    _checks.named(joint, joint.name)
    if not joint.ends:
        raise ValueError(f"{joint.owner}: it has no ends")
    for end in joint.ends:
        _checks.instance(joint.owner, "an end", end, End)
    if not callable(joint.function):
        raise TypeError(f"{joint.owner}: function must be a function, got {joint.function!r}")
    _checks.array(joint.owner, "data", np.array(joint.data, dtype=np.float64), (-1,))


def evaluate_motion(joint: Constraint, t: float, count: int) -> tuple[FloatArray, ...]:
    """Value, rate and second rate (count) of a prescribed motion at t.

    Raises:
        ValueError: the function returns something else.
    """
    if joint.motion is None:
        return tuple(np.zeros(count) for _ in range(3))
    return values_of(joint.owner, joint.motion, t, count)
