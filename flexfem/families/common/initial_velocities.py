# SPDX-License-Identifier: LGPL-3.0-or-later
"""Velocities of the nodes of a beam at the start."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.model.bodies.basic import Beam

__all__ = ["initial_velocities"]


def initial_velocities(beam: Beam, frames: FloatArray) -> FloatArray:
    """Local twists (n, 6) at the start of nodes with frames (n, 12): a rigid motion."""
    back = np.swapaxes(frames[:, 3:].reshape(-1, 3, 3), -1, -2)
    speed = beam.velocity + np.cross(beam.angular_velocity, frames[:, :3])
    local = np.einsum("nij,nj->ni", back, speed)
    return np.concatenate([local, back @ beam.angular_velocity], axis=1)
