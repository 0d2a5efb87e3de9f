# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shapes of rigid bodies, for pictures and contact."""

from collections.abc import Sequence
from itertools import product
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import Array, Given, array, checked, declared, number, vector
from flexfem._types import FloatArray, IntArray
from flexfem.core.pose import Pose

__all__ = [
    "SHAPES", "Box", "Capsule", "CompoundShape", "Cylinder", "Shape", "Sphere", "SurfaceShape",
]  # fmt: skip


def _sizes(owner: str, what: str, value: Any) -> None:
    """Check three positive numbers."""
    if (_checks.vector(owner, what, value) <= 0.0).any():
        raise ValueError(f"{owner}: {what} must be positive, got {_checks.show(value)}")


def _corners(sizes: FloatArray) -> FloatArray:
    """Corners (8, 3) of a box about the origin."""
    corners: FloatArray = 0.5 * sizes * np.array(list(product((-1.0, 1.0), repeat=3)))
    return corners


@declared(eq=True)
class Box:
    """Box about the reference point, for pictures and contact.

    Attributes:
        sizes: Edge lengths along the body axes, metres.

    Raises:
        TypeError: The sizes are not numbers.
        ValueError: They are not three positive numbers.
    """

    sizes: tuple[float, float, float] = checked(_sizes, as_given=True)

    @property
    def corners(self) -> FloatArray:
        """Corners (8, 3) of its box along the body axes, m."""
        return _corners(np.array(self.sizes))


@declared(eq=True)
class Sphere:
    """Sphere about the reference point, for pictures and contact.

    Attributes:
        radius: Radius, metres.

    Raises:
        TypeError: The radius is not a number.
        ValueError: It is not positive.
    """

    radius: float = number(positive=True, as_given=True)

    @property
    def corners(self) -> FloatArray:
        """Corners (8, 3) of its box along the body axes, m."""
        return _corners(np.full(3, 2.0 * self.radius))


@declared(eq=True)
class Cylinder:
    """Cylinder with flat ends about the reference point, for pictures and contact.

    Attributes:
        radius: Radius, metres.
        length: Length, metres.
        axis: Direction of the axis in body axes, of any length but zero.

    Raises:
        TypeError: A value is not a number.
        ValueError: A length is not positive or the axis is zero.
    """

    radius: float = number(positive=True, as_given=True)
    length: float = number(positive=True, as_given=True)
    axis: tuple[float, float, float] = vector(default=(1.0, 0.0, 0.0), nonzero=True, as_given=True)

    @property
    def corners(self) -> FloatArray:
        """Corners (8, 3) of its box along the body axes, m."""
        along = np.abs(self.axis) / np.linalg.norm(self.axis)
        across = np.sqrt(np.clip(1.0 - along**2, 0.0, 1.0))
        return _corners(self.length * along + 2.0 * self.radius * across)


@declared(eq=True)
class Capsule:
    """Cylinder with half spheres at its ends about the reference point, for pictures and contact.

    Attributes:
        radius: Radius of the cylinder and of both half spheres, metres.
        length: Distance between the centres of the half spheres, metres.
        axis: Direction of the axis in body axes, of any length but zero.

    Raises:
        TypeError: A value is not a number.
        ValueError: A length is not positive or the axis is zero.
    """

    round_ends: ClassVar[bool] = True

    radius: float = number(positive=True, as_given=True)
    length: float = number(positive=True, as_given=True)
    axis: tuple[float, float, float] = vector(default=(1.0, 0.0, 0.0), nonzero=True, as_given=True)

    @property
    def ends(self) -> FloatArray:
        """Centres (2, 3) of the half spheres in body axes, m."""
        along = np.array(self.axis) / np.linalg.norm(self.axis)
        return np.outer([-0.5, 0.5], self.length * along)

    @property
    def corners(self) -> FloatArray:
        """Corners (8, 3) of its box along the body axes, m."""
        along = np.abs(self.axis) / np.linalg.norm(self.axis)
        return _corners(self.length * along + 2.0 * self.radius)


@declared
class SurfaceShape:
    """Triangulated surface in body axes, for pictures and contact.

    Attributes:
        points: Points (n, 3), body axes, from the reference point, metres.
        triangles: Point numbers (m, 3), counterclockwise seen from outside.

    Raises:
        TypeError: An argument does not consist of numbers of the right kind.
        ValueError: A wrong shape, NaN, no triangle, or a point that there is not.
    """

    points: Array = array(-1, 3)
    triangles: Given[npt.ArrayLike, IntArray]

    def __post_init__(self) -> None:
        """Check the triangles."""
        corners = _checks.indices("SurfaceShape", "triangles", self.triangles, len(self.points), 3)
        if len(corners) == 0:
            raise ValueError("SurfaceShape: triangles must hold at least one, got none")
        _checks.assign(self, triangles=_checks.freeze(corners, "int64"))

    @property
    def corners(self) -> FloatArray:
        """Its points (n, 3) in body axes, m."""
        return self.points


def _parts(owner: str, what: str, value: Any) -> tuple[tuple["Shape", Pose], ...]:
    """Return checked pairs of a shape and a pose."""
    if len(value) == 0:
        raise ValueError(f"{owner}: {what} must hold at least one, got none")
    for part in value:
        if not isinstance(part, tuple) or len(part) != 2:
            raise TypeError(
                f"{owner}: {what} must be pairs of a shape and a Pose, got {_checks.show(part)}"
            )
        _checks.instance(owner, "shape", part[0], SHAPES)
        _checks.instance(owner, "pose", part[1], Pose)
    return tuple(value)


@declared(eq=True)
class CompoundShape:
    """Several shapes as one, for pictures and contact.

    Attributes:
        parts: Shapes and their places in body axes.

    Raises:
        TypeError: A part is no pair of a shape and a pose.
        ValueError: There is none.
    """

    parts: Sequence[tuple["Shape", Pose]] = checked(_parts)

    @property
    def corners(self) -> FloatArray:
        """Corners (n, 3) of the boxes of its parts in body axes, m."""
        placed = [shape.corners @ pose.rotation.T + pose.position for shape, pose in self.parts]
        return np.concatenate(placed)


#: Appearance of a rigid body.
Shape = Box | Sphere | Cylinder | Capsule | SurfaceShape | CompoundShape
SHAPES = (Box, Sphere, Cylinder, Capsule, SurfaceShape, CompoundShape)
