# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shapes of rigid bodies, for pictures."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.core.pose import Pose

__all__ = ["SHAPES", "Box", "CompoundShape", "Cylinder", "Shape", "Sphere", "SurfaceShape"]


@dataclass(frozen=True)
class Box:
    """Box about the reference point, for pictures.

    Attributes:
        sizes: Edge lengths along the body axes, metres.
    """

    sizes: tuple[float, float, float]

    def __post_init__(self) -> None:
        """Check the sizes.

        Raises:
            TypeError: The sizes are not numbers.
            ValueError: They are not three positive numbers.
        """
        sizes = _checks.vector("Box", "sizes", self.sizes)
        if (sizes <= 0.0).any():
            raise ValueError(f"Box: sizes must be positive, got {_checks.show(self.sizes)}")


@dataclass(frozen=True)
class Sphere:
    """Sphere about the reference point, for pictures.

    Attributes:
        radius: Radius, metres.
    """

    radius: float

    def __post_init__(self) -> None:
        """Check the radius.

        Raises:
            TypeError: The radius is not a number.
            ValueError: It is not positive.
        """
        _checks.number("Sphere", "radius", self.radius, positive=True)


@dataclass(frozen=True)
class Cylinder:
    """Cylinder about the reference point, for pictures.

    Attributes:
        radius: Radius, metres.
        length: Length, metres.
        axis: Direction of the axis in body axes, of any length but zero.
    """

    radius: float
    length: float
    axis: tuple[float, float, float] = (1.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            TypeError: A value is not a number.
            ValueError: A length is not positive or the axis is zero.
        """
        _checks.number("Cylinder", "radius", self.radius, positive=True)
        _checks.number("Cylinder", "length", self.length, positive=True)
        _checks.vector("Cylinder", "axis", self.axis, nonzero=True)


@dataclass(frozen=True, eq=False, init=False)
class SurfaceShape:
    """Triangulated surface in body axes, for pictures.

    Attributes:
        points: Points (n, 3), body axes, from the reference point, metres.
        triangles: Point numbers (m, 3), counterclockwise seen from outside.
    """

    points: FloatArray
    triangles: IntArray

    def __init__(self, points: npt.ArrayLike, triangles: npt.ArrayLike) -> None:
        """Create the surface.

        Raises:
            TypeError: An argument does not consist of numbers of the right kind.
            ValueError: A wrong shape, NaN, no triangle, or a point that there is not.
        """
        places = _checks.array("SurfaceShape", "points", points, (-1, 3))
        corners = _checks.indices("SurfaceShape", "triangles", triangles, len(places), 3)
        if len(corners) == 0:
            raise ValueError("SurfaceShape: triangles must hold at least one, got none")
        _checks.assign(self, points=places, triangles=_checks.freeze(corners, "int64"))


@dataclass(frozen=True)
class CompoundShape:
    """Several shapes as one, for pictures.

    Attributes:
        parts: Shapes and where they are in body axes.
    """

    parts: Sequence[tuple["Shape", Pose]]

    def __post_init__(self) -> None:
        """Check the parts.

        Raises:
            TypeError: A part is no pair of a shape and a pose.
            ValueError: There is none.
        """
        if len(self.parts) == 0:
            raise ValueError("CompoundShape: parts must hold at least one, got none")
        for part in self.parts:
            if not isinstance(part, tuple) or len(part) != 2:
                raise TypeError(
                    "CompoundShape: parts must be pairs of a shape and a Pose, got "
                    f"{_checks.show(part)}"
                )
            _checks.instance("CompoundShape", "shape", part[0], SHAPES)
            _checks.instance("CompoundShape", "pose", part[1], Pose)
        _checks.assign(self, parts=tuple(self.parts))


#: How a rigid body may look.
Shape = Box | Sphere | Cylinder | SurfaceShape | CompoundShape
SHAPES = (Box, Sphere, Cylinder, SurfaceShape, CompoundShape)
