# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints as rows of elementary scalar constraints between two markers.

A joint is data: the list of its rows, each with directions fixed in the axes of its markers. All
rows of all joints are evaluated as one batch in compiled code (``flexfem.system.row_kernels``),
with their first and second derivatives; a new joint is a new list of rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.core.marker import Attachment, Ground, Marker
from flexfem.core.pose import Pose

__all__ = [
    "AxisJoint",
    "Joint",
    "Row",
    "RowKind",
    "coincidence",
    "equal_rotation",
    "line_guidance",
    "parallelism",
    "perpendicular",
    "turn_angle",
]

_ZERO = np.zeros(3)


class RowKind(IntEnum):
    """Elementary constraints between marker a (pose x_a, R_a) and marker b (x_b, R_b)."""

    #: u . (x_b - x_a) - target, u in inertial axes
    INERTIAL = 0
    #: R_a u . (x_b - x_a) - target
    ALONG = 1
    #: R_a u . R_b v - target
    AXES = 2
    #: |x_b - x_a| - target
    DISTANCE = 3
    #: angle about R_a u from R_a p to R_b v - target; continuous over any number of turns
    ANGLE = 4


@dataclass(frozen=True)
class Row:
    """One scalar constraint, rigid or elastic.

    Attributes:
        kind: which elementary constraint.
        u: direction in the axes of marker a (inertial axes for ``INERTIAL``).
        v: direction in the axes of marker b.
        p: zero direction of an angle, in the axes of marker a, perpendicular to ``u``.
        target: value that the constraint function takes (m, rad or 1).
        stiffness: None for a rigid row; else the row carries the force ``stiffness * value +
            damping * rate`` (N/m or N m/rad).
        damping: N s/m or N m s/rad, with a stiffness that may be zero.
    """

    kind: RowKind
    u: FloatArray = field(default_factory=lambda: _ZERO)
    v: FloatArray = field(default_factory=lambda: _ZERO)
    p: FloatArray = field(default_factory=lambda: _ZERO)
    target: float = 0.0
    stiffness: float | None = None
    damping: float = 0.0


@dataclass(frozen=True, eq=False)
class Joint:
    """A connection between two markers.

    Attributes:
        name: unique name within the model.
        a: first marker.
        b: second marker.
    """

    name: str
    a: Attachment
    b: Attachment

    #: rows change with time: they are asked for at every step
    driven: ClassVar[bool] = False

    def __post_init__(self) -> None:
        """Check the name and the markers.

        Raises:
            TypeError: the name is not a string, or a marker is not a Marker or Ground.
            ValueError: the name is empty or not printable.
        """
        for label in ("a", "b"):
            _checks.instance(self.owner, label, getattr(self, label), (Marker, Ground))

    @property
    def owner(self) -> str:
        """Class and name, with which messages begin."""
        return _checks.named(self, self.name)

    @property
    def direction(self) -> FloatArray | None:
        """Axis of the joint at the start in inertial axes (unit vector), None if it has none."""
        return None

    def rows(self, a: Pose, b: Pose, t: float) -> tuple[Row, ...]:
        """Rows of the joint at time ``t`` (s), given the poses of its markers at the start."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class AxisJoint(Joint):
    """A joint with one axis.

    Attributes:
        axis: direction of the axis at the start, inertial axes; any length but zero.
    """

    axis: Sequence[float] = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        """Check the axis.

        Raises:
            ValueError: the axis is zero or not three finite numbers.
        """
        super().__post_init__()
        _checks.vector(self.owner, "axis", self.axis, nonzero=True)

    @property
    def direction(self) -> FloatArray:
        """See :attr:`Joint.direction`."""
        axis = np.array(self.axis, dtype=np.float64)
        return axis / np.linalg.norm(axis)


def perpendicular(axis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors that complete a unit axis to a right-handed basis (axis, p, q)."""
    p = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    p /= np.linalg.norm(p)
    return p, np.cross(axis, p)


def coincidence() -> tuple[Row, ...]:
    """Three rows that keep the origins of both markers together."""
    return tuple(Row(RowKind.INERTIAL, u=e) for e in np.eye(3))


def parallelism(axis: FloatArray, a: Pose, b: Pose) -> tuple[Row, ...]:
    """Two rows that keep an axis (inertial components at the start) common to both markers."""
    return tuple(
        Row(RowKind.AXES, u=a.rotation.T @ direction, v=b.rotation.T @ axis)
        for direction in perpendicular(axis)
    )


def line_guidance(axis: FloatArray, a: Pose) -> tuple[Row, ...]:
    """Two rows that keep marker b on the line through marker a along an axis fixed in a."""
    return tuple(
        Row(RowKind.ALONG, u=a.rotation.T @ direction) for direction in perpendicular(axis)
    )


def equal_rotation(a: Pose, b: Pose, turned: FloatArray | None = None) -> tuple[Row, ...]:
    """Three rows that keep the initial relative rotation, turned by a matrix in marker a's axes.

    They hold the three off-diagonal products of the axes at zero: unique while the rotation error
    stays below a quarter turn.
    """
    start = np.eye(3) if turned is None else turned
    relative = a.rotation.T @ b.rotation
    return tuple(
        Row(RowKind.AXES, u=start[:, i].copy(), v=relative[j].copy())
        for i, j in ((1, 2), (2, 0), (0, 1))
    )


def turn_angle(axis: FloatArray, a: Pose, b: Pose, angle: float) -> Row:
    """Row that holds the angle (rad) by which b has turned from a since the start.

    The axis is given in inertial components at the start and stays fixed in a.
    """
    p, _ = perpendicular(axis)
    return Row(
        RowKind.ANGLE,
        u=a.rotation.T @ axis,
        p=a.rotation.T @ p,
        v=b.rotation.T @ p,
        target=angle,
    )
