# SPDX-License-Identifier: LGPL-3.0-or-later
"""The run loop of all analyses: steps, records, checkpoints, signals and the summary."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mpi4py import MPI

from flexfem._faults import current
from flexfem._types import FloatArray
from flexfem.analyses.dynamics import RunOptions
from flexfem.analyses.relaxation import RelaxationOptions
from flexfem.analyses.statics import StaticOptions
from flexfem.core.status import Status
from flexfem.launch import Interrupted, StopSignals
from flexfem.simulation.run.cautions import Cautions
from flexfem.simulation.run.checkpoints import Checkpoints, Restart
from flexfem.simulation.run.disk_room import lack_of_room
from flexfem.simulation.run.functions_alike import NONE, FunctionsAlike
from flexfem.simulation.run.guard import guarded, reason_of
from flexfem.simulation.run.interruption import Agreement, interruption
from flexfem.simulation.run.outcome import Outcome, Results, conclude, summary_of
from flexfem.simulation.run.recording import Records, closing_table

__all__ = ["Run", "Steps", "carry_out"]

_Options = RunOptions | RelaxationOptions | StaticOptions


class Steps:
    """Steps of one analysis, taken and recorded one after the other by a :class:`Run`.

    Attributes:
        system: the assembled system, or another object with a communicator ``comm``.
        functions: comparison of user-defined functions between the ranks, or None.
        cautions: warnings of the run.
        recorder: history, fields and progress.
        checkpoints: writer of the state between steps.
        status: status of the start of the analysis.
        done: True if the analysis is complete.
    """

    system: Any
    functions: FunctionsAlike | None
    cautions: Cautions
    recorder: Records
    checkpoints: Checkpoints
    status: Status = Status.OK
    done: bool = False

    @property
    def completed(self) -> int | None:
        """Number of the last completed step for a checkpoint, None if none can be written."""
        raise NotImplementedError

    @property
    def further_instants(self) -> int:
        """Number of instants of fields to be written after the start; zero if it is not known."""
        return 0

    @property
    def at(self) -> str:
        """Position of the accepted state, such as "t = 0.1 s"."""
        raise NotImplementedError

    @property
    def after(self) -> str:
        """Progress of the computation, such as "t = 0.1 s"."""
        return self.at

    @property
    def outputs(self) -> FloatArray:
        """Outputs of controllers at the accepted state, the same on all ranks."""
        return NONE

    def record_start(self) -> None:
        """Record the start of a run that is not resumed from a checkpoint (collective)."""
        raise NotImplementedError

    def begin(self) -> None:
        """Prepare for the first step, once the start is recorded (collective)."""

    def take(self, stopping: Callable[[], bool]) -> Status:
        """Take the next step and, unless it fails, record it (collective).

        Args:
            stopping: returns True if a signal ends the run (collective), for long steps.
        """
        raise NotImplementedError

    def record_failure(self) -> None:
        """Record the state before a step that has failed (collective)."""

    def finish(self) -> None:
        """Compute the results after the last step of a complete run (collective)."""

    def reason(self, status: Status) -> str:
        """The status in words, "ok" for a complete run (collective)."""
        raise NotImplementedError

    def look_back(self, reason: str, history: Mapping[str, FloatArray]) -> None:
        """Add the warnings known at the end only (collective); the first rank has the history."""

    def common(self, case: str, reason: str) -> dict[str, Any]:
        """Entries of ``summary.json`` on sizes, counts and status."""
        return summary_of(self.system, case, reason)

    def summary(self) -> dict[str, Any]:
        """Entries of ``summary.json`` of this analysis only."""
        raise NotImplementedError


def carry_out(
    prepare: Callable[[Restart | None], Steps], options: _Options, comm: MPI.Intracomm, case: str,
    results: Results | None,
) -> Outcome:  # fmt: skip
    """Run an analysis to its end and write the results (collective).

    Args:
        prepare: creates the steps of the analysis, from a checkpoint if there is one.
        options: of the analysis.
        comm: communicator of all ranks.
        case: name for the summary.
        results: function of the history's columns that returns the headline results.

    Raises:
        InputError: a mistake in the model or the options, before anything is written.
        FunctionError: a function of the model failed after the start.
        OSError: the results cannot be written.
        KeyboardInterrupt: SIGINT, SIGTERM or SIGHUP came.
    """
    begin = time.perf_counter()
    with guarded(options, comm) as faults:
        restart = None if options.restart is None else Restart(options, comm)
        steps = prepare(restart)
        run = Run(steps, options, case, results, begin, None if restart is None else restart.step)
        with closing_table(steps.recorder), StopSignals() as signals:
            status = run.to_the_end(signals)
            if run.signal:
                raise run.interrupted()
            after = f" after {steps.after}"
            return run.finish(reason_of(faults, comm, after, lambda: steps.reason(status)))


class Run:
    """One run from the start, or from a checkpoint, to the results.

    Attributes:
        signal: number of the signal that ended it early, 0 for none.
    """

    def __init__(
        self, steps: Steps, options: _Options, case: str = "model",
        results: Results | None = None, begin: float = 0.0, start: int | None = None,
    ) -> None:  # fmt: skip
        """Store the steps; nothing is run yet.

        Args:
            steps: of the analysis.
            options: of the analysis.
            case: name for the summary.
            results: function of the history's columns that returns the headline results.
            begin: reading of ``time.perf_counter`` when the run began, s.
            start: step of the checkpoint from which the run is resumed, None without one.
        """
        self._steps, self._options, self._case, self._results = steps, options, case, results
        self._begin, self._start = begin, start
        self.signal, self._agreement = 0, Agreement(steps.system.comm, steps.functions)
        self._checkpoint: Path | None = None
        self._setup: float | None = None
        self._first: float | None = None

    def _elapsed(self) -> float:
        return time.perf_counter() - self._begin

    def to_the_end(self, signals: StopSignals) -> Status:
        """Take all steps, or those before the first that fails or a signal (collective)."""
        steps, status = self._steps, self._steps.status
        steps.cautions.say()
        if status is not Status.OK:
            return status
        if self._start is None:
            steps.record_start()
            steps.cautions.say(
                lack_of_room(self._options.output, steps.further_instants, steps.system.comm)
            )
            self._look(signals)
        self._setup = self._elapsed()
        steps.begin()
        return self._to_the_last(signals)

    def _to_the_last(self, signals: StopSignals) -> Status:
        steps, every = self._steps, self._options.checkpoint_every

        def stopping() -> bool:
            return bool(self._agreement.on(signals))

        status, early = Status.OK, False
        while not (steps.done or early):
            status = steps.take(stopping)
            self._first = self._first or self._elapsed()
            self._look(signals)  # a step may fail because functions differ between ranks
            failed = status is not Status.OK
            if failed:
                steps.record_failure()
            early = bool(failed or self.signal or self._agreement.failed)
            step = steps.completed
            if step is not None and (early or (every and (steps.done or step % every == 0))):
                self._save(step)
        if not early:
            steps.finish()
        return status

    def _look(self, signals: StopSignals) -> None:
        """Check for signals, and show progress if it is due (collective)."""
        recorder, agreement = self._steps.recorder, self._agreement
        self.signal = agreement.on(signals, recorder.due, self._steps.outputs)
        if agreement.show:
            recorder.show()

    def _save(self, step: int) -> None:
        """Write a checkpoint; an error of the disk is recorded."""
        with current().files():
            steps = self._steps
            self._checkpoint = steps.checkpoints.write(step, steps.recorder.state())

    def interrupted(self) -> Interrupted:
        """Write the remaining records and the summary; return the exception (collective)."""
        reason = f"interrupted at {self._steps.at}"
        return interruption(self.signal, reason, self._checkpoint, self.finish(reason))

    def finish(self, reason: str) -> Outcome:
        """Write the remaining records and the summary (collective)."""
        steps, wall = self._steps, self._elapsed()
        steps.recorder.close()
        history = steps.recorder.history()
        steps.look_back(reason, history)
        summary = steps.common(self._case, reason) | steps.summary() | {
            "restarted_at_step": self._start,
            "wall_seconds": wall,
            "wall_seconds_setup": self._setup or wall,
            "wall_seconds_first_step": self._first,
            "warnings": steps.cautions.texts,
        }  # fmt: skip
        return conclude(summary, history, self._results, self._options, steps.system.comm)
