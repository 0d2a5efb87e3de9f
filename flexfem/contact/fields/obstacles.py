# SPDX-License-Identifier: LGPL-3.0-or-later
"""Obstacles in their places, and closest points in their axes.

An obstacle is where its four points are: its origin, and one on each axis at the distance ``size``.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._faults import noted
from flexfem._types import FloatArray, IntArray
from flexfem.contact.fields.data import FieldPairs, FieldState
from flexfem.contact.fields.shapes import Distance, WrittenDistance, distance_of
from flexfem.contact.primitives.data import Pairs
from flexfem.contact.surfaces.rigid import DistanceField
from flexfem.kernels.compiled import kernel
from flexfem.lie import se3

__all__ = ["Obstacle", "Obstacles", "Placed", "arms_of", "weights_of"]

#: Step of differences of normals, in parts of the distance.
_DIFFERENCE = 1e-4


@dataclass(frozen=True)
class Placed:
    """Positions at one instant.

    Attributes:
        points: Positions of all points, shape (n, 3), metres.
        frames: Frames of all obstacles, shape (f, 12).
    """

    points: FloatArray
    frames: FloatArray


@dataclass(frozen=True)
class Obstacle:
    """An obstacle.

    Attributes:
        distance: its signed distance in its axes.
        points: (4,) rows of its points.
        size: of their distances from the first one, m.
        body: its number among the bodies.
        fixed: True if it lies on the ground.
    """

    distance: Distance
    points: IntArray
    size: float
    body: int = 0
    fixed: bool = False

    @classmethod
    def of(cls, field: DistanceField) -> "Obstacle":
        """The obstacle of a rigid surface of a model."""
        distance = distance_of(field.surface)
        return cls(distance, field.points, field.size, field.body, field.fixed)

    def frame(self, points: FloatArray) -> FloatArray:
        """Frame (12,) at positions (n, 3) of all points."""
        own = points[self.points]
        axes = (own[1:] - own[0]) / self.size
        return np.concatenate([own[0], axes.T.ravel()])


class Obstacles:
    """Some obstacles, in the order of the numbers of pairs.

    Attributes:
        every: the obstacles.
    """

    def __init__(self, every: Sequence[Obstacle]) -> None:
        """Store the obstacles."""
        self.every = tuple(every)
        self._sizes = np.array([one.size for one in every])

    def __len__(self) -> int:
        """Number of obstacles."""
        return len(self.every)

    @property
    def points(self) -> IntArray:
        """Rows (f, 4) of the points of all obstacles."""
        return np.array([one.points for one in self.every], dtype=np.int64).reshape(-1, 4)

    def placed(self, points: FloatArray) -> Placed:
        """Where they are at positions (n, 3) of all points."""
        return Placed(points, np.array([one.frame(points) for one in self.every]).reshape(-1, 12))

    def closest(
        self, numbers: IntArray, arms: FloatArray, reach: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Distances (k,) and closest points (k, 3) of the obstacles with some numbers (k,).

        Args:
            numbers: of the obstacles.
            arms: points (k, 3) in the axes of the obstacles, m; so are the closest points.
            reach: distances (k,), m, beyond which the distance may be any larger one, and the point
                NaN; None to find all.
        """
        distances, feet = np.empty(len(numbers)), np.empty((len(numbers), 3))
        for f, obstacle in enumerate(self.every):
            own = np.flatnonzero(numbers == f) if len(self.every) > 1 else slice(None)
            far = None if reach is None else reach[own]
            distances[own], feet[own] = obstacle.distance.closest(arms[own], far)
        return distances, feet

    def state(self, found: FieldPairs, at: Placed) -> FieldState:
        """Distances and closest points of pairs at some instant."""
        pairs, sizes = found.pairs, self._sizes[found.fields, np.newaxis]
        arms = arms_of(at.points[pairs.points[:, 0]], at.frames[found.fields])
        distance, feet = self.closest(found.fields, arms, pairs.touch + pairs.dhat)
        self._check(found, arms, distance, feet)
        return FieldState(
            points=np.ascontiguousarray(at.points), distance=distance,
            feet=weights_of(feet / sizes), places=weights_of(arms / sizes),
        )  # fmt: skip

    def state_of_copies(self, copies: Pairs, fields: IntArray, points: FloatArray) -> FieldState:
        """The same of pairs with obstacles of their own, copies of those of the numbers (m,).

        The obstacles are where the points (n, 3) of the pairs are.
        """
        origins, sizes = points[copies.points[:, 1]], self._sizes[fields, np.newaxis]
        axes = points[copies.points[:, 2:]] - origins[:, np.newaxis]
        turns = axes.swapaxes(1, 2) / sizes[:, np.newaxis]
        frames = np.concatenate([origins, turns.reshape(-1, 9)], axis=1)
        arms = arms_of(points[copies.points[:, 0]], frames)
        distance, feet = self.closest(fields, arms, copies.touch + copies.dhat)
        return FieldState(
            points=points, distance=distance, feet=weights_of(feet / sizes),
            places=weights_of(arms / sizes),
        )  # fmt: skip

    def _check(
        self, found: FieldPairs, arms: FloatArray, distance: FloatArray, feet: FloatArray
    ) -> None:
        """Note pairs that act although no way leads to the surface of a user's function."""
        reach = found.pairs.touch + found.pairs.dhat
        lost = np.isnan(feet[:, 0]) & (distance < reach)
        for row in np.flatnonzero(lost)[:1]:
            written = self.every[found.fields[row]].distance
            assert isinstance(written, WrittenDistance)
            surface = written.surface
            noted(surface.owner, surface.function, surface.lost(arms[row], distance[row]))

    def bends(self, found: FieldPairs, at: Placed, state: FieldState) -> FloatArray:
        """Second derivatives (m, 9) of the distances by inertial positions, 1/m; 0 if far away.

        They are central differences of the normals, and that of points fixed to the obstacle.
        """
        bends, pairs = np.zeros((found.count, 3, 3)), found.pairs
        near = np.flatnonzero(
            (state.distance < pairs.touch + pairs.dhat) & np.isfinite(state.feet).all(axis=1)
        )
        numbers = found.fields[near]
        frames = at.frames[numbers]
        arms = arms_of(at.points[pairs.points[near, 0]], frames)
        step = _DIFFERENCE * np.abs(state.distance[near])[:, None]
        for a in range(3):
            move = step * np.eye(3)[a]
            ends = [self._normals(numbers, arms + sign * move) for sign in (1.0, -1.0)]
            bends[near, :, a] = (ends[0] - ends[1]) / (2.0 * step)
        turns = se3.rotation(frames)
        local = 0.5 * (bends[near] + bends[near].swapaxes(1, 2))
        bends[near] = turns @ local @ turns.swapaxes(1, 2)
        return bends.reshape(-1, 9)

    def _normals(self, numbers: IntArray, arms: FloatArray) -> FloatArray:
        """Gradients (k, 3) of the distances at points in the axes of the obstacles."""
        distances, feet = self.closest(numbers, arms)
        normals: FloatArray = (arms - feet) / distances[:, None]
        return normals


def arms_of(points: FloatArray, frames: FloatArray) -> FloatArray:
    """Points (k, 3) in the axes of frames (k, 12)."""
    arms = np.empty(points.shape)
    _arms_into(points, np.ascontiguousarray(frames), arms)
    return arms


@kernel
def _arms_into(points: FloatArray, frames: FloatArray, arms: FloatArray) -> None:
    """Write the result of :func:`arms_of`."""
    for k in range(len(points)):
        for a in range(3):
            arms[k, a] = 0.0
            for b in range(3):
                arms[k, a] += frames[k, 3 + 3 * b + a] * (points[k, b] - frames[k, b])


def weights_of(arms: FloatArray) -> FloatArray:
    """Weights (k, 4) of the four points for places (k, 3) in parts of their distance."""
    return np.concatenate([1.0 - arms.sum(axis=1, keepdims=True), arms], axis=1)
