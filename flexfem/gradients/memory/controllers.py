# SPDX-License-Identifier: LGPL-3.0-or-later
"""What controllers carry from step to step: held outputs, states of laws, and measurements.

A sampled law carries its outputs, which act until the next sample, and its own state. A continuous
one that cannot act implicitly carries the measurements of the last two states, from which it is
called for the end of a step. Laws are differentiated by central differences of fourth order, which
are exact for linear ones; their outputs act linearly in the equations of a step.

Where steps depend on both of their ends, the force of an actuator is the mean of those there, and a
load is that of the middle of a step: outputs at its end are carried as well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._faults import FAILURES
from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.differences import central, suited_step
from flexfem.gradients.equations.step_tangent import BlockVectors
from flexfem.gradients.equations.values import Equations, equations_at, product
from flexfem.gradients.memory.base import Memory, StepEnd
from flexfem.gradients.renewals.grid import Grid
from flexfem.joints.actuator import Actuator
from flexfem.simulation.control.controls import ContinuousLoop, SampledLoop
from flexfem.simulation.motion.stepping import Simulation
from flexfem.system.system import System

__all__ = ["ControllerMemory", "recall"]

#: Differences of outputs, over their sizes or one: equations are linear in them.
_FAR = 1024.0
#: Relative error of differences from which on a law has no derivative, and deviation of results of
#: the same arguments.
_KINK, _AGAIN = 1e-5, 1e-12


class Controlled(Protocol):
    """A motion with controllers.

    Attributes:
        simulation: its simulation.
        times: of its states, s.
        known: state of the controllers after each step.
        grid: of all steps.
        alpha: True if outputs act at the end of each step alone.
    """

    simulation: Simulation
    times: FloatArray
    known: list[dict[str, FloatArray]]
    grid: Grid

    @property
    def system(self) -> System:
        """System of the simulation."""
        ...

    @property
    def alpha(self) -> bool:
        """See the class."""
        ...


@dataclass(frozen=True)
class _Loop:
    """A controller that carries s numbers, with p outputs and m measurements.

    Attributes:
        number: in the controls.
        inputs: (m,) numbers of its measurements there.
        places: (m,) in the measured columns of the memory.
        numbers: its place in the carried numbers.
        loads: (p,) outputs on loads, not on actuators.
    """

    number: int
    inputs: IntArray
    places: IntArray
    numbers: slice
    loads: BoolArray


@dataclass(frozen=True)
class _Linear:
    """Derivatives of a loop over a step.

    Attributes:
        outputs: (p, s) of those that act in it by the numbers before it.
        numbers: (s, s) of the numbers after it by those before it.
        columns: (s, m) by the measurements at its accepted state.
    """

    outputs: FloatArray
    numbers: FloatArray
    columns: FloatArray


class ControllerMemory(Memory):
    """Numbers of all controllers whose outputs follow accepted states, on the first rank."""

    def __init__(self, motion: Controlled) -> None:
        """Find them.

        Args:
            motion: at its start.
        """
        self._motion, self._comm = motion, motion.system.comm
        controls, model = motion.simulation.controls, motion.simulation.serial.model
        chosen = [(k, one) for k, one in enumerate(controls.loops) if not one.implicit]
        used = sorted({int(i) for k, _ in chosen for i in controls.inputs[k]})
        self.measured = [controls.measured[i] for i in used]
        self._loops, end = list[_Loop](), 0
        for k, _ in chosen:
            inputs, start = controls.inputs[k], end
            end += len(self._at_start(motion.simulation, k))
            driven = [model.get(name) for name in controls.loops[k].controller.outputs]
            loads = np.array([not isinstance(one, Actuator) for one in driven])
            places = np.searchsorted(used, inputs)
            self._loops.append(_Loop(k, inputs, places, slice(start, end), loads))
        self.owned = np.full(end if self._comm.rank == 0 else 0, True)
        self._known: tuple[int, list[_Linear]] = 0, []
        self._effects: list[Equations] = []

    def start(self, simulation: Simulation) -> FloatArray:
        """See :class:`Memory`."""
        if self._comm.rank:
            return np.zeros(0)
        return np.concatenate(
            [np.zeros(0), *(self._at_start(simulation, loop.number) for loop in self._loops)]
        )

    def _at_start(self, simulation: Simulation, number: int) -> FloatArray:
        """Numbers of a loop at the start."""
        one, found = simulation.controls.loops[number], list[FloatArray]()
        if isinstance(one, SampledLoop):
            found = [one.held, one.memory().ravel()]
        else:
            y = one.state()["last"][1:]
            found = [y, y]
        if not self._motion.alpha:
            found.append(one.outputs(simulation.time))
        return np.concatenate(found)

    def take(self, end: StepEnd) -> None:
        """See :class:`Memory`."""
        self._linear(end.number)
        system, controls = self._motion.system, self._motion.simulation.controls
        t, self._effects = float(self._motion.times[end.number]), []
        acts = t + system.lead  # beside a jump of loads

        def imposed(outputs: Mapping[int, FloatArray]) -> Equations:
            if end.imposed is not None:
                return end.imposed(outputs)
            for number, own in outputs.items():
                controls.loops[number].impose(acts, own)
            system.set_time(t)
            return equations_at(system, end.shifts, end.mechanics)

        for loop in self._loops:
            one = controls.loops[loop.number]
            given = one.outputs(acts)
            for j in range(one.count):
                by = _FAR * max(1.0, abs(float(given[j])))
                found = []
                for sign in (1.0, -1.0):
                    moved = given.copy()
                    moved[j] += sign * by
                    found.append(imposed({loop.number: moved}))
                blocks = [(a - b) / (2.0 * by) for a, b in zip(*(x[0] for x in found), strict=True)]
                self._effects.append((blocks, (found[0][1] - found[1][1]) / (2.0 * by)))
            one.impose(acts, given)
        imposed({})

    def equations(self, change: FloatArray) -> Equations:
        """See :class:`Memory`."""
        system, moved = self._motion.system, np.zeros(len(self._effects))
        if self._comm.rank == 0:
            parts = [
                own.outputs @ change[loop.numbers]
                for loop, own in zip(self._loops, self._known[1], strict=True)
            ]
            moved[:] = np.concatenate([np.zeros(0), *parts])
        self._comm.Bcast(moved)
        blocks = [np.zeros_like(part.block.owned_step) for part in system.parts]
        rows = np.zeros(system.constraints.size)
        for factor, (own_blocks, own_rows) in zip(moved.tolist(), self._effects, strict=True):
            blocks = [a + factor * b for a, b in zip(blocks, own_blocks, strict=True)]
            rows += factor * own_rows
        return blocks, rows

    def arrive(self, step: int, change: FloatArray, measured: FloatArray) -> FloatArray:
        """See :class:`Memory`."""
        found = np.zeros_like(change)
        linear = self._linear(step)
        for loop, own in zip(self._loops, linear, strict=False):
            found[loop.numbers] = own.numbers @ change[loop.numbers]
            found[loop.numbers] += own.columns @ measured[loop.places]
        return found

    def weights(self, step: int, sums: FloatArray) -> FloatArray:
        """See :class:`Memory`."""
        found = np.zeros(len(self.measured))
        for loop, own in zip(self._loops, self._linear(step), strict=False):
            np.add.at(found, loop.places, sums[loop.numbers] @ own.columns)
        self._comm.Bcast(found)
        return found

    def back(self, sums: FloatArray, z: BlockVectors, mu: FloatArray) -> FloatArray:
        """See :class:`Memory`."""
        system, at = self._motion.system, 0
        by_outputs = np.array([product(system, (z, mu), own) for own in self._effects])
        self._comm.Allreduce(MPI.IN_PLACE, by_outputs)
        found = np.zeros_like(sums)
        for loop, own in zip(self._loops, self._known[1], strict=False):
            count = len(own.outputs)
            found[loop.numbers] = own.numbers.T @ sums[loop.numbers]
            found[loop.numbers] -= own.outputs.T @ by_outputs[at : at + count]
            at += count
        return found

    def recall(self, simulation: Simulation, step: int) -> None:
        """See :class:`Memory`."""
        recall(simulation, self._motion.known[step - 1])

    def moved(self, simulation: Simulation, end: StepEnd, change: FloatArray) -> FloatArray:
        """See :class:`Memory`."""
        loops = simulation.controls.loops

        def found() -> FloatArray:
            parts = [np.zeros(0)]
            for loop in self._loops:
                one = loops[loop.number]
                y = self._measurements(end.number, loop) + change[loop.places]
                if isinstance(one, SampledLoop):
                    parts.append(self._sampled(end.number, loop, one, y))
                    ended = self._value(end.number - 1, loop, "held")
                else:
                    parts.append(np.concatenate([y, np.zeros_like(y)]))
                    t = float(self._motion.times[end.number])
                    ended = one.call(t, self._extrapolated(end.number, loop, t)[0])
                if not self._motion.alpha:
                    parts.append(ended if self._both(end.number) else 0.0 * ended)
            return np.concatenate(parts)

        return self._on_first(found, np.zeros(0))

    def _sampled(self, step: int, loop: _Loop, one: SampledLoop, y: FloatArray) -> FloatArray:
        """Numbers of a sampled loop after a step with measurements y (m,)."""
        before = self._value(step - 1, loop, "law")
        if not self._due(step, loop):
            return np.concatenate([self._value(step - 1, loop, "held"), before.ravel()])
        return _called(one, float(self._motion.times[step]), y, before)

    def _linear(self, step: int) -> list[_Linear]:
        """Derivatives of all loops over a step, on the first rank; none on others (collective)."""
        if self._known[0] != step:
            self._known = step, self._on_first(lambda: [*map(self._derived(step), self._loops)], [])
        return self._known[1]

    def _derived(self, step: int) -> Callable[[_Loop], _Linear]:
        loops = self._motion.simulation.controls.loops

        def derived(loop: _Loop) -> _Linear:
            one = loops[loop.number]
            if isinstance(one, SampledLoop):
                return self._of_sampled(step, loop, one)
            return self._of_continuous(step, loop, one)

        return derived

    def _of_sampled(self, step: int, loop: _Loop, one: SampledLoop) -> _Linear:
        """Derivatives of a sampled loop."""
        size, m = loop.numbers.stop - loop.numbers.start, len(loop.inputs)
        held = np.eye(one.count, size)
        outputs, numbers = held, np.eye(size)
        if self._both(step):
            outputs = self._mean(loop, held, held, size)
            numbers[-one.count :] = held
        if not self._due(step, loop):
            return _Linear(outputs, numbers, np.zeros((size, m)))
        t, before = float(self._motion.times[step]), self._value(step - 1, loop, "law")
        given = np.concatenate([self._measurements(step, loop), before.ravel()])

        def law(both: FloatArray) -> FloatArray:
            return _called(one, t, both[:m], both[m:].reshape(before.shape))

        after = [self._value(step, loop, name).ravel() for name in ("held", "law")]
        by = _law_derivatives(one.owner, t, law, given, np.concatenate(after))
        one.recall(self._value(step, loop, "law"))
        columns, own = np.zeros((size, m)), len(by)
        columns[:own], numbers[:own] = by[:, :m], 0.0
        numbers[:own, one.count : own] = by[:, m:]
        return _Linear(outputs, numbers, columns)

    def _of_continuous(self, step: int, loop: _Loop, one: ContinuousLoop) -> _Linear:
        """Derivatives of a loop that extrapolates its measurements."""
        m, size = len(loop.inputs), loop.numbers.stop - loop.numbers.start
        begin, t = (float(self._motion.times[k]) for k in (step - 1, step))

        def outputs_at(t: float) -> FloatArray:
            y, share = self._extrapolated(step, loop, t)
            by = _law_derivatives(one.owner, t, lambda y: one.call(t, y), y, one.call(t, y))
            found = np.zeros((one.count, size))
            found[:, : 2 * m] = np.hstack([(1.0 + share) * by, -share * by])
            return found

        outputs, numbers = outputs_at(t), np.zeros((size, size))
        numbers[2 * m :, 2 * m :] = np.eye(size - 2 * m)
        if self._both(step):
            numbers[2 * m :] = outputs
            outputs = self._mean(loop, outputs_at(0.5 * (begin + t)), outputs, size)
        after, last = self._value(step, loop, "before"), self._value(step - 1, loop, "last")
        if len(after):  # of the last state, or of one before it if that is too near
            first = 0 if after[0] == last[0] else m
            numbers[m : 2 * m, first : first + m] = np.eye(m)
        return _Linear(outputs, numbers, np.eye(size, m))

    def _both(self, step: int) -> bool:
        """True for a step whose equations depend on outputs at both of its ends."""
        return not self._motion.alpha and self._motion.grid.renewal(step) is None

    def _mean(self, loop: _Loop, middle: FloatArray, end: FloatArray, size: int) -> FloatArray:
        """Derivatives (p, s) of outputs over a step by those in its middle and at its end."""
        start = np.eye(size)[size - len(end) :]
        found: FloatArray = np.where(loop.loads[:, np.newaxis], middle, 0.5 * (start + end))
        return found

    def _extrapolated(self, step: int, loop: _Loop, t: float) -> tuple[FloatArray, float]:
        """Measurements (m,) for a time, s, in a step, and their part of the last change."""
        last, before = (self._value(step - 1, loop, name) for name in ("last", "before"))
        share, y = 0.0, last[1:]
        if len(before):
            share = (t - last[0]) / (last[0] - before[0])
            y = y + share * (last[1:] - before[1:])
        return y, share

    def _value(self, step: int, loop: _Loop, name: str) -> FloatArray:
        """What a loop knows after a step, copied."""
        return self._motion.known[step][f"controls_{loop.number}_{name}"].copy()

    def _measurements(self, step: int, loop: _Loop) -> FloatArray:
        """(m,) measurements of a loop after a step."""
        found: FloatArray = self._motion.known[step]["controls_angles"][loop.inputs]
        return found

    def _due(self, step: int, loop: _Loop) -> bool:
        """True if a loop takes a sample after a step."""
        first, last = (self._value(k, loop, "next")[0] for k in (step - 1, step))
        return bool(first != last)

    def _on_first[Found](self, function: Callable[[], Found], other: Found) -> Found:
        """Result of a function on the first rank, another one on the others (collective).

        Raises:
            InputError: the function does so.
        """
        found, refusal = other, ""
        if self._comm.rank == 0:
            try:
                found = function()
            except InputError as error:
                refusal = str(error)
        if refusal := self._comm.bcast(refusal):
            raise InputError(refusal)
        return found


def recall(simulation: Simulation, known: Mapping[str, FloatArray]) -> None:
    """Give the controllers of a simulation what they know at a state."""
    simulation.controls.restore({name: values.copy() for name, values in known.items()})


def _called(one: SampledLoop, t: float, y: FloatArray, before: FloatArray) -> FloatArray:
    """Outputs and state of a law after a sample, with a state before it."""
    one.recall(before.copy())
    try:
        outputs = one.sampled(t, y.copy())
    except FAILURES as error:
        raise InputError(f"gradient: {one.owner}: law fails at t = {t:.6g} s: {error}") from error
    return np.concatenate([outputs, one.memory().ravel()])


def _law_derivatives(
    owner: str, t: float, law: Callable[[FloatArray], FloatArray], at: FloatArray,
    expected: FloatArray,
) -> FloatArray:  # fmt: skip
    """Derivatives (p, n) of a law by its arguments (n,).

    Raises:
        InputError: there are none, or it gives other results (p,) than those expected.
    """

    def check() -> None:
        again, size = law(at), float(np.abs(expected).max(initial=0.0))
        if not np.allclose(again, expected, rtol=0.0, atol=_AGAIN * size):
            raise InputError(
                f"gradient: {owner}: law does not return the same again at t = {t:.6g} s; keep all "
                "its memory in its attribute state"
            )

    def found(step: float) -> FloatArray:
        sizes = step * np.maximum(1.0, np.abs(at))
        if not len(at):
            return np.zeros((len(expected), 0))
        return central(lambda k, size: law(at + size * np.eye(1, len(at), k)[0]), sizes.tolist())

    check()
    step, off = suited_step(found)
    if off > _KINK:
        raise InputError(
            f"gradient: {owner}: law has a kink or jumps at t = {t:.6g} s, and has no derivative "
            "there"
        )
    by = found(step)
    check()  # which many calls might have changed
    return by
