# SPDX-License-Identifier: LGPL-3.0-or-later
"""Why a computation failed, where the model's own functions are to blame."""

from collections.abc import Iterable

import numpy as np

from flexfem.system.assembly import Assembly
from flexfem.system.connect import joint_ends

__all__ = ["not_finite"]


def not_finite(serial: Assembly, times: Iterable[float]) -> str | None:
    """The first drive or load that is not a number at one of the times; None if all are."""
    times = list(times)
    for joint in serial.joints:
        if joint.driven:
            poses = joint_ends(serial, joint).poses
            targets = [row.target for t in times for row in joint.rows(poses, t)]
            if not np.isfinite(targets).all():
                return f"{joint.owner}: the motion is not finite"
    for load in serial.model.loads:
        if not np.isfinite([load.factor(t) for t in times]).all():
            return f'{type(load).__name__} "{load.name}": the amplitude is not finite'
    return None
