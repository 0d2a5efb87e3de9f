# SPDX-License-Identifier: LGPL-3.0-or-later
"""Position and orientation of a frame in the inertial frame."""

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import ZERO, Array, ArrayOrNone, declared, rotation, vector
from flexfem._types import FloatArray


@declared
class Pose:
    """Frame H = (x, R) in the inertial frame.

    Attributes:
        position: Origin x of the frame in inertial axes, shape (3,), metres.
        rotation: Matrix R that maps components in the frame to inertial ones, shape (3, 3); the
            identity when None.

    Raises:
        TypeError: An argument does not consist of numbers.
        ValueError: An argument has the wrong shape, is not finite or not a rotation.
    """

    position: Array = vector(default=ZERO)
    rotation: ArrayOrNone = rotation(default=None)

    def __matmul__(self, other: "Pose") -> "Pose":
        """Return the pose of `other`, which is given relative to this one: H_self H_other."""
        return Pose(self.position + self.rotation @ other.position, self.rotation @ other.rotation)

    def inverse(self) -> "Pose":
        """Return the inverse frame (-R^T x, R^T)."""
        return Pose(-self.rotation.T @ self.position, self.rotation.T)

    def apply(self, points: npt.ArrayLike) -> FloatArray:
        """Map points given in this frame to the inertial frame.

        Args:
            points: Components in this frame, shape (..., 3), metres.

        Returns:
            Inertial positions of the same shape.
        """
        result: FloatArray = self.position + np.asarray(points, dtype=np.float64) @ self.rotation.T
        return result


def computed_poses(frames: FloatArray) -> list[Pose]:
    """Return the poses of many frames (n, 12), products of checked ones, see :class:`Pose`.

    Rotation matrices are made orthonormal as those that are given.
    """
    matrices = _checks.orthonormal(frames[:, 3:].reshape(-1, 3, 3))
    positions = _checks.freeze(frames[:, :3])
    poses = []
    for position, matrix in zip(positions, matrices, strict=True):
        pose = object.__new__(Pose)
        _checks.assign(pose, position=position, rotation=matrix)
        poses.append(pose)
    return poses
