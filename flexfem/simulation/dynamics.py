# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion in time: from a model and options to results in a folder."""

from __future__ import annotations

import time
import weakref
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._faults import current
from flexfem._types import FloatArray
from flexfem.analyses.dynamics import RunOptions
from flexfem.core.status import Status
from flexfem.launch import Interrupted, StopSignals
from flexfem.model.model import Model
from flexfem.simulation.checkpoints import Checkpoints, Restart
from flexfem.simulation.energy_watch import EnergyWatch
from flexfem.simulation.functions_alike import NONE, FunctionsAlike
from flexfem.simulation.interruption import Agreement, interruption
from flexfem.simulation.locked_shapes import locked_shapes
from flexfem.simulation.made_up_energy import made_up_energy
from flexfem.simulation.outcome import Outcome, Results, conclude, summary_of
from flexfem.simulation.reasons import ITERATED, MOTION, START, moves_most, not_finite, with_hint
from flexfem.simulation.recording import Recorder, closing_table
from flexfem.simulation.run_guard import guarded, reason_of
from flexfem.simulation.stepping import HALVINGS, Simulation
from flexfem.simulation.time_grid import TimeGrid
from flexfem.simulation.unresolved_turns import UnresolvedTurns

__all__ = ["simulate"]


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
        TypeError: the options are those of another analysis.
        FunctionError: a function of the model failed after the start; a checkpoint and what was
            computed are written (a RuntimeError).
        OSError: the results cannot be written.
        KeyboardInterrupt: SIGINT, SIGTERM or SIGHUP came; a checkpoint and what was computed are
            written.
    """
    _checks.instance("simulate", "options", options, RunOptions)
    begin = time.perf_counter()
    comm = comm or MPI.COMM_WORLD
    with guarded(options, comm) as faults:
        restart = None if options.restart is None else Restart(options, comm)
        simulation = Simulation(model, options, comm, restart)
        with StopSignals() as signals:
            run = _Run(simulation, options, case, results, begin, restart)
            with closing_table(run.recorder):
                status = run.to_the_end(signals)
                if run.signal:
                    raise run.interrupted()
                when = f" after t = {simulation.time:.6g} s"
                why = partial(_reason, simulation, status, options)
                return run.finish(reason_of(faults, comm, when, why))


class _Run:
    """One run from the start, or from a checkpoint, to the results.

    Attributes:
        signal: number of the signal that ended it early, 0 for none.
        recorder: history, fields and progress.
    """

    def __init__(
        self, simulation: Simulation, options: RunOptions, case: str, results: Results | None,
        begin: float, restart: Restart | None,
    ) -> None:  # fmt: skip
        self._simulation, self._options, self._case = simulation, options, case
        self._results, self._begin = results, begin
        self._grid = TimeGrid.of(options.dt, options.t_end) if restart is None else restart.grid
        self._start = None if restart is None else restart.step
        self.recorder = Recorder(
            simulation.system, simulation.serial, options, options.every, options.t_end,
            resume=None if restart is None else restart.state, varies=options.adaptive,
            measures=simulation.controls.columns,
        )  # fmt: skip
        self._checkpoints = Checkpoints(simulation, simulation.serial, options, self._grid, restart)
        self._checkpoint: Path | None = None
        functions = FunctionsAlike(simulation.system, simulation.serial.model)
        self.signal, self._agreement = 0, Agreement(simulation.system.comm, functions)
        self._faults = current()
        self._watch: EnergyWatch | None = None
        self._turns: UnresolvedTurns | None = None
        self._setup: float | None = None
        self._first: float | None = None

    def _elapsed(self) -> float:
        return time.perf_counter() - self._begin

    def to_the_end(self, signals: StopSignals) -> Status:
        """Take all steps, or those before the first that fails or a signal."""
        simulation, options, grid = self._simulation, self._options, self._grid
        simulation.cautions.say()
        status = simulation.status
        if status is not Status.OK:
            return status
        if self._start is None:
            self.recorder.record(0, measures=self._outputs())
            self._look(signals)
        self._setup = self._elapsed()
        self._watch = watch = EnergyWatch(
            simulation.system,
            simulation.serial,
            grid.h,
            probed=self.recorder.balances,
            fast="steps" in simulation.cautions.found,
            undamped=options.rho_inf == 1.0,
        )
        self._turns = turns = UnresolvedTurns(
            simulation.system, simulation.serial, options, simulation.turn_limit
        )
        simulation.follow = _weakly(self._follow)
        if options.adaptive:
            simulation.observe = _weakly(self._between)
        count, first = grid.steps(options.t_end), (self._start or 0) + 1
        every = options.checkpoint_every
        for step in range(first, count + 1):
            status = simulation.advance(grid.rest(simulation.time, step), grid.time(step))
            if step == first:
                self._first = self._elapsed()
            turns.step(simulation.rejected)
            if status is not Status.OK:
                self._look(signals)  # functions that differ between ranks may be why
                watch.fail()
                self.recorder.record_last(step, self._outputs())
                self._save(step - 1)
                break
            stopped = simulation.events.stopped_by is not None
            last = stopped or step == count
            watch.step(len(simulation.events.fired), last)
            self.recorder.record(step, last=last, measures=self._outputs())
            if stopped:
                if every:  # the rest of the step is made by a restart
                    self._save(step if simulation.time >= grid.time(step) else step - 1)
                break
            self._look(signals)
            early = self.signal or self._agreement.failed
            if early or (every and (step % every == 0 or step == count)):
                self._save(step)
            if early:
                break
        return status

    def _between(self) -> None:
        """Record an accepted state within a step."""
        self.recorder.record_between(self._outputs())

    def _follow(self) -> None:
        """Take in the work up to an accepted state that is not recorded."""
        self.recorder.follow()
        assert self._watch is not None
        self._watch.follow()

    def _outputs(self) -> FloatArray:
        """What the controllers do from the accepted state on."""
        return self._simulation.controls.outputs(self._simulation.time)

    def _look(self, signals: StopSignals) -> None:
        """Look for signals, and show progress where it is time to (collective)."""
        outputs = self._outputs() if len(self._simulation.controls) else NONE
        self.signal = self._agreement.on(signals, self.recorder.due, outputs)
        if self._agreement.show:
            self.recorder.show()

    def _save(self, step: int) -> None:
        """Write a checkpoint, if the disk takes it."""
        with self._faults.files():
            self._checkpoint = self._checkpoints.write(step, self.recorder.state())

    def interrupted(self) -> Interrupted:
        """Write what is left and the summary; the exception that ends the run (collective)."""
        reason = f"interrupted at t = {self._simulation.time:.6g} s"
        outcome = self.finish(reason)
        return interruption(self.signal, reason, self._checkpoint, outcome)

    def finish(self, reason: str) -> Outcome:
        """Write what is left and the summary (collective)."""
        self.recorder.close()
        history = self.recorder.history()
        summary = _summary(self._simulation, self._case, reason, self._elapsed())
        summary["restarted_at_step"] = self._start
        summary["wall_seconds_setup"] = self._setup or summary["wall_seconds"]
        summary["wall_seconds_first_step"] = self._first
        comm, cautions = self._simulation.system.comm, self._simulation.cautions
        for watch in (self._watch, self._turns):
            cautions.say([] if watch is None else watch.texts())
        # the history is the first rank's
        cautions.say(comm.bcast(made_up_energy(self._simulation.serial.model, history)))
        cautions.say(locked_shapes(self._simulation.serial, self._simulation.system))
        summary["warnings"] = cautions.texts
        return conclude(summary, history, self._results, self._options, comm)


def _weakly(method: Callable[[], None]) -> Callable[[], None]:
    """A method that does not keep its object: a cycle would let systems outlive their runs."""
    reference = weakref.WeakMethod(method)

    def call() -> None:
        if alive := reference():
            alive()

    return call


def _reason(simulation: Simulation, status: Status, options: RunOptions) -> str:
    """The status in words, with the time, where, and what to try (collective)."""
    if status is Status.OK:
        return "ok"
    t = simulation.time
    if status is Status.LEFT:
        return f"{simulation.departures.reason} after t = {t:.6g} s"
    if status is Status.EVENT:
        if simulation.events.bad is not None:
            name = simulation.events.bad
            return f'Event "{name}": the function is not finite after t = {t:.6g} s'
        name = simulation.events.fired[-1][0]
        return (
            f'Event "{name}": too many in one step at t = {t:.6g} s (what bounces comes to rest '
            "with a rest_speed)"
        )
    # the start looks ahead to differentiate drives
    ahead = t + options.dt * np.array([0.5**HALVINGS, 0.5, 1.0, 2.0, 3.0])
    culprit = simulation.controls.not_finite(t) or not_finite(simulation.serial, ahead)
    if culprit:
        return f"{culprit} after t = {t:.6g} s"
    where = moves_most(simulation.serial, simulation.system) if status in ITERATED else ""
    if status in ITERATED and simulation.status is status:  # before the first step
        return with_hint(f"{status.value} in the search for the equilibrium{where}", START)
    return with_hint(f"{status.value} at t = {t:.6g} s{where}", MOTION.get(status))


def _summary(simulation: Simulation, case: str, reason: str, wall: float) -> dict[str, Any]:
    counters = simulation.system.counters
    return summary_of(simulation.system, case, reason) | {
        "steps": simulation.steps,
        "rejected_steps": simulation.rejected,
        "mass_factorizations": counters.mass_factorizations,
        "fallbacks": counters.fallbacks,
        "events": [{"name": name, "t": t} for name, t in simulation.events.fired],
        "stopped_by": simulation.events.stopped_by,
        "wall_seconds": wall,
        # without the first step, which factorises and loads compiled code
        "wall_seconds_steps": sum(simulation.step_seconds[1:]),
    }
