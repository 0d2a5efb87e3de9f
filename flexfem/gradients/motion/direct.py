# SPDX-License-Identifier: LGPL-3.0-or-later
"""What columns depend on a parameter by themselves: through markers, functions and measurements.

At a fixed state the columns of two models differ where an offset of a probe's marker, a number in
its function, or the stiffness behind a stress, is the parameter. Nodes whose start moves with the
parameter move by as much in the models, and this motion is subtracted by the exact derivatives of
the columns: strains between nodes that stay where they are while the shape changes would be much
larger than those of the motion.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from functools import cached_property, partial
from inspect import getclosurevars
from types import FunctionType

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.differences import differenced
from flexfem.core.marker import SlidingMarker
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.gradients.equations.node_maps import moved, start_moves
from flexfem.gradients.equations.values import copy_state
from flexfem.gradients.forces.accepted import hold_applied
from flexfem.gradients.motion.trajectory import Motion
from flexfem.gradients.unilateral.forces import recall_penalties
from flexfem.model.probes.aggregate import AggregateProbe
from flexfem.model.probes.base import AnyProbe, Probe
from flexfem.model.probes.cable import CableProbe
from flexfem.model.probes.measured import EnergyProbe, ReactionProbe
from flexfem.simulation.motion.stepping import Simulation
from flexfem.system.measure.aggregate import Aggregate
from flexfem.system.measure.energies import refresh_rows
from flexfem.system.measure.probes import ProbeRecorder
from flexfem.system.system import System

__all__ = ["DirectEffect", "columns_of", "disturb", "force_columns", "free_twists", "take_rows"]

#: Difference of columns, relative to their size, from which on they depend on the parameter.
_SEEN = 1e-13


class DirectEffect:
    """Columns of models that differ in a parameter, at the states of a motion.

    Attributes:
        present: True if they differ from those of the motion at a fixed state, or may do so:
            forces of joints depend on masses and drives at any time, and functions with other
            numbers inside may use them at some states alone.
    """

    def __init__(
        self, motion: Motion, others: Sequence[Simulation],
        weights: Sequence[float] = (1.0, -1.0),
    ) -> None:  # fmt: skip
        """Compare the columns at a state at random, at all times of steps (collective).

        The motion is at another state after it.

        Args:
            motion: the motion.
            others: starts of the models.
            weights: of their columns in :meth:`difference`.
        """
        self._motion, self._weights = motion, weights
        self._others = [_Columns(one, motion.wanted) for one in others]
        own = _Columns(motion.simulation, motion.wanted)
        parts = motion.system.parts
        self._moves = [
            [start_moves(a.block, b.block) for a, b in zip(parts, one.system.parts, strict=True)]
            for one in others
        ]
        self.present = own.forces or any(own.computed_otherwise(one) for one in self._others)
        if self.present:
            return
        motion.go_to(0)
        disturb(motion)
        still, inside = own.values(motion.times), own.inside()
        changes = [np.zeros(1)]
        for one, near in zip(self._others, self._values(motion.times), strict=True):
            changes += [_relative(still, near), _relative(inside, one.inside())]
        self.present = motion.largest(np.concatenate(changes))[0] > _SEEN
        motion.go_to(0)

    @cached_property
    def following(self) -> list[FloatArray]:
        """Weighted sums of local twists (n_owned, 6) of nodes to their starts in the models.

        Those of fixed unknowns are zero.
        """
        found = []
        for k, part in enumerate(self._motion.system.parts):
            pairs = zip(self._weights, self._moves, strict=True)
            found.append(free_twists(part.block, np.sum([w * own[k] for w, own in pairs], axis=0)))
        return found

    def difference(self, step: int, *, following: bool = True) -> FloatArray:
        """Weighted sums of the columns of the models, on the first rank (collective).

        Args:
            step: number of the step, at whose accepted state the system of the motion is.
            following: nodes follow their starts; False for a fixed state.
        """
        for one in self._others:
            if one.forces:
                take_rows(self._motion, one.simulation.system, step)
        values = self._values([self._motion.times[step]], step, following=following)
        found: FloatArray = np.nan_to_num(differenced(self._weights, [own[0] for own in values]))
        return found

    def _values(
        self, times: Sequence[float] | FloatArray, step: int = 0, *, following: bool = True
    ) -> Iterator[FloatArray]:
        """Columns of the models at some times and the present state, with nodes that may follow.

        Args:
            times: of the columns, s.
            step: number of the step after which the present state is.
            following: nodes follow their starts.
        """
        for one, moves in zip(self._others, self._moves, strict=True):
            system = one.simulation.system
            copy_state(self._motion.system, system)
            for part, other, by in zip(self._motion.system.parts, system.parts, moves, strict=True):
                frames = part.block.frames
                if following and by.any():
                    other.block.frames[:] = moved(frames, by, inertial=part.block.inertial)
            system.interface.update()
            system.constraints.reported = None
            for contacts in system.contacts:
                contacts.forget()
            if one.forces:
                # the models may have taken no step yet, whose stiffness energies need
                recall_penalties(self._motion.system, system, self._motion.state(step))
                refresh_rows(system)
            yield one.values(times)


def _relative(first: FloatArray, second: FloatArray) -> FloatArray:
    """Differences (n,) of finite values over their sizes."""
    size = np.maximum(np.abs(first), np.abs(second))
    both = np.isfinite(first) & np.isfinite(second) & (size > 0.0)
    found: FloatArray = np.abs(first - second)[both] / size[both]
    return found


def columns_of(motion: Motion) -> Callable[[Sequence[float]], FloatArray]:
    """The columns (n, columns) at the present state and some times, zero where not wanted.

    They are zero on other ranks than the first (collective).
    """
    columns = _Columns(motion.simulation, motion.wanted)
    return lambda times: np.nan_to_num(columns.values(times))


def free_twists(block: FrameBlock, by: FloatArray) -> FloatArray:
    """Twists (n_owned, 6) without fixed unknowns."""
    found = by[: block.owned].copy()
    found[:, block.width :] = 0.0
    found[:, : block.width] = block.hold(found[:, : block.width].copy())
    return found


class _Columns:
    """Columns of a model of which derivatives are wanted, NaN for the others.

    Attributes:
        forces: True if there are forces of joints among them.
    """

    def __init__(self, simulation: Simulation, wanted: Collection[str]) -> None:
        self.simulation = simulation
        self._recorder = ProbeRecorder(simulation.system, simulation.serial, depth=1)
        self._names = {
            probe.name
            for probe in simulation.serial.model.probes
            if not {*probe.differentiable}.isdisjoint(wanted)
        }
        self.forces = force_columns(simulation, wanted)

    def computed_otherwise(self, other: _Columns) -> bool:
        """True if a function of a probe is not that of another model, or has other numbers."""
        pairs = zip(self._functions(), other._functions(), strict=True)
        return not all(_alike(first, second) for first, second in pairs)

    def _functions(self) -> list[Callable[..., object]]:
        """Functions of the probes, in the order of the model."""
        probes = self.simulation.serial.model.probes
        return [
            probe.function
            for probe in probes
            if isinstance(probe, (Probe, AggregateProbe)) and probe.name in self._names
        ]

    def values(self, times: Sequence[float] | FloatArray) -> FloatArray:
        """All columns (n, columns) at the present state and some times (collective).

        They are zero on other ranks than the first.
        """
        states, at, found = self._recorder.states(), 0, []
        comm, sensors = self.simulation.system.comm, self._recorder.sensors
        for probe in self.simulation.serial.model.probes:
            own = np.zeros((len(times), len(probe.columns)))
            if probe.name not in self._names:
                own[:] = np.nan
            elif not isinstance(probe, Probe):
                shares = comm.reduce(sensors[probe.name].update())
                own[:] = 0.0 if shares is None else shares
            elif comm.rank == 0:
                seen = states[at : at + len(probe.markers)]
                own[:] = [probe.evaluate(t, seen) for t in times]
            at += len(probe.markers)
            found.append(own)
        return np.hstack(found) if found else np.zeros((len(times), 0))

    def inside(self) -> FloatArray:
        """Values (n,) of which columns are the largest, in the elements of this rank.

        At another state the largest one may be that of another element, and depend on others.
        """
        found = [np.empty(0)]
        for sensor in self._recorder.sensors.values():
            if isinstance(sensor, Aggregate):
                found += [part.values() for part in sensor.nodal]
        return np.concatenate(found)


def _alike(first: object, second: object) -> bool:
    """True if functions, or what is inside them, give the same for the same arguments."""
    if first is second:
        return True
    if type(first) is not type(second):
        return False
    if isinstance(first, partial) and isinstance(second, partial):
        inside = [(one.func, one.args, one.keywords) for one in (first, second)]
        return _alike(*inside)
    if isinstance(first, FunctionType) and isinstance(second, FunctionType):
        inside = [
            (one.__defaults__, one.__kwdefaults__, *getclosurevars(one).nonlocals.values())
            for one in (first, second)
        ]
        return first.__code__ == second.__code__ and _alike(*inside)
    if isinstance(first, (tuple, list)) and isinstance(second, (tuple, list)):
        pairs = zip(first, second, strict=False)
        return len(first) == len(second) and all(_alike(a, b) for a, b in pairs)
    if isinstance(first, dict) and isinstance(second, dict):
        return first.keys() == second.keys() and all(_alike(first[k], second[k]) for k in first)
    if isinstance(first, np.ndarray) and isinstance(second, np.ndarray):
        return np.array_equal(first, second)
    return isinstance(first, (int, float, str)) and first == second


def force_columns(simulation: Simulation, wanted: Collection[str]) -> bool:
    """True if some columns of a model depend on the rows of joints."""
    return any(
        _by_rows(probe) and not {*probe.columns}.isdisjoint(wanted)
        for probe in simulation.serial.model.probes
    )


def _by_rows(probe: AnyProbe) -> bool:
    """True if columns depend on the rows of joints, their times, or places on lines."""
    sliding = any(isinstance(marker, SlidingMarker) for marker in probe.markers)
    return sliding or isinstance(probe, (CableProbe, EnergyProbe, ReactionProbe))


def take_rows(motion: Motion, system: System, step: int) -> None:
    """Bring rows and loads of another model to the accepted state after a step (collective)."""
    state, rows, own = motion.state(step), system.constraints, motion.system.constraints
    rows.angles[:] = own.angles
    rows.lines.restore_places(state.rows["places"]["places"])
    rows.lines.angles[:] = own.lines.angles
    rows.active[:], rows.held[:], rows.forces[:] = own.active, own.held, own.forces
    rows.targets[own.held] = own.targets[own.held]
    rows.consistent, system.lead = own.consistent, motion.system.lead
    system.set_time(float(motion.times[step]))
    hold_applied(rows)


def disturb(motion: Motion) -> None:
    """Move the trial state at random, so that all forces change."""
    system = motion.system
    random = np.random.default_rng(1)
    for part in system.parts:
        block = part.block
        # the same on all ranks
        noise = random.standard_normal((block.size_global, 3, 6))[block.global_ids]
        block.step[:] = 0.0
        block.step[:, : block.width] = 1e-3 * noise[:, 0, : block.width]
        if block.dirichlet is not None:
            block.step[:, : block.width][block.dirichlet] = 0.0
        block.correct(1.0)
        block.velocity[:] = noise[:, 1]
        block.acceleration[:] = noise[:, 2]
    system.interface.update()
