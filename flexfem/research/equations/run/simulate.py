# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion in time of equations in a vector of coordinates: the same output as of a model.

Every rank solves the same equations, the first one writes.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

from mpi4py import MPI

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._faults import current
from flexfem.analyses.dynamics import RunOptions
from flexfem.core.status import Status
from flexfem.io.atomic import raise_together
from flexfem.launch import Interrupted, StopSignals
from flexfem.research.equations.run.records import EquationRecords
from flexfem.research.equations.run.stepping import SteppedEquations
from flexfem.research.equations.vector_equations import VectorEquations
from flexfem.simulation.checkpoints import Checkpoints, Restart
from flexfem.simulation.interruption import Agreement, interruption
from flexfem.simulation.outcome import Outcome, Results, conclude
from flexfem.simulation.reasons import EQUATIONS, with_hint
from flexfem.simulation.run_guard import guarded, reason_of, refuse
from flexfem.simulation.time_grid import TimeGrid

__all__ = ["Source", "simulate_equations"]

#: Options of multibody models that equations know nothing of, with the values they must have.
_FOREIGN = {
    "integrator": "generalized_alpha", "redundant_constraints": "refuse", "start": "given",
    "adaptive": False, "kernels": "fast",
}  # fmt: skip


class Source(Protocol):
    """Equations that a case builds; ``drivers`` names this module's function."""

    drivers: Mapping[str, str]

    def validate(self) -> None:
        """Check the data.

        Raises:
            ValueError: something does not fit.
        """

    def equations(self, comm: MPI.Intracomm) -> VectorEquations:
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
) -> SteppedEquations:
    """The equations at their start, or where a checkpoint left them (collective).

    Raises:
        InputError: they have none.
    """
    _validate(source, comm)
    try:
        simulation = SteppedEquations(source.equations(comm), options, comm)
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


class _Run:
    """One run from the start, or from a checkpoint, to the results.

    Attributes:
        signal: number of the signal that ended it early, 0 for none.
    """

    def __init__(
        self, simulation: SteppedEquations, options: RunOptions, case: str, results: Results | None,
        begin: float, restart: Restart | None,
    ) -> None:  # fmt: skip
        self._simulation, self._options, self._case = simulation, options, case
        self._results, self._begin = results, begin
        comm = simulation.system.comm
        self._grid = TimeGrid.of(options.dt, options.t_end) if restart is None else restart.grid
        self._start = None if restart is None else restart.step
        self._records = EquationRecords(
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
