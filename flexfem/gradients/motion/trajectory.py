# SPDX-License-Identifier: LGPL-3.0-or-later
"""The motion to be differentiated: accepted states of all steps, and the return to a step's end."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.analyses.dynamics import RunOptions
from flexfem.constraints.elements.states import AT_REST
from flexfem.core.state import State
from flexfem.core.status import Status
from flexfem.gradients.equations.carried import Carried
from flexfem.gradients.equations.odd_forces import AT_STATE
from flexfem.gradients.equations.values import Equations, SystemEquations
from flexfem.gradients.memory.base import Memories, Memory, StepEnd
from flexfem.gradients.memory.controllers import ControllerMemory, recall
from flexfem.gradients.memory.elements import ElementMemory
from flexfem.gradients.memory.histories import HistoryMemory
from flexfem.gradients.memory.lagged_contacts import LaggedMemory, lagging
from flexfem.gradients.motion.records import Records, Storage
from flexfem.gradients.motion.support import (
    check_contacts,
    check_supported,
    differentiable,
)
from flexfem.gradients.renewals.damping import DAMPING
from flexfem.gradients.renewals.grid import Grid, Step
from flexfem.gradients.renewals.renewal import Accelerations, Projection, Renewal
from flexfem.gradients.schemes.base import Steps, StoppedError
from flexfem.gradients.schemes.energy_momentum import EnergySteps
from flexfem.gradients.schemes.generalized_alpha import AlphaSteps
from flexfem.gradients.schemes.stabilized_index2 import StabilizedSteps
from flexfem.integrators.accepted_forces import AcceptedForces
from flexfem.integrators.generalized_alpha import GeneralizedAlpha
from flexfem.integrators.stabilized_index2 import StabilizedIndex2
from flexfem.layout.elements import HistoryElements, TurningElements
from flexfem.model.event import Rebound
from flexfem.model.model import Model
from flexfem.simulation.control.controls import ContinuousLoop
from flexfem.simulation.motion.stepping import Simulation
from flexfem.simulation.run.time_grid import TimeGrid
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.solvers.newton.policy import Policy
from flexfem.system.measure.probes import ProbeRecorder

__all__ = ["TOLERANCE", "Motion", "StoppedError"]

#: Largest Newton step at the end of each step of a motion that is differentiated: errors of a
#: gradient are one to a hundred times as large after a second.
TOLERANCE = 1e-9


class Motion:
    """A motion with the accepted states of all steps.

    Attributes:
        simulation: after the last step.
        recorder: of the columns of the history.
        columns: names of the columns.
        start_decayed: True if damping has ended accelerations of the start.
        grid: all steps, those between rows of the history among them.
        steps: number of these, or rather of states besides the first one.
        renewal: equations of the state to which :meth:`go_to_end` has gone last, if it was made
            consistent at the same positions; None for a step.
        between: equations of that state that are not those of a step, None for a step.
        times: (steps + 1,) of the states, s.
        rows_at: (rows,) numbers of the states that are rows of the history.
        values: (rows, columns) of the history, on the first rank; zero on the others.
        equations: those at the present state, if known, see ``influence.own_equations``.
        memories: what is carried from step to step beside the nodes.
        measured: names of the columns that these follow.
        known: state of the controllers after each step.
        wanted: names of the columns of which derivatives are wanted.
    """

    def __init__(
        self, model: Model, options: RunOptions, comm: MPI.Intracomm | None, storage: Storage,
        wanted: Iterable[str] | None = None,
    ) -> None:  # fmt: skip
        """Compute the motion (collective), whose states go to a storage.

        Derivatives of some columns are wanted, of all that have any by default.

        Raises:
            InputError: a mistake in the model, or something in it that has no derivatives.
            StoppedError: a step failed.
        """
        self.options = replace(
            options, tolerance=min(options.tolerance, TOLERANCE), output=None, quiet=True
        )
        check_supported(model, self.options)
        self.simulation = Simulation(model, self.options, comm)
        self.system = self.simulation.system
        check_supported_system(self)
        self.recorder = ProbeRecorder(self.system, self.simulation.serial)
        self.columns = self.recorder.columns
        # states whose multipliers belong to accelerations that satisfy the constraints
        self._consistent: set[int] = set()
        main = self.simulation.integrator
        ahead = main.alpha_m - main.alpha_f if isinstance(main, GeneralizedAlpha) else None
        self.start_decayed = self.system.decayed
        self.grid = Grid(
            self._add, self._change, self._check_renewal, self._locked, ahead, self._parts
        )
        self.scheme = self._steps()
        self.renewal: Renewal | None = None
        self.between: SystemEquations | None = None
        self.equations: Equations | None = None
        # what controllers know after each step
        self.known: list[dict[str, FloatArray]] = []
        self.memories = Memories(self._memories())
        self.measured = [name for one in self.memories.parts for name in one.measured]
        every = differentiable(model) if wanted is None else wanted
        self.wanted = {*every, *self.measured}
        self._run(TimeGrid.of(options.dt, options.t_end), storage)

    def _parts(self) -> Sequence[type[Renewal]]:
        """Parts of the renewal that has been made."""
        return (Projection, Accelerations, *(DAMPING if self.system.decayed else ()))

    def _steps(self) -> Steps:
        """Steps of the integrator."""
        if not self.alpha:
            return EnergySteps(self)
        stabilized = isinstance(self.simulation.integrator, StabilizedIndex2)
        return StabilizedSteps(self) if stabilized else AlphaSteps(self)

    def _memories(self) -> list[Memory]:
        """What there is to carry."""
        found: list[Memory] = []
        if self.system.constraints.has_elements:
            found.append(ElementMemory(self.system, self.state))
        if len(self.simulation.controls):
            found.append(ControllerMemory(self))
        if self.system.comm.allreduce(self.system.remembering, op=MPI.LOR):
            found.append(HistoryMemory(self.system, self.state))
        if lagging(self.system):
            found.append(LaggedMemory(self.system))
        return found

    @property
    def model(self) -> Model:
        """The model with its probes."""
        return self.simulation.serial.model

    @property
    def accepted(self) -> AcceptedForces:
        """Computation of reported forces of rows."""
        return self.simulation.row_forces

    @property
    def remembering(self) -> bool:
        """True if something is carried from step to step beside the nodes, on any rank."""
        return bool(self.memories.parts)

    @property
    def alpha(self) -> bool:
        """True for motions of the generalized-alpha method."""
        return isinstance(self.simulation.integrator, GeneralizedAlpha)

    @property
    def policy(self) -> Policy:
        """Policy of the Newton method, with its factors."""
        return self.simulation.policy

    @property
    def steps_repeated(self) -> int:
        """Number of steps that were taken again, for states that did not fit in the memory."""
        return self._records.repeated

    @property
    def tangent(self) -> TangentSolver:
        """Solver of the exact matrix."""
        return self.simulation.tangent

    def lacking(self, step: int) -> float:
        """Size of the step before a step, s, if it has left a part of damping to that; else 0."""
        before = self.grid.moves[step - 2] if step > 1 else None
        taken = isinstance(before, Step) and before.acting and self.system.viscous()
        return before.h if isinstance(before, Step) and taken else 0.0

    def kicked(self, state: int) -> bool:
        """True if impulses in the step to a state have changed velocities."""
        return state > 0 and self.grid.renewal(state) is None and self.grid.step(state).kicked

    def _run(self, grid: TimeGrid, storage: Storage) -> None:
        """Take all steps."""
        simulation, options = self.simulation, self.options
        if simulation.status is not Status.OK:
            raise StoppedError(f"gradient: the motion did not start: {simulation.status.value}")
        simulation.journal = simulation.events.journal = self.grid
        count = grid.steps(options.t_end)
        self._records = Records(self.scheme.stored, count, storage, self._repeat)
        rows_at, values = list[int](), list[FloatArray]()

        def record() -> None:
            if rows_at and rows_at[-1] == len(self.grid.moves):  # an event has ended the motion
                return
            rows_at.append(len(self.grid.moves))
            self.recorder.record(simulation.time)
            values.extend(found for _, found in self.recorder.flush())

        if options.adaptive:  # whose histories have all steps
            simulation.observe = record
        record()
        self.scheme.begin(simulation)
        self._add()
        for step in range(1, count + 1):
            self._advance(grid.rest(simulation.time, step), grid.time(step))
            record()
            if simulation.events.stopped_by is not None:
                break
        self.rows_at: IntArray = np.array(rows_at, dtype=np.int64)
        self.steps, self.times = len(self.grid.moves), np.array(self._records.times)
        self.values = np.zeros((len(rows_at), len(self.columns)))
        if self.system.comm.rank == 0:
            self.values[:] = values

    def _advance(self, h: float, end: float) -> None:
        """Take a step of the size ``dt``, or all parts of it."""
        status = self.simulation.advance(h, end)
        if status is not Status.OK:
            raise StoppedError(
                f"gradient: the step to t = {end:.6g} s failed ({status.value}); take smaller steps"
            )
        self.known[-1] = self._knowledge()  # with the samples at its end

    def _knowledge(self) -> dict[str, FloatArray]:
        return {name: values.copy() for name, values in self.simulation.controls.state().items()}

    def _add(self) -> None:
        """Record the accepted state.

        Raises:
            InputError: a stop has been closed for long.
        """
        rows = self.system.constraints
        closed = self.alpha and bool((rows.forces[rows.unilateral] != 0.0).any())
        if self.system.comm.allreduce(closed, op=MPI.LOR):
            raise InputError(
                "gradient: there are no derivatives of stops that stay closed yet; leave them out"
            )
        if rows.consistent:
            self._consistent.add(len(self.grid.moves))
        last = self.grid.moves[-1] if self.grid.moves else None
        if isinstance(last, Step) and last.kicked and self.grid.free(len(self.grid.moves) - 1):
            raise InputError(
                f"gradient: contacts or stops act in the step to t = {self.system.time:.6g} s "
                "behind an event, which has no derivatives yet"
            )
        kept = last is not None and not isinstance(last, Step)
        self._records.add(self.scheme.stored.state(), self.simulation.time, keep=kept)
        self.known.append(self._knowledge())

    def _change(self) -> None:
        """Record it again."""
        self._records.change(self.scheme.stored.state())
        self.known[-1] = self._knowledge()

    def _repeat(self, step: int) -> None:
        """Take a step again from the state before it."""
        taken, end = self.grid.step(step), float(self.times[step])
        self.system.reset()  # what accelerations lack is found there
        recall(self.simulation, self.known[step - 1])
        self.scheme.recall(step)
        status = self.simulation.repeat(taken.scheme, taken.h, end)
        if status is not Status.OK:
            raise StoppedError(
                f"gradient: the step to t = {end:.6g} s failed when it was taken again; allow "
                "more memory"
            )
        if lead := self.grid.leads.get(step):
            for part in self.system.parts:
                before = part.block.accelerations
                if lead.part:
                    before = self.state(lead.before).rows[part.block.name]["acceleration"]
                part.block.lead_auxiliary(before, lead.part)

    def go_to(self, step: int) -> None:
        """Return to the accepted state after a step (collective)."""
        self.equations = None
        self._load(step)
        self._set_lead(step, before=False)
        recall(self.simulation, self.known[step])
        self.scheme.stored.restore(self._records.state(step))
        self.system.constraints.consistent = step in self._consistent

    def go_to_end(self, step: int) -> None:
        """Return to the trial state at the end of a step (collective)."""
        self.equations = None
        self._load(step - 1, step)
        if renewal := self.grid.renewal(step):
            self._go_to_renewal(step, renewal)
            return
        self.renewal = self.between = None
        self.go_to(step - 1)
        self._set_lead(step, before=True)
        self.scheme.recover(step)

    def _load(self, *steps: int) -> None:
        """Make states available, and those that they follow from (collective)."""
        leads = [self.grid.leads[step] for step in steps if step in self.grid.leads]
        self._records.load(*steps, *(lead.before for lead in leads))

    def _go_to_renewal(self, step: int, renewal: type[Renewal]) -> None:
        """Linearise a part of a renewal at its end."""
        self.go_to(step - 1 if renewal is Projection else step)
        rows, own = self.system.constraints, self.rows(step)  # which events may have switched
        rows.active[:], rows.held[:] = own["active"] > 0.0, own["held"] > 0.0
        rows.targets[rows.held] = own["targets"][rows.held]
        recall(self.simulation, self.known[step - 1])  # before controllers measure again
        self.system.set_time(self.times[step])  # with the loads behind a jump
        factors = self.grid.restitutions.get(step, np.zeros(rows.size))
        self.renewal = renewal(self.system, self.tangent, self.options.dt, factors)
        self.renewal.take()
        self.between = self.renewal

    @contextmanager
    def set_aside(self, carried: Sequence[Carried]) -> Iterator[None]:
        """Without what is carried in place of acceleration-like variables."""
        others = [] if self.alpha else [own.a for own in carried]
        for own, other in zip(carried, others, strict=False):
            own.a = np.zeros_like(other)
        yield
        for own, other in zip(carried, others, strict=False):
            own.a = other

    def lead_by_size(self, state: int) -> list[FloatArray]:
        """Derivatives of acceleration-like variables by the size of the step before their lead.

        They are (n_owned, w) for each block, m/s^3 and so on; leads are inverse to that size.
        """
        lead = self.grid.leads[state]
        factor, found = -lead.part / self.grid.step(lead.before + 1).h, []
        for part in self.system.parts:
            own = np.s_[: part.block.owned, : part.block.width]
            now, before = (
                self.state(k).rows[part.block.name]["acceleration"][own]
                for k in (state, lead.before)
            )
            found.append(factor * (now - before))
        return found

    def restitution(self, simulation: Simulation, step: int) -> FloatArray | None:
        """Restitution (r,) of another model in the projection to a state; None without impact."""
        found, event = self.grid.restitutions.get(step), self.grid.event(step)
        if found is None or event is None:
            return None
        found, rows = found.copy(), simulation.system.constraints
        for action in simulation.serial.model.events[event].actions:
            if isinstance(action, Rebound):
                own = rows.rows_of(action.joint)
                found[own] = np.where(found[own] != 0.0, action.restitution, 0.0)
        return found

    def _set_lead(self, step: int, *, before: bool) -> None:
        """Let loads be those just before or after a jump at a state."""
        lead = self.simulation.breakpoints.lead(float(self.times[step]), before=before)
        self.system.lead = lead

    def history(self) -> dict[str, FloatArray]:
        """Columns by name, on the first rank; the others have none."""
        if self.system.comm.rank:
            return {}
        found = dict(zip(self.columns, self.values.T, strict=True))
        return {"t": self.times[self.rows_at], **found}

    def on_all_ranks[Value](self, value: Value) -> Value:
        """The first rank's value (collective)."""
        found: Value = self.system.comm.bcast(value)
        return found

    def largest(self, *values: FloatArray) -> list[float]:
        """Largest entry of each array on any rank (collective)."""
        found = np.array([float(np.abs(one).max(initial=0.0)) for one in values])
        self.system.comm.Allreduce(MPI.IN_PLACE, found, op=MPI.MAX)
        return [float(one) for one in found]

    def end(self, step: int) -> StepEnd:
        """The end of a step, or of a part of a renewal."""
        if self.grid.renewal(step) is not None:
            return StepEnd(step, AT_STATE, AT_REST)
        return self.scheme.end(step)

    def follows(self, state: int) -> bool:
        """True if numbers of memories follow from a state, which is no intermediate one."""
        return self.grid.renewal(state) is None or state in self.grid.ends

    def take_memories(self, state: int) -> None:
        """Linearise memories where they act, or follow from a state (collective)."""
        acts = self.renewal is not None and self.renewal.acts
        if self.remembering and (acts or self.follows(state)):
            self.memories.take(self.end(state))

    def frames(self, step: int, block: str) -> FloatArray:
        """Frames (n, 12) of a block at the accepted state after a step."""
        return self._records.state(step).rows[block]["frames"]

    def rows(self, step: int) -> Mapping[str, FloatArray]:
        """Arrays of the rows at the accepted state after a step."""
        return self._records.state(step).rows["rows"]

    def state(self, step: int) -> State:
        """The accepted state after a step."""
        return self._records.state(step)

    def _locked(self) -> bool:
        """True if rows are held at values of the motion (collective)."""
        rows = self.system.constraints
        if self.system.comm.allreduce(bool((rows.held & ~rows.rigid).any()), op=MPI.LOR):
            raise InputError(
                "gradient: an event holds a joint with a force law, or one that it opens, which "
                "has no derivatives yet"
            )
        return bool(self.system.comm.allreduce(bool(rows.held.any()), op=MPI.LOR))

    def not_renewed(self) -> str | None:
        """Something with which consistent accelerations have no derivatives (collective)."""
        system, rows = self.system, self.system.constraints
        at = [system.time + part * self.options.dt for part in (0.01, 0.125, 0.5)]
        last = [move for move in self.grid.moves if isinstance(move, Step)][-1:]
        acting = [contacts.closed > 0 for contacts in system.contacts]
        found = {
            "drives whose directions change with time": bool(rows.drives_at(at)[1].any()),
            "internal variables": system.remembering,
            "contacts or stops that are closed": any(acting) or any(one.kicked for one in last),
        }
        if not self.alpha:
            found["contacts or stops that are closed"] |= bool(rows.forces[rows.unilateral].any())
        if self.grid.events or not self.alpha:  # whose times move steps, or with means of outputs
            elements = [group.law for group in rows.elements.groups]
            loops = self.simulation.controls.loops
            found |= {
                "damping of contacts by the penalty": any(
                    group.surfaces.contact.damping > 0.0
                    for contacts in lagging(system)
                    for group in contacts.groups
                ),
                "states of Force": any(law.states or law.explicit for law in elements),
                "continuous controllers that follow accepted states": any(
                    isinstance(loop, ContinuousLoop) and not loop.implicit for loop in loops
                ),
            }
        every = [name for name in found if system.comm.allreduce(found[name], op=MPI.LOR)]
        return every[0] if every else None

    def _check_renewal(self) -> None:
        """Refuse to make a state consistent where that has no derivatives (collective)."""
        if name := self.not_renewed():
            raise InputError(
                "gradient: a load jumps, or an event happens, at t = "
                f"{self.system.time:.6g} s, which has no derivatives with {name} yet"
            )


def _without_corrections(motion: Motion) -> dict[str, bool]:
    """What corrections of positions have no derivatives with, and whether this rank has it."""
    system, rows = motion.system, motion.system.constraints
    return {
        "events": bool(motion.model.events),
        "contacts": len(system.contacts) > 0,
        "stops and slack joints": rows.has_unilateral,
        "controllers": len(motion.simulation.controls) > 0,
        "force elements": rows.has_elements,
        "internal variables": system.remembering,
        "damping of modes": system.modal_dampers is not None,
        "damping of shells": any(
            isinstance(part.elements, TurningElements) and part.elements.viscous
            for part in system.parts
        ),
        "redundant constraints": rows.relaxation > 0.0,
    }


def check_supported_system(motion: Motion) -> None:
    """Raise for what the built system has and cannot be differentiated (collective)."""
    system, rows = motion.system, motion.system.constraints
    comm = system.comm
    found = {
        "friction of cables": bool(len(rows.wrapped_rows)),
        "internal variables in plane stress, or of mixed cells that change their volumes": any(
            isinstance(part.elements, HistoryElements)
            and part.elements.remembering
            and part.elements.history_derivatives() is None
            for part in system.parts
        ),
    }
    if not motion.alpha:
        found |= {
            "events with the integrator energy_momentum and rho_inf below 1": motion.options.rho_inf
            < 1.0
            and bool(motion.model.events),
        }
    if isinstance(motion.simulation.integrator, StabilizedIndex2):
        found |= {
            f"{name} with the integrator stabilized_index2": present
            for name, present in _without_corrections(motion).items()
        }
    if rows.split:
        found |= {
            "impulses with friction in joints": bool(len(rows.coupled)),
            "impulses with states of Force": any(
                group.law.states or group.law.explicit for group in rows.elements.groups
            ),
            "impulses with friction or damping of penalties": bool(lagging(system)),
            "stops of sliders": bool((rows.unilateral & rows.on_lines).any()),
        }
    for name, present in found.items():
        if comm.allreduce(present, op=MPI.LOR):
            raise InputError(f"gradient: there are no derivatives of {name} yet; leave them out")
    check_contacts(system.contacts)
