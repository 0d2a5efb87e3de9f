# SPDX-License-Identifier: LGPL-3.0-or-later
"""Events of a run: detection, location in time, actions.

Every rank evaluates the functions with the same marker states; decisions are based on the largest
of their values, so that they are the same on all ranks.
"""

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._faults import FAILURES, FunctionError, ReturnError, noted
from flexfem._types import BoolArray, FloatArray
from flexfem.constraints.batch import Constraints
from flexfem.core.laws import LawKind
from flexfem.core.nodes.prediction import Prediction
from flexfem.core.state import counts
from flexfem.core.status import Status
from flexfem.integrators.start import make_consistent, project_velocities
from flexfem.layout.numbered_model import NumberedModel
from flexfem.model.event import Event, LockJoint, Rebound, ReleaseJoint, Stop
from flexfem.model.model import Model
from flexfem.simulation.motion.journal import Journal
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.system.measure.marker_states import MarkerStates
from flexfem.system.system import System

__all__ = ["Events"]

#: Relative difference of the values of one function between computers that may be rounding.
_ALIKE = 1e-9
#: Round-off of a time, relative.
_ROUND_OFF = 1e-15
#: Number of evaluations after which a bracket must have halved; else it is bisected.
_PATIENCE = 3
#: Largest distance (m) or angle (rad) of a joint that closes as it is defined from where that is.
_CLOSED = 1e-4


@dataclass
class _Impact:
    """A rebound requested by an action.

    Attributes:
        event: number of the event; the others as in ``Mechanism.rebound``.
    """

    event: int
    joint: str
    restitution: float
    rest_speed: float


class Events:
    """The events of a model during a motion.

    Attributes:
        fired: name and time of each event so far.
        stopped_by: name of the event that ended the run, None before.
        bad: name of an event whose function was not finite, None if there is none.
        journal: is told of events and their changes.
    """

    def __init__(
        self, system: System, serial: NumberedModel, tangent: TangentSolver, span: float
    ) -> None:
        """Evaluate all functions at the start (collective).

        Args:
            system: at its consistent start.
            serial: serial data of its model.
            tangent: solver of the exact matrix, for impacts.
            span: interval for the differentiation of drives after an impact, s.

        Raises:
            InputError: a function does not return a finite number, or a rebound is at a joint
                without impacts.
        """
        self._system, self._tangent, self._span = system, tangent, span
        self._events = serial.model.events
        self._states = MarkerStates(
            system, serial, [m for event in self._events for m in event.markers]
        )
        self.fired: list[tuple[str, float]] = []
        self.stopped_by: str | None = None
        self.bad: str | None = None
        self.journal = Journal()
        self._largest = np.zeros(len(self._events))
        _check_rebounds(system.constraints, serial.model)
        self._reversing: BoolArray = np.array([e.reverses for e in self._events], dtype=np.bool_)
        self._armed: BoolArray = np.ones(len(self._events), dtype=np.bool_)
        try:
            self.values = self.evaluate()
        except FunctionError as error:
            raise InputError(str(error)) from error
        if self.bad is not None:
            raise InputError(f'Event "{self.bad}": function must be finite at t = 0')
        self._sides = np.sign(self.values)

    def state(self) -> dict[str, FloatArray]:
        """Return the values of the functions, and the events that have happened."""
        names = [event.name for event in self._events]
        fired = [(names.index(name), t) for name, t in self.fired]
        return {
            "events": np.array([self.values, self._sides, self._armed], dtype=np.float64),
            "fired": np.array(fired, dtype=np.float64).reshape(-1, 2),
        }

    def restore(self, state: Mapping[str, FloatArray]) -> None:
        """Restore a result of :meth:`state`."""
        self.values, self._sides = state["events"][:2]
        self._armed = state["events"][2] > 0.0
        numbers = counts("fired", state["fired"][:, 0])
        times = state["fired"][:, 1].tolist()
        self.fired = [(self._events[i].name, t) for i, t in zip(numbers, times, strict=True)]

    def __len__(self) -> int:
        """Number of events."""
        return len(self._events)

    def evaluate(self) -> FloatArray:
        """Values of all functions at the trial state (collective)."""
        states, at, values = self._states.evaluate(), 0, np.zeros(len(self._events))
        for i, event in enumerate(self._events):
            count = len(event.markers)
            values[i] = event.evaluate(self._system.time, states[at : at + count])
            at += count
        if self._events:
            self._agree(values)
        return values

    def _agree(self, values: FloatArray) -> None:
        """Take the largest values of all ranks, and record events that differ (collective).

        A function may fail on one rank only, or have another value there.
        """
        comm = self._system.comm
        if comm.size == 1:
            bad = ~np.isfinite(values)
        else:
            fine = np.isfinite(values)
            both = np.where(fine, [values, -values], np.inf)
            comm.Allreduce(MPI.IN_PLACE, both, op=MPI.MAX)
            bad = np.isinf(both[0])
            values[:] = np.where(bad, np.nan, both[0])
            self._largest = np.maximum(self._largest, np.where(bad, 0.0, np.abs(both).max(axis=0)))
            apart = ~bad & (both.sum(axis=0) > _ALIKE * self._largest)
            for i in np.flatnonzero(apart).tolist():
                event, why = self._events[i], "gives {:.9g} on one rank and {:.9g} on another"
                noted(
                    f'Event "{event.name}"', event.function,
                    ReturnError(why.format(-both[1, i], both[0, i])),
                )  # fmt: skip
            bad |= apart
        if bad.any():
            self.bad = self._events[int(np.flatnonzero(bad)[-1])].name

    def crossed(self, values: FloatArray) -> BoolArray:
        """Return flags of events that have crossed zero in their direction, from new values."""
        direction = np.array([event.direction for event in self._events], dtype=np.int64)
        up = (self._sides < 0.0) & (values >= 0.0) & (direction >= 0)
        down = (self._sides > 0.0) & (values <= 0.0) & (direction <= 0)
        return self._armed & (up | down)

    def passed(self, values: FloatArray) -> None:
        """Store the values of an accepted state without events."""
        self.values = values
        self._sides = np.where(values != 0.0, np.sign(values), self._sides)

    def locate(
        self, trial: Callable[[float], Status], size: float, values: FloatArray
    ) -> tuple[Status, float, BoolArray]:
        """Find the first event within a step (collective).

        Args:
            trial: solves for the trial state at a given time after the accepted state.
            size: size of the step whose end, the present trial state, is after the event.
            values: values of the functions there.

        Returns:
            Status, time of the trial state after the accepted state, and the events that happen
            there. Time and state are just after the event; but just before an impact, since the
            next one may follow before any state between them is evaluated.
        """
        left, right, low, high = 0.0, size, self.values, values
        reached, widths = size, [size]
        hit = self.crossed(values)
        tolerance = min(e.tolerance for e, is_hit in zip(self._events, hit, strict=True) if is_hit)
        tolerance = max(tolerance, _ROUND_OFF * self._system.time)
        while right - left > tolerance:
            tau = 0.5 * (left + right)
            if len(widths) <= _PATIENCE or widths[-1] <= 0.5 * widths[-1 - _PATIENCE]:
                hit = self.crossed(high)
                roots = low[hit] / (low[hit] - high[hit])
                tau = left + (right - left) * float(roots.min())
            # converged from one side: the next trial is just on the other
            tau = min(max(tau, left + 0.5 * tolerance), right - 0.5 * tolerance)
            status = trial(tau)
            if status is not Status.OK:
                return status, tau, hit
            reached, found = tau, self.evaluate()
            if self.bad is not None:
                return Status.EVENT, tau, hit
            if self.crossed(found).any():
                right, high = tau, found
            else:
                left, low = tau, found
            widths.append(right - left)
        hit = self.crossed(high)
        impacts = hit & self._reversing
        at, hit = (left, impacts) if impacts.any() else (right, hit)
        return (Status.OK if reached == at else trial(at)), at, hit

    def carry_out(self, hits: BoolArray) -> Status:
        """Carry out the actions of some events at the accepted state (collective).

        Positions are kept, velocities are projected onto the constraints then active by the least
        kinetic energy, accelerations and multipliers are computed again.
        """
        system = self._system
        system.reset()
        system.interface.update()
        mechanism, before = (
            _Moving(system, self.fired),
            deepcopy((self.state(), system.constraints.state())),
        )
        self.journal.happened(np.flatnonzero(hits).tolist())
        for i in np.flatnonzero(hits):
            event = self._events[i]
            self.fired.append((event.name, system.time))
            if not event.reverses:
                self._sides[i] = -self._sides[i]
            self._armed[i] = not event.once
            mechanism.event = int(i)
            if not (self._act(event, mechanism) and self._closes(event, mechanism)):
                self.restore(before[0])
                system.constraints.restore(before[1])
                return Status.EVENT
            if mechanism.stopped:
                self.stopped_by = event.name
                return Status.OK
        if mechanism.changed:
            self.journal.switched()
        status = Status.OK
        for impact in mechanism.impacts:
            status = self._rebound(impact) if status is Status.OK else status
        if status is Status.OK and mechanism.changed:
            status = make_consistent(system, self._tangent, self._span)
            self.journal.renewed()
            system.prediction = Prediction.VELOCITY
        after = self.evaluate()
        others = ~hits & (after != 0.0)
        self.values = after
        self._sides[others] = np.sign(after[others])
        return status if self.bad is None else Status.EVENT

    def _act(self, event: Event, mechanism: "_Moving") -> bool:
        """Carry out the actions of an event; True on success on all ranks (collective)."""
        done = True
        for act in event.actions:
            try:
                act(mechanism)
            except FAILURES as error:
                noted(f'Event "{event.name}"', act, error)
                done = False
        comm = self._system.comm
        return done if comm.size == 1 else bool(comm.allreduce(done, op=MPI.LAND))

    def _closes(self, event: Event, mechanism: "_Moving") -> bool:
        """True if the joints that an event has closed as they are defined hold there (collective).

        The next step would move bodies by what is missing, whatever energy that takes.
        """
        rows = self._system.constraints
        if mechanism.closed:
            rows.evaluate(np.array([1.0, 1.0]))
        for joint in mechanism.closed:
            own = rows.rows_of(joint)
            own = own[rows.rigid[own]]
            gap = float(np.abs(rows.values[own]).max(initial=0.0))
            gap = self._system.comm.allreduce(gap, op=MPI.MAX)
            if gap > _CLOSED:
                why = (
                    f'"{joint}" does not hold at t = {mechanism.time:.6g} s: it is off by '
                    f"{gap:.6g} (m or rad) and would jump; close it with hold=True where it is, or "
                    "at a time when it holds"
                )
                noted(f'Event "{event.name}"', event.function, ValueError(why))
                return False
        mechanism.closed = []
        return True

    def _rebound(self, impact: _Impact) -> Status:
        """Set the velocities after an impact at a released joint, which stays released."""
        system, rows = self._system, self._system.constraints
        rows.set_active(impact.joint, True)
        system.interface.update()
        rows.evaluate(np.array([1.0, 1.0]))
        own, restitution = rows.rows_of(impact.joint), np.zeros(rows.size)
        speed = system.comm.allreduce(float(np.abs(rows.rates()[own]).max(initial=0.0)), op=MPI.MAX)
        rests = impact.restitution * speed <= impact.rest_speed
        restitution[own] = 0.0 if rests else impact.restitution
        status = project_velocities(system, self._tangent, self._span, restitution)
        for part in system.parts:
            part.block.start()
        self.journal.rebounded(restitution)
        if rests:  # a function that rests at zero does not cross it
            self._armed[impact.event] = False
        else:
            rows.set_active(impact.joint, False)
        return status


def _check_rebounds(rows: Constraints, model: Model) -> None:
    """Raise for a rebound at a joint with a law of force, or that is closed (collective).

    Raises:
        InputError: names event and joint.
    """
    actions = [(event, action) for event in model.events for action in event.actions]
    named = (LockJoint, ReleaseJoint, Rebound, Stop)
    opened = {action.joint for _, action in actions if isinstance(action, ReleaseJoint)}
    opened.update(model.released)
    custom = any(not isinstance(action, named) for _, action in actions)
    for event, action in actions:
        if not isinstance(action, Rebound):
            continue
        owner, joint = f'Event "{event.name}"', f'"{action.joint}"'
        lawful = bool(np.any(rows.elastic[rows.rows_of(action.joint), 0] != LawKind.RIGID))
        if rows.comm.allreduce(lawful, op=MPI.LOR):
            raise InputError(f"{owner}: rebounds need a rigid constraint, but {joint} has none")
        if action.joint not in opened and not custom:
            raise InputError(
                f"{owner}: rebounds need an open joint, but {joint} is never released "
                f"(Model.release({joint}))"
            )


class _Moving:
    """Interface of the system for actions; see ``flexfem.model.event.Mechanism``."""

    def __init__(self, system: System, fired: Sequence[tuple[str, float]]) -> None:
        self._rows, self.time, self._fired = system.constraints, system.time, fired
        self.impacts: list[_Impact] = []
        self.closed: list[str] = []  # as they are defined
        self.changed = self.stopped = False
        self.event = 0

    def set_active(self, joint: str, active: bool, hold: bool = False) -> None:
        self._rows.set_active(joint, active, hold)
        if active and not hold:
            self.closed.append(joint)
        self.changed = True

    def rebound(self, joint: str, restitution: float, rest_speed: float = 0.0) -> None:
        self.impacts.append(_Impact(self.event, joint, restitution, rest_speed))
        self.changed = True

    def stop(self) -> None:
        self.stopped = True

    def happened(self, event: str) -> bool:
        return any(name == event for name, _ in self._fired)
