# SPDX-License-Identifier: LGPL-3.0-or-later
"""Floating frames and their coordinates.

The formalisms of Lagrange and Hamilton need true coordinates. In the plane they are the origin and
the angle. In space the orientation has Euler parameters (a, b, c, d), one more than it has degrees
of freedom: they are free of singular positions, and R is a polynomial of second degree in them,
which is cheap to differentiate. R is left without division by their norm: off the unit sphere it
also stretches, so that all four have inertia, which the Legendre transformation to momenta needs.
Their unit norm is a constraint like that of a joint.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexfem._types import FloatArray

__all__ = ["Frame", "PlanarFrame", "SpatialFrame"]

Expr = Any


@dataclass(frozen=True)
class PlanarFrame:
    """Frame that moves in the plane of the first two axes: coordinates x, y (m) and angle (rad)."""

    count = 3
    dimension = 2
    names = ("x", "y", "angle")
    #: constraints among the coordinates themselves
    constraints = 0

    def start(self, origin: FloatArray, rotation: FloatArray) -> FloatArray:
        """Coordinates of a position and a rotation matrix (3x3)."""
        angle = np.arctan2(rotation[1, 0], rotation[0, 0])
        return np.array([origin[0], origin[1], angle])

    def start_rates(
        self, coordinates: FloatArray, velocity: FloatArray, angular: FloatArray
    ) -> FloatArray:
        """Rates of the coordinates from velocities in inertial axes (3)."""
        return np.array([velocity[0], velocity[1], angular[2]])

    def rotation_matrix(self, coordinates: FloatArray) -> FloatArray:
        """The rotation (3x3) of numbers."""
        c, s = np.cos(coordinates[2]), np.sin(coordinates[2])
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def origin(self, coordinates: FloatArray) -> FloatArray:
        """The origin (3) of numbers."""
        return np.array([coordinates[0], coordinates[1], 0.0])

    def place(self, g: Expr, local: Expr) -> Expr:
        """Position in UFL of a point with local coordinates, two or three."""
        import ufl

        origin = [g[0], g[1], 0.0][: local.ufl_shape[0]]
        return ufl.as_vector(origin) + self.turn(g, local)

    def turn(self, g: Expr, local: Expr) -> Expr:
        """A local vector of two or three components in inertial axes, in UFL."""
        import ufl

        c, s = ufl.cos(g[2]), ufl.sin(g[2])
        if local.ufl_shape[0] == 2:
            return ufl.as_matrix([[c, -s], [s, c]]) * local
        return ufl.as_matrix([[c, -s, 0], [s, c, 0], [0, 0, 1]]) * local

    def norm(self, g: Expr) -> list[Expr]:
        """Constraints among the coordinates: none."""
        return []

    def projected(self, coordinates: FloatArray) -> FloatArray:
        """The coordinates themselves."""
        return coordinates


@dataclass(frozen=True)
class SpatialFrame:
    """Frame in space: coordinates x, y, z (m) and Euler parameters a, b, c, d of unit norm."""

    count = 7
    dimension = 3
    names = ("x", "y", "z", "a", "b", "c", "d")
    constraints = 1

    def start(self, origin: FloatArray, rotation: FloatArray) -> FloatArray:
        """Coordinates of a position and a rotation matrix (3x3)."""
        # the eigenvector of Bar-Itzhack's matrix (2000) for any rotation, without branches
        R = rotation
        K = np.empty((4, 4))
        K[0, 0] = np.trace(R)
        K[1:, 1:] = R + R.T - np.trace(R) * np.eye(3)
        K[0, 1:] = K[1:, 0] = [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]
        p = np.linalg.eigh(K)[1][:, -1]
        return np.concatenate([origin, p if p[np.argmax(np.abs(p))] > 0.0 else -p])

    def start_rates(
        self, coordinates: FloatArray, velocity: FloatArray, angular: FloatArray
    ) -> FloatArray:
        """Rates of the coordinates from velocities in inertial axes (3)."""
        a, v = coordinates[3], coordinates[4:]
        rates = np.concatenate([[-angular @ v], a * angular + np.cross(angular, v)])
        return np.concatenate([velocity, 0.5 * rates])

    def rotation_matrix(self, coordinates: FloatArray) -> FloatArray:
        """The rotation (3x3) of numbers."""
        a, b, c, d = coordinates[3:]
        return np.array(_rotation(a, b, c, d))

    def origin(self, coordinates: FloatArray) -> FloatArray:
        """The origin (3) of numbers."""
        return coordinates[:3].copy()

    def place(self, g: Expr, local: Expr) -> Expr:
        """Position in UFL of a point with local coordinates, two or three."""
        import ufl

        return ufl.as_vector([g[0], g[1], g[2]]) + self.turn(g, local)

    def turn(self, g: Expr, local: Expr) -> Expr:
        """A local vector of two or three components in inertial axes, in UFL."""
        import ufl

        R = ufl.as_matrix(_rotation(g[3], g[4], g[5], g[6]))
        parts = [local[i] for i in range(local.ufl_shape[0])]
        return R * ufl.as_vector(parts + [0.0] * (3 - len(parts)))

    def norm(self, g: Expr) -> list[Expr]:
        """Constraints among the coordinates: the unit norm of the Euler parameters."""
        return [0.5 * (g[3] * g[3] + g[4] * g[4] + g[5] * g[5] + g[6] * g[6] - 1.0)]

    def projected(self, coordinates: FloatArray) -> FloatArray:
        """The coordinates with Euler parameters scaled to unit norm."""
        scaled = coordinates.copy()
        scaled[3:] /= np.linalg.norm(scaled[3:])
        return scaled


Frame = PlanarFrame | SpatialFrame


def _rotation(a: Expr, b: Expr, c: Expr, d: Expr) -> list[list[Expr]]:
    """Rows of the rotation of Euler parameters, homogeneous of second degree in them."""
    return [
        [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
        [2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)],
        [2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d],
    ]
