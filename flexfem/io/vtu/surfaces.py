# SPDX-License-Identifier: LGPL-3.0-or-later
"""Triangulated surfaces that represent rigid bodies and joints in pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexfem.mesh.triangles import solids

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Surface:
    """Closed triangulated surface in body axes.

    Attributes:
        points: Points (n, 3) in m.
        triangles: Point numbers (m, 3), counterclockwise seen from outside.
    """

    points: FloatArray
    triangles: IntArray

    def moved(self, matrix: ArrayLike, shift: ArrayLike) -> Surface:
        """The surface mapped by x -> matrix x + shift (matrix of positive determinant)."""
        points = self.points @ np.asarray(matrix, dtype=np.float64).T
        return Surface(points + np.asarray(shift, dtype=np.float64), self.triangles)

    def scaled(self, factor: float) -> Surface:
        """The surface enlarged about its origin."""
        return self.moved(factor * np.eye(3), np.zeros(3))


def joined(*surfaces: Surface) -> Surface:
    """Several surfaces as one; they may reach into each other."""
    starts = np.cumsum([0, *(len(s.points) for s in surfaces)])
    triangles = [s.triangles + at for s, at in zip(surfaces, starts, strict=False)]
    return Surface(np.concatenate([s.points for s in surfaces]), np.concatenate(triangles))


def box(sizes: ArrayLike) -> Surface:
    """Box with the given edge lengths (3,) in m, centred at the origin."""
    return Surface(*solids.box(sizes))


def cylinder(
    radius: float, length: float, axis: ArrayLike, *, sides: int = 32, caps: bool = True
) -> Surface:
    """Cylinder about an axis (3,), centred at the origin; radius and length in m."""
    phi = 2.0 * np.pi * np.arange(sides) / sides
    ring = radius * np.stack([np.cos(phi), np.sin(phi), np.zeros(sides)], axis=1)
    half = np.array([0.0, 0.0, 0.5 * length])
    # The caps have their own points, so that a smoothly shaded side keeps sharp edges.
    points = np.concatenate([ring - half, ring + half, ring - half, ring + half, [-half, half]])
    j, k = np.arange(sides), (np.arange(sides) + 1) % sides
    bottom, top = 2 * sides, 3 * sides
    faces = [
        (j, k, k + sides),
        (j, k + sides, j + sides),
        (np.full(sides, 4 * sides), bottom + k, bottom + j),
        (np.full(sides, 4 * sides + 1), top + j, top + k),
    ]
    triangles = np.concatenate([np.stack(f, axis=1) for f in (faces if caps else faces[:2])])
    points = points if caps else points[:bottom]
    return Surface(points @ frames_along(np.atleast_2d(axis))[0].T, triangles)


def capsule(radius: float, length: float, axis: ArrayLike, *, sides: int = 32) -> Surface:
    """Cylinder with half spheres at its ends about an axis (3,), centred at the origin.

    Args:
        radius: In m.
        length: Between the centres of the half spheres in m.
        axis: Of any length but zero.
        sides: Around the axis; a half sphere has a quarter as many rings.
    """
    points, triangles = solids.capsule(radius, length, sides)
    return Surface(points @ frames_along(np.atleast_2d(axis))[0].T, triangles)


def sphere(radius: float, *, refinements: int = 3) -> Surface:
    """Sphere about the origin (radius in m): an octahedron refined by halving its edges."""
    points = np.concatenate([np.eye(3), -np.eye(3)])
    triangles = np.array(
        [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    )
    for _ in range(refinements):
        edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        unique, inverse = np.unique(edges, axis=0, return_inverse=True)
        mid = inverse.reshape(-1, 3) + len(points)
        (a, b, c), (ab, bc, ca) = triangles.T, mid.T
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        middles = points[unique].sum(axis=1)
        points = np.concatenate([points, middles / np.linalg.norm(middles, axis=1)[:, None]])
        triangles = np.concatenate([np.stack(p, axis=1) for p in parts])
    return Surface(radius * points, triangles)


def body_surface(
    shape: Any,
    mass: float,
    inertia: ArrayLike,
    centre: ArrayLike = (0.0, 0.0, 0.0),
    largest: float = np.inf,
) -> Surface:
    """Surface of a rigid body in its own axes.

    Args:
        shape: Object with ``sizes`` (a box), ``radius``, ``length`` and ``axis`` (a cylinder, or a
            capsule where it has ``round_ends``) or ``radius`` (a sphere), in m, about the
            reference point; with ``points`` and
            ``triangles``, or with ``parts``, pairs of a shape and its pose; or None: the
            homogeneous box of this mass and inertia about the centre of mass.
        mass: Mass in kg.
        inertia: Inertia (3, 3) or its diagonal (3,) about the centre of mass in kg m^2.
        centre: Centre of mass (3,) relative to the reference point in body axes in m.
        largest: Longest side of the box in m; it is smaller, where it would be longer.

    Raises:
        TypeError: If the shape has none of these attributes.
    """
    if shape is None:
        matrix, sizes = _equivalent_box(mass, inertia)
        sizes *= min(1.0, largest / float(sizes.max()))
        return box(sizes).moved(matrix, centre)
    return _shape_surface(shape)


def _shape_surface(shape: Any) -> Surface:
    """Surface of a shape about its own origin."""
    if hasattr(shape, "parts"):
        return _joined(
            [_shape_surface(s).moved(pose.rotation, pose.position) for s, pose in shape.parts]
        )
    if hasattr(shape, "triangles"):
        return Surface(shape.points, shape.triangles)
    if hasattr(shape, "sizes"):
        return box(shape.sizes)
    if hasattr(shape, "round_ends"):
        return capsule(shape.radius, shape.length, shape.axis)
    if hasattr(shape, "radius") and hasattr(shape, "length"):
        return cylinder(shape.radius, shape.length, shape.axis)
    if hasattr(shape, "radius"):
        return sphere(shape.radius)
    raise TypeError(f"body_surface: a {type(shape).__name__} is not a shape")


def _joined(surfaces: Sequence[Surface]) -> Surface:
    """Several surfaces as one."""
    starts = np.cumsum([0, *(len(s.points) for s in surfaces)])[:-1]
    triangles = [s.triangles + i for s, i in zip(surfaces, starts, strict=True)]
    return Surface(np.concatenate([s.points for s in surfaces]), np.concatenate(triangles))


def frames_along(axes: ArrayLike) -> FloatArray:
    """Rotations (n, 3, 3) whose third column points along the given vectors (n, 3).

    The frame depends continuously on the vector except at -z (Duff et al., Building an
    Orthonormal Basis, Revisited, JCGT 6(1), 2017); a zero vector counts as z.
    """
    a = np.array(axes, dtype=np.float64).reshape(-1, 3)
    length = np.linalg.norm(a, axis=1)
    a[length == 0.0] = (0.0, 0.0, 1.0)
    a /= np.where(length == 0.0, 1.0, length)[:, None]
    x, y, z = a.T
    sign = np.copysign(1.0, z)
    p = -1.0 / (sign + z)
    q = x * y * p
    first = np.stack([1.0 + sign * x * x * p, sign * q, -sign * x], axis=1)
    second = np.stack([q, sign + y * y * p, -y], axis=1)
    return np.stack([first, second, a], axis=2)


def _equivalent_box(mass: float, inertia: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Principal axes and edge lengths of the homogeneous box of this mass and inertia."""
    tensor = np.asarray(inertia, dtype=np.float64)
    tensor = np.diag(tensor) if tensor.ndim == 1 else tensor
    moments, axes = np.linalg.eigh(tensor)
    if np.linalg.det(axes) < 0.0:
        axes = -axes
    squares = np.maximum(6.0 * (moments.sum() - 2.0 * moments) / mass, 0.0)
    sizes = np.sqrt(squares)
    # Rods and plates get a thickness that can be seen.
    return axes, np.maximum(sizes, 0.05 * sizes.max())


class Instances:
    """Moving copies of surfaces as one mesh: which points and triangles belong to which copy."""

    def __init__(self, surfaces: Sequence[Surface]) -> None:
        """Concatenate the surfaces.

        Args:
            surfaces: One surface per copy.
        """
        points = [s.points for s in surfaces]
        counts = [len(p) for p in points]
        starts = np.cumsum([0, *counts])[:-1]
        triangles = [s.triangles + i for s, i in zip(surfaces, starts, strict=True)]
        index = np.arange(len(surfaces))
        self.local: FloatArray = np.concatenate([np.zeros((0, 3)), *points])
        self.triangles: IntArray = np.concatenate([np.zeros((0, 3), dtype=np.int64), *triangles])
        self.owner: IntArray = np.repeat(index, counts)
        self.cell_owner: IntArray = np.repeat(index, [len(s.triangles) for s in surfaces])

    def arms(self, frames: FloatArray) -> FloatArray:
        """Vectors from each copy's origin to its points, rotated by its frame (n, 3, 3)."""
        if not len(self.local):
            return self.local
        turned: FloatArray = np.matmul(frames.take(self.owner, axis=0), self.local[:, :, None])[
            :, :, 0
        ]
        return turned


class InstanceCache:
    """Instances for a selection of templates, rebuilt only when the selection changes."""

    def __init__(self, templates: Sequence[Surface]) -> None:
        """Keep the surfaces to choose from.

        Args:
            templates: All surfaces, by index.
        """
        self.templates = list(templates)
        self._selection: IntArray | None = None
        self._instances = Instances([])

    def select(self, selection: IntArray) -> Instances:
        """The templates with the given numbers (n,), in this order."""
        if self._selection is None or not np.array_equal(selection, self._selection):
            self._instances = Instances([self.templates[i] for i in selection])
            self._selection = selection.copy()
        return self._instances
