# SPDX-License-Identifier: LGPL-3.0-or-later
"""Steps that are too long for the angular velocities at the start."""

from collections.abc import Iterator

import numpy as np

from flexfem.inspection.checks.velocities import drive_rates
from flexfem.inspection.finding import Finding, owner_of
from flexfem.inspection.inspection import Inspection

#: Rotation in a step, rad, beyond which integrators lose their accuracy: a twelfth of a turn.
_TURN = 0.5


def find(inspection: Inspection) -> Iterator[Finding]:
    """The fastest body or drive, if its rotation in a step is too large."""
    dt = getattr(inspection.options, "dt", None)
    if dt is None:
        return
    bodies = inspection.model.bodies
    turning = np.array([body.angular_velocity for body in bodies]).reshape(-1, 3)
    speeds = np.linalg.norm(turning, axis=1)
    fastest = int(np.argmax(speeds))
    spins = [(float(speeds[fastest]), owner_of(bodies[fastest]))]
    if inspection.rows.driven:
        driven = drive_rates(inspection) * inspection.turning
        for row in np.flatnonzero(driven):
            joint = inspection.rows.joints[inspection.rows.rows.joint_of_row[row]]
            spins.append((abs(float(driven[row])), joint.owner))
    spin, owner = max(spins)
    if spin * dt > _TURN:
        yield Finding(
            "steps", owner,
            f"it starts with {spin:.4g} rad/s, which is {spin * dt:.3g} rad in a step of "
            f"{dt:.3g} s",
            f"take steps of {0.1 / spin:.1g} s or less",
        )  # fmt: skip
