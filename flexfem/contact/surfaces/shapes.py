# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shapes of rigid bodies as meshes of triangles, in body axes."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.joint import perpendicular
from flexfem.core.pose import Pose
from flexfem.mesh.surface_mesh import SurfaceMesh
from flexfem.mesh.triangles import solids
from flexfem.model.bodies.shapes import Box, Capsule, CompoundShape, Cylinder, Shape, SurfaceShape

__all__ = ["axes_along", "shape_mesh", "simple_shapes"]

#: Sides of the prism of a cylinder: it is up to 0.12 % of the radius inside.
_SIDES = 64


def simple_shapes(shape: Shape, pose: Pose | None = None) -> list[tuple[Shape, Pose]]:
    """Return the parts of a shape, which are not compound, and their poses in body axes."""
    pose = Pose() if pose is None else pose
    if not isinstance(shape, CompoundShape):
        return [(shape, pose)]
    return [found for part, own in shape.parts for found in simple_shapes(part, pose @ own)]


def axes_along(axis: object) -> FloatArray:
    """Return a rotation (3, 3) whose third column is along a vector."""
    along = np.asarray(axis, dtype=np.float64)
    along = along / np.linalg.norm(along)
    return np.column_stack([*perpendicular(along), along])


def shape_mesh(owner: str, shape: Shape) -> SurfaceMesh:
    """Return the triangles of a box, cylinder, capsule or surface.

    Raises:
        ValueError: the triangles of a surface make no mesh.
    """
    points, triangles = _triangles(shape)
    try:
        return SurfaceMesh(points, triangles, {"shape": np.arange(len(triangles))})
    except ValueError as error:
        raise ValueError(f"{owner}: its shape: {error}") from None


def _triangles(shape: Shape) -> tuple[FloatArray, IntArray]:
    """Points (n, 3) and triangles (m, 3) of a shape, each point used and there once."""
    if isinstance(shape, Box):
        return solids.box(shape.sizes)
    if isinstance(shape, (Cylinder, Capsule)):
        make = solids.cylinder if isinstance(shape, Cylinder) else solids.capsule
        points, triangles = make(shape.radius, shape.length, _SIDES)
        return points @ axes_along(shape.axis).T, triangles
    assert isinstance(shape, SurfaceShape)
    rows, triangles = np.unique(shape.triangles, return_inverse=True)
    places, number = np.unique(shape.points[rows], axis=0, return_inverse=True)
    triangles = number.reshape(-1)[triangles.reshape(-1, 3)]
    flat = (triangles == np.roll(triangles, 1, axis=1)).any(axis=1)
    return places, triangles[~flat].astype(np.int64)
