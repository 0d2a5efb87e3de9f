# SPDX-License-Identifier: LGPL-3.0-or-later
"""Obstacles on the ground and on carriers, and closest points in the axes of the carriers.

A carrier is a node of a rigid body, beam or floating body with a frame; that of what lies on the
ground is the identity. A place is fixed to its carrier by a relative frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._faults import noted
from flexfem._types import FloatArray, IntArray
from flexfem.contact.fields.data import FieldPairs, FieldState
from flexfem.contact.fields.shapes import Distance, WrittenDistance, distance_of
from flexfem.contact.surfaces.rigid import DistanceField
from flexfem.lie import se3

__all__ = ["Obstacle", "Obstacles", "Placed", "arms_of"]

#: Step of differences of normals, in parts of the distance.
_DIFFERENCE = 1e-4


@dataclass(frozen=True)
class Placed:
    """Positions at one instant.

    Attributes:
        points: Positions of all points, shape (n, 3), metres.
        frames: Frames of the carriers of all obstacles, shape (f, 12).
    """

    points: FloatArray
    frames: FloatArray


@dataclass(frozen=True)
class Obstacle:
    """An obstacle on a carrier.

    Attributes:
        distance: its signed distance in its own axes.
        frame: (12,) of these axes in those of the carrier, absolute on the ground.
        label: for messages.
    """

    distance: Distance
    frame: FloatArray
    label: str = "an obstacle"

    @classmethod
    def of(cls, field: DistanceField, label: str) -> "Obstacle":
        """The obstacle of a rigid surface of a model."""
        return cls(distance_of(field.surface), field.frame, label)

    def closest(self, arms: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distances (k,) and closest points (k, 3) of points (k, 3), all in the carrier's axes."""
        place, turn = se3.position(self.frame), se3.rotation(self.frame)
        distances, feet = self.distance.closest((arms - place) @ turn)
        return distances, place + feet @ turn.T

    def local(self, arms: FloatArray) -> FloatArray:
        """Points (k, 3) in the carrier's axes, in the own ones."""
        moved: FloatArray = (arms - se3.position(self.frame)) @ se3.rotation(self.frame)
        return moved


class Obstacles:
    """Some obstacles, in the order of the numbers of pairs.

    Attributes:
        every: the obstacles.
    """

    def __init__(self, every: Sequence[Obstacle]) -> None:
        """Store the obstacles."""
        self.every = tuple(every)

    def __len__(self) -> int:
        """Number of obstacles."""
        return len(self.every)

    def closest(self, numbers: IntArray, arms: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distances (k,) and closest points (k, 3) of the obstacles with some numbers (k,).

        Args:
            numbers: of the obstacles.
            arms: points (k, 3) in the axes of the carriers, m; so are the closest points.
        """
        distances, feet = np.empty(len(numbers)), np.empty((len(numbers), 3))
        for f, obstacle in enumerate(self.every):
            own = np.flatnonzero(numbers == f)
            if len(own):
                distances[own], feet[own] = obstacle.closest(arms[own])
        return distances, feet

    def state(self, pairs: FieldPairs, at: Placed) -> FieldState:
        """Distances and closest points of pairs at some instant."""
        arms = arms_of(at.points[pairs.points], at.frames[pairs.fields])
        distance, feet = self.closest(pairs.fields, arms)
        self._check(pairs, arms, distance, feet)
        return FieldState(
            points=np.ascontiguousarray(at.points), frames=np.ascontiguousarray(at.frames),
            distance=distance, arms=feet,
        )  # fmt: skip

    def _check(
        self, pairs: FieldPairs, arms: FloatArray, distance: FloatArray, feet: FloatArray
    ) -> None:
        """Note pairs that act although no way leads to the surface of a user's function."""
        lost = np.isnan(feet).any(axis=1) & (distance < pairs.touch + pairs.dhat)
        for row in np.flatnonzero(lost)[:1]:
            obstacle = self.every[pairs.fields[row]]
            assert isinstance(obstacle.distance, WrittenDistance)
            surface = obstacle.distance.surface
            error = surface.lost(obstacle.local(arms[[row]])[0], distance[row])
            noted(surface.owner, surface.function, error)

    def bends(self, pairs: FieldPairs, state: FieldState) -> FloatArray:
        """Second derivatives (m, 9) of the distances by inertial positions, 1/m; 0 if far away.

        They are central differences of the normals, and that of points fixed to the carrier.
        """
        bends = np.zeros((pairs.count, 3, 3))
        near = np.flatnonzero(
            (state.distance < pairs.touch + pairs.dhat) & np.isfinite(state.arms).all(axis=1)
        )
        frames, numbers = state.frames[pairs.fields[near]], pairs.fields[near]
        arms = arms_of(state.points[pairs.points[near]], frames)
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
        """Gradients (k, 3) of the distances at points in the axes of the carriers."""
        distances, feet = self.closest(numbers, arms)
        normals: FloatArray = (arms - feet) / distances[:, None]
        return normals


def arms_of(points: FloatArray, frames: FloatArray) -> FloatArray:
    """Points (k, 3) in the axes of frames (k, 12)."""
    arms: FloatArray = np.einsum("kba,kb->ka", se3.rotation(frames), points - se3.position(frames))
    return arms
