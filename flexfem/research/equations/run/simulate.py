# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion in time of equations in a vector of coordinates: the same output as of a model.

Every rank solves the same equations, the first one writes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Protocol

from mpi4py import MPI

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._faults import current
from flexfem.analyses.dynamics import RunOptions
from flexfem.core.status import Status
from flexfem.io.atomic import raise_together
from flexfem.research.equations.run.records import EquationRecords
from flexfem.research.equations.run.stepping import SteppedEquations
from flexfem.research.equations.vector_equations import VectorEquations
from flexfem.simulation.run.cautions import Cautions
from flexfem.simulation.run.checkpoints import Checkpoints, Restart
from flexfem.simulation.run.failure_reasons import EQUATIONS, with_hint
from flexfem.simulation.run.guard import agreed, refuse
from flexfem.simulation.run.loop import Steps, carry_out
from flexfem.simulation.run.outcome import Outcome, Results
from flexfem.simulation.run.time_grid import TimeGrid

__all__ = ["Source", "simulate_equations"]

#: Options of multibody models that do not apply to equations, with the values they must have.
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
        source: source of the equations, the same on every rank.
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
        FunctionError: a function of the model failed after the start; a checkpoint and the results
            so far are written (a RuntimeError).
        OSError: the results cannot be written.
        KeyboardInterrupt: SIGINT, SIGTERM or SIGHUP came; a checkpoint and the results so far are
            written.
    """
    _checks.instance("simulate_equations", "options", options, RunOptions)
    for name, only in _FOREIGN.items():
        if getattr(options, name) != only:
            raise InputError(
                f"{name} {getattr(options, name)!r}: equations in coordinates support only {only!r}"
            )
    if options.iteration_matrix == "material":
        raise InputError(
            "iteration_matrix 'material': equations in coordinates support only 'auto', 'frozen' "
            "and 'updated'"
        )
    comm = comm or MPI.COMM_WORLD
    return carry_out(partial(_EquationSteps, source, options, comm), options, comm, case, results)


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


class _EquationSteps(Steps):
    """Steps of the size ``dt``; every rank takes all of them."""

    recorder: EquationRecords

    def __init__(
        self, source: Source, options: RunOptions, comm: MPI.Intracomm, restart: Restart | None
    ) -> None:
        self._simulation = simulation = _started(source, options, comm, restart)
        refuse(current(), comm)
        self.system, self.status, self.functions = simulation.system, simulation.status, None
        self.cautions = Cautions(comm, options)
        self._grid = TimeGrid.of(options.dt, options.t_end) if restart is None else restart.grid
        self._count = self._grid.steps(options.t_end)
        self._step = self._completed = 0 if restart is None else restart.step
        self.done = self._step >= self._count
        self.recorder = EquationRecords(
            simulation, options, comm, None if restart is None else restart.state
        )
        self.checkpoints = Checkpoints(
            simulation, simulation.equations.identity(), options, self._grid, restart
        )

    @property
    def at(self) -> str:
        """See :class:`Steps`."""
        return f"t = {self._time:.6g} s"

    @property
    def after(self) -> str:
        """See :class:`Steps`; of the first rank (collective)."""
        return f"t = {self.system.comm.bcast(self._time):.6g} s"

    @property
    def _time(self) -> float:
        """Time of the accepted state, s; 0 where there is none."""
        started = self._simulation.status is Status.OK
        return self._simulation.stepper.motion.t if started else 0.0

    @property
    def completed(self) -> int:
        """See :class:`Steps`."""
        return self._completed

    def record_start(self) -> None:
        """See :class:`Steps`."""
        self.recorder.record(0)

    def take(self, stopping: Callable[[], bool]) -> Status:
        """See :class:`Steps`."""
        simulation, grid, comm = self._simulation, self._grid, self.system.comm
        step = self._step + 1
        status = simulation.advance(grid.rest(simulation.stepper.motion.t, step), grid.time(step))
        if agreed(current(), comm) is not None:  # the first rank's state is the one that is written
            status = comm.bcast(status)
        if status is Status.OK:
            self._step = self._completed = step
            self.done = step == self._count
            self.recorder.record(step, last=self.done)
        return status

    def record_failure(self) -> None:
        """See :class:`Steps`."""
        self.recorder.picture(self._step)

    def reason(self, status: Status) -> str:
        """See :class:`Steps`."""
        if status is Status.OK:
            return "ok"
        return with_hint(f"{status.value} at {self.at}", EQUATIONS.get(status))

    def common(self, case: str, reason: str) -> dict[str, Any]:
        """See :class:`Steps`."""
        simulation, equations = self._simulation, self._simulation.equations
        return {
            "case": case, "ranks": self.system.comm.size,
            "unknowns": equations.size, "multipliers": equations.multipliers,
            "steps": simulation.steps, "rejected_steps": simulation.rejected,
            **simulation.stepper.counters, "status": reason, "results": {},
        }  # fmt: skip

    def summary(self) -> dict[str, Any]:
        """See :class:`Steps`."""
        return dict(self._simulation.equations.summary())
