# SPDX-License-Identifier: LGPL-3.0-or-later
"""The driver: from a model and options to results in a folder."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

with suppress(ImportError):  # absent beside a DOLFINx of conda, Debian or a container
    import dolfinx_solver  # noqa: F401  (the binary wheel must come before dolfinx and petsc4py)

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.core.status import Status
from flexfem.integrators.generalized_alpha import GeneralizedAlpha
from flexfem.integrators.start import start_consistently
from flexfem.io.field_output import FieldOutput
from flexfem.io.history import HistoryWriter
from flexfem.io.progress import Progress
from flexfem.io.summary import remove_summary, write_summary
from flexfem.model.model import Model
from flexfem.options import RunOptions
from flexfem.solvers.newton import NewtonOptions
from flexfem.solvers.policies import Policy, create_policy
from flexfem.solvers.tangent import TangentSolver
from flexfem.system.assembly import Assembly
from flexfem.system.build import build
from flexfem.system.probes import ProbeRecorder
from flexfem.system.system import System

__all__ = ["Outcome", "Simulation", "simulate"]

#: A step is halved this often before the run gives up.
_HALVINGS = 12

Results = Callable[[Mapping[str, FloatArray]], Mapping[str, float]]


@dataclass(frozen=True)
class Outcome:
    """What a run came to.

    Attributes:
        status: "ok" or the reason of failure.
        summary: what ``summary.json`` holds.
        history: columns of the history, angles unwrapped; empty on other ranks than the first.
    """

    status: str
    summary: Mapping[str, Any]
    history: Mapping[str, FloatArray] = field(default_factory=dict)


class Simulation:
    """A system with its integrator, stepped from Python.

    Attributes:
        system: the assembled system.
        steps, rejected: accepted (partial) steps and rejected ones.
        step_seconds: wall-clock time of each call of :meth:`advance`, s.
    """

    def __init__(
        self, model: Model, options: RunOptions, comm: MPI.Intracomm | None = None
    ) -> None:
        """Build the system and start it consistently (collective).

        Raises:
            InputError: a mistake in the model (a ValueError).
        """
        try:
            model.validate()
            self.serial = Assembly(model)
            self.system: System = build(self.serial, comm or MPI.COMM_WORLD, options.split_above)
        except ValueError as error:  # on every rank, the model being the same
            raise InputError(str(error)) from error
        self.options = options
        self.system.set_time(0.0)
        self._integrator = GeneralizedAlpha(options.rho_inf)
        tangent = TangentSolver(self.system)
        self.status = start_consistently(self.system, tangent, options.dt)
        newton = NewtonOptions(options.tolerance)
        self._policy: Policy = create_policy(options.iteration_matrix, self.system, newton, tangent)
        self.steps = self.rejected = 0
        self.step_seconds: list[float] = []

    @property
    def time(self) -> float:
        """Time of the accepted state, s."""
        return self.system.time

    def advance(self, h: float, t: float | None = None) -> Status:
        """Advance by ``h`` (s) in one step, or in halved steps where one step fails.

        Args:
            h: step size; factors are kept for equal step sizes, so pass the same number.
            t: time reached, where the caller knows it free of accumulated rounding.
        """
        begin = time.perf_counter()
        status = self._advance(h, _HALVINGS)
        self.step_seconds.append(time.perf_counter() - begin)
        if status is Status.OK and t is not None:
            self.system.time = t
        return status

    def _advance(self, h: float, halvings: int) -> Status:
        status = self._integrator.step(self.system, self._policy, h)
        if status is Status.OK:
            self.steps += 1
            return status
        self.rejected += 1
        if halvings == 0:
            return status
        first = self._advance(0.5 * h, halvings - 1)
        return self._advance(0.5 * h, halvings - 1) if first is Status.OK else first


class _Recorder:
    """History, fields and progress of one run."""

    def __init__(self, simulation: Simulation, options: RunOptions) -> None:
        system = simulation.system
        self._simulation, self._every = simulation, options.every
        self._probes = ProbeRecorder(system, simulation.serial)
        self._rows: list[FloatArray] = []
        self._time = 0.0  # of the last record
        self._table = self._fields = None
        if options.output is not None:
            remove_summary(options.output / "summary.json", system.comm)
            self._table = HistoryWriter(
                options.output / "history.csv", self._probes.columns, system.comm,
                self._probes.unwrap,
            )  # fmt: skip
            self._fields = FieldOutput(options.output, system, simulation.serial)
        quiet = options.quiet or system.comm.rank != 0
        self._progress = Progress(options.t_end, not quiet)

    def record(self, step: int, last: bool = False) -> None:
        """Note the accepted state of a step."""
        simulation = self._simulation
        self._time = simulation.time
        self._probes.record(simulation.time)
        due = step % self._every == 0 or last
        if due or self._probes.full:  # the table is never behind the fields
            self._flush()
        if due and self._fields is not None:
            self._fields.write(simulation.time, step)
        counters = simulation.system.counters
        self._progress.update(simulation.time, counters.newton_iterations, counters.factorizations)

    def record_last(self, step: int) -> None:
        """Note the state reached before a step that failed, which may lie within the step."""
        system = self._simulation.system
        system.reset()
        system.interface.update()
        system.constraints.accept()
        if system.time > self._time:
            self.record(step, last=True)
        elif self._fields is not None:
            self._fields.write(system.time, step - 1)

    def _flush(self) -> None:
        for t, values in self._probes.flush():
            self._rows.append(np.concatenate([[t], values]))
            if self._table is not None:
                self._table.write(t, values)

    def close(self) -> None:
        """Write what is left."""
        self._flush()
        self._progress.close()
        if self._table is not None:
            self._table.close()
        if self._fields is not None:
            self._fields.close()

    def history(self) -> dict[str, FloatArray]:
        """Columns recorded so far, on the first rank."""
        if not self._rows:
            return {}
        table = np.array(self._rows)
        columns = dict(zip(["t", *self._probes.columns], table.T.copy(), strict=True))
        for name in self._probes.unwrap:
            columns[name] = np.unwrap(columns[name])
        return columns


def simulate(
    model: Model,
    options: RunOptions,
    *,
    case: str = "model",
    results: Results | None = None,
    comm: MPI.Intracomm | None = None,
) -> Outcome:
    """Run a model to the end and write its results (collective).

    Args:
        model: the model, the same on every rank.
        options: step size, end, output folder and so on.
        case: name for the summary.
        results: function of the history's columns that returns the headline results.
        comm: communicator, all ranks by default.

    Returns:
        The outcome, the same status on every rank.

    Raises:
        InputError: a mistake in the model, before anything is written (a ValueError).
        OSError: the results cannot be written.
        KeyboardInterrupt: after what is there was written, if there is one rank only.
    """
    begin = time.perf_counter()
    simulation = Simulation(model, options, comm)
    run = _Run(simulation, options, case, results, begin)
    try:
        status = run.to_the_end()
    except KeyboardInterrupt:
        # ranks are interrupted at different places, where no collective call can end well
        if simulation.system.comm.size == 1:
            run.finish(f"interrupted at t = {simulation.time:.6g} s")
        raise
    return run.finish(_reason(simulation, status, options))


class _Run:
    """One run from the start to the results."""

    def __init__(
        self, simulation: Simulation, options: RunOptions, case: str, results: Results | None,
        begin: float,
    ) -> None:  # fmt: skip
        self._simulation, self._options, self._case = simulation, options, case
        self._results, self._begin = results, begin
        self._recorder = _Recorder(simulation, options)
        self._setup: float | None = None
        self._first: float | None = None

    def _elapsed(self) -> float:
        return time.perf_counter() - self._begin

    def to_the_end(self) -> Status:
        """Take all steps, or those before the first that fails."""
        simulation, options = self._simulation, self._options
        status = simulation.status
        if status is not Status.OK:
            return status
        self._recorder.record(0)
        self._setup = self._elapsed()
        count = max(1, round(options.t_end / options.dt))
        for step in range(1, count + 1):
            status = simulation.advance(options.t_end / count, options.t_end * step / count)
            if step == 1:
                self._first = self._elapsed()
            if status is not Status.OK:
                self._recorder.record_last(step)
                break
            self._recorder.record(step, last=step == count)
        return status

    def finish(self, reason: str) -> Outcome:
        """Write what is left and the summary (collective)."""
        self._recorder.close()
        history = self._recorder.history()
        summary = _summary(self._simulation, self._case, reason, self._elapsed())
        summary["wall_seconds_setup"] = self._setup or summary["wall_seconds"]
        summary["wall_seconds_first_step"] = self._first
        if history and self._results is not None:
            summary["results"] = dict(self._results(history))
        if self._options.output is not None:
            path = self._options.output / "summary.json"
            write_summary(path, summary, self._simulation.system.comm)
        return Outcome(reason, summary, history)


def _reason(simulation: Simulation, status: Status, options: RunOptions) -> str:
    """The status in words, with the time and with a drive or load that is not a number."""
    if status is Status.OK:
        return "ok"
    t, model = simulation.time, simulation.serial.model
    text = f"{status.value} at t = {t:.6g} s"
    # the start looks three steps ahead to differentiate drives
    ahead = t + options.dt * np.array([0.5**_HALVINGS, 0.5, 1.0, 2.0, 3.0])
    for joint in model.joints:
        if joint.driven:
            poses = [simulation.serial.marker_pose(m) for m in (joint.a, joint.b)]
            targets = [row.target for s in ahead for row in joint.rows(poses[0], poses[1], s)]
            if not np.isfinite(targets).all():
                return f"{joint.owner}: the motion is not finite after t = {t:.6g} s"
    for load in model.loads:
        if not np.isfinite([load.factor(s) for s in ahead]).all():
            name = f'{type(load).__name__} "{load.name}"'
            return f"{name}: the amplitude is not finite after t = {t:.6g} s"
    return text


def _summary(
    simulation: Simulation, case: str, reason: str, wall: float
) -> dict[str, Any]:  # fmt: skip
    system, counters = simulation.system, simulation.system.counters
    return {
        "case": case,
        "ranks": system.comm.size,
        "unknowns": system.unknowns,
        "multipliers": system.multipliers,
        "steps": simulation.steps,
        "rejected_steps": simulation.rejected,
        "newton_iterations": counters.newton_iterations,
        "factorizations": counters.factorizations,
        "mass_factorizations": counters.mass_factorizations,
        "fallbacks": counters.fallbacks,
        "residual_evaluations": counters.residual_evaluations,
        "wall_seconds": wall,
        # without the first step, which factorises and loads compiled code
        "wall_seconds_steps": sum(simulation.step_seconds[1:]),
        "status": reason,
        "results": {},
    }
