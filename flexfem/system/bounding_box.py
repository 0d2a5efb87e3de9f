# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bounding box of a model, and its diagonal."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.constraints.connect import all_ends
from flexfem.layout.numbered_model import NumberedModel

__all__ = ["diagonal", "model_box", "model_extent"]


def model_box(serial: NumberedModel) -> FloatArray:
    """Lowest and highest coordinates (2, 3) of nodes, bodies and markers of joints at the start."""
    poses = [pose.position for ends in all_ends(serial) for pose in ends.poses]
    every = np.concatenate([np.array(poses).reshape(-1, 3), serial.points])
    if not len(every):
        return np.zeros((2, 3))
    box: FloatArray = np.stack([every.min(axis=0), every.max(axis=0)])
    return box


def diagonal(box: FloatArray) -> float:
    """Diagonal of a box (2, 3), m; 1 m for a point."""
    low, high = box
    return float(np.linalg.norm(high - low)) or 1.0


def model_extent(serial: NumberedModel) -> float:
    """Diagonal of the box about all nodes, bodies and markers of joints at the start, m."""
    return diagonal(model_box(serial))
