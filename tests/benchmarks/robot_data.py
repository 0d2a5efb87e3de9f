# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers of the arm of ``robot.py``, for all programs."""

import numpy as np

#: Origin of each joint before the motion, m; the last one is the tip of the rigid arm.
PLACES = np.array(
    [
        (0.0, 0.0, 0.0), (0.0, 0.0, 0.3), (0.0, 0.0, 0.9), (0.5, 0.0, 0.9), (0.6, 0.0, 0.9),
        (0.7, 0.0, 0.9), (0.8, 0.0, 0.9),
    ]
)  # fmt: skip
#: Axes of the joints then.
AXES = ((0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0))
#: Masses of the links, kg.
MASSES = (8.0, 10.0, 5.0, 2.0, 2.0, 0.5)
#: Gains, N m / rad and N m s / rad, and angles to be reached, rad, within a time, s.
STIFFNESS = (2000.0, 2000.0, 1000.0, 100.0, 100.0, 20.0)
DAMPING = (100.0, 100.0, 50.0, 5.0, 5.0, 1.0)
TARGETS, SPAN = (1.0, 0.6, -0.8, 0.7, 0.9, -1.2), 1.0


def inertia(k: int) -> float:
    """Moment of inertia of a link about all axes through its middle, kg m^2."""
    length = float(np.linalg.norm(PLACES[k + 1] - PLACES[k]))
    return float(MASSES[k] * (length**2 / 12.0 + 0.05**2))
