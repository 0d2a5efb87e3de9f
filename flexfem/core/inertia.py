# SPDX-License-Identifier: LGPL-3.0-or-later
"""Inertia matrices of sets of sections or points."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.lie import se3

__all__ = ["inertia_about", "point_inertia"]


def inertia_about(
    origin: FloatArray, frames: FloatArray, inertia: FloatArray, weights: FloatArray | None = None
) -> FloatArray:
    """Sum of inertia matrices (6, 6) in frames (k, 12), times weights (k,), about a frame (12,)."""
    A = se3.adjoint(se3.inverse(se3.compose(se3.inverse(origin), frames)))
    w = np.ones(len(frames)) if weights is None else weights
    A = A.reshape(-1, 6)
    weighted = (inertia @ A.reshape(-1, 6, 6)) * w[:, np.newaxis, np.newaxis]
    total: FloatArray = A.T @ weighted.reshape(-1, 6)
    return total


def point_inertia(origin: FloatArray, points: FloatArray, masses: FloatArray) -> FloatArray:
    """Inertia matrix (6, 6) of masses (k,), kg, at points (k, 3), m, about a frame (12,)."""
    frames = se3.frame(points, np.broadcast_to(np.eye(3), (len(points), 3, 3)))
    return inertia_about(origin, frames, np.diag([1.0] * 3 + [0.0] * 3), masses)
