# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contacts of stops and slack springs that few steps resolve, where their forces are recorded.

The motion after such a contact has the right energy (``integrators.split``), but forces are means
over steps, less than the largest ones: by up to 10 % for half a wave of a sine in four steps.
"""

import numpy as np

from flexfem._types import IntArray
from flexfem.model.model import Model
from flexfem.model.probes.cable import CableProbe
from flexfem.model.probes.measured import ReactionProbe
from flexfem.simulation.watch.gathering import gathered
from flexfem.system.system import System

__all__ = ["BriefContacts"]

#: Number of steps that resolve the force of a contact.
_RESOLVED = 5


class BriefContacts:
    """Lengths of the contacts of recorded unilateral rows, in whole steps of a run."""

    def __init__(self, system: System, model: Model) -> None:
        """Find the recorded rows of this rank."""
        rows, self._system = system.constraints, system
        recorded = {p.joint for p in model.probes if isinstance(p, ReactionProbe)}
        recorded |= {p.cable for p in model.probes if isinstance(p, CableProbe)}
        asked = np.array([placed.joint.name in recorded for placed in rows.joints], dtype=np.bool_)
        chosen = rows.unilateral & (rows.owned > 0.0) & rows.split
        self._rows: IntArray = np.flatnonzero(chosen & asked[rows.joint_of_row]).astype(np.int64)
        self._steps = np.zeros(len(self._rows), dtype=np.int64)
        # number of brief contacts of each joint, and time at which the first one ended
        self._found: dict[int, tuple[int, float]] = {}

    def look(self) -> None:
        """Look at the accepted state of this rank."""
        if not len(self._rows):
            return
        rows, own = self._system.constraints, self._rows
        acting = (rows.forces[own] != 0.0) | (rows.impulses[own] != 0.0)
        brief = ~acting & (self._steps > 0) & (self._steps < _RESOLVED)
        self._steps = np.where(acting, self._steps + 1, 0)
        for joint in rows.joint_of_row[own[brief]].tolist():
            count, first = self._found.get(joint, (0, self._system.time))
            self._found[joint] = count + 1, first

    def texts(self) -> list[str]:
        """Warnings, the same on every rank (collective)."""
        joints = self._system.constraints.joints
        own = {
            joints[joint].index: _text(joints[joint].joint.owner, *found)
            for joint, found in self._found.items()
        }
        return gathered(self._system.comm, own)


def _text(owner: str, count: int, first: float) -> str:
    return (
        f"{owner}: contacts last less than {_RESOLVED} steps ({count} of them, from t = "
        f"{first:.4g} s on), whose recorded forces are means over steps, less than the largest "
        "ones; use a smaller dt for these"
    )
