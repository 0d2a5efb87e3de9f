# SPDX-License-Identifier: LGPL-3.0-or-later
"""Taut cables whose end is pulled through an eyelet in a run.

A straight part as short as nothing has no direction: behind it the cable pulls back, and a body
that is hauled in too far swings about its guide, stretching the cable by what is missing. A real
one would stop there.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.joints.cable import Cable
from flexfem.joints.cable_guides import Eyelet, Sheave
from flexfem.joints.cable_path import neighbours
from flexfem.simulation.watch.gathering import gathered
from flexfem.system.system import System

__all__ = ["PassageWatch"]


class PassageWatch:
    """Straight parts beside eyelets of the cables of this rank, at the accepted states of a run."""

    def __init__(self, system: System) -> None:
        """Find them."""
        self._system = system
        rows = system.constraints
        self._cables: list[tuple[int, str, IntArray]] = []
        found: list[list[int]] = []  # cable here, both guides, both markers
        for i, placed in enumerate(rows.joints):
            cable = placed.joint
            if not (placed.owned and isinstance(cable, Cable)):
                continue
            path, first, here = cable.path, int(rows.marker_start[i]), len(self._cables)
            parts = int(rows.start[i]) + np.array(cable.part_rows, dtype=np.int64)
            self._cables.append((placed.index, cable.owner, parts))
            for ends in neighbours(len(path), cable.closed):
                pair = [path[end] for end in ends]
                points = not any(isinstance(guide, Sheave) for guide in pair)
                if points and any(isinstance(guide, Eyelet) for guide in pair):
                    found.append([here, *ends, *(first + end for end in ends)])
        table = np.array(found, dtype=np.int64).reshape(-1, 5)
        self._place, self._ends = table[:, :3], table[:, 3:]
        self._turned: dict[int, tuple[int, int, float]] = {}
        self._last = self._lines()

    def _lines(self) -> FloatArray:
        """Vectors (k, 3) of the straight parts, m."""
        places = self._system.constraints.poses[:, :3]
        found: FloatArray = places[self._ends[:, 1]] - places[self._ends[:, 0]]
        return found

    def look(self) -> None:
        """Look at the accepted state of this rank."""
        if not len(self._ends):
            return
        lines = self._lines()
        turned = np.einsum("ki,ki->k", lines, self._last) < 0.0
        # one that has no direction keeps the last one
        self._last = np.where(lines.any(axis=1, keepdims=True), lines, self._last)
        if not turned.any():
            return
        rows = self._system.constraints
        for n in np.flatnonzero(turned).tolist():
            cable, first, last = self._place[n].tolist()
            parts = self._cables[cable][2]
            if np.any(rows.forces[parts] + rows.impulses[parts]):  # it is not slack
                self._turned.setdefault(cable, (first, last, self._system.time))

    def texts(self) -> list[str]:
        """Warnings, the same on every rank (collective)."""
        own = {}
        for cable, (first, last, t) in self._turned.items():
            index, owner, _ = self._cables[cable]
            own[index] = (
                f"{owner}: from path[{first}] to path[{last}] it turns round in the step to "
                f"t = {t:.6g}, as where a body is pulled through an eyelet, which does not stop "
                "it; let the winch end before, or use smaller steps"
            )
        return gathered(self._system.comm, own)
