# SPDX-License-Identifier: LGPL-3.0-or-later
"""What columns depend on a parameter by themselves: through markers and functions of their probes.

At a fixed state the columns of two models differ where an offset of a probe's marker, or a number
in its function, is the parameter.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from flexfem._types import FloatArray
from flexfem.gradients.equations.node_maps import fixed_apart
from flexfem.gradients.motion.trajectory import Motion
from flexfem.model.probes.base import Probe
from flexfem.simulation.motion.stepping import Simulation
from flexfem.system.measure.probes import ProbeRecorder
from flexfem.system.system import System

__all__ = ["DirectEffect", "copy_state", "disturb"]

#: Difference of columns, relative to their size, from which on they depend on the parameter.
_SEEN = 1e-13


class DirectEffect:
    """Columns of models that differ in a parameter, at the states of a motion.

    Attributes:
        present: True if they differ from those of the motion at a fixed state.
    """

    def __init__(self, motion: Motion, others: Sequence[Simulation]) -> None:
        """Compare the columns at a state at random, at all times of steps (collective).

        The motion is at another state after it.
        """
        self._motion = motion
        self._others = [_Columns(one) for one in others]
        own = _Columns(motion.simulation)
        motion.go_to(0)
        disturb(motion)
        still, change = own.values(motion.times), 0.0
        for moved in self._values(motion.times):
            size = np.maximum(np.abs(still), np.abs(moved))
            both = np.isfinite(still) & np.isfinite(moved) & (size > 0.0)
            apart = np.abs(still - moved)[both] / size[both]
            change = max(change, float(apart.max(initial=0.0)))
        self.present = motion.on_all_ranks(change) > _SEEN
        motion.go_to(0)

    def difference(self, step: int) -> FloatArray:
        """Columns of the first model less those of the second, on the first rank (collective).

        Args:
            step: number of the step, at whose accepted state the system of the motion is.
        """
        first, second = self._values([self._motion.times[step]])
        found: FloatArray = np.nan_to_num(first - second)[0]
        return found

    def _values(self, times: Sequence[float] | FloatArray) -> Iterator[FloatArray]:
        """Columns of the models at the present state and some times."""
        for one in self._others:
            copy_state(self._motion.system, one.simulation.system)
            yield one.values(times)


class _Columns:
    """Columns of the functions of markers of a model, NaN for the others."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self._recorder = ProbeRecorder(simulation.system, simulation.serial, depth=1)

    def values(self, times: Sequence[float] | FloatArray) -> FloatArray:
        """All columns (n, columns) at the present state and some times (collective).

        They are zero on other ranks than the first.
        """
        states, at, found = self._recorder.states(), 0, []
        for probe in self.simulation.serial.model.probes:
            own = np.zeros((len(times), len(probe.columns)))
            if not isinstance(probe, Probe):
                own[:] = np.nan
            elif self.simulation.system.comm.rank == 0:
                seen = states[at : at + len(probe.markers)]
                own[:] = [probe.evaluate(t, seen) for t in times]
                at += len(probe.markers)
            found.append(own)
        return np.hstack(found) if found else np.zeros((len(times), 0))


def copy_state(source: System, target: System) -> None:
    """Copy a trial state to another model, whose fixed unknowns stay at its own start."""
    for part, other in zip(source.parts, target.parts, strict=True):
        trial = other.block.trial()
        for name, values in part.block.trial().items():
            trial[name][:] = values
        if part.block.dirichlet is not None:
            other.block.frames[:] = fixed_apart(part.block, other.block)
    target.constraints.multipliers[:] = source.constraints.multipliers


def disturb(motion: Motion) -> None:
    """Move the trial state at random, so that all forces change."""
    system = motion.system
    random = np.random.default_rng(1)
    for part in system.parts:
        block = part.block
        # the same on all ranks
        noise = random.standard_normal((block.size_global, 3, 6))[block.global_ids]
        block.step[:] = 1e-3 * noise[:, 0]
        if block.dirichlet is not None:
            block.step[:, : block.width][block.dirichlet] = 0.0
        block.correct(1.0)
        block.velocity[:] = noise[:, 1]
        block.acceleration[:] = noise[:, 2]
    system.interface.update()
