# SPDX-License-Identifier: LGPL-3.0-or-later
"""Progress along a path of equilibria: the contents of its checkpoints."""

from dataclasses import dataclass, field

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.state import State, counts
from flexfem.simulation.equilibria.path import CriticalPoint
from flexfem.solvers.statics.equilibrium import Equilibrium, Snapshot
from flexfem.system.system import System

__all__ = ["Followed"]

_KINDS = ("limit point", "bifurcation")


@dataclass
class Followed:
    """Load steps so far, and the accepted equilibrium from which the next one starts.

    Attributes:
        system, equilibrium: of the model.
        columns: names of those of the history.
        steps, rejected: accepted and rejected steps.
        largest: largest step tried.
        next: size of the next step; 0 before the first one.
        critical: points found so far.
    """

    system: System
    equilibrium: Equilibrium
    columns: list[str]
    steps: int = 0
    rejected: int = 0
    largest: float = 0.0
    next: float = 0.0
    critical: list[CriticalPoint] = field(default_factory=list)

    def state(self) -> State:
        """State on which the next step depends, and the results so far (collective)."""
        found = self.critical
        numbers = [
            [float(_KINDS.index(c.kind)), c.t, *map(float, c.unstable), *c.columns.values()]
            for c in found
        ]
        own = {
            "path": np.array([self.steps, self.rejected, self.largest, self.next], dtype=float),
            "critical": np.array(numbers) if found else np.zeros((0, 4 + len(self.columns))),
            "held": self.equilibrium.memory,
        }
        motions: dict[str, dict[str, FloatArray]] = {}
        for b, part in enumerate(self.system.parts):
            block = part.block
            motions[block.name] = {}
            for k, point in enumerate(found):
                whole = np.zeros((len(block.frames), 6))
                whole[: block.owned, : block.width] = point.motion[b]
                motions[block.name][f"critical_{k}"] = whole
        return State(own, motions) | self.system.state()

    def restore(self, state: State) -> None:
        """Restore a result of :meth:`state` (collective)."""
        self.steps, self.rejected = counts("path", state.values["path"][:2])
        self.largest, self.next = state.values["path"][2:].tolist()
        system, equilibrium = self.system, self.equilibrium
        equilibrium.memory = state.values["held"]
        system.restore(state)
        frames = [part.block.frames.copy() for part in system.parts]
        multipliers = system.constraints.forces * equilibrium.shifts.scale
        equilibrium.restore(Snapshot(frames, multipliers, float(state.values["time"][0])))
        for k, row in enumerate(state.values["critical"]):
            motion = []
            for part in system.parts:
                whole = state.rows[part.block.name][f"critical_{k}"]
                motion.append(whole[: part.block.owned, : part.block.width].copy())
            kind, before, after = counts("critical", row[[0, 2, 3]])
            values = dict(zip(self.columns, row[4:].tolist(), strict=False))
            self.critical.append(
                CriticalPoint(_KINDS[kind], float(row[1]), (before, after), values, motion)
            )
