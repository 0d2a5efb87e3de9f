# SPDX-License-Identifier: LGPL-3.0-or-later
"""Times of events, which depend on the motion and on parameters.

A step that ends at an event has the size h for which the event's function g is zero at its end, and
the next one has another size: with the changes D of its end by h, that of the time of the loads
included, ``dh = -(g_x dx + g_p dp)/(g_x D + g_t)``, where dx is the change of the end with given h.
Backwards, with the sums xb of influences of the end of the step and tb of those of its time,

``xb -= k g_x`` and a gradient loses ``k g_p``, with ``k = (xb D + tb)/(g_x D + g_t)``

(compare Corner, Sandu, Sandu, ACM Trans. Math. Softw. 46 (2020) 13, on jumps of adjoints at
events). The equations of a step depend on its time by loads and drives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.core.differences import STENCIL
from flexfem.gradients.equations.step_tangent import joined
from flexfem.gradients.equations.values import Equations
from flexfem.gradients.motion.adjoint import Adjoint, Tangent
from flexfem.gradients.motion.columns import ColumnDerivatives, Seeds
from flexfem.gradients.motion.direct import columns_of
from flexfem.gradients.motion.trajectory import Motion
from flexfem.gradients.schemes.base import Recursion, SizeChange
from flexfem.model.model import Model
from flexfem.model.probes.base import Probe
from flexfem.system.measure.probes import ProbeRecorder

__all__ = ["EventTimes", "along", "by_time"]

#: Weights of differences of third order from one side.
_ONE_SIDE = (-11.0 / 6.0, 3.0, -1.5, 1.0 / 3.0)
#: Differences of times, as parts of ``dt``, the longest first.
_TIMES = 1e-2, 1e-3, 1e-4
#: Relative difference of derivatives from both sides, up to which there is no kink between.
_SMOOTH = 1e-4
#: Rounding of equations, relative to what they consist of.
_ROUNDED = 1e-12
#: Part of the terms of the rate of an event's function below which it is zero.
_GRAZING = 1e-9


class _Functions:
    """Functions of the events of a motion, and their derivatives at accepted states."""

    def __init__(self, motion: Motion) -> None:
        """Find their markers."""
        self._motion = motion
        self.system, self.times = motion.system, motion.times
        self._model = copy(motion.model)
        self._model.probes = [
            Probe(event.name, event.markers, (f"event {k}",), _row_of(event.function))
            for k, event in enumerate(motion.model.events)
        ]
        serial = copy(motion.simulation.serial)
        serial.model = self._model
        self.recorder = ProbeRecorder(self.system, serial, depth=1)
        self.columns = self.recorder.columns
        self._derivatives: dict[int, ColumnDerivatives] = {}

    @property
    def model(self) -> Model:
        """A model whose probes are the functions."""
        return self._model

    @property
    def accepted(self) -> None:
        """None: functions of markers alone."""
        return None

    def seeds(self, state: int) -> Seeds:
        """Derivatives of the function of the event at a state by nodes (collective)."""
        number = self._motion.grid.events[state]
        if number not in self._derivatives:
            own = ColumnDerivatives(self, [self.columns[number]])
            self._derivatives[number] = own
        return self._derivatives[number].seeds(state, np.ones(1))

    def by_time(self, state: int) -> float:
        """Derivative of the function by time at a fixed motion, 1/s (collective)."""
        number, system = self._motion.grid.events[state], self.system
        step, total = _TIMES[0] * self._motion.options.dt, 0.0
        for place, weight in STENCIL:
            system.time = float(self.times[state]) + place * step
            values = self._motion.simulation.events.evaluate()
            total += weight / step * float(values[number])
        system.time = float(self.times[state])
        return total


def _row_of(function: Callable[..., float]) -> Callable[..., Sequence[float]]:
    """A function of a probe of a function of an event."""
    return lambda t, *states: (function(t, *states),)


@dataclass(frozen=True)
class _Rates:
    """Derivatives of values by time.

    Attributes:
        step: of the differences, s.
        values: (7, ...) at times around that of a state.
        central: central differences.
        apart: differences from one side less those from the other one.
    """

    step: float
    values: FloatArray
    central: FloatArray
    apart: FloatArray


def _rates(motion: Motion, at: Callable[[float], FloatArray]) -> Iterator[_Rates]:
    """Derivatives by the time (s) after that of a state, over shorter and shorter times."""
    one_side = np.array(_ONE_SIDE)
    for part in _TIMES:
        step = part * motion.options.dt
        values = np.array([at(k * step) for k in range(-3, 4)])
        central = np.array([w for _, w in STENCIL]) @ values[[1, 2, 4, 5]] / step
        yield _Rates(step, values, central, one_side @ (values[3:] + values[3::-1]) / step)


def by_time(motion: Motion, state: int) -> Equations:
    """Derivatives of the equations at the end of a step, or of a renewal, by time (collective).

    They are those of loads and drives. Differences are taken over times that are short enough to
    miss kinks and jumps nearby: those from both sides agree then.

    Raises:
        InputError: there is a kink at that time.
    """
    system = motion.system
    sizes = [part.block.owned_step.shape for part in system.parts]
    for own in _rates(motion, lambda later: joined(*_at(motion, state, later))):
        central = own.central
        apart, size, scale = motion.largest(own.apart, central, own.values)
        if apart <= max(_SMOOTH * size, _ROUNDED * max(scale, _largest_rate(motion)) / own.step):
            break
    else:
        raise InputError(
            f"gradient: an event happens at t = {motion.times[state]:.6g} s, at a kink of a load "
            "or drive, and its time has no derivative"
        )
    system.set_time(float(motion.times[state]))
    if motion.renewal is None:
        motion.scheme.at_time(state, 0.0)
    ends = np.cumsum([a * b for a, b in sizes])
    *blocks, rows = np.split(central, ends)
    return [own.reshape(size) for own, size in zip(blocks, sizes, strict=True)], rows


def _largest_rate(motion: Motion) -> float:
    """Largest velocity, acceleration or multiplier at the trial state (collective)."""
    blocks = [part.block for part in motion.system.parts]
    rates = [x for block in blocks for x in (block.velocity, block.acceleration)]
    return max(motion.largest(*rates, motion.system.constraints.multipliers))


def _at(motion: Motion, state: int, later: float) -> Equations:
    """The equations with loads and drives of a time (s) beside that of a state (collective)."""
    if motion.renewal is None:
        return motion.scheme.at_time(state, later)
    motion.system.set_time(float(motion.times[state]) + later)
    return motion.renewal.equations(motion.system)


class EventTimes:
    """Times of the events of a motion, and the steps whose sizes depend on them."""

    def __init__(self, motion: Motion) -> None:
        """Find the markers of all functions."""
        self._motion = motion
        self._functions = _Functions(motion) if motion.grid.events else None
        self._first = motion.system.comm.rank == 0

    def reach(self, state: int) -> None:
        """Differentiate the function of the event at a state (collective)."""
        assert self._functions is not None
        self._motion.go_to(state)
        self._seeds = self._functions.seeds(state)
        self._rate = self._functions.by_time(state)
        self._adjoint = Adjoint(self._motion)
        self._adjoint.add(self._seeds)

    def rates(self, state: int, columns: Sequence[str]) -> FloatArray:
        """Derivatives (columns,) of columns by time at a fixed state, on the first rank; else zero.

        They are zero where the time of the state is given (collective).

        Raises:
            InputError: there is a kink at that time.
        """
        motion = self._motion
        if not motion.grid.free(state):
            return np.zeros(len(columns))
        places = [motion.columns.index(name) for name in columns]
        motion.go_to(state)
        every, t, system = columns_of(motion), float(motion.times[state]), motion.system

        def at(later: float) -> FloatArray:
            system.set_time(t + later)
            return every([t + later])[0, places]

        for own in _rates(motion, at):
            size = np.abs(own.values).max(axis=0, initial=0.0)
            smooth = np.maximum(_SMOOTH * np.abs(own.central), _ROUNDED * size / own.step)
            if not system.comm.allreduce(bool((np.abs(own.apart) > smooth).any()), op=MPI.LOR):
                system.set_time(t)
                return own.central
        raise InputError(
            f"gradient: an event ends the motion at t = {t:.6g} s, at a kink of a column, which "
            "has no derivative there"
        )

    def size(self, over: Recursion) -> SizeChange | None:
        """What the size of a step changes, which is linearised at its end; None if it is given."""
        grid = self._motion.grid
        if not (grid.free(over.step) or grid.free(over.step - 1)):
            return None
        self._size = self._motion.scheme.size_change(over)
        return self._size

    def renew(self, state: int, adjoints: Sequence[Adjoint]) -> None:
        """Add influences of the time of a part of a renewal that adjoints have gone back over."""
        if self._motion.grid.free(state):
            changes = by_time(self._motion, state)
            for adjoint in adjoints:
                adjoint.time -= adjoint.times(changes)

    def renew_ahead(
        self, state: int, tangents: Sequence[Tangent], changes: Sequence[Equations]
    ) -> None:
        """Go over a part of a renewal, with the changes of its time (collective)."""
        renewal = self._motion.renewal
        assert renewal is not None
        own = by_time(self._motion, state) if self._motion.grid.free(state) else None
        for tangent, change in zip(tangents, changes, strict=True):
            total = change
            if own is not None:
                blocks = [a + tangent.time * b for a, b in zip(change[0], own[0], strict=True)]
                total = blocks, change[1] + tangent.time * own[1]
            tangent.renew(state, renewal, total)

    def back(self, over: Recursion, adjoints: Sequence[Adjoint]) -> FloatArray:
        """Complete adjoints that have gone back over a step with its size as given (collective).

        Returns:
            k of each, zero for a step that ends at no event.
        """
        factors = np.zeros(len(adjoints))
        if over.step in self._motion.grid.events:
            changes, own = by_time(self._motion, over.step), self._adjoint
            own.step(over, self._size)
            below = own.by_size - own.times(changes)
            for k, adjoint in enumerate(adjoints):
                above = adjoint.by_size - adjoint.times(changes) + adjoint.time
                factors[k] = self._quotient(above, below)
                adjoint.subtract(own, factors[k])
        free = self._motion.grid.free(over.step - 1)
        for adjoint in adjoints:
            adjoint.time = -adjoint.by_size if free else 0.0
        return factors

    def ahead(self, over: Recursion, tangents: Sequence[tuple[Tangent, float]]) -> None:
        """Change the times and ends of tangents that have done the step (collective).

        Args:
            over: the step, which is linearised at its end.
            tangents: with changes of the function by parameters.
        """
        motion = self._motion
        changed = tangents[0][0].like()
        changed.step(over, by_time(motion, over.step), (self._size, 1.0))
        motion.go_to(over.step)
        end = along(motion, self._seeds, changed)
        for tangent, change in tangents:
            own = along(motion, self._seeds, tangent) + (change if self._first else 0.0)
            tangent.time = -self._quotient(own, end)
            tangent.add(changed, tangent.time)

    def _quotient(self, above: float, below: float) -> float:
        """Over the rate of the function along the motion (collective).

        Raises:
            InputError: it touches zero.
        """
        motion, own = self._motion, self._rate if self._first else 0.0
        parts = motion.system.comm.allreduce(
            np.array([above, below + own, abs(below) + abs(own)]), op=MPI.SUM
        )
        if not abs(parts[1]) > _GRAZING * parts[2]:
            raise InputError(
                f"gradient: the function of an event touches zero at t = {motion.system.time:.6g} "
                "s, and its time has no derivative"
            )
        return float(parts[0] / parts[1])


def along(motion: Motion, seeds: Seeds, tangent: Tangent) -> float:
    """This rank's part of the change of a column by that of the state, at an accepted state."""
    one = Adjoint(motion)
    one.add(seeds)
    forces = float(one.forces @ (motion.system.constraints.owned * tangent.forces))
    return forces + sum(a.product(b) for a, b in zip(one.carried, tangent.carried, strict=True))
