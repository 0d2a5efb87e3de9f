# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of positions in triangles and over their patches, for the strains of membranes."""

import numpy as np

from flexfem._types import BoolArray, FloatArray

__all__ = ["plane_gradients", "smoothed_gradients"]


def plane_gradients(local: FloatArray) -> FloatArray:
    """Derivatives (m, 2, 3) of the linear shape functions of plane triangles (m, 3, 2)."""
    ends = np.roll(local, -2, 1) - np.roll(local, -1, 1)
    doubled = ends[:, 0, 0] * ends[:, 1, 1] - ends[:, 0, 1] * ends[:, 1, 0]
    gradients: FloatArray = np.stack([-ends[:, :, 1], ends[:, :, 0]], 1) / doubled[:, None, None]
    return gradients


def smoothed_gradients(local: FloatArray, around: FloatArray, present: BoolArray) -> FloatArray:
    """Maps (m, 2, 6) from positions to the mean of the derivatives at the three edges.

    At an edge they are the mean of those of both triangles, at one without neighbour those of the
    triangle. So a triangle also takes account of the change of the membrane around it.

    Args:
        local: corners (m, 3, 2).
        around: nodes opposite to the edges, rotated into the plane, (m, 3, 2).
        present: whether they exist, (m, 3).
    """
    own = plane_gradients(local)
    maps = np.zeros((len(local), 2, 6))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        # some node beyond the edge where there is none
        mirrored = local[:, i] + local[:, j] - local[:, k]
        beyond = np.where(present[:, k, None], around[:, k], mirrored)
        other = plane_gradients(np.stack([local[:, j], local[:, i], beyond], 1))
        part = np.where(present[:, k], 1 / 6, 0.0)[:, None]
        maps[:, :, :3] += (1 / 3 - part)[:, :, None] * own
        for n, column in enumerate((j, i, 3 + k)):
            maps[:, :, column] += part * other[:, :, n]
    return maps
