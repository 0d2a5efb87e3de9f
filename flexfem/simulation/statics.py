# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static equilibria: from a model and options to results in a folder."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path as FilePath
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._checks import InputError
from flexfem.analyses.statics import StaticOptions
from flexfem.core.status import Status
from flexfem.io.field_output import FieldOutput
from flexfem.launch import Interrupted, StopSignals
from flexfem.model.model import Model
from flexfem.simulation.checkpoints import Checkpoints, Restart
from flexfem.simulation.departures import Departures
from flexfem.simulation.equilibrium import check_held, rest
from flexfem.simulation.followed import Followed
from flexfem.simulation.interruption import Agreement, interruption
from flexfem.simulation.outcome import Outcome, Results, conclude, summary_of
from flexfem.simulation.path import CriticalPoint, Path
from flexfem.simulation.reasons import ITERATED, STATICS, moves_most, not_finite, with_hint
from flexfem.simulation.recording import Recorder
from flexfem.simulation.setup import set_up
from flexfem.simulation.time_grid import TimeGrid
from flexfem.solvers.buckling import LinearBuckling
from flexfem.solvers.statics import Equilibrium, Limits, settle
from flexfem.solvers.tangent import TangentSolver
from flexfem.system.probes import ProbeRecorder

__all__ = ["solve_static"]

#: What stands for no column.
_NONE = "none"
#: A step is halved this often before the run gives up.
_HALVINGS = 12
#: Iterations of an easy step, after which steps grow again.
_EASY = 5
#: Accuracy of the end of a run, relative to its value.
_EXACT = 1e-10
#: Largest rotation (rad) or relative displacement of an arc-length step.
_LARGEST_TURN = 0.15
#: Largest rotation (rad) or relative displacement in the picture of a mode.
_SHOWN = 0.1


def solve_static(
    model: Model,
    options: StaticOptions,
    *,
    case: str = "model",
    results: Results | None = None,
    comm: MPI.Intracomm | None = None,
) -> Outcome:
    """Follow a model's static equilibria and write the results (collective).

    Args:
        model: the model, the same on every rank.
        options: load steps, output folder and so on.
        case: name for the summary.
        results: function of the history's columns that returns the headline results.
        comm: communicator, all ranks by default.

    Returns:
        The outcome, the same status on every rank; the column ``t`` of the history is the load
        factor. The summary has ``critical_points`` and ``buckling`` loads besides the results.

    Raises:
        InputError: a mistake in the model, before anything is written (a ValueError).
        TypeError: the options are those of another analysis.
        OSError: the results cannot be written.
        KeyboardInterrupt: SIGINT or SIGTERM came; the path so far is written, and of load steps a
            checkpoint.
    """
    _checks.instance("solve_static", "options", options, StaticOptions)
    comm = comm or MPI.COMM_WORLD
    restart = None if options.restart is None else Restart(options, comm)
    run = _Run(model, options, case, results, comm, restart)
    with StopSignals() as signals:
        status = run.to_the_end(signals)
        if run.signal:
            raise run.interrupted()
        return run.finish(run.reason(status))


def _columns(probes: ProbeRecorder, equilibrium: Equilibrium) -> dict[str, float]:
    """The history's columns at the trial state, on the first rank (collective)."""
    equilibrium.react()
    probes.record(equilibrium.loading.t)
    for _, values in probes.flush():
        return dict(zip(probes.columns, values.tolist(), strict=True))
    return {}


class _Run:
    """One run from the start to the results.

    Attributes:
        signal: number of the signal that ended it early, 0 for none.
    """

    def __init__(
        self, model: Model, options: StaticOptions, case: str, results: Results | None,
        comm: MPI.Intracomm | None, restart: Restart | None = None,
    ) -> None:  # fmt: skip
        self._begin = time.perf_counter()
        self._options, self._case, self._results = options, case, results
        check = None if restart is None else restart.check
        self._serial, self.system = set_up(model, comm, options.split_above, check)
        self._probes = ProbeRecorder(self.system, self._serial, depth=1)
        self._check_column()
        self.equilibrium = rest(
            self._serial, self.system, TangentSolver(self.system),
            Limits(options.tolerance, options.max_iterations),
            span=options.t_end, grow=True, gravity_grows=options.gravity == "proportional",
            stabilise=options.stabilise,
        )  # fmt: skip
        if not options.stabilise:
            check_held(self._serial, self.equilibrium)
        self._departures = Departures(self.system, self._serial)
        self._columns = partial(_columns, self._probes, self.equilibrium)
        self._status = self._checked(settle(self.equilibrium))
        self._buckling = LinearBuckling(self.equilibrium) if options.buckling_modes else None
        self.followed = Followed(self.system, self.equilibrium, self._probes.columns)
        if restart is not None:
            self._go_on(restart)
        self._start = None if restart is None else restart.step
        self.path = Path(
            self.equilibrium, follow=options.arc_length > 0.0, count=options.critical_points,
            columns=self._columns,
        )  # fmt: skip
        if self._status is Status.OK and not self.path.aimed:
            raise InputError(
                f"StaticOptions: arc_length {options.arc_length:g} follows the path of a growing "
                f'load, but nothing in Model "{model.name}" that moves it grows with t'
            )
        self._recorder = Recorder(
            self.system, self._serial, options, options.every, options.t_end, unit="",
            varies=True, resume=None if restart is None else restart.state,
        )  # fmt: skip
        self._checkpoints = Checkpoints(
            self.followed, self._serial, options, TimeGrid(1.0, 1), restart
        )
        self._checkpoint: FilePath | None = None
        self.signal, self._agreement = 0, Agreement(self.system.comm)
        self._factors: list[float] = []
        self._setup: float | None = None
        self._first: float | None = None
        self._branched = options.branch == 0.0

    def _go_on(self, restart: Restart) -> None:
        """Put everything where the checkpoint left it (collective)."""
        restart.restore(self.followed, self.system)
        t, end = self.equilibrium.loading.t, self._options.t_end
        if t >= end * (1.0 - _EXACT):
            raise restart.refuse(f"is at t = {t:g} already, t_end = {end:g} leaves nothing to do")

    def _check_column(self) -> None:
        column = self._options.stop_column
        if column != _NONE and column not in self._probes.columns:
            raise InputError(
                f"StaticOptions: stop_column '{column}' is no column of the history, which has "
                f"{', '.join(self._probes.columns) or 'none'}"
            )

    def _beyond(self) -> float:
        """How far the column that ends the run lies above its value at the end."""
        value = self._columns().get(self._options.stop_column, 0.0)
        value = float(self.system.comm.bcast(value))
        return value - float(self._options.stop_value)

    def _elapsed(self) -> float:
        return time.perf_counter() - self._begin

    def to_the_end(self, signals: StopSignals) -> Status:
        """Take all steps, or those before the first that fails or a signal."""
        options, path, status = self._options, self.path, self._status
        if status is not Status.OK:
            return status
        if self._start is None:
            self._recorder.record(0)
            self._look(signals)
        self._setup = self._elapsed()
        h = options.t_end / options.load_steps
        if path.arc is not None:
            h = options.arc_length * options.t_end / path.arc.slope
        width, done, followed = h, False, self.followed
        h = min(h, followed.next or h)
        while not done:
            if path.arc is not None:
                h = min(h, _LARGEST_TURN / path.arc.largest_turn())
                if followed.steps == options.max_steps:
                    return Status.NOT_CONVERGED
            else:
                h = min(h, options.t_end - path.point.t)
            status, tried, done = self._advance(h, signals)
            if status is not Status.OK:
                self._recorder.record_last(followed.steps)
                followed.next = width
                self._save()
                return status
            h = followed.next = self._grown(tried, width)
            self._look(signals)
            every = options.checkpoint_every
            if self.signal or (every and (done or followed.steps % every == 0)):
                self._save()
            if self.signal:
                return status
        self._find_buckling()
        return status

    def _look(self, signals: StopSignals) -> None:
        """Look for signals, and show progress where it is time to (collective)."""
        self.signal = self._agreement.on(signals, self._recorder.due)
        if self._agreement.show:
            self._recorder.show()

    def _save(self) -> None:
        """Write a checkpoint of load steps."""
        if self.path.arc is None:
            records = self._recorder.state()
            self._checkpoint = self._checkpoints.write(self.followed.steps, records)

    def _grown(self, h: float, width: float) -> float:
        """Next step from the one just taken and its iterations."""
        iterations = self.equilibrium.iterations
        if self.path.arc is None:
            h *= min(2.0, self.equilibrium.room) if iterations <= _EASY else 1.0
            # back to where equal steps would be
            t = self.path.point.t
            left = (np.floor(t / width + 1e-9) + 1.0) * width - t
            return float(min(h, width, left if left > 1e-9 * width else width))
        return h * float(min(max((_EASY / iterations) ** 0.5, 0.5), 2.0))

    def _advance(self, h: float, signals: StopSignals) -> tuple[Status, float, bool]:
        """One accepted step of at most ``h``, its size, and whether the run has ended."""
        path, before = self.path, self._beyond() if self._options.stop_column != _NONE else 0.0
        self.followed.largest = max(self.followed.largest, h)
        smallest = self.followed.largest * 0.5**_HALVINGS
        status, end, critical = self._tried(h, before)
        while status not in (Status.OK, Status.LEFT) and h > smallest:
            self.followed.rejected += 1
            h *= self.equilibrium.cut
            status, end, critical = self._tried(h, before)
            self.signal = self.signal or self._agreement.on(signals)
            if self.signal:
                break
        if status is not Status.OK:
            path.return_to_base()
            return status, h, True
        self._accept(end and critical is None)
        if critical is not None:
            self.followed.critical.append(critical)
            status = self._branch_off(critical)
        return status, h, end and critical is None

    def _tried(self, h: float, before: float) -> tuple[Status, bool, CriticalPoint | None]:
        """Try one step, to the end of the run or the first critical point if these come first."""
        status, end, critical = self.path.attempt(h), False, None
        if status is Status.OK:
            status, end = self._end(h, before)
        if status is Status.OK:
            status, critical = self.path.critical_point()
        return self._checked(status), end, critical

    def _checked(self, status: Status) -> Status:
        """Status of a trial state, in which a slider may have left its carrier."""
        left = status is Status.OK and self._departures.found()
        return Status.LEFT if left else status

    def _accept(self, last: bool) -> None:
        self.path.accept()
        self.followed.steps += 1
        if self._first is None:
            self._first = self._elapsed()
        self._recorder.record(self.followed.steps, last=last)

    def _branch_off(self, critical: CriticalPoint) -> Status:
        """Leave the path at the first bifurcation, if that is asked for."""
        if self._branched or critical.kind != "bifurcation":
            return Status.OK
        self._branched = True
        status = self.path.branch_off(critical, self._options.branch)
        if status is Status.OK:
            self._accept(last=False)
        else:
            self.path.return_to_base()
        return status

    def _end(self, h: float, before: float) -> tuple[Status, bool]:
        """Move the trial state back to the end if the step has passed it."""
        path, options = self.path, self._options
        if options.stop_column != _NONE:
            after = self._beyond()
            if after == 0.0 or (before != 0.0 and (before > 0.0) != (after > 0.0)):
                near = _EXACT * max(abs(after), abs(before))
                return path.search(self._beyond, (0.0, h), (before, after), near), True
        ends = path.point.t - options.t_end, path.trial.t - options.t_end
        if ends[1] < -_EXACT * options.t_end:
            return Status.OK, False
        if path.arc is None:
            return Status.OK, True
        return path.search(
            lambda: path.trial.t - options.t_end, (0.0, h), ends, _EXACT * options.t_end
        ), True

    def _find_buckling(self) -> None:
        """Linearised buckling loads; pictures of all modes."""
        found = self._buckling.solve(self._options.buckling_modes) if self._buckling else []
        self._factors = [t for t, _ in found]
        if self._options.output is None:
            return
        modes = [(c.t, c.motion) for c in self.followed.critical if c.kind == "bifurcation"] + found
        fields = FieldOutput(self._options.output / "modes", self.system, self._serial)
        base = self.equilibrium.keep()
        for number, (t, motion) in enumerate(modes):
            for part, steps in zip(self.system.parts, motion, strict=True):
                part.block.owned_step[:] = steps
            size, turn, _ = self.equilibrium.measure(np.zeros(0))
            self.equilibrium.move(
                _SHOWN / max(size, turn), np.zeros(self.system.constraints.size), 0.0
            )
            self.system.interface.update()
            fields.write(t, number)
            self.equilibrium.restore(base)
        fields.close()

    def interrupted(self) -> Interrupted:
        """Write what is left and the summary; the exception that ends the run (collective)."""
        reason = f"interrupted at t = {self.path.point.t:.6g}"
        return interruption(self.signal, reason, self._checkpoint, self.finish(reason))

    def reason(self, status: Status) -> str:
        """The status in words, with the load factor, where, and what to try (collective)."""
        if status is Status.OK:
            return "ok"
        t, options = self.equilibrium.loading.t, self._options
        if status is Status.LEFT:
            return f"{self._departures.reason} after t = {t:.6g}"
        if self.followed.steps == options.max_steps:
            return with_hint(
                f"not at the end after {options.max_steps} arc-length steps, t = {t:.6g}",
                "take more max_steps or a larger arc_length, or a stop_value that is reached",
            )
        h = options.t_end / options.load_steps
        culprit = not_finite(self._serial, t + h * np.array([0.5**_HALVINGS, 0.5, 1.0]))
        if culprit:
            return f"{culprit} after t = {t:.6g}"
        where = moves_most(self._serial, self.system) if status in ITERATED else ""
        return with_hint(f"{status.value} at t = {t:.6g}{where}", STATICS.get(status))

    def finish(self, reason: str) -> Outcome:
        """Write what is left and the summary (collective)."""
        self._recorder.close()
        history, summary = self._recorder.history(), self._summary(reason)
        return conclude(summary, history, self._results, self._options, self.system.comm)

    def _summary(self, reason: str) -> dict[str, Any]:
        return summary_of(self.system, self._case, reason) | {
            "steps": self.followed.steps,
            "rejected_steps": self.followed.rejected,
            "restarted_at_step": self._start,
            "wall_seconds": self._elapsed(),
            "wall_seconds_setup": self._setup or self._elapsed(),
            "wall_seconds_first_step": self._first,
            "critical_points": [point.summary() for point in self.followed.critical],
            "buckling": self._factors,
        }
