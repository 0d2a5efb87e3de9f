# SPDX-License-Identifier: LGPL-3.0-or-later
"""Explicit forces that alternate from step to step and grow: too stiff for the steps.

A force that follows the motion of the last step overshoots where its gains are large for the
inertia that it acts on. It changes its direction in every step then, by more each time.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.simulation.control.controls import Controls
from flexfem.system.system import System

__all__ = ["AlternatingForces"]

#: Changes of alternating sign, and their growth, that are no coincidence: few that grow fast, or
#: many.
_FAST, _SLOW = (3, 10.0), (8, 1.5)
#: Size of a change over the one before with which it still alternates.
_PERSISTS = 0.8
#: Least change over the largest force: above round-off, and of one that matters.
_LEAST, _MATTERS = 1e-6, 0.1


class AlternatingForces:
    """Monitor of outputs of explicit controllers, and of forces with ``every="step"``."""

    def __init__(self, system: System, controls: Controls) -> None:
        """Read the start."""
        self._system, self._controls = system, controls
        elements = system.constraints.elements
        self._groups = [group for group in elements.groups if group.law.explicit]
        self._names = [
            *controls.explicit,
            *(group.law.owner for group in self._groups for _ in group.held.ravel()),
        ]
        count = len(self._names)
        self._last, self._change, self._first = np.zeros((3, count))
        self._run, self._largest = np.zeros(count, dtype=np.int64), np.zeros(count)
        self._found: tuple[float, str] | None = None
        if count:
            self._last = self._values()

    def step(self) -> None:
        """Look at the accepted state."""
        if not self._names:
            return
        values = self._values()
        change, self._last = values - self._last, values
        self._largest = np.maximum(self._largest, np.abs(values))
        moved = np.abs(change) > _LEAST * self._largest
        persists = np.abs(change) > _PERSISTS * np.abs(self._change)
        turned = moved & persists & (change * self._change < 0.0)
        begun = moved & ~turned
        self._run[turned] += 1
        self._run[begun], self._first[begun] = 0, np.abs(change[begun])
        self._change = np.where(moved, change, self._change)
        growth = np.abs(self._change) / np.where(self._first > 0.0, self._first, np.inf)
        large, bad = np.abs(self._change) > _MATTERS * self._largest, np.zeros_like(moved)
        for count, least in (_FAST, _SLOW):
            bad |= large & (self._run >= count - 1) & (growth > least)
        if self._found is None and bad.any():
            self._found = self._system.time, self._names[int(np.argmax(bad))]

    def _values(self) -> FloatArray:
        """Outputs of controllers and explicit forces at the accepted state."""
        own = [self._controls.explicit_outputs(self._system.time)]
        return np.concatenate([*own, *(group.held.ravel() for group in self._groups)])

    def texts(self) -> list[str]:
        """Warnings, the same on every rank (collective)."""
        every = [one for one in self._system.comm.allgather(self._found) if one is not None]
        if not every:
            return []
        t, name = min(every)
        return [
            f"{name}: its force alternates from step to step and grows (at t = {t:.4g}), since it "
            "follows the motion of the last step and acts on little inertia; use smaller steps, "
            'or one that acts implicitly: a continuous law of markers, a Force with "iteration"'
        ]
