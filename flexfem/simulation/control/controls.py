# SPDX-License-Identifier: LGPL-3.0-or-later
"""Controllers of a run: measurement, control laws, zero-order hold of outputs.

All ranks measure the same numbers. Sampled laws are called on the first rank alone, once per sample
and only at accepted states, and the others receive the outputs: a law may have side effects, and a
repeated step does not repeat its sample. Continuous laws of the motion of markers act implicitly
on actuators (``feedback``); others are functions of the time and of measurements extrapolated from
accepted states. Nothing has to be undone after a rejected step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy, deepcopy

import numpy as np

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._faults import FAILURES, FunctionError, ReturnError, noted
from flexfem._types import FloatArray, IntArray
from flexfem.control.law import SampledLaw, StaticLaw
from flexfem.core.joint import Joint
from flexfem.core.load import Load
from flexfem.core.state import counts
from flexfem.joints.actuator import Actuator
from flexfem.layout.numbered_model import NumberedModel
from flexfem.model.controller import Controller
from flexfem.model.model import Model
from flexfem.simulation.control.feedback import DrivenActuator, FeedbackLaw, feedback
from flexfem.simulation.control.measurements import Measurements
from flexfem.system.system import System

__all__ = ["ContinuousLoop", "Controls", "Loop", "Outputs", "SampledLoop", "driven_model"]

#: Values of all outputs of a model at a time (s), one after the other.
Outputs = Callable[[float], FloatArray]

#: Relative tolerance of sample times as multiples of the step, and of the instants of samples.
_ROUND_OFF = 1e-6
#: Least part of a time step over which slopes are taken: after an event it may be round-off.
_SHORT = 0.05


def driven_model(model: Model, controls: Controls | None = None) -> Model:
    """The model with its controllers' outputs, which are zero without ``controls``.

    The given model is not changed, and may be run again.
    """
    names = [output for controller in model.controllers for output in controller.outputs]
    if not names:
        return model
    driven = copy(model)
    joints = {} if controls is None else controls.actuators(model)
    driven.joints = [joints.get(joint.name, joint) for joint in model.joints]
    outputs = None if controls is None else controls.outputs
    driven.loads = [
        _driven_load(load, names.index(load.name), outputs) if load.name in names else load
        for load in model.loads
    ]
    return driven


def _driven_joint(actuator: Actuator, number: int, outputs: Outputs) -> Actuator:
    own, changed = actuator.force, copy(actuator)
    _checks.assign(changed, force=lambda t: float(own(t)) + float(outputs(t)[number]))
    return changed


def _driven_load(load: Load, number: int, outputs: Outputs | None) -> Load:
    changed = copy(load)
    _checks.assign(
        changed, amplitude=lambda t: 0.0 if outputs is None else float(outputs(t)[number])
    )
    return changed


class Loop:
    """One controller during a run."""

    def __init__(self, controller: Controller) -> None:
        """Store the controller."""
        self.controller = controller
        self.owner = f'{type(controller).__name__} "{controller.name}"'
        self.count = len(controller.outputs)

    @property
    def implicit(self) -> bool:
        """True if its outputs follow the trial motion."""
        return False

    @property
    def driven(self) -> list[str]:
        """Outputs in messages."""
        return [f'{self.owner}: output "{name}"' for name in self.controller.outputs]

    def checked(self, t: float, outputs: object) -> FloatArray:
        """Outputs as an array (count,).

        Raises:
            ReturnError: the law has returned other values.
        """
        try:
            values = np.atleast_1d(_checks.numbers(outputs))
        except (TypeError, ValueError):
            values = np.empty(0)
        if values.shape != (self.count,):
            noun = "number" if self.count == 1 else "numbers"
            raise ReturnError(
                f"law must return {self.count} {noun}, got {_checks.show(outputs)} at t = {t:.6g} s"
            )
        return values


class ContinuousLoop(Loop):
    """A function of the time and of extrapolated measurements."""

    def __init__(self, controller: Controller, step: float) -> None:
        """Store the controller; ``step`` (s) is that of the run's grid."""
        super().__init__(controller)
        self._least = _SHORT * step
        self.law: FeedbackLaw | None = None  # where it acts implicitly
        # time and measurements at the last accepted state, and at one before
        self._last = self._before = np.empty(0)
        self._at, self._outputs = np.nan, np.zeros(self.count)

    def note(self, t: float, y: FloatArray, jumped: bool) -> None:
        """Take the time (s) and measurements of an accepted state, see `Controls.accepted`."""
        if jumped or not len(self._last):
            self._before = np.empty(0)
        elif t - self._last[0] >= self._least:
            self._before = self._last
        self._last, self._at = np.concatenate([[t], y]), np.nan
        if self.law is not None:
            self.law.previous = y.copy()

    @property
    def implicit(self) -> bool:
        """See :attr:`Loop.implicit`."""
        return self.law is not None and self.law.follows

    def feedback(self, model: Model) -> dict[str, DrivenActuator]:
        """Its actuators, where it acts implicitly; else none."""
        found = feedback(model, self.controller, self.call, self.outputs)
        self.law = next((one.law for one in found.values()), None)
        return found

    def call(self, t: float, y: FloatArray) -> FloatArray:
        """Checked outputs of the law at a time (s) and measurements.

        Raises:
            Exception: whatever the law raises, or a ReturnError for other or infinite values.
        """
        assert callable(self.controller.law)
        outputs = self.checked(t, self.controller.law(t, y))
        if not np.isfinite(outputs).all():
            found = _checks.show(outputs.tolist())
            raise ReturnError(f"law returned {found} at t = {t:.6g} s")
        return outputs

    def impose(self, t: float, outputs: FloatArray) -> None:
        """Let other outputs act at time ``t`` (s), until the next accepted or restored state."""
        self._at, self._outputs = t, outputs

    def outputs(self, t: float) -> FloatArray:
        """Outputs at time ``t`` (s) by measurements extrapolated from accepted states."""
        if not len(self._last):
            return self._outputs
        if t != self._at:
            y = self._last[1:]
            if len(self._before) and t != self._last[0]:
                change = self._last - self._before
                y = y + (t - self._last[0]) / change[0] * change[1:]
            try:
                self._outputs = self.call(t, y.copy())
            except FAILURES as error:
                noted(self.owner, self.controller.law, error)
                self._outputs = np.full(self.count, np.nan)
            self._at = t
        return self._outputs

    def state(self) -> dict[str, FloatArray]:
        """Time and measurements at the last accepted state, and at one before it."""
        return {"last": self._last, "before": self._before}

    def restore(self, state: Mapping[str, FloatArray]) -> None:
        """Restore a result of :meth:`state`."""
        self._last, self._before, self._at = state["last"], state["before"], np.nan
        if self.law is not None and len(self._last):
            self.law.previous = self._last[1:].copy()


class SampledLoop(Loop):
    """A law called once per sample on the first rank, with a zero-order hold of its outputs."""

    def __init__(self, controller: Controller, step: float) -> None:
        """Copy the law; ``step`` (s) is that of the run's grid.

        Raises:
            InputError: the sample time is no multiple of the step, or the law cannot be copied.
        """
        super().__init__(controller)
        self._span = controller.sample_time or step
        ratio = self._span / step
        if abs(ratio - round(ratio)) > _ROUND_OFF * ratio or round(ratio) < 1:
            raise InputError(
                f"{self.owner}: sample_time must be a multiple of the time step {step:.9g} s, got "
                f"{self._span:.9g}"
            )
        try:
            law = deepcopy(controller.law)
        except Exception as error:
            raise InputError(f"{self.owner}: law cannot be copied for the run: {error}") from error
        # asked once: the check of a protocol takes as long as a small law
        self._with_memory = law if isinstance(law, SampledLaw) else None
        self._law: StaticLaw = law.update if isinstance(law, SampledLaw) else law
        self._next, self.held = 0, np.zeros(self.count)

    def due(self, t: float) -> bool:
        """Return True if an accepted state is a sample."""
        return t >= (self._next - _ROUND_OFF) * self._span

    def take(self, t: float, held: FloatArray) -> None:
        """Store the outputs of a sample, and count it."""
        self._next, self.held = int(t / self._span + _ROUND_OFF) + 1, held

    def sampled(self, t: float, y: FloatArray) -> FloatArray:
        """Call the law."""
        return self.checked(t, self._law(t, y))

    def memory(self) -> FloatArray:
        """A copy of the state of the law."""
        return np.array(() if self._with_memory is None else self._with_memory.state)

    def recall(self, memory: FloatArray) -> None:
        """Restore a result of :meth:`memory`."""
        if self._with_memory is not None:
            self._with_memory.state = memory

    def impose(self, t: float, outputs: FloatArray) -> None:
        """Hold other outputs, until the next sample or restored state."""
        self.held = outputs

    def outputs(self, t: float) -> FloatArray:
        """Outputs that are held."""
        return self.held

    def state(self) -> dict[str, FloatArray]:
        """Number of the next sample, held outputs and the state of the law."""
        law = self._with_memory
        memory = np.empty(0) if law is None else np.asarray(law.state, dtype=np.float64)
        return {"next": np.array([self._next]), "held": self.held, "law": memory}

    def restore(self, state: Mapping[str, FloatArray], first: bool) -> None:
        """Restore a result of :meth:`state`; ``first``: on the first rank, which calls the law."""
        (self._next,), self.held = counts("next", state["next"]), state["held"]
        if first and self._with_memory is not None:
            self._with_memory.state = state["law"]


class Controls:
    """All controllers of a model during a motion.

    Attributes:
        columns: names of all outputs in the history.
        loops: controllers during the motion.
        inputs: for each of them, (n,) numbers of its measurements in ``measured``.
    """

    def __init__(self, model: Model, step: float) -> None:
        """Make copies of the laws; ``step`` (s) is that of the run's grid.

        Raises:
            InputError: a sample time is no multiple of the step, or a law cannot be copied.
        """
        self.loops: list[SampledLoop | ContinuousLoop] = [
            (SampledLoop if controller.sampled else ContinuousLoop)(controller, step)
            for controller in model.controllers
        ]
        self.columns = [c for controller in model.controllers for c in controller.columns]
        self._nothing = np.empty(0)

    def __len__(self) -> int:
        """Number of controllers."""
        return len(self.loops)

    def actuators(self, model: Model) -> dict[str, Joint]:
        """The driven actuators of a model by name."""
        found: dict[str, Joint] = {}
        for loop in self.loops:
            if isinstance(loop, ContinuousLoop):
                found.update(loop.feedback(model))
        for loop in self.loops:
            for number, name in enumerate(loop.controller.outputs):
                joint = model.get(name)
                if isinstance(joint, Actuator) and name not in found:
                    found[name] = _driven_joint(joint, number, loop.outputs)
        return found

    def outputs(self, t: float) -> FloatArray:
        """All outputs that act at time ``t`` (s), one after the other."""
        if not self.loops:
            return self._nothing
        return np.concatenate([loop.outputs(t) for loop in self.loops])

    @property
    def explicit(self) -> list[str]:
        """Actuators and loads, by class and name, whose outputs follow accepted states."""
        return [name for loop in self.loops if not loop.implicit for name in loop.driven]

    def explicit_outputs(self, t: float) -> FloatArray:
        """Their outputs at time ``t`` (s)."""
        found = [loop.outputs(t) for loop in self.loops if not loop.implicit]
        return np.concatenate([self._nothing, *found])

    def attach(self, system: System, serial: NumberedModel) -> None:
        """Set up the measurements (collective)."""
        self._system = system
        measured = [loop.controller.measured(serial.model) for loop in self.loops]
        probes = {probe.name: probe for part in measured for probe, _ in part}
        often = [
            probe.name
            for loop, part in zip(self.loops, measured, strict=True)
            if isinstance(loop, ContinuousLoop)
            for probe, _ in part
        ]
        self._measurements = Measurements(system, serial, list(probes.values()), often)
        columns = self._measurements.columns
        self.inputs: list[IntArray] = [
            np.array([columns.index(probe.columns[k]) for probe, k in part], dtype=np.int64)
            for part in measured
        ]

    @property
    def measured(self) -> list[str]:
        """Names of all columns that are measured; their values are a part of :meth:`state`."""
        return self._measurements.columns

    def start(self) -> None:
        """Measure at the start and compute the first outputs (collective).

        Raises:
            InputError: a law or a probe fails, or a law does not return a number per output.
        """
        try:
            self._measurements.begin()
            self.accepted(jumped=True)
            self.outputs(self._system.time)
            self.sample()
        except (ValueError, TypeError, FunctionError) as error:
            raise InputError(str(error)) from error

    def started(self) -> None:
        """Begin the measurement of energies, with the forces of the present outputs."""
        self._measurements.begin()

    def accepted(self, jumped: bool = False) -> None:
        """Measure at an accepted state (collective); ``jumped``: velocities may have changed."""
        if not self.loops:
            return
        self._measurements.accepted()
        for loop, inputs in zip(self.loops, self.inputs, strict=True):
            if isinstance(loop, ContinuousLoop):
                loop.note(self._system.time, self._measurements.values[inputs], jumped)

    def sample(self) -> None:
        """Call the laws whose sample is due at the accepted state (collective).

        If a law fails, the outputs are kept and the sample remains due: the run ends here.
        """
        if not self.loops:
            return
        t, comm = self._system.time, self._system.comm
        due = [
            (loop, inputs)
            for loop, inputs in zip(self.loops, self.inputs, strict=True)
            if isinstance(loop, SampledLoop) and loop.due(t)
        ]
        if not due:
            return
        self._measurements.complete()
        found = self._called(due, t) if comm.rank == 0 else []
        if comm.size > 1:
            found = comm.bcast(found)
        if found:
            for (loop, _), held in zip(due, found, strict=True):
                loop.take(t, held)

    def _called(self, due: Sequence[tuple[SampledLoop, IntArray]], t: float) -> list[FloatArray]:
        """Outputs of laws; None if one fails, and all laws are restored."""
        found, before = [], [loop.memory() for loop, _ in due]
        for loop, inputs in due:
            try:
                found.append(loop.sampled(t, self._measurements.values[inputs]))
            except FAILURES as error:  # all ranks get the error at the next agreement
                noted(loop.owner, loop.controller.law, error)
                for (one, _), memory in zip(due, before, strict=True):
                    one.recall(memory)
                return []
        return found

    def not_finite(self, t: float) -> str | None:
        """The first controller whose outputs are not finite."""
        for loop in self.loops:
            if not np.isfinite(loop.outputs(t)).all():
                return f"{loop.owner}: the output is not finite"
        return None

    def state(self) -> dict[str, FloatArray]:
        """Return the memory of all controllers (collective)."""
        own = self._measurements.state() if self.loops else {}
        for k, loop in enumerate(self.loops):
            own |= {f"controls_{k}_{name}": value for name, value in loop.state().items()}
        return own

    def restore(self, state: Mapping[str, FloatArray]) -> None:
        """Restore outputs and memories of a result of :meth:`state`."""
        for k, loop in enumerate(self.loops):
            own = {name: state[f"controls_{k}_{name}"] for name in loop.state()}
            if isinstance(loop, SampledLoop):
                loop.restore(own, self._system.comm.rank == 0)
            else:
                loop.restore(own)

    def resume(self, state: Mapping[str, FloatArray]) -> None:
        """Restore the measurements after the system has been restored (collective)."""
        if self.loops:
            self._measurements.restore(state["controls_angles"], state["controls_sums"])
            self.sample()  # one that failed is still due
