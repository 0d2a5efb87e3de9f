# SPDX-License-Identifier: LGPL-3.0-or-later
"""A system with its time integrator, stepped from Python."""

import time
import weakref
from collections.abc import Callable

from mpi4py import MPI

import numpy as np

from flexfem._faults import current
from flexfem._types import FloatArray
from flexfem.analyses.dynamics import RunOptions
from flexfem.core.nodes.prediction import Prediction
from flexfem.core.state import State, counts
from flexfem.core.status import Status
from flexfem.integrators.accepted_forces import AcceptedForces
from flexfem.integrators.integrator import Integrator, create_integrator, discard
from flexfem.integrators.start import make_consistent, start_consistently
from flexfem.la.linear_solver import LinearSolver
from flexfem.model.model import Model
from flexfem.simulation.control.controls import Controls
from flexfem.simulation.equilibria.equilibrium import start_in_equilibrium
from flexfem.simulation.motion.breakpoints import Breakpoints
from flexfem.simulation.motion.events import Events
from flexfem.simulation.motion.journal import Journal
from flexfem.simulation.motion.slider_exit import SliderExit
from flexfem.simulation.motion.start_velocities import StartVelocities
from flexfem.simulation.motion.step_control import HALVINGS, StepControl
from flexfem.simulation.run.cautions import Cautions
from flexfem.simulation.run.checkpoints import Restart
from flexfem.simulation.run.guard import agreed
from flexfem.simulation.run.setup import set_up
from flexfem.simulation.run.time_grid import TimeGrid
from flexfem.solvers.linear.iterative import check_iterative
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.solvers.newton.iteration import NewtonOptions
from flexfem.solvers.newton.policy import Policy
from flexfem.solvers.policies import create_policy

__all__ = ["HALVINGS", "Simulation"]

#: Number of events within one largest step after which the run fails.
_MOST_EVENTS = 200
#: Relative size of a step below which its accelerations are round-off: they are computed again
#: after it.
_SHORT = 0.05
#: Span over multiples of which drives are differentiated for forces, as a part of the largest step.
_SPAN, _SPAN_ADAPTIVE = 1.0 / 8.0, 1.0 / 64.0
#: Failures of a run that smaller steps do not avoid.
_FINAL = (Status.EVENT, Status.LEFT)


class Simulation:
    """A system with its integrator, stepped from Python.

    Attributes:
        system: the assembled system.
        steps, rejected: accepted (partial) steps and rejected ones.
        step_seconds: wall-clock time of each call of :meth:`advance`, s.
        events: the model's events and their history.
        slider_exit: check that sliders are on their carriers.
        controls: the model's controllers.
        cautions: warnings of the run.
        breakpoints: jumps and kinks of loads and drives, at which steps end.
        observe: called after every accepted step that does not end a call of :meth:`advance`.
        follow: called at accepted states within a step and before and after jumps of loads, to sum
            up work.
        journal: is told of every change of the accepted state.
        row_forces: forces of joints at accepted states.
    """

    def __init__(
        self,
        model: Model,
        options: RunOptions,
        comm: MPI.Intracomm | None = None,
        restart: Restart | None = None,
    ) -> None:
        """Build the system and start it consistently, or from a checkpoint (collective).

        Raises:
            InputError: a mistake in the model, or a checkpoint that does not belong to it (a
                ValueError).
        """
        check = None if restart is None else restart.check
        grid = TimeGrid.of(options.dt, options.t_end) if restart is None else restart.grid
        self.controls = Controls(model, grid.h)
        self.serial, self.system = set_up(
            model, comm, options.split_above, check, self.controls, options.kernels, moving=True,
            linear=LinearSolver(options.linear_solver, options.linear_tolerance),
        )  # fmt: skip
        check_iterative(self.system)
        self.options = options
        self.cautions = Cautions.of_model(self.serial, options, self.system)
        self.breakpoints = Breakpoints(model, grid, options.t_end)
        self.cautions.note(self.breakpoints.texts)
        self._jump_to(0.0)
        self._integrator = create_integrator(options.integrator, options.rho_inf)
        self._control = StepControl(
            options.error_tolerance if options.adaptive else None, self._integrator.order
        )
        self._tangent = TangentSolver(self.system)
        span = options.dt * (_SPAN_ADAPTIVE if options.adaptive else _SPAN)
        self.row_forces = AcceptedForces(self.system, self._tangent, span, options.t_end)
        # weak references: in a cycle they would outlive the simulation, with their communicators
        self.system.row_forces = weakref.proxy(self.row_forces)
        self.slider_exit = SliderExit(self.system, self.serial)
        self.controls.attach(self.system, self.serial)
        self.status = self._start() if restart is None else Status.OK
        self._integrator.prepare(self.system)
        newton = NewtonOptions(options.tolerance)
        self._policy: Policy = create_policy(
            options.iteration_matrix, self.system, newton, self._tangent, self._integrator.mechanics
        )
        # steps to and from events have other sizes: their factors would not be used again
        self._fresh = create_policy(
            "updated", self.system, newton, self._tangent, self._integrator.mechanics
        )
        self.events = Events(self.system, self.serial, self._tangent, options.dt)
        self.steps = self.rejected = 0
        self.step_seconds: list[float] = []
        self.observe: Callable[[], None] = _nothing
        self.follow: Callable[[], None] = _nothing
        self.journal = Journal()
        self._error, self._limit = 0.0, _MOST_EVENTS
        # scheme of the steps, and True if the next one is the first after a jump
        self._scheme, self._behind_jump = self._integrator, False
        # accelerations at the start of the last part of a step, and its size
        self._last_part: tuple[list[FloatArray], float] = [], 0.0
        if restart is not None:
            restart.restore(self, self.system)
            restart.check_time(self.time)

    def _start(self) -> Status:
        """Bring the system to its start: as the model says, or at rest in equilibrium."""
        least_norm = self.options.redundant_constraints == "least_norm"
        if self.options.start == "equilibrium":
            status = start_in_equilibrium(self.serial, self.system, self._tangent)
            if status is not Status.OK:
                return status
            if self.slider_exit.found():
                return Status.LEFT
        given = StartVelocities(self.serial, self.system)
        status = start_consistently(self.system, self._tangent, self.options.dt, least_norm)
        if status is Status.OK and len(self.controls):
            self.controls.start()
            self._jump_to(self.time)
            status = make_consistent(self.system, self._tangent, self.options.dt)
            self.controls.started()
        self._tangent.release_masses()
        if status is Status.OK and (self.system.slowed or "velocities" in self.cautions.found):
            self.cautions.note(given.changes())
        return status

    @property
    def time(self) -> float:
        """Time of the accepted state, s."""
        return self.system.time

    @property
    def integrator(self) -> Integrator:
        """Scheme of whole steps."""
        return self._integrator

    @property
    def policy(self) -> Policy:
        """Policy of the Newton method of whole steps, with its factors."""
        return self._policy

    @property
    def tangent(self) -> TangentSolver:
        """Solver of the exact matrix."""
        return self._tangent

    @property
    def turn_limit(self) -> float:
        """See :attr:`flexfem.integrators.integrator.Integrator.turn_limit`."""
        return self._integrator.turn_limit

    def state(self) -> State:
        """State on which the next step depends, and the counters so far."""
        counts = self.steps, self.rejected, self._error, self._behind_jump
        own = {
            "steps": np.array(counts, dtype=np.float64),
            "control": self._control.state(),
            **self.events.state(),
            **self.controls.state(),
        }
        parts = self._policy.state() | self.system.state() | self._integrator.state(self.system)
        return State(own) | parts

    def restore(self, state: State) -> None:
        """Restore a result of :meth:`state` (collective)."""
        self.steps, self.rejected = counts("steps", state.values["steps"][:2])
        self._error = float(state.values["steps"][2])
        self._behind_jump = bool(state.values["steps"][3])
        self._control.restore(state.values["control"])
        self.events.restore(state.values)
        self.controls.restore(state.values)
        system = self.system
        self._policy.restore(state)
        system.restore(state)
        self._integrator.restore(system, state)
        self.controls.resume(state.values)

    def advance(self, h: float, t: float | None = None) -> Status:
        """Advance by ``h`` (s), in one step or in parts of it.

        Steps are halved where one fails or misses the error tolerance, and shortened to end at
        events and at jumps and kinks of loads and drives. An event that ends the run ends the call
        there, with success.

        Args:
            h: largest step; factors are kept for equal step sizes, so pass the same number.
            t: time at the end, if the caller knows it without accumulated rounding.
        """
        begin, system, control = time.perf_counter(), self.system, self._control
        start = system.time
        control.begin()
        system.begin_row()
        status, self._limit = Status.OK, len(self.events.fired) + _MOST_EVENTS
        while not control.done and self.events.stopped_by is None:
            size, end = h * control.part, start + h * control.end
            if self._behind_jump or self.breakpoints.within(system.time, end):
                status = self._through_breakpoints(size, end)
            else:
                before = system.time
                self._aim(before + size)
                status = self._scheme.solve(system, self._policy, size)
                status = self._arrive(before, size, end, status)
            if status is Status.OK:
                control.accepted(self._error)
                if control.done and self.events.stopped_by is None:
                    if t is not None:
                        system.time = t
                    self.controls.sample()
                elif not control.done:
                    self.observe()
            elif status in _FINAL or self._failed() or not self._smaller(status):
                break
        self.step_seconds.append(time.perf_counter() - begin)
        return status

    def repeat(self, scheme: Integrator, h: float, end: float) -> Status:
        """Take a step again that was accepted before, from the same state (collective).

        Args:
            scheme: of the step.
            h: its size, s.
            end: time at its end, s.
        """
        self._aim(end)
        status = scheme.solve(self.system, self._policy, h)
        self.system.lead = 0.0
        if status is Status.OK:
            scheme.accept(self.system, h)
            self.system.time = end
        return status

    def _failed(self) -> bool:
        """Return True if a user-defined function failed on a rank, with any step (collective)."""
        return agreed(current(), self.system.comm) is not None

    def _smaller(self, status: Status) -> bool:
        """Count a rejected step and reduce the step size; False if it is the smallest."""
        self.rejected += 1
        return self._control.refused(self._error if status is Status.INACCURATE else None)

    def _arrive(self, start: float, size: float, end: float, status: Status) -> Status:
        """Accept a solved step of the grid to time ``end``, or go through events within it."""
        status = self._checked(start, size, status, self._policy)
        if status is not Status.OK or not len(self.events):
            return self._accept(start, size, end) if status is Status.OK else status
        values = self.events.evaluate()
        if self.events.bad is None and not self.events.crossed(values).any():
            return self._accept(start, size, end, values)
        discard(self.system, start)
        if self.events.bad is not None:
            return Status.EVENT
        return self._through_events(size, end)

    def _aim(self, end: float) -> None:
        """Make the next step end just before a jump of loads and drives at time ``end`` (s)."""
        self.system.lead = self.breakpoints.lead(end, before=True)

    def _checked(self, start: float, size: float, status: Status, policy: Policy) -> Status:
        """Check the error of a solved step; after a failure its trial state is discarded."""
        self.system.lead = 0.0
        tolerance = self._control.tolerance
        if status is Status.OK and tolerance is not None:
            self._error = self._scheme.error(self.system, policy, size)
            if not self._error <= tolerance:
                discard(self.system, start)
                return Status.INACCURATE
        return status

    def _accept(
        self, start: float, size: float, end: float, values: FloatArray | None = None
    ) -> Status:
        """Accept the trial state, with the ``values`` of the events, unless a slider leaves."""
        if self.slider_exit.found():
            discard(self.system, start)
            return Status.LEFT
        self._scheme.accept(self.system, size)
        self.system.time = end
        self.steps += 1
        self.controls.accepted()
        self.journal.stepped(self._scheme, size)
        if values is not None:
            self.events.passed(values)
        if not self.breakpoints.lead(end, before=False):
            return Status.OK
        self.follow()
        return self._jump()

    def _accept_part(
        self, start: float, size: float, end: float, values: FloatArray | None = None
    ) -> Status:
        """Accept a part of a step, see :meth:`_accept`, and keep the accelerations before it.

        Its solution may have divided them from those of impulses.
        """
        before = [part.block.accelerations.copy() for part in self.system.parts]
        self._last_part = before, size
        return self._accept(start, size, end, values)

    def _jump_to(self, t: float) -> None:
        """Set loads and drives to those at time ``t`` (s), or just after it if they jump there."""
        self.system.lead = self.breakpoints.lead(t, before=False)
        self.system.set_time(t)
        self.system.lead = 0.0

    def _jump(self) -> Status:
        """Compute accelerations and multipliers of the accepted state after a jump of loads."""
        status = self.renew()
        self.journal.renewed()
        self.system.prediction = Prediction.VELOCITY
        self._behind_jump = True
        self.controls.accepted(jumped=True)
        self.journal.measured()
        self.follow()
        return status

    def renew(self) -> Status:
        """Make the accepted state consistent, with the loads behind a jump (collective)."""
        system = self.system
        system.lead = self.breakpoints.lead(system.time, before=False)
        system.reset()
        system.set_time(system.time)
        system.interface.update()
        status = make_consistent(system, self._tangent, self.options.dt)
        self._integrator.renewed(system)
        system.lead = 0.0
        return status

    def _through_breakpoints(self, whole: float, end: float) -> Status:
        """Step to time ``end`` in parts between jumps and kinks; restore the usual scheme."""
        self._scheme = self._integrator.begin_parts(self.system)
        self.journal.began_parts()
        self._last_part = [part.block.accelerations.copy() for part in self.system.parts], 0.0
        status = self._through_events(whole, end)
        before, size = self._last_part
        ratio = whole / size if size > _SHORT * whole and not self._behind_jump else 0.0
        self._integrator.end_parts(self.system, before, ratio)
        self.journal.ended_parts(ratio)
        self._scheme = self._integrator
        return status

    def _through_events(self, whole: float, end: float) -> Status:
        """Step from the accepted state to time ``end`` through the events before it.

        They end at jumps and kinks of loads and drives. Steps that fail are halved, down to the
        smallest part of ``whole`` (s).
        """
        system, events, most = self.system, self.events, whole
        while system.time < end and events.stopped_by is None:
            start, stop = system.time, self.breakpoints.next(system.time, end)
            self._behind_jump = False
            size = min(most, stop - start)
            self._last_part = self._last_part[0], 0.0
            status = self._to_event(start, size, stop)
            short = 0.0 < system.time - start < _SHORT * whole
            if status is Status.OK and short and not self._behind_jump:
                status = self.renew()
                self.journal.renewed()
                self.controls.accepted()
                self.journal.measured()
            if status is Status.OK and system.time < end:
                self.follow()
            if status is Status.OK and len(events.fired) > self._limit:
                return Status.EVENT
            if status in _FINAL:
                return status
            if status is not Status.OK:
                if self._failed():
                    return status
                self.rejected += 1
                most = 0.5 * size
                if most < whole * 0.5**HALVINGS:
                    return status
        return Status.OK

    def _to_event(self, start: float, size: float, end: float) -> Status:
        """Take one step of ``size`` (s), or to the first event within it, and carry that out."""
        system, events = self.system, self.events

        def trial(tau: float) -> Status:
            discard(system, start)
            if tau <= 0.0:
                return Status.OK
            self._aim(start + tau)
            status = self._scheme.solve(system, self._fresh, tau)
            return self._checked(start, tau, status, self._fresh)

        status = trial(size)
        if status is not Status.OK:
            return status
        values = events.evaluate()
        if events.bad is None and not events.crossed(values).any():
            reached = end if size == end - start else start + size
            return self._accept_part(start, size, reached, values)
        if events.bad is None:
            status, size, hits = events.locate(trial, size, values)
        if events.bad is not None:
            status = Status.EVENT
        if status is not Status.OK:
            discard(system, start)
            return status
        if size > 0.0:
            status = self._accept_part(start, size, start + size)
        else:
            self.journal.at_once()
        if status is Status.OK:
            status = events.carry_out(hits)
            self.controls.accepted(jumped=True)
            self.journal.measured()
        return status


def _nothing() -> None:
    """Observe nothing."""
