# SPDX-License-Identifier: LGPL-3.0-or-later
"""Distances of rigid surfaces, and their closest points, in the axes of the surface.

Distances are positive on the free side, and exact: no point of the surface is nearer. A tube of
finite length is a wall without thickness, which acts on both sides: what leaves it through its end
meets its rim.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.obstacles.shapes import ShapeKind
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.users.signed_distance import SignedDistance
from flexfem.model.rigid_surface import (
    RigidCylinder,
    RigidObstacle,
    RigidPlane,
    RigidSphere,
    RigidSurface,
)

__all__ = ["Bend", "Distance", "SimpleDistance", "distance_of"]


class Bend(IntEnum):
    """How the distance changes along straight lines."""

    #: not faster than the way
    ANY = 0
    #: convexly: outside of convex obstacles
    CONVEX = 1
    #: concavely: inside of convex walls
    CONCAVE = 2


class Distance(Protocol):
    """Signed distance of a surface in its axes."""

    @property
    def bend(self) -> Bend:
        """How it changes along lines."""

    def closest(
        self, points: FloatArray, reach: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Distances (k,) of points (k, 3), m, and the closest points of the surface (k, 3).

        Beyond ``reach`` (k,) the distance may be any larger one, and the closest point NaN.
        """


@dataclass(frozen=True)
class SimpleDistance:
    """Distance of a simple shape.

    Attributes:
        kind: Its shape.
        radius: Metres.
        length: Along the axis, metres, or infinite.
    """

    kind: ShapeKind
    radius: float = 0.0
    length: float = np.inf

    @property
    def bend(self) -> Bend:
        """How it changes along lines."""
        if self.kind == ShapeKind.TUBE and self.length < np.inf:
            return Bend.ANY
        hollow = self.kind in (ShapeKind.HOLLOW_SPHERE, ShapeKind.TUBE)
        return Bend.CONCAVE if hollow else Bend.CONVEX

    def closest(
        self, points: FloatArray, reach: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """See :meth:`Distance.closest`."""
        distances, feet = np.empty(len(points)), np.empty((len(points), 3))
        given = np.ascontiguousarray(points)
        _closest_into(int(self.kind), self.radius, self.length, given, distances, feet)
        return distances, feet


@dataclass(frozen=True)
class WrittenDistance:
    """Distance of a surface that a user has written.

    Attributes:
        surface: the surface.
    """

    surface: SignedDistance
    bend = Bend.ANY

    def closest(
        self, points: FloatArray, reach: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """See :meth:`Distance.closest`."""
        return self.surface.closest(points, reach)


def distance_of(surface: RigidSurface) -> Distance:
    """Return the distance of a rigid surface of the model.

    Raises:
        TypeError: it has none.
    """
    match surface:
        case RigidPlane():
            return SimpleDistance(ShapeKind.PLANE)
        case RigidSphere(radius=radius, inside=inside):
            return SimpleDistance(ShapeKind.HOLLOW_SPHERE if inside else ShapeKind.SPHERE, radius)
        case RigidCylinder(radius=radius, length=length, inside=inside):
            return SimpleDistance(ShapeKind.TUBE if inside else ShapeKind.CYLINDER, radius, length)
        case RigidObstacle():
            return WrittenDistance(surface.surface)
    raise TypeError(f"no distance of {surface!r}")


_PLANE, _SPHERE, _HOLLOW = int(ShapeKind.PLANE), int(ShapeKind.SPHERE), int(ShapeKind.HOLLOW_SPHERE)
_TUBE = int(ShapeKind.TUBE)


@inlined
def _way(x: FloatArray, foot: FloatArray) -> float:
    """Distance of two points."""
    return float(np.sqrt((x[0] - foot[0]) ** 2 + (x[1] - foot[1]) ** 2 + (x[2] - foot[2]) ** 2))


@inlined
def _on_sphere(x: FloatArray, radius: float, foot: FloatArray) -> float:
    """Write the closest point of a sphere; returns the distance from its outside."""
    size = np.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])
    for a in range(3):
        foot[a] = radius * x[a] / size if size > 0.0 else 0.0
    if size == 0.0:
        foot[2] = radius
    return float(size - radius)


@inlined
def _on_side(x: FloatArray, radius: float, foot: FloatArray) -> float:
    """Write the closest point of a cylinder without end; returns the distance from its outside."""
    size = np.sqrt(x[0] * x[0] + x[1] * x[1])
    foot[0] = radius * x[0] / size if size > 0.0 else radius
    foot[1] = radius * x[1] / size if size > 0.0 else 0.0
    foot[2] = x[2]
    return float(size - radius)


@inlined
def _on_closed(x: FloatArray, radius: float, half: float, foot: FloatArray) -> float:
    """Write the closest point of a cylinder with flat ends; returns its distance."""
    beside = _on_side(x, radius, foot)
    end = 1.0 if x[2] >= 0.0 else -1.0
    above = end * x[2] - half
    if above <= 0.0 and beside >= above:
        return beside
    foot[2] = end * half
    if beside <= 0.0:
        foot[0], foot[1] = x[0], x[1]
        return float(above)
    return _way(x, foot)


@kernel
def _closest_into(
    kind: int, radius: float, length: float, points: FloatArray, distances: FloatArray,
    feet: FloatArray,
) -> None:  # fmt: skip
    """Write distances (k,) and closest points (k, 3) of a shape for points (k, 3)."""
    half = 0.5 * length
    for k in range(len(points)):
        x, foot = points[k], feet[k]
        if kind == _PLANE:
            foot[0], foot[1], foot[2] = x[0], x[1], 0.0
            distances[k] = x[2]
        elif kind == _SPHERE:
            distances[k] = _on_sphere(x, radius, foot)
        elif kind == _HOLLOW:
            distances[k] = -_on_sphere(x, radius, foot)
        elif kind == _TUBE:
            distances[k] = -_on_side(x, radius, foot)
            if length < np.inf:
                foot[2] = min(max(x[2], -half), half)
                distances[k] = _way(x, foot)
        elif length < np.inf:
            distances[k] = _on_closed(x, radius, half, foot)
        else:
            distances[k] = _on_side(x, radius, foot)
