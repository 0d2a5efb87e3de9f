# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shapes of rigid bodies and rigid surfaces: spheres, rods and meshes on a node or the ground."""

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.surfaces.collected import GROUND, Collected, CollisionBody
from flexfem.contact.surfaces.shapes import shape_mesh, simple_shapes
from flexfem.core.marker import Ground, Marker
from flexfem.layout.node_key import NodeKey
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.mesh.surface_mesh import SurfaceMesh
from flexfem.model.bodies.basic import RigidBody
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.bodies.shapes import Capsule, Sphere
from flexfem.model.rigid_surface import (
    RigidCylinder,
    RigidMesh,
    RigidObstacle,
    RigidSphere,
    RigidSurface,
)

__all__ = ["DistanceField", "add_rigid_body", "add_surface"]

#: Where long cylinders end, in parts of the distance of the model.
_FAR = 1000.0


@dataclass(frozen=True)
class DistanceField:
    """A rigid surface that stations touch by its signed distance.

    It is carried by four points: its origin, and one on each axis at the distance ``size``.

    Attributes:
        surface: of the model: a cylinder with ends, a hollow surface, or a signed distance.
        body: its number.
        points: (4,) rows of its points.
        size: of the surface, m.
        fixed: True on the ground.
    """

    surface: RigidSurface
    body: int
    points: IntArray
    size: float
    fixed: bool


@dataclass(frozen=True)
class _Carrier:
    """A node or the ground, with the place of a thing on it."""

    key: NodeKey | None
    base: FloatArray
    frame: FloatArray

    @classmethod
    def of(cls, serial: NumberedModel, place: Marker | Ground) -> "_Carrier":
        """Carrier of a marker."""
        frame = serial.marker_frame(place)
        if isinstance(place, Ground):
            return cls(None, se3.frame(np.zeros(3), np.eye(3)), frame)
        return cls(serial.key(place), serial.carrier_frame(place), frame)

    @property
    def start(self) -> FloatArray:
        """Frame (12,) of the thing at the start."""
        return se3.compose(self.base, self.frame)

    def add(self, made: Collected, points: FloatArray) -> IntArray:
        """Add points (n, 3) in the axes of the thing; returns their numbers."""
        arms = se3.position(self.frame) + points @ se3.rotation(self.frame).T
        start = se3.position(self.base) + arms @ se3.rotation(self.base).T
        if self.key is None:
            return made.fixed(GROUND, np.arange(len(points)), start)
        kind, node = self.key
        return made.fixed(kind, np.full(len(points), node), start, arms)


def add_rigid_body(made: Collected, serial: NumberedModel, name: str) -> int:
    """Add the shape of a rigid body; returns the number of the body.

    Raises:
        ValueError: the triangles of its shape make no mesh.
    """
    body: RigidBody = serial.model[name]
    assert body.shape is not None
    owner = f'RigidBody "{name}"'
    parts = simple_shapes(body.shape)
    meshes = [
        None if isinstance(shape, (Sphere, Capsule)) else shape_mesh(owner, shape)
        for shape, _ in parts
    ]
    area = sum(float(mesh.areas.sum()) for mesh in meshes if mesh is not None)
    area += sum(_shadow(shape) for shape, _ in parts if isinstance(shape, (Sphere, Capsule)))
    number = made.body(CollisionBody(owner, name, False, True, np.inf, body.mass / area))
    for (shape, pose), mesh in zip(parts, meshes, strict=True):
        place = Marker(name, offset=pose.position, rotation=body.rotation @ pose.rotation)
        carrier = _Carrier.of(serial, place)
        if mesh is not None:
            _add_mesh(made, carrier, number, mesh)
        elif isinstance(shape, Sphere):
            _add_sphere(made, carrier, number, shape.radius)
        elif isinstance(shape, Capsule):
            rows = carrier.add(made, shape.ends)
            made.touching(rows, shape.radius, number, np.full(2, 0.5 * _shadow(shape)))
            made.edges(rows[np.newaxis], number)
    return number


def add_surface(
    made: Collected, serial: NumberedModel, surface: RigidSurface, label: str
) -> tuple[int, DistanceField | None]:
    """Add a rigid surface; returns the number of its body, and the field if it is one."""
    carrier = _Carrier.of(serial, surface.place)
    owner = "" if isinstance(surface.place, Ground) else surface.place.body
    mesh = surface.mesh if isinstance(surface, RigidMesh) else None
    ball = surface if isinstance(surface, RigidSphere) and not surface.inside else None
    body = serial.model.get(owner)
    mass = body.mass if isinstance(body, (RigidBody, FloatingBody)) else np.inf
    area = np.inf
    if mesh is not None:
        area = float(mesh.areas.sum())
    elif ball is not None:
        area = _shadow(Sphere(ball.radius))
    density = mass / area if np.isfinite(area) else np.inf
    number = made.body(CollisionBody(label, owner, True, True, np.inf, density))
    if isinstance(surface, RigidMesh):
        _add_mesh(made, carrier, number, surface.mesh, 0 if surface.two_sided else 1)
    elif ball is not None:
        _add_sphere(made, carrier, number, ball.radius)
    elif isinstance(surface, RigidCylinder) and surface.length == np.inf and not surface.inside:
        _add_rod(made, carrier, number, surface.radius, _FAR * _extent(serial, carrier))
    else:
        size = _size(serial, surface, carrier)
        rows = carrier.add(made, size * np.eye(4)[:, 1:])
        return number, DistanceField(surface, number, rows, size, carrier.key is None)
    return number, None


def _size(serial: NumberedModel, surface: RigidSurface, carrier: _Carrier) -> float:
    """How far from its origin a surface acts, m."""
    if isinstance(surface, (RigidSphere, RigidCylinder)):
        return surface.radius
    if isinstance(surface, RigidObstacle):
        return float(np.abs(surface.box).max())
    return _extent(serial, carrier)


def _extent(serial: NumberedModel, carrier: _Carrier) -> float:
    """Largest distance of nodes from a surface at the start, m."""
    frames = [family.frames[:, :3] for family in serial.families.values() if len(family.frames)]
    points = np.concatenate([np.zeros((0, 3)), *frames])
    away = np.linalg.norm(points - se3.position(carrier.start), axis=1)
    return float(away.max(initial=0.0)) or 1.0


def _add_rod(made: Collected, carrier: _Carrier, number: int, radius: float, half: float) -> None:
    """Add a cylinder whose ends are far away."""
    rows = carrier.add(made, half * np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]))
    made.touching(rows, radius, number, np.full(2, 2.0 * half * radius))
    made.edges(rows[np.newaxis], number)


def _shadow(shape: Sphere | Capsule) -> float:
    """Area of a sphere or rod as seen from the side, m^2."""
    length = shape.length if isinstance(shape, Capsule) else 0.0
    return shape.radius * (2.0 * length + np.pi * shape.radius)


def _add_sphere(made: Collected, carrier: _Carrier, number: int, radius: float) -> None:
    """Add a sphere, which is a point with a radius."""
    rows = carrier.add(made, np.zeros((1, 3)))
    made.touching(rows, radius, number, np.array([np.pi * radius**2]))


def _add_mesh(
    made: Collected, carrier: _Carrier, number: int, mesh: SurfaceMesh, side: int = 0
) -> None:
    """Add the triangles of a mesh."""
    rows = carrier.add(made, mesh.points)
    made.touching(rows, 0.0, number)
    made.triangles(rows[mesh.triangles], number, side=side)
