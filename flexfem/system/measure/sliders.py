# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sections of carriers at sliders, for probes and events."""

from collections.abc import Sequence

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.marker import Observed, SlidingMarker
from flexfem.system.system import System

__all__ = ["Sliders"]


class Sliders:
    """Sliding markers whose joints this rank owns.

    Attributes:
        places: (n,) their numbers among the given markers.
        exist: True if there are sliding markers, here or on other ranks.
    """

    def __init__(self, system: System, markers: Sequence[Observed]) -> None:
        """Find the joints on this rank."""
        self._rows = system.constraints
        joints = {j.joint.name: i for i, j in enumerate(self._rows.joints) if j.owned}
        found = [(k, m.joint) for k, m in enumerate(markers) if isinstance(m, SlidingMarker)]
        mine = [(k, joints[name]) for k, name in found if name in joints]
        self.exist = bool(found)
        self.places: IntArray = np.array([k for k, _ in mine], dtype=np.int64)
        self._joints = [joint for _, joint in mine]

    def motion(self) -> FloatArray:
        """(n, 20) frames, local twists, arc lengths and their rates at the interface's state."""
        face = self._rows.interface
        return self._rows.lines.motions(self._joints, face.frames, face.velocities)
