# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops around calls of users' laws of the motion of markers."""

from flexfem._types import FloatArray
from flexfem.kernels.compiled import inlined, kernel

__all__ = ["inertial_motion", "wrench_components"]


@inlined
def _rotated(rotations: FloatArray, k: int, i: int, x: float, y: float, z: float) -> float:
    """Component i in inertial axes of a vector in the axes of marker k."""
    R, at = rotations[k], 3 * i
    found: float = R[at] * x + R[at + 1] * y + R[at + 2] * z
    return found


@kernel
def inertial_motion(
    poses: FloatArray, twists: FloatArray, positions: FloatArray, rotations: FloatArray,
    velocities: FloatArray,
) -> None:  # fmt: skip
    """Motion of m markers in inertial axes.

    Args:
        poses: (m, 12) position and rotation of the markers.
        twists: (m, 6) local.
        positions: (m, 3) becomes their positions.
        rotations: (m, 9) becomes their rotations, row by row.
        velocities: (2, m, 3) becomes velocities and angular velocities.
    """
    for k in range(poses.shape[0]):
        for i in range(9):
            rotations[k, i] = poses[k, 3 + i]
        for i in range(3):
            positions[k, i] = poses[k, i]
            for part in range(2):
                x, y, z = twists[k, 3 * part], twists[k, 3 * part + 1], twists[k, 3 * part + 2]
                velocities[part, k, i] = _rotated(rotations, k, i, x, y, z)


@kernel
def wrench_components(wrenches: FloatArray, rotations: FloatArray) -> None:
    """Replace vectors ``f`` in inertial axes by components of rows, ``-R^T f``.

    Args:
        wrenches: (m, kinds, 3) forces, and moments if there are any.
        rotations: (m, 3, 3) axes of the markers.
    """
    for k in range(wrenches.shape[0]):
        for kind in range(wrenches.shape[1]):
            vector = wrenches[k, kind]
            x, y, z = vector[0], vector[1], vector[2]
            for j in range(3):
                vector[j] = -(
                    rotations[k, 0, j] * x + rotations[k, 1, j] * y + rotations[k, 2, j] * z
                )
