# SPDX-License-Identifier: LGPL-3.0-or-later
"""Size of a model."""

import numpy as np

from flexfem.lie import se3
from flexfem.system.assembly import Assembly
from flexfem.system.connect import joint_ends

__all__ = ["model_extent"]


def model_extent(serial: Assembly) -> float:
    """Diagonal of the box about all nodes, bodies and markers of joints at the start, m."""
    joints = serial.joints
    poses = [pose.position for joint in joints for pose in joint_ends(serial, joint).poses]
    every = np.concatenate(
        [np.array(poses).reshape(-1, 3), se3.position(serial.rigid_frames), serial.nodes]
    )
    size = float(np.linalg.norm(np.ptp(every, axis=0))) if len(every) else 0.0
    return size or 1.0
