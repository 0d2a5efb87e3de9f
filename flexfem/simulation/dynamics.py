# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion in time: from a model and options to results in a folder."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.analyses.dynamics import RunOptions
from flexfem.core.status import Status
from flexfem.model.model import Model
from flexfem.simulation.motion.stepping import HALVINGS, Simulation
from flexfem.simulation.run.checkpoints import Checkpoints, Restart
from flexfem.simulation.run.failure_reasons import (
    ITERATED,
    MOTION,
    START,
    moves_most,
    not_finite,
    with_hint,
)
from flexfem.simulation.run.functions_alike import NONE, FunctionsAlike
from flexfem.simulation.run.loop import Steps, carry_out
from flexfem.simulation.run.outcome import Outcome, Results
from flexfem.simulation.run.recording import Recorder
from flexfem.simulation.run.time_grid import TimeGrid
from flexfem.simulation.watch.alternating_forces import AlternatingForces
from flexfem.simulation.watch.energy_drift import energy_drift
from flexfem.simulation.watch.energy_watch import EnergyWatch
from flexfem.simulation.watch.locked_shapes import locked_shapes
from flexfem.simulation.watch.unresolved_turns import UnresolvedTurns

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
        FunctionError: a function of the model failed after the start; a checkpoint and the results
            so far are written (a RuntimeError).
        OSError: the results cannot be written.
        KeyboardInterrupt: SIGINT, SIGTERM or SIGHUP came; a checkpoint and the results so far are
            written.
    """
    _checks.instance("simulate", "options", options, RunOptions)
    comm = comm or MPI.COMM_WORLD
    return carry_out(partial(_TimeSteps, model, options, comm), options, comm, case, results)


class _TimeSteps(Steps):
    """Steps of the size ``dt`` on a grid in time."""

    recorder: Recorder

    def __init__(
        self, model: Model, options: RunOptions, comm: MPI.Intracomm, restart: Restart | None
    ) -> None:
        simulation = Simulation(model, options, comm, restart)
        self._simulation, self._options = simulation, options
        self.system, self.cautions = simulation.system, simulation.cautions
        self.status = simulation.status
        self._grid = TimeGrid.of(options.dt, options.t_end) if restart is None else restart.grid
        self._count = self._grid.steps(options.t_end)
        self._step = self._completed = 0 if restart is None else restart.step
        self.functions = FunctionsAlike(self.system, simulation.serial.model)
        self.checkpoints = Checkpoints(simulation, simulation.serial, options, self._grid, restart)
        self._watch: EnergyWatch | None = None
        self._turns: UnresolvedTurns | None = None
        self._alternating: AlternatingForces | None = None
        self.recorder = Recorder(
            self.system, simulation.serial, options, options.every, options.t_end,
            resume=None if restart is None else restart.state, varies=options.adaptive,
            measures=simulation.controls.columns,
        )  # fmt: skip

    @property
    def further_instants(self) -> int:
        """See :class:`Steps`: those of every so many steps, and of the last one."""
        return -(-self._count // self._options.every)

    @property
    def at(self) -> str:
        """See :class:`Steps`."""
        return f"t = {self._simulation.time:.6g} s"

    @property
    def completed(self) -> int:
        """See :class:`Steps`; the rest of a step is made by a restart."""
        return self._completed

    @property
    def outputs(self) -> FloatArray:
        """See :class:`Steps`."""
        return self._outputs() if len(self._simulation.controls) else NONE

    def record_start(self) -> None:
        """See :class:`Steps`."""
        self.recorder.record(0, measures=self._outputs())

    def begin(self) -> None:
        """Begin to monitor energies and rotations."""
        simulation, options = self._simulation, self._options
        self._watch = EnergyWatch(
            self.system,
            simulation.serial,
            self._grid.h,
            options.tolerance,
            probed=self.recorder.balances,
            fast="steps" in self.cautions.found,
            undamped=options.rho_inf == 1.0,
        )
        self._turns = UnresolvedTurns(
            self.system, simulation.serial, options, simulation.turn_limit
        )
        self._alternating = AlternatingForces(self.system, simulation.controls)
        simulation.follow = _weakly(self._follow)
        simulation.observe = _weakly(self._between if options.adaptive else self._follow)

    def take(self, stopping: Callable[[], bool]) -> Status:
        """See :class:`Steps`."""
        simulation, grid = self._simulation, self._grid
        assert self._watch is not None
        assert self._turns is not None
        assert self._alternating is not None
        self._step = step = self._step + 1
        status = simulation.advance(grid.rest(simulation.time, step), grid.time(step))
        self._turns.step(simulation.rejected)
        if status is not Status.OK:
            return status
        stopped = simulation.events.stopped_by is not None
        self.done = stopped or step == self._count
        self._watch.step(len(simulation.events.fired), self.done)
        self._alternating.step()
        self.recorder.record(step, last=self.done, measures=self._outputs())
        if not stopped or simulation.time >= grid.time(step):
            self._completed = step
        return status

    def record_failure(self) -> None:
        """See :class:`Steps`."""
        assert self._watch is not None
        self._watch.fail()
        self.recorder.record_last(self._step, self._outputs())

    def _between(self) -> None:
        """Record an accepted state within a step."""
        self.recorder.record_between(self._outputs())
        assert self._watch is not None
        self._watch.follow()

    def _follow(self) -> None:
        """Sum the work up to an accepted state that is not recorded."""
        self.recorder.follow()
        assert self._watch is not None
        self._watch.follow()

    def _outputs(self) -> FloatArray:
        """Return the outputs of the controllers from the accepted state on."""
        return self._simulation.controls.outputs(self._simulation.time)

    def reason(self, status: Status) -> str:
        """See :class:`Steps`."""
        return _reason(self._simulation, status, self._options)

    def look_back(self, reason: str, history: Mapping[str, FloatArray]) -> None:
        """See :class:`Steps`."""
        cautions, serial = self.cautions, self._simulation.serial
        for watch in (self._watch, self._turns, self._alternating):
            cautions.say([] if watch is None else watch.texts())
        lossless = self._options.rho_inf == 1.0 and not self._simulation.events.fired
        # the first rank has the history
        drift = energy_drift(serial.model, history, lossless=lossless)
        cautions.say(self.system.comm.bcast(drift))
        cautions.say(locked_shapes(serial, self.system))

    def summary(self) -> dict[str, Any]:
        """See :class:`Steps`."""
        simulation, counters = self._simulation, self.system.counters
        return {
            "steps": simulation.steps,
            "rejected_steps": simulation.rejected,
            "mass_factorizations": counters.mass_factorizations,
            "fallbacks": counters.fallbacks,
            "linear_solves": self.system.linear.counts.solves,
            "linear_iterations": self.system.linear.counts.iterations,
            "events": [{"name": name, "t": t} for name, t in simulation.events.fired],
            "stopped_by": simulation.events.stopped_by,
            # without the first step, which factorises and loads compiled code
            "wall_seconds_steps": sum(simulation.step_seconds[1:]),
        }


def _weakly(method: Callable[[], None]) -> Callable[[], None]:
    """A method without a reference to its object: a cycle would keep systems after their runs."""
    reference = weakref.WeakMethod(method)

    def call() -> None:
        if alive := reference():
            alive()

    return call


def _reason(simulation: Simulation, status: Status, options: RunOptions) -> str:
    """The status in words, with the time, the place and advice (collective)."""
    if status is Status.OK:
        return "ok"
    t = simulation.time
    if status is Status.LEFT:
        return f"{simulation.slider_exit.reason} after t = {t:.6g} s"
    if status is Status.EVENT:
        if simulation.events.bad is not None:
            name = simulation.events.bad
            return f'Event "{name}": the function is not finite after t = {t:.6g} s'
        name = simulation.events.fired[-1][0]
        return (
            f'Event "{name}": too many in one step at t = {t:.6g} s (set rest_speed to let '
            "rebounds come to rest)"
        )
    # drives are differentiated at the start by later values
    ahead = t + options.dt * np.array([0.5**HALVINGS, 0.5, 1.0, 2.0, 3.0])
    culprit = simulation.controls.not_finite(t) or not_finite(simulation.serial, ahead)
    if culprit:
        return f"{culprit} after t = {t:.6g} s"
    where = moves_most(simulation.serial, simulation.system) if status in ITERATED else ""
    if status in ITERATED and simulation.status is status:  # before the first step
        return with_hint(f"{status.value} in the search for the equilibrium{where}", START)
    return with_hint(f"{status.value} at t = {t:.6g} s{where}", MOTION.get(status))
