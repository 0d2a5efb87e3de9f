# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion in time of equations in a vector of coordinates: the same output as of a model.

Every rank solves the same equations, the first one writes.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._faults import FAILURES, ReturnError, current, noted, where
from flexfem._types import FloatArray
from flexfem.analyses.dynamics import RunOptions
from flexfem.core.equations import Equations, Motion, Stepper
from flexfem.core.state import Numbering, State, counts
from flexfem.core.status import Status
from flexfem.integrators.vector_alpha import VectorAlpha
from flexfem.io.atomic import raise_together
from flexfem.io.history import AngleColumns, FolderLostError, HistoryWriter
from flexfem.io.paraview_state import write_paraview_state
from flexfem.io.progress import Progress
from flexfem.io.summary import remove_summary
from flexfem.io.vtu_series import VtuSeries
from flexfem.launch import Interrupted, StopSignals
from flexfem.simulation.checkpoints import Checkpoints, Restart
from flexfem.simulation.interruption import Agreement, interruption
from flexfem.simulation.outcome import Outcome, Results, conclude
from flexfem.simulation.reasons import EQUATIONS, with_hint
from flexfem.simulation.recording import last_record
from flexfem.simulation.run_guard import agreed, guarded, reason_of, refuse
from flexfem.simulation.time_grid import TimeGrid

__all__ = ["Source", "simulate_equations"]

#: Halvings of a step that fails.
_HALVINGS = 6
#: Series that a run of a multibody model may have left in the folder.
_OF_MODELS = (
    "beams", "beam_surfaces", "shells", "floating_bodies", "floating_lines", "rigid_bodies",
    "joints", "reactions", "contact_surfaces",
)  # fmt: skip
#: Options of multibody models that equations know nothing of, with the values they must have.
_FOREIGN = {
    "integrator": "generalized_alpha", "redundant_constraints": "refuse", "start": "given",
    "adaptive": False, "kernels": "fast",
}  # fmt: skip


class Source(Protocol):
    """What a case builds; ``drivers`` names this module's function."""

    drivers: Mapping[str, str]

    def validate(self) -> None:
        """Check the data.

        Raises:
            ValueError: something does not fit.
        """

    def equations(self, comm: MPI.Intracomm) -> Equations:
        """The equations, the same on every rank (collective).

        Raises:
            ValueError: something does not fit.
        """


def simulate_equations(
    source: Source,
    options: RunOptions,
    *,
    case: str = "equations",
    results: Results | None = None,
    comm: MPI.Intracomm | None = None,
) -> Outcome:
    """Run equations of motion to the end and write the results (collective).

    Args:
        source: what has the equations, the same on every rank.
        options: step size, end, output folder and so on.
        case: name for the summary.
        results: function of the history's columns that returns the headline results.
        comm: communicator, all ranks by default.

    Returns:
        The outcome, the same status on every rank.

    Raises:
        InputError: a mistake in the data, or an option that has no meaning here, before anything is
            written (a ValueError).
        TypeError: the options are those of another analysis.
        FunctionError: a function of the model failed after the start; a checkpoint and what was
            computed are written (a RuntimeError).
        OSError: the results cannot be written.
        KeyboardInterrupt: SIGINT, SIGTERM or SIGHUP came; a checkpoint and what was computed are
            written.
    """
    _checks.instance("simulate_equations", "options", options, RunOptions)
    for name, only in _FOREIGN.items():
        if getattr(options, name) != only:
            raise InputError(
                f"{name} {getattr(options, name)!r}: equations in coordinates know only {only!r}"
            )
    if options.iteration_matrix == "material":
        raise InputError(
            "iteration_matrix 'material': equations in coordinates know only 'auto', 'frozen' and "
            "'updated'"
        )
    begin = time.perf_counter()
    comm = comm or MPI.COMM_WORLD
    with guarded(options, comm) as faults:
        restart = None if options.restart is None else Restart(options, comm)
        simulation = _started(source, options, comm, restart)
        refuse(faults, comm)
        with StopSignals() as signals:
            run = _Run(simulation, options, case, results, begin, restart)
            status = run.to_the_end(signals)
            if run.signal:
                raise run.interrupted()
            when = f" after t = {comm.bcast(run.time):.6g} s"
            return run.finish(reason_of(faults, comm, when, lambda: run.reason(status)))


def _started(
    source: Source, options: RunOptions, comm: MPI.Intracomm, restart: Restart | None
) -> _Stepped:
    """The equations at their start, or where a checkpoint left them (collective).

    Raises:
        InputError: they have none.
    """
    _validate(source, comm)
    try:
        simulation = _Stepped(source.equations(comm), options, comm)
        if restart is not None:
            restart.check(simulation.equations.identity())
        simulation.begin()
        refuse(current(), comm)  # a function may have failed on one rank
        if restart is not None and simulation.status is Status.OK:
            restart.restore(simulation, simulation.system)
            restart.check_time(simulation.stepper.motion.t)
    except ValueError as error:  # on every rank, the data being the same
        raise InputError(str(error)) from error
    if simulation.status is Status.OK:
        simulation.observed()
    return simulation


def _validate(source: Source, comm: MPI.Intracomm) -> None:
    """Check the data before all ranks build on them together (collective).

    Raises:
        InputError: a mistake, on a rank or on all.
    """
    mistake: ValueError | None = None
    try:
        source.validate()
    except ValueError as error:
        mistake = error
    try:
        raise_together(comm, mistake and InputError(str(mistake)))
    except InputError as error:
        raise error from mistake


class _Replicated:
    """The part of a system that checkpoints need: nothing is distributed."""

    def __init__(self, comm: MPI.Intracomm) -> None:
        self.comm = comm

    def numberings(self) -> dict[str, Numbering]:
        """No rows but the values that are the same on every rank."""
        return {}

    def doubts(self, state: State) -> str:
        """No rows that could be wrong."""
        return ""


class _Stepped:
    """Equations with their scheme in time.

    Attributes:
        status: whether there was a consistent start.
        steps, rejected: accepted (partial) steps and rejected ones.
    """

    def __init__(self, equations: Equations, options: RunOptions, comm: MPI.Intracomm) -> None:
        self.equations, self.options = equations, options
        self.system: Any = _Replicated(comm)
        self.stepper: Stepper = equations.stepper or VectorAlpha()
        self.status, self.steps, self.rejected = Status.OK, 0, 0

    def begin(self) -> None:
        """Start at t = 0."""
        self.status = Status.DIVERGED  # unless all functions can be called
        # what is not finite becomes a status
        with np.errstate(all="ignore"), self._functions():
            self.status = self.stepper.begin(self.equations, self.options)

    @contextmanager
    def _functions(self) -> Iterator[None]:
        """Note where a function of the user's fails within."""
        try:
            yield
        except FAILURES as error:
            if not (where(error) or isinstance(error, ReturnError)):
                raise
            noted(type(self.equations).__name__, self.equations, error)

    def observed(self) -> FloatArray:
        """The columns of the history at the accepted state."""
        row = np.full(len(self.equations.columns), np.nan)
        with self._functions():
            row[:] = self.equations.observe(self.stepper.motion)
        return row

    def advance(self, h: float, t: float) -> Status:
        """One step, or parts of it, to time ``t``; one in which a function fails diverges."""
        status = Status.DIVERGED
        with np.errstate(all="ignore"), self._functions():
            status = self._advance(h, _HALVINGS)
        if status is Status.OK:
            self.stepper.motion.t = t
        return status

    def _advance(self, h: float, halvings: int) -> Status:
        status = self.stepper.step(h)
        if status is Status.OK:
            self.steps += 1
            return status
        self.rejected += 1
        if not halvings or self.equations.linear:
            return status
        first = self._advance(0.5 * h, halvings - 1)
        return first if first is not Status.OK else self._advance(0.5 * h, halvings - 1)

    def state(self) -> State:
        """All that the next step depends on."""
        counts = np.array([self.steps, self.rejected], dtype=np.float64)
        return State({"steps": counts, **self.stepper.state()})

    def restore(self, state: State) -> None:
        """Go on from what :meth:`state` returned."""
        self.steps, self.rejected = counts("steps", state.values["steps"])
        self.stepper.restore(self.equations, self.options, state.values)


class _Records:
    """History, pictures and progress of one run."""

    def __init__(
        self, equations: Equations, options: RunOptions, comm: MPI.Intracomm, resume: State | None
    ) -> None:
        self._equations, self._comm, self._every = equations, comm, options.every
        self._columns = list(equations.columns)
        self._angles = AngleColumns(self._columns, list(equations.angles))
        self._rows: list[FloatArray] = []
        self._folder = options.output
        self._table: HistoryWriter | None = None
        self._series: dict[str, VtuSeries] = {}
        self._opened = False  # ParaView's script is written
        self._faults, self._broken = current(), False  # broken: the table lacks rows
        row = None if resume is None else last_record(resume, len(self._columns))
        self._resume = start = None if row is None else float(row[0])
        if options.output is not None:
            self._table = HistoryWriter(
                options.output / "history.csv", self._columns, comm, resume=start
            )
            remove_summary(options.output / "summary.json", comm)
        if row is not None:
            self._angles.previous = row[1:].copy()
            kept = [] if self._table is None else list(self._table.kept)
            if self._table is not None and not kept:
                self._table.write(row[0], row[1:])
            self._rows = kept or [row]
        self._progress = Progress(
            options.t_end, not options.quiet and comm.rank == 0, t_start=start or 0.0,
            how=options.progress,
        )  # fmt: skip

    @property
    def due(self) -> bool:
        """This rank shows progress, and it is time for :meth:`show`."""
        return self._progress.due

    def show(self, simulation: _Stepped) -> None:
        """Show progress."""
        counters, t = simulation.stepper.counters, simulation.stepper.motion.t
        self._progress.update(t, counters["newton_iterations"], counters["factorizations"])

    def record(self, step: int, simulation: _Stepped, last: bool = False) -> None:
        """Note the accepted state."""
        motion = simulation.stepper.motion
        row = self._angles.unwrap(simulation.observed())
        self._rows.append(np.concatenate([[motion.t], row]))
        self._write(motion.t, row)
        if last or step % self._every == 0:
            self.picture(step, motion)
        if last:
            self.show(simulation)

    def _write(self, t: float, row: FloatArray) -> None:
        """Append a row to the table, as long as the disk takes them."""
        table = self._table
        try:
            if table is not None:
                table.write(t, row)
        except OSError as error:
            self._faults.note(error)
            self._table, self._broken = None, True

    def picture(self, step: int, motion: Motion) -> None:
        """Write what is seen, unless something has failed (collective)."""
        self._look_after_the_table()
        if self._folder is not None and agreed(self._faults, self._comm) is None:
            with self._faults.files():
                self._picture(self._folder, step, motion)

    def _look_after_the_table(self) -> None:
        """Write it anew where it was removed; the run ends then."""
        table = self._table
        if table is not None and table.lost:
            self._faults.note(FolderLostError(table.path.parent, table.path.exists()))
            self._broken = table.path.exists()
            if self._broken:
                table.close()
                self._table = None
                return
            with self._faults.files():
                table.write_anew(self._rows)

    def _picture(self, folder: Path, step: int, motion: Motion) -> None:
        """Write what is seen (collective); the first rank has all of it."""
        for name, seen in self._equations.pictures(motion).items():
            if name not in self._series:
                self._series[name] = VtuSeries(folder, name, self._comm, resume=self._resume)
            mine = slice(None) if self._comm.rank == 0 else slice(0)
            self._series[name].write(
                motion.t, step, seen.points[mine], seen.cells[mine], seen.cell_type,
                {key: values[mine] for key, values in seen.point_data.items()},
                {key: values[mine] for key, values in seen.cell_data.items()},
            )  # fmt: skip
        if self._series and not self._opened:
            write_paraview_state(folder, self._comm)
            self._opened = True

    def state(self) -> State:
        """What the records go on from; the table is on disk first (collective)."""
        error: Exception | None = self._faults.error if self._broken else None
        try:
            if self._table is not None:
                self._table.sync()
        except OSError as exc:
            error = exc
        raise_together(self._comm, error)
        return State({"history": self._rows[-1]})

    def close(self) -> dict[str, FloatArray]:
        """Close the files; the columns so far on the first rank."""
        self._progress.close()
        self._look_after_the_table()
        with self._faults.files():
            if self._table is not None:
                self._table.close()
        with self._faults.files():
            if self._folder is not None and agreed(self._faults, self._comm) is None:
                for name in _OF_MODELS:
                    if name not in self._series:
                        VtuSeries(self._folder, name, self._comm).close()
            for series in self._series.values():
                series.close()
        if self._comm.rank or not self._rows:
            return {}
        table = np.array(self._rows)
        return dict(zip(["t", *self._columns], table.T.copy(), strict=True))


class _Run:
    """One run from the start, or from a checkpoint, to the results.

    Attributes:
        signal: number of the signal that ended it early, 0 for none.
    """

    def __init__(
        self, simulation: _Stepped, options: RunOptions, case: str, results: Results | None,
        begin: float, restart: Restart | None,
    ) -> None:  # fmt: skip
        self._simulation, self._options, self._case = simulation, options, case
        self._results, self._begin = results, begin
        comm = simulation.system.comm
        self._grid = TimeGrid.of(options.dt, options.t_end) if restart is None else restart.grid
        self._start = None if restart is None else restart.step
        self._records = _Records(
            simulation.equations, options, comm, None if restart is None else restart.state
        )
        self._checkpoints = Checkpoints(
            simulation, simulation.equations.identity(), options, self._grid, restart
        )
        self._checkpoint: Path | None = None
        self.signal, self._agreement = 0, Agreement(comm)
        self._setup = self._first = None  # type: float | None

    def to_the_end(self, signals: StopSignals) -> Status:
        """Take all steps, or those before the first that fails or a signal."""
        simulation, options, grid = self._simulation, self._options, self._grid
        if simulation.status is not Status.OK:
            return simulation.status
        if self._start is None:
            self._records.record(0, simulation)
        self._setup = time.perf_counter() - self._begin
        count, first = grid.steps(options.t_end), (self._start or 0) + 1
        every, status = options.checkpoint_every, Status.OK
        for step in range(first, count + 1):
            t = simulation.stepper.motion.t
            status = simulation.advance(grid.rest(t, step), grid.time(step))
            if step == first:
                self._first = time.perf_counter() - self._begin
            self.signal = self._agreement.on(signals)
            if self._agreement.failed:  # what the first rank has is what is written
                status = simulation.system.comm.bcast(status)
            if status is not Status.OK:
                self._records.picture(step - 1, simulation.stepper.motion)
                self._save(step - 1)
                break
            self._records.record(step, simulation, last=step == count)
            if self._records.due:
                self._records.show(simulation)
            early = self.signal or self._agreement.failed
            if early or (every and (step % every == 0 or step == count)):
                self._save(step)
            if early:
                break
        return status

    def _save(self, step: int) -> None:
        with current().files():
            self._checkpoint = self._checkpoints.write(step, self._records.state())

    @property
    def time(self) -> float:
        """Time of the accepted state, s; 0 where there is none."""
        started = self._simulation.status is Status.OK
        return self._simulation.stepper.motion.t if started else 0.0

    def interrupted(self) -> Interrupted:
        """Write what is left and the summary; the exception that ends the run (collective)."""
        reason = f"interrupted at t = {self._simulation.stepper.motion.t:.6g} s"
        outcome = self.finish(reason)
        return interruption(self.signal, reason, self._checkpoint, outcome)

    def reason(self, status: Status) -> str:
        """The status in words."""
        if status is Status.OK:
            return "ok"
        return with_hint(f"{status.value} at t = {self.time:.6g} s", EQUATIONS.get(status))

    def finish(self, reason: str) -> Outcome:
        """Write what is left and the summary (collective)."""
        simulation = self._simulation
        history = self._records.close()
        equations, wall = simulation.equations, time.perf_counter() - self._begin
        summary = {
            "case": self._case, "ranks": simulation.system.comm.size,
            "unknowns": equations.size, "multipliers": equations.multipliers,
            "steps": simulation.steps, "rejected_steps": simulation.rejected,
            **simulation.stepper.counters, "status": reason, "results": {},
            "restarted_at_step": self._start, "wall_seconds": wall,
            "wall_seconds_setup": self._setup or wall, "wall_seconds_first_step": self._first,
            **equations.summary(),
        }  # fmt: skip
        comm = simulation.system.comm
        return conclude(summary, history, self._results, self._options, comm)
