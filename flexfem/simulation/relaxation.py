# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dynamic relaxation: from a model and options to results in a folder."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._faults import current
from flexfem.analyses.relaxation import RelaxationOptions
from flexfem.integrators.start import check_start
from flexfem.launch import Interrupted, StopSignals
from flexfem.model.model import Model
from flexfem.simulation.cautions import Cautions
from flexfem.simulation.checkpoints import Checkpoints, Restart
from flexfem.simulation.functions_alike import FunctionsAlike
from flexfem.simulation.interruption import Agreement, interruption
from flexfem.simulation.outcome import Outcome, Results, conclude, summary_of
from flexfem.simulation.reasons import RELAXATION, not_finite, with_hint
from flexfem.simulation.recording import Recorder, closing_table
from flexfem.simulation.run_guard import guarded, reason_of
from flexfem.simulation.setup import set_up
from flexfem.simulation.time_grid import TimeGrid
from flexfem.solvers.relaxation import Progression, Relaxation, Scheme
from flexfem.solvers.tangent import TangentSolver
from flexfem.system.extent import model_extent

__all__ = ["relax"]

#: Columns of the history before those of the probes.
_COLUMNS = ("residual", "largest_step", "pseudo_energy")


def relax(
    model: Model,
    options: RelaxationOptions,
    *,
    case: str = "model",
    results: Results | None = None,
    comm: MPI.Intracomm | None = None,
) -> Outcome:
    """Bring a model to equilibrium by dynamic relaxation and write the results (collective).

    Inertia, dampers and friction of joints do not act.

    Args:
        model: the model, the same on every rank.
        options: tolerances, damping, output folder and so on.
        case: name for the summary.
        results: function of the history's columns that returns the headline results.
        comm: communicator, all ranks by default.

    Returns:
        The outcome, the same status on every rank; not "ok" without convergence. In the history
        ``t`` counts iterations; ``residual`` is the norm of the forces out of balance relative to
        that of the applied ones (to its first value where none are applied), ``largest_step`` the
        largest displacement in an iteration relative to the size of the model, or rotation (rad),
        and ``pseudo_energy`` the kinetic energy of the fictitious motion.

    Raises:
        InputError: a mistake in the model, before anything is written (a ValueError).
        TypeError: the options are those of another analysis.
        FunctionError: a function of the model failed after the start; a checkpoint and what was
            computed are written (a RuntimeError).
        OSError: the results cannot be written.
        KeyboardInterrupt: SIGINT, SIGTERM or SIGHUP came; a checkpoint and what was computed are
            written.
    """
    _checks.instance("relax", "options", options, RelaxationOptions)
    begin = time.perf_counter()
    comm = comm or MPI.COMM_WORLD
    with guarded(options, comm) as faults:
        restart = None if options.restart is None else Restart(options, comm)
        run = _Run(model, options, case, results, comm, restart, begin)
        with closing_table(run.recorder), StopSignals() as signals:
            run.to_the_end(signals)
            if run.signal:
                raise run.interrupted()
            when = f" after {run.relaxation.iteration} iterations"
            return run.finish(reason_of(faults, comm, when, run.reason))


class _Run:
    """One run from the start, or from a checkpoint, to the results.

    Attributes:
        signal: number of the signal that ended it early, 0 for none.
        recorder: history, fields and progress.
    """

    def __init__(
        self, model: Model, options: RelaxationOptions, case: str, results: Results | None,
        comm: MPI.Intracomm, restart: Restart | None, begin: float,
    ) -> None:  # fmt: skip
        self._begin, self._options, self._case, self._results = begin, options, case, results
        self._serial, self.system = set_up(
            model, comm, options.split_above, kernels=options.kernels
        )
        self._cautions = Cautions(self._serial, options, self.system)
        if restart is not None:
            restart.check(self._serial)
        self.system.set_time(options.at_time)
        if restart is None:
            check_start(self.system)
        self.relaxation = Relaxation(
            TangentSolver(self.system), model_extent(self._serial), _scheme(options),
            at_time=options.at_time, fresh=restart is None,
        )  # fmt: skip
        if restart is not None:
            restart.restore(self.relaxation, self.relaxation.system)
        self.recorder = Recorder(
            self.system, self._serial, options, options.every, float(options.max_iterations),
            resume=None if restart is None else restart.state, unit="", measures=_COLUMNS,
        )  # fmt: skip
        self._start = None if restart is None else restart.step
        self._checkpoints = Checkpoints(
            self.relaxation, self._serial, options, TimeGrid(1.0, 1), restart
        )
        self._checkpoint: Path | None = None
        self._finite = True
        self._setup: float | None = None
        self._iterating = 0.0
        functions = FunctionsAlike(self.system, self._serial.model)
        self.signal, self._agreement = 0, Agreement(comm, functions)

    def _elapsed(self) -> float:
        return time.perf_counter() - self._begin

    def to_the_end(self, signals: StopSignals) -> None:
        """Iterate to convergence, or as far as it goes."""
        options, relaxation = self._options, self.relaxation
        self._cautions.say()
        done = False
        if self._start is None:
            self._finite = relaxation.evaluate()
            self._record(last=not self._finite)
            done = self._converged(relaxation.progress)
            self._look(signals)
        self._setup = self._elapsed()
        while self._finite and not done:
            self._finite = relaxation.advance()
            at = relaxation.iteration
            if self._finite and at % options.record_every and at < options.max_iterations:
                continue
            self._finite = self._finite and relaxation.evaluate()
            done = self._converged(relaxation.progress) or at >= options.max_iterations
            self._record(last=done or not self._finite)
            self._look(signals)
            self._save_if_due(done)
            if self.signal or self._agreement.failed:
                break
        self._iterating = self._elapsed() - self._setup

    def _look(self, signals: StopSignals) -> None:
        """Look for signals, and show progress where it is time to (collective)."""
        self.signal = self._agreement.on(signals, self.recorder.due)
        if self._agreement.show:
            self.recorder.show()

    def _converged(self, reached: Progression) -> bool:
        """Whether both measures are below their tolerances."""
        options = self._options
        return reached.residual <= options.tolerance and reached.step <= options.step_tolerance

    def _record(self, last: bool) -> None:
        relaxation = self.relaxation
        relaxation.settle()
        reached = relaxation.progress
        values = np.array([reached.residual, reached.step, reached.energy])
        self.recorder.record(relaxation.iteration, last=last, measures=values)

    def _save_if_due(self, done: bool) -> None:
        """Write a checkpoint at its interval, at the end, or if the run ends early."""
        every, at = self._options.checkpoint_every, self.relaxation.iteration
        early = (
            self.signal
            or self._agreement.failed
            or (done and not self._converged(self.relaxation.progress))
        )
        if self._finite and (early or (every and (done or at % every == 0))):
            with current().files():
                self._checkpoint = self._checkpoints.write(at, self.recorder.state())

    def interrupted(self) -> Interrupted:
        """Write what is left and the summary; the exception that ends the run (collective)."""
        reason = f"interrupted at iteration {self.relaxation.iteration}"
        outcome = self.finish(reason)
        return interruption(self.signal, reason, self._checkpoint, outcome)

    def reason(self) -> str:
        """The status in words."""
        reached, at = self.relaxation.progress, self.relaxation.iteration
        if self._finite and self._converged(reached):
            return "ok"
        if self._finite:
            return with_hint(
                f"not in equilibrium after {at} iterations: residual {reached.residual:.3g} of the "
                f"applied forces, largest step {reached.step:.3g}",
                RELAXATION[0],
            )
        if culprit := not_finite(self._serial, np.array([self._options.at_time])):
            return f"{culprit} after {at} iterations"
        return with_hint(f"the relaxation diverged after {at} iterations", RELAXATION[1])

    def finish(self, reason: str) -> Outcome:
        """Write what is left and the summary (collective)."""
        self.recorder.close()
        history, summary = self.recorder.history(), self._summary(reason)
        return conclude(summary, history, self._results, self._options, self.system.comm)

    def _summary(self, reason: str) -> dict[str, Any]:
        reached = self.relaxation.progress
        return summary_of(self.system, self._case, reason) | {
            "steps": self.relaxation.iteration,
            "renewals": self.relaxation.renewals,
            "residual": reached.residual,
            "largest_step": reached.step,
            "restarted_at_step": self._start,
            "wall_seconds": self._elapsed(),
            "wall_seconds_setup": self._setup or self._elapsed(),
            "wall_seconds_steps": self._iterating,
            "warnings": self._cautions.texts,
        }


def _scheme(options: RelaxationOptions) -> Scheme:
    return Scheme(
        damping=options.damping,
        margin=options.margin,
        least=options.least_mass,
        physical=options.masses == "scaled",
        renew=options.renew_every,
    )
