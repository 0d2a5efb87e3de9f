# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints as rows: scalar constraints and force laws between markers.

A joint is data: the list of its rows (``flexfem.core.row``), each a sum of elementary functions of
two markers with directions fixed in their axes. All rows of all joints are evaluated as one batch
in compiled code (``flexfem.constraints.rows.kernels``), with their first and second derivatives; a
new joint is a new list of rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from functools import cache, cached_property
from math import sqrt
from typing import Any, ClassVar

import numpy as np

from flexfem import _checks
from flexfem._fields import declared, instance, vector
from flexfem._types import FloatArray
from flexfem.core.laws import ElementLaw, Law
from flexfem.core.marker import Attachment, Carrier, Ground, Marker
from flexfem.core.node_row import NodeRow
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = [
    "AxisJoint",
    "Joint",
    "JointAction",
    "axes_of",
    "check_limits",
    "check_sliding",
    "coincidence",
    "coincidence_directions",
    "displacement",
    "distance",
    "equal_rotation",
    "equal_rotation_directions",
    "line_guidance",
    "parallelism",
    "parallelism_directions",
    "perpendicular",
    "turn_angle",
    "turn_angles",
    "unit",
]

#: Inertial axes; rows of joints share them.
_AXES: FloatArray = _checks.freeze(np.eye(3))
#: What is added to the sizes of an axis' components before they are compared, so that none are
#: equal in the directions that users take.
_BEHIND = 0.0, 0.0473, 0.0871


@declared
class Joint:
    """A connection between two markers, of some joints more.

    Attributes:
        name: unique name within the model.
        a: first marker.
        b: second marker.
    """

    name: str
    a: Attachment
    b: Attachment

    #: rows change with time, and are asked for at every step
    driven: ClassVar[bool] = False
    #: marker a may be the line of a beam, on which marker b slides
    slides: ClassVar[bool] = False
    #: markers may be lines of shells; it is evaluated as its parts
    joins_lines: ClassVar[bool] = False
    #: rows of many joints of the class are made together, by ``directions``
    alike: ClassVar[bool] = False
    #: relative motions left along ("translation") and about ("rotation") the axis of the joint
    leaves: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls) -> None:
        """Find out if a class has directions for its own rows; those of scripts may change any."""
        super().__init_subclass__()
        base = next(base for base in cls.__mro__ if "rows" in vars(base))
        known = cls.__module__.startswith("flexfem.")
        cls.alike = known and base is not Joint and "directions" in vars(base)

    def __post_init__(self) -> None:
        """Check the name and the markers.

        Raises:
            TypeError: the name is not a string, or a marker is not a Marker or Ground.
            ValueError: the name is empty or not printable.
        """
        for label, marker in self.places:
            _checks.instance(self.owner, label, marker, (Marker, Ground))

    @property
    def places(self) -> tuple[tuple[str, Attachment], ...]:
        """All markers with the names by which messages call them; a and b unless overridden."""
        return ("a", self.a), ("b", self.b)

    @cached_property
    def markers(self) -> tuple[Attachment, ...]:
        """All markers."""
        return tuple(marker for _, marker in self.places)

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Markers that move relative to one another, by their numbers."""
        return ((0, 1),)

    @property
    def partner(self) -> Joint | None:
        """Joint with the same markers that this one acts on, such as the one with friction."""
        return None

    @property
    def element(self) -> tuple[ElementLaw, int] | None:
        """Law of the forces of all its rows together, and its number among the law's elements.

        None for most joints, whose rows have laws of their own.
        """
        return None

    @property
    def second(self) -> int:
        """Number of the marker that belongs to the body of marker b."""
        return 1

    @property
    def owner(self) -> str:
        """Class and name, with which messages begin."""
        return _checks.named(self, self.name)

    @property
    def direction(self) -> FloatArray | None:
        """Axis of the joint at the start in inertial axes (unit vector), None if it has none."""
        return None

    def turned(self, turns: Sequence[FloatArray]) -> Mapping[str, FloatArray]:
        """Its directions at another start, by field, where the bodies of its markers are rotated.

        Args:
            turns: the rotation (3, 3) of each marker's body, in inertial axes.
        """
        return {}

    def parts(self, lines: Sequence[NodeRow | None]) -> Sequence[Joint]:
        """The joints between nodes that it consists of: itself, unless it joins lines of shells.

        Args:
            lines: the lines that its markers are, None for the others.

        Raises:
            ValueError: the lines do not fit.
        """
        return (self,)

    def motion_term(self, kind: str, poses: Sequence[Pose]) -> Term:
        """Displacement (m) for "translation" or angle (rad) for "rotation", see ``leaves``."""
        a, b = poses
        axis = np.asarray(self.direction)
        if kind == "translation":
            return Term(RowKind.ALONG, u=a.rotation.T @ axis)
        return turn_angle(axis, a, b)

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """Rows of the joint at time ``t`` (s).

        Args:
            poses: poses of its markers at the start.
            t: time, s.

        Raises:
            ValueError: the poses leave no direction or no row.
        """
        raise NotImplementedError

    @staticmethod
    def directions(joints: Sequence[Any], rotations: FloatArray) -> FloatArray:
        """Directions (n, t, 3, 3) in the t terms of the rows of many joints of the class.

        A class that has them has rigid rows, with targets of zero, that differ from joint to joint
        in these directions alone, and :meth:`rows` raises nothing.

        Args:
            joints: n of them.
            rotations: (n, m, 3, 3) of the poses of their m markers at the start.
        """
        raise NotImplementedError

    def targets(self, poses: Sequence[Pose], t: float) -> Sequence[float] | None:
        """Targets of the rows at time ``t`` (s), where a drive changes nothing else of them.

        None where it does; :meth:`rows` is asked for them at every step then.
        """
        return None

    def applied(self, t: float) -> Sequence[float] | None:
        """Forces of rows that carry an ``applied`` one at time ``t`` (s), nothing else changes.

        None where it does, as of :meth:`targets`.
        """
        return None


@declared
class AxisJoint(Joint):
    """A joint with one axis.

    Attributes:
        axis: direction of the axis at the start, inertial axes; any length but zero.

    Raises:
        ValueError: the axis is zero or not three finite numbers.
    """

    axis: Sequence[float] = vector(default=(0.0, 0.0, 1.0), nonzero=True, as_given=True)

    @property
    def direction(self) -> FloatArray:
        """See :attr:`Joint.direction`."""
        return unit(self.axis)

    def turned(self, turns: Sequence[FloatArray]) -> Mapping[str, FloatArray]:
        """See :meth:`Joint.turned`."""
        return {"axis": turns[0] @ self.direction}


@declared
class JointAction(Joint):
    """Base class of forces and drives on the motion that another joint leaves, at its markers.

    Attributes:
        joint: the other joint; in the model too.
        motion: "translation" along or "rotation" about its axis; None for all that it leaves.

    Raises:
        TypeError: ``joint`` is not a joint.
        ValueError: the joint leaves no such motion.
    """

    a: Attachment = field(init=False)
    b: Attachment = field(init=False)
    joint: Joint = instance(Joint)
    motion: str | None = None

    slides = True

    def __post_init__(self) -> None:
        """Take markers and axis from the joint."""
        _checks.assign(self, a=self.joint.a, b=self.joint.b)
        super().__post_init__()
        if not self.motions:
            what = "motion along or about an axis" if self.motion is None else str(self.motion)
            raise ValueError(f"{self.owner}: {self.joint.owner} has no free {what}")

    @property
    def motions(self) -> tuple[str, ...]:
        """Motions acted on."""
        return tuple(m for m in self.joint.leaves if self.motion in (None, m))

    @property
    def direction(self) -> FloatArray | None:
        """See :attr:`Joint.direction`."""
        return self.joint.direction

    def terms(self, poses: Sequence[Pose]) -> list[Term]:
        """Displacement (m) and angle (rad) of these motions."""
        return [self.joint.motion_term(kind, poses) for kind in self.motions]


def unit(vector: Sequence[float] | FloatArray) -> FloatArray:
    """Unit vector along a vector."""
    array = np.array(vector, dtype=np.float64)
    return np.asarray(array / sqrt(array.dot(array)))


def axes_of(joints: Sequence[AxisJoint]) -> FloatArray:
    """Unit axes (n, 3) of many joints at the start, inertial axes."""
    axes = np.array([joint.axis for joint in joints], dtype=np.float64).reshape(-1, 3)
    return axes / np.sqrt(np.sum(axes * axes, axis=1, keepdims=True))


def distance(owner: str, poses: Sequence[Pose], names: str = "a and b") -> float:
    """Distance of the first two markers at the start, m; ``names`` are their names for messages.

    Raises:
        ValueError: it is zero, so that its direction is unknown.
    """
    length = float(np.linalg.norm(poses[1].position - poses[0].position))
    if length == 0.0:
        raise ValueError(f"{owner}: the markers {names} coincide at the start, no direction")
    return length


def check_limits(
    owner: str, lower: float | None, upper: float | None, stiffness: float, damping: float
) -> None:
    """Check the numbers of a stop.

    Raises:
        TypeError: one of them is not a number.
        ValueError: no limit, lower not below upper, stiffness not positive, damping negative.
    """
    if lower is None and upper is None:
        raise ValueError(f"{owner}: needs lower or upper, got neither")
    low = -np.inf if lower is None else _checks.number(owner, "lower", lower)
    high = np.inf if upper is None else _checks.number(owner, "upper", upper)
    if low >= high:
        raise ValueError(f"{owner}: lower must be below upper, got {lower} and {upper}")
    _checks.number(owner, "stiffness", stiffness, positive=True)
    _checks.number(owner, "damping", damping, nonnegative=True)


def check_sliding(action: JointAction) -> None:
    """Check that an action belongs to a joint that slides on a beam.

    Raises:
        TypeError: it does not.
    """
    if not isinstance(action.joint.a, Carrier):
        raise TypeError(f"{action.owner}: joint must be a Sliding joint, got {action.joint.owner}")


def perpendicular(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors that complete a unit axis to a right-handed basis (axis, p, q).

    They are smooth functions of the axis about coordinate axes and the diagonals between them.
    """
    sizes = [abs(x) + more for x, more in zip(axis.tolist(), _BEHIND, strict=True)]
    p = _cross(axis, _AXES[sizes.index(min(sizes))])
    p /= sqrt(p.dot(p))
    return p, _cross(axis, p)


def _perpendiculars(axes: FloatArray) -> FloatArray:
    """The vectors (n, 2, 3) of :func:`perpendicular` for many unit axes (n, 3)."""
    p = np.cross(axes, _AXES[np.argmin(np.abs(axes) + _BEHIND, axis=1)])
    p /= np.sqrt(np.sum(p * p, axis=1, keepdims=True))
    return np.stack([p, np.cross(axes, p)], axis=1)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Product of two vectors: drives need it in every step, and NumPy's own is slow."""
    (a0, a1, a2), (b0, b1, b2) = a.tolist(), b.tolist()
    return np.array([a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0])


@cache
def coincidence(b: int = 1) -> tuple[Row, ...]:
    """Three rows that keep the origins of the first marker and of marker ``b`` together."""
    return tuple(Row((Term(RowKind.INERTIAL, u=e, b=b),)) for e in _AXES)


def coincidence_directions(count: int) -> FloatArray:
    """Directions (n, 3, 3, 3) of :func:`coincidence` for so many joints."""
    out = np.zeros((count, 3, 3, 3))
    out[:, :, 0] = _AXES
    return out


def parallelism(axis: FloatArray, a: Pose, b: Pose) -> tuple[Row, ...]:
    """Two rows that keep an axis (inertial components at the start) common to both markers."""
    v = b.rotation.T @ axis
    return tuple(
        Row((Term(RowKind.AXES, u=a.rotation.T @ direction, v=v),))
        for direction in perpendicular(axis)
    )


def parallelism_directions(axes: FloatArray, rotations: FloatArray) -> FloatArray:
    """Directions (n, 2, 3, 3) of :func:`parallelism` for unit axes (n, 3) of many joints.

    Args:
        axes: inertial components at the start.
        rotations: (n, 2, 3, 3) of both poses.
    """
    out = np.zeros((len(axes), 2, 3, 3))
    out[:, :, 0] = _perpendiculars(axes) @ rotations[:, 0]
    out[:, :, 1] = axes[:, np.newaxis] @ rotations[:, 1]
    return out


def displacement(axis: FloatArray, a: Pose, target: float = 0.0, law: Law | None = None) -> Row:
    """Row of the position of b relative to a along an axis that is fixed in a.

    The axis is given in inertial components at the start.
    """
    return Row((Term(RowKind.ALONG, u=a.rotation.T @ axis),), target, law)


def line_guidance(axis: FloatArray, a: Pose) -> tuple[Row, ...]:
    """Two rows that keep marker b on the line through marker a along an axis fixed in a."""
    return tuple(displacement(direction, a) for direction in perpendicular(axis))


def equal_rotation(
    a: Pose, b: Pose, turned: FloatArray | None = None, number: int = 1
) -> tuple[Row, ...]:
    """Three rows that keep the initial relative rotation, rotated by a matrix in marker a's axes.

    They keep the three off-diagonal products of the axes at zero: unique while the rotation error
    stays below a quarter turn. ``number`` is that of marker b within the joint.
    """
    start = np.eye(3) if turned is None else turned
    relative = a.rotation.T @ b.rotation
    return tuple(
        Row((Term(RowKind.AXES, u=start[:, i].copy(), v=relative[j].copy(), b=number),))
        for i, j in ((1, 2), (2, 0), (0, 1))
    )


def equal_rotation_directions(rotations: FloatArray) -> FloatArray:
    """Directions (n, 3, 3, 3) of :func:`equal_rotation`, for (n, 2, 3, 3) of both poses."""
    out = np.zeros((len(rotations), 3, 3, 3))
    relative = np.swapaxes(rotations[:, 0], 1, 2) @ rotations[:, 1]
    out[:, :, 0], out[:, :, 1] = _AXES[[1, 2, 0]], relative[:, [2, 0, 1]]
    return out


def turn_angle(
    axis: FloatArray,
    a: Pose,
    b: Pose,
    ends: tuple[int, int] = (0, 1),
    reference: FloatArray | None = None,
) -> Term:
    """Angle (rad) by which b has rotated from a since the start.

    The axis is given in inertial components at the start and stays fixed in a; ``ends`` are the
    numbers of both markers within the joint. The angle is that between projections along the axis
    of a vector in a and the one in b that is the same at the start: ``reference``, perpendicular to
    the axis, any if None. It matters where b rotates about other axes, too.
    """
    p = perpendicular(axis)[0] if reference is None else reference
    return Term(
        RowKind.ANGLE,
        u=a.rotation.T @ axis,
        p=a.rotation.T @ p,
        v=b.rotation.T @ p,
        a=ends[0],
        b=ends[1],
    )


def turn_angles(a: Pose, b: Pose) -> list[Term]:
    """Angles (rad) about the axes of a by which b has rotated from a since the start.

    References are chosen so that a rotation about the third axis alone changes no other angle,
    whatever its size, nor do rotations below a right angle about one of the others.
    """
    axes = a.rotation.T
    return [turn_angle(axes[k], a, b, reference=axes[r]) for k, r in enumerate((2, 2, 1))]
