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
from flexfem._faults import current
from flexfem.analyses.statics import StaticOptions
from flexfem.core.status import Status
from flexfem.io.field_output import FieldOutput
from flexfem.launch import Interrupted, StopSignals
from flexfem.model.contact import Contact
from flexfem.model.measured import EnergyProbe
from flexfem.model.model import Model
from flexfem.simulation.cautions import Cautions
from flexfem.simulation.checkpoints import Checkpoints, Restart
from flexfem.simulation.departures import Departures
from flexfem.simulation.equilibrium import check_held, rest
from flexfem.simulation.followed import Followed
from flexfem.simulation.functions_alike import FunctionsAlike
from flexfem.simulation.inside_out import inside_out
from flexfem.simulation.interruption import Agreement, interruption
from flexfem.simulation.locked_shapes import locked_shapes
from flexfem.simulation.outcome import Outcome, Results, conclude, summary_of
from flexfem.simulation.path import CriticalPoint, Path
from flexfem.simulation.reasons import ITERATED, STATICS, moves_most, not_finite, with_hint
from flexfem.simulation.recording import Recorder, closing_table
from flexfem.simulation.run_guard import agreed, guarded, reason_of
from flexfem.simulation.setup import set_up
from flexfem.simulation.targets import LOAD, Targets
from flexfem.simulation.time_grid import TimeGrid
from flexfem.solvers.buckling import LinearBuckling
from flexfem.solvers.linear_statics import solve_linear
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
#: Part of a linear solution above which what it neglects is warned of.
_NEGLECTED = 0.01
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
        FunctionError: a function of the model failed after the start (a RuntimeError); the path so
            far is written, and of load steps a checkpoint.
        OSError: the results cannot be written.
        KeyboardInterrupt: SIGINT, SIGTERM or SIGHUP came; the same is written.
    """
    _checks.instance("solve_static", "options", options, StaticOptions)
    comm = comm or MPI.COMM_WORLD
    with guarded(options, comm) as faults:
        restart = None if options.restart is None else Restart(options, comm)
        run = _Run(model, options, case, results, comm, restart)
        with closing_table(run.recorder), StopSignals() as signals:
            status = run.to_the_end(signals)
            if run.signal:
                raise run.interrupted()
            when = f" after t = {run.equilibrium.loading.t:.6g}"
            return run.finish(reason_of(faults, comm, when, lambda: run.reason(status)))


def _columns(probes: ProbeRecorder, equilibrium: Equilibrium) -> dict[str, float]:
    """The history's columns at the trial state, on the first rank (collective)."""
    equilibrium.react()
    probes.record(equilibrium.loading.t)
    for _, values in probes.flush():
        return dict(zip(probes.columns, values.tolist(), strict=True))
    return {}


def _too_large(part: float, size: float) -> str:
    """Words on a linear solution that neglects a part of itself."""
    share = f"{100.0 * part:.3g} %" if part < 1.0 else "more than 100 %"
    return (
        f"linear: the next iteration would change {share} of the solution, whose "
        f"largest rotation (rad) or relative displacement is {size:.3g}; leave out linear"
    )


class _Run:
    """One run from the start to the results.

    Attributes:
        signal: number of the signal that ended it early, 0 for none.
        recorder: history, fields and progress.
    """

    def __init__(
        self, model: Model, options: StaticOptions, case: str, results: Results | None,
        comm: MPI.Intracomm | None, restart: Restart | None = None,
    ) -> None:  # fmt: skip
        self._begin = time.perf_counter()
        self._options, self._case, self._results = options, case, results
        check = None if restart is None else restart.check
        self._serial, self.system = set_up(
            model, comm, options.split_above, check, kernels=options.kernels
        )
        self._cautions = Cautions(self._serial, options, self.system)
        self._probes = ProbeRecorder(self.system, self._serial, depth=1)
        self._check_column()
        self._targets = Targets(options.output_at, self._probes.columns, options.t_end)
        self._reached: list[tuple[str, float]] = []
        self.equilibrium = rest(
            self._serial, self.system, TangentSolver(self.system),
            Limits(options.tolerance, options.max_iterations),
            span=options.t_end, grow=True, gravity_grows=options.gravity_load == "proportional",
            stabilise=options.stabilise,
        )  # fmt: skip
        if not options.stabilise:
            check_held(self._serial, self.equilibrium)
        self._departures = Departures(self.system, self._serial)
        self._inverted = ""
        self._columns = partial(_columns, self._probes, self.equilibrium)
        self._neglected: dict[str, float] = {}
        if options.linear:
            self._check_linear(model)
        status = Status.OK if options.linear else settle(self.equilibrium)
        self._status = self._checked(status)
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
        self.recorder = Recorder(
            self.system, self._serial, options, options.every, options.t_end, unit="",
            varies=True, resume=None if restart is None else restart.state,
        )  # fmt: skip
        self._checkpoints = Checkpoints(
            self.followed, self._serial, options, TimeGrid(1.0, 1), restart
        )
        self._checkpoint: FilePath | None = None
        functions = FunctionsAlike(self.system, self._serial.model)
        self.signal, self._agreement = 0, Agreement(self.system.comm, functions)
        self._stopped = options.stop_column == _NONE
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
        self._cautions.say()
        if status is not Status.OK:
            return status
        if self._start is None:
            self.recorder.record(0)
            self._look(signals)
        self._setup = self._elapsed()
        if options.linear:
            return self._linear(signals)
        h = options.t_end / options.load_steps
        if path.arc is not None:
            h = options.arc_length * options.t_end / path.arc.slope
        width, done, followed = h, False, self.followed
        h = min(h, followed.next or h)
        while not done:
            if path.arc is not None:
                h = min(h, options.max_step / path.arc.largest_turn())
                if followed.steps == options.max_steps:
                    return Status.NOT_CONVERGED
            else:
                t = path.point.t
                h = min(h, options.t_end - t, self._targets.room(t))
            status, tried, done = self._advance(h, signals)
            if status is not Status.OK:
                self._look(signals)  # functions that differ between ranks may be why
                self.recorder.record_last(followed.steps + 1)
                followed.next = width
                self._save()
                return status
            h = followed.next = self._grown(tried, width)
            self._look(signals)
            early, every = self.signal or self._agreement.failed, options.checkpoint_every
            if early or (every and (done or followed.steps % every == 0)):
                self._save()
            if early:
                return status
        self._find_buckling()
        return status

    def _check_linear(self, model: Model) -> None:
        """Raise for what has no meaning to first order: energies, and contacts that open or close.

        Raises:
            InputError: names it.
        """
        found: list[Contact | EnergyProbe] = list(model.contacts)
        found += [probe for probe in model.probes if isinstance(probe, EnergyProbe)]
        for thing in found:
            raise InputError(
                f'{type(thing).__name__} "{thing.name}": linear statics has none, leave out linear'
            )
        for name in self._targets.values:
            if name != LOAD:
                raise InputError(
                    "StaticOptions: linear solutions are for load factors, output_at names "
                    f"'{name}'"
                )

    def _linear(self, signals: StopSignals) -> Status:
        """A linear solution for each load factor that is asked for, and for the end."""
        equilibrium, followed = self.equilibrium, self.followed
        start = equilibrium.keep()
        for t in sorted({*self._targets.values.get(LOAD, ()), self._options.t_end}):
            solution = solve_linear(equilibrium, start, t)
            if solution is None:
                return Status.SINGULAR
            values = solution.columns(equilibrium, self._columns)
            part = solution.neglected(equilibrium)
            self._neglected = {"neglected": part, "largest": solution.size}
            if t == self._options.t_end and part > _NEGLECTED:
                self._cautions.say([_too_large(part, solution.size)])
            followed.steps += 1
            self._targets.note((), t)
            self.recorder.record_values(followed.steps, values)
            self._look(signals)
            if self.signal or self._agreement.failed:
                break
        return Status.OK

    def _look(self, signals: StopSignals) -> None:
        """Look for signals, and show progress where it is time to (collective)."""
        self.signal = self._agreement.on(signals, self.recorder.due)
        if self._agreement.show:
            self.recorder.show()

    def _save(self) -> None:
        """Write a checkpoint of load steps."""
        if self.path.arc is None:
            with current().files():
                records = self.recorder.state()
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
        self._before = self._wanted(path.point.t)
        status, end, critical = self._tried(h, before)
        while status not in (Status.OK, Status.LEFT) and h > smallest:
            if agreed(current(), self.system.comm) is not None:  # smaller steps do not help
                break
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
        self._reached = []
        if status is Status.OK:
            status, end = self._end(h, before)
        if status is Status.OK:
            status = self._meet()
        if status is Status.OK:
            status, critical = self.path.critical_point()
        if critical is not None:
            self._reached = []
        return self._checked(status), end and not self._reached, critical

    def _wanted(self, t: float) -> dict[str, float]:
        """Columns whose values the path is to meet, at the trial state (collective).

        Load steps end at load factors anyhow.
        """
        names = [name for name in self._targets.values if name != LOAD]
        columns = self._columns() if names else {}
        found = {name: columns.get(name, 0.0) for name in names}
        if self.path.arc is not None and LOAD in self._targets.values:
            found[LOAD] = t
        return dict(self.system.comm.bcast(found)) if found else found

    def _meet(self) -> Status:
        """Move the trial state back to the first value of output_at that the step has passed."""
        path = self.path

        def beyond(name: str, value: float) -> float:
            return self._wanted(path.trial.t)[name] - value

        tried: list[tuple[str, float]] = []
        while self._before:
            crossing = self._targets.crossing(self._before, self._wanted(path.trial.t), tried)
            if crossing is None:
                break
            name, value, ends = crossing
            near = _EXACT * abs(ends[0] - ends[1])
            status = path.search(partial(beyond, name, value), (0.0, path.tried), ends, near)
            if status is not Status.OK:
                return status
            tried.append((name, value))
            self._reached = tried[-1:]
        return Status.OK

    def _checked(self, status: Status) -> Status:
        """Status of a trial state: a slider may have left its carrier, a body be inside out."""
        if status is not Status.OK:
            return status
        if self._departures.found():
            return Status.LEFT
        self._inverted = inside_out(self._serial, self.system)
        return Status.INSIDE_OUT if self._inverted else Status.OK

    def _accept(self, last: bool) -> None:
        self.path.accept()
        self.followed.steps += 1
        if self._first is None:
            self._first = self._elapsed()
        noted = self._targets.note(self._reached, self.path.point.t)
        self.recorder.record(self.followed.steps, last=last or noted)

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
            self._stopped = after == 0.0 or (before != 0.0 and (before > 0.0) != (after > 0.0))
            if self._stopped:
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
        t, options = self.equilibrium.loading.t, self._options
        if status is Status.OK:
            return "ok" if self._stopped else self._unreached()
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
        text = self._inverted if status is Status.INSIDE_OUT else status.value
        return with_hint(f"{text} at t = {t:.6g}{where}", STATICS.get(status))

    def _unreached(self) -> str:
        """The run came to ``t_end`` before the column had its value (collective)."""
        options = self._options
        wanted, last = options.stop_value, options.stop_value + self._beyond()
        return with_hint(
            f"stop_value {wanted:g} of {options.stop_column} not reached: {last:g} at "
            f"t = {options.t_end:g}",
            "take a larger t_end, or a value of the other sign if the column moves away from it",
        )

    def finish(self, reason: str) -> Outcome:
        """Write what is left and the summary (collective)."""
        self.recorder.close()
        if reason == "ok":
            self._cautions.say(self._targets.missed)
        self._cautions.say(locked_shapes(self._serial, self.system))
        history, summary = self.recorder.history(), self._summary(reason)
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
            "output_at": self._targets.met,
            "linear": self._neglected or None,
            "warnings": self._cautions.texts,
        }
