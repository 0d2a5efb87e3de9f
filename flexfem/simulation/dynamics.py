# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion in time: from a model and options to results in a folder."""

from __future__ import annotations

import time
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem.core.status import Status
from flexfem.io.summary import write_summary
from flexfem.model.model import Model
from flexfem.options import RunOptions
from flexfem.simulation.outcome import Outcome, Results
from flexfem.simulation.reasons import not_finite
from flexfem.simulation.recording import Recorder
from flexfem.simulation.stepping import HALVINGS, Simulation

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
        self._recorder = Recorder(
            simulation.system, simulation.serial, options, options.every, options.t_end
        )
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
        if options.adaptive:
            simulation.observe = self._recorder.record_between
        count = max(1, round(options.t_end / options.dt))
        for step in range(1, count + 1):
            status = simulation.advance(options.t_end / count, options.t_end * step / count)
            if step == 1:
                self._first = self._elapsed()
            if status is not Status.OK:
                self._recorder.record_last(step)
                break
            stopped = simulation.events.stopped_by is not None
            self._recorder.record(step, last=stopped or step == count)
            if stopped:
                break
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
    t = simulation.time
    if status is Status.EVENT:
        if simulation.events.bad is not None:
            name = simulation.events.bad
            return f'Event "{name}": the function is not finite after t = {t:.6g} s'
        name = simulation.events.fired[-1][0]
        return (
            f'Event "{name}": too many in one step at t = {t:.6g} s (what bounces comes to rest '
            "with a rest_speed)"
        )
    # the start looks three steps ahead to differentiate drives
    ahead = t + options.dt * np.array([0.5**HALVINGS, 0.5, 1.0, 2.0, 3.0])
    culprit = not_finite(simulation.serial, ahead)
    return f"{culprit} after t = {t:.6g} s" if culprit else f"{status.value} at t = {t:.6g} s"


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
        "events": [{"name": name, "t": t} for name, t in simulation.events.fired],
        "stopped_by": simulation.events.stopped_by,
        "wall_seconds": wall,
        # without the first step, which factorises and loads compiled code
        "wall_seconds_steps": sum(simulation.step_seconds[1:]),
        "status": reason,
        "results": {},
    }
