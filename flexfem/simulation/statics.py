# SPDX-License-Identifier: LGPL-3.0-or-later
"""Static equilibria: from a model and options to results in a folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._faults import current
from flexfem._types import FloatArray
from flexfem.analyses.statics import StaticOptions
from flexfem.core.status import Status
from flexfem.io.paraview.field_output import FieldOutput
from flexfem.io.vtu.field_choice import FieldChoice
from flexfem.la.linear_solver import LinearSolver
from flexfem.model.contact import Contact
from flexfem.model.model import Model
from flexfem.model.probes.measured import EnergyProbe
from flexfem.simulation.equilibria.equilibrium import check_held, rest
from flexfem.simulation.equilibria.path import CriticalPoint, Path
from flexfem.simulation.equilibria.path_progress import Followed
from flexfem.simulation.equilibria.targets import LOAD, Targets
from flexfem.simulation.motion.slider_exit import SliderExit
from flexfem.simulation.run.cautions import Cautions
from flexfem.simulation.run.checkpoints import Checkpoints, Restart
from flexfem.simulation.run.failure_reasons import (
    ITERATED,
    STABILISED,
    STATICS,
    moves_most,
    not_finite,
    with_hint,
)
from flexfem.simulation.run.functions_alike import FunctionsAlike
from flexfem.simulation.run.guard import agreed
from flexfem.simulation.run.loop import Steps, carry_out
from flexfem.simulation.run.outcome import Outcome, Results
from flexfem.simulation.run.recording import Recorder
from flexfem.simulation.run.setup import set_up
from flexfem.simulation.run.time_grid import TimeGrid
from flexfem.simulation.watch.inside_out import inside_out
from flexfem.simulation.watch.locked_shapes import locked_shapes
from flexfem.simulation.watch.validity import doubtful_state
from flexfem.solvers.linear.iterative import check_iterative
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.solvers.statics.buckling import LinearBuckling
from flexfem.solvers.statics.equilibrium import Equilibrium, Limits, settle
from flexfem.solvers.statics.linear import solve_linear
from flexfem.system.measure.probes import ProbeRecorder

__all__ = ["StaticSteps", "solve_static"]

#: Name of no column.
_NONE = "none"
#: Number of times that a step is halved before the run fails.
_HALVINGS = 12
#: Iterations of an easy step, after which steps grow again.
_EASY = 5
#: Accuracy of the end of a run, relative to its value.
_EXACT = 1e-10
#: Neglected part of a linear solution above which a warning is given.
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
            far is written, and a checkpoint in load steps.
        OSError: the results cannot be written.
        KeyboardInterrupt: SIGINT, SIGTERM or SIGHUP came; the same is written.
    """
    _checks.instance("solve_static", "options", options, StaticOptions)
    comm = comm or MPI.COMM_WORLD
    steps = _LinearSolutions if options.linear else StaticSteps
    return carry_out(partial(steps, model, options, comm), options, comm, case, results)


def _columns(probes: ProbeRecorder, equilibrium: Equilibrium) -> dict[str, float]:
    """The history's columns at the trial state, on the first rank (collective)."""
    equilibrium.react()
    probes.record(equilibrium.loading.t)
    for _, values in probes.flush():
        return dict(zip(probes.columns, values.tolist(), strict=True))
    return {}


def _too_large(part: float, size: float) -> str:
    """Warning of a linear solution with a large linearisation error."""
    share = f"{100.0 * part:.3g} %" if part < 1.0 else "more than 100 %"
    return (
        f"linear: the next iteration would change {share} of the solution, whose "
        f"largest rotation (rad) or relative displacement is {size:.3g}; leave out linear"
    )


class StaticSteps(Steps):
    """Steps along a path of equilibria.

    Attributes:
        serial: serial data of the model.
        equilibrium: its static equations, at the accepted equilibrium between steps.
        path: the path.
    """

    recorder: Recorder

    def __init__(
        self, model: Model, options: StaticOptions, comm: MPI.Intracomm, restart: Restart | None
    ) -> None:
        """Set the system up in equilibrium at its start (collective).

        Args:
            model: the model, the same on every rank.
            options: of the analysis.
            comm: communicator of all ranks.
            restart: checkpoint to resume from, None to start at t = 0.

        Raises:
            InputError: a mistake in the model, or options that do not apply to it.
        """
        self._options = options
        check = None if restart is None else restart.check
        kind = "direct" if options.factored else options.linear_solver
        self.serial, self.system = set_up(
            model, comm, options.split_above, check, kernels=options.kernels,
            linear=LinearSolver(kind, options.linear_tolerance),
        )  # fmt: skip
        check_iterative(self.system)
        if options.arc_length > 0.0 and self.system.rate_dependent:
            raise InputError(
                f"StaticOptions: arc_length {options.arc_length:g} has no time for viscoelastic "
                "solids: use load steps, whose load factor counts as time"
            )
        self.cautions = Cautions.of_model(self.serial, options, self.system)
        self._probes = ProbeRecorder(self.system, self.serial, depth=1)
        self._check_column()
        self._targets = Targets(options.output_at, self._probes.columns, options.t_end)
        self._reached: list[tuple[str, float]] = []
        self.equilibrium = rest(
            self.serial, self.system, TangentSolver(self.system),
            Limits(options.tolerance, options.max_iterations),
            span=options.t_end, grow=True, gravity_grows=options.gravity_load == "proportional",
            stabilise=options.stabilise,
        )  # fmt: skip
        if not options.stabilise:
            check_held(self.serial, self.equilibrium)
        self._slider_exit = SliderExit(self.system, self.serial)
        self._inverted = ""
        self._columns = partial(_columns, self._probes, self.equilibrium)
        self.status = self._checked(self._settled(model))
        self._buckling = LinearBuckling(self.equilibrium) if options.buckling_modes else None
        self.followed = Followed(self.system, self.equilibrium, self._probes.columns)
        if restart is not None:
            self._go_on(restart)
        self.path = Path(
            self.equilibrium, follow=options.arc_length > 0.0, count=options.critical_points,
            columns=self._columns,
        )  # fmt: skip
        if self.status is Status.OK and not self.path.aimed:
            raise InputError(
                f"StaticOptions: arc_length {options.arc_length:g} follows the path of a growing "
                f'load, but nothing in Model "{model.name}" that moves it grows with t'
            )
        self.checkpoints = Checkpoints(
            self.followed, self.serial, options, TimeGrid(1.0, 1), restart
        )
        self.functions = FunctionsAlike(self.system, self.serial.model)
        self._stopped = options.stop_column == _NONE
        self._factors: list[float] = []
        self._branched = options.branch == 0.0
        self._width = self._h = 0.0
        self.recorder = Recorder(
            self.system, self.serial, options, options.every, options.t_end, unit="",
            varies=True, resume=None if restart is None else restart.state,
        )  # fmt: skip

    def _settled(self, model: Model) -> Status:
        """Bring the system to its equilibrium at t = 0."""
        return settle(self.equilibrium)

    @property
    def at(self) -> str:
        """See :class:`Steps`."""
        return f"t = {self.path.point.t:.6g}"

    @property
    def after(self) -> str:
        """See :class:`Steps`."""
        return f"t = {self.equilibrium.loading.t:.6g}"

    @property
    def completed(self) -> int | None:
        """See :class:`Steps`; a path by arc length cannot be resumed."""
        return self.followed.steps if self.path.arc is None else None

    def _go_on(self, restart: Restart) -> None:
        """Restore the state from the checkpoint (collective)."""
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
        """Return the value of the column that ends the run less its value at the end."""
        value = self._columns().get(self._options.stop_column, 0.0)
        value = float(self.system.comm.bcast(value))
        return value - float(self._options.stop_value)

    def record_start(self) -> None:
        """See :class:`Steps`."""
        self.recorder.record(0)

    def begin(self) -> None:
        """Choose the first step."""
        options, path = self._options, self.path
        h = options.t_end / options.load_steps
        if path.arc is not None:
            h = options.arc_length * options.t_end / path.arc.slope
        self._width = h
        self._h = min(h, self.followed.next or h)

    def take(self, stopping: Callable[[], bool]) -> Status:
        """See :class:`Steps`."""
        tangent = self.equilibrium.tangent
        tangent.stop_when(stopping)
        try:
            return self._next(stopping)
        finally:
            tangent.stop_when(bool)  # the other one holds the run

    def _next(self, stopping: Callable[[], bool]) -> Status:
        """Take a step along the path."""
        options, path, h = self._options, self.path, self._h
        if path.arc is not None:
            if self.followed.steps == options.max_steps:
                return Status.NOT_CONVERGED
            h = min(h, options.max_step / path.arc.largest_turn())
        else:
            t = path.point.t
            h = min(h, options.t_end - t, self._targets.room(t))
        status, tried, done = self._advance(h, stopping)
        if status is Status.OK:
            self._h = self.followed.next = self._grown(tried, self._width)
            self.done = done
        return status

    def record_failure(self) -> None:
        """See :class:`Steps`."""
        self.recorder.record_last(self.followed.steps + 1)
        self.followed.next = self._width

    def _grown(self, h: float, width: float) -> float:
        """Next step from the one just taken and its iterations."""
        iterations = self.equilibrium.iterations
        if self.path.arc is None:
            h *= min(2.0, self.equilibrium.room) if iterations <= _EASY else 1.0
            # back to the grid of equal steps
            t = self.path.point.t
            left = (np.floor(t / width + 1e-9) + 1.0) * width - t
            return float(min(h, width, left if left > 1e-9 * width else width))
        return h * float(min(max((_EASY / iterations) ** 0.5, 0.5), 2.0))

    def _advance(self, h: float, stopping: Callable[[], bool]) -> tuple[Status, float, bool]:
        """Take one step of at most ``h``; returns status, size, and True at the end of the run."""
        path, before = self.path, self._beyond() if self._options.stop_column != _NONE else 0.0
        self.followed.largest = max(self.followed.largest, h)
        smallest = self.followed.largest * 0.5**_HALVINGS
        self._before = self._wanted(path.point.t)
        status, end, critical = self._tried(h, before)
        while status not in (Status.OK, Status.LEFT) and h > smallest:
            if self.equilibrium.stuck or stopping():
                break
            if agreed(current(), self.system.comm) is not None:  # smaller steps do not help
                break
            self.followed.rejected += 1
            h *= self.equilibrium.cut
            status, end, critical = self._tried(h, before)
        if status is not Status.OK:
            path.return_to_base()
            return status, h, True
        self._accept(end and critical is None)
        if critical is not None:
            self.followed.critical.append(critical)
            status = self._branch_off(critical)
        return status, h, end and critical is None

    def _tried(self, h: float, before: float) -> tuple[Status, bool, CriticalPoint | None]:
        """Try one step, shortened to the end of the run or the first critical point in it."""
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

        Load steps end at load factors in any case.
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
        if self._slider_exit.found():
            return Status.LEFT
        self._inverted = inside_out(self.serial, self.system)
        return Status.INSIDE_OUT if self._inverted else Status.OK

    def _accept(self, last: bool) -> None:
        self.path.accept()
        self.followed.steps += 1
        noted = self._targets.note(self._reached, self.path.point.t)
        self.recorder.record(self.followed.steps, last=last or noted)

    def _branch_off(self, critical: CriticalPoint) -> Status:
        """Leave the path at the first bifurcation, if requested."""
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

    def finish(self) -> None:
        """Linearised buckling loads; pictures of all modes."""
        found = self._buckling.solve(self._options.buckling_modes) if self._buckling else []
        self._factors = [t for t, _ in found]
        if self._options.output is None:
            return
        modes = [(c.t, c.motion) for c in self.followed.critical if c.kind == "bifurcation"] + found
        fields = FieldOutput(
            self._options.output / "modes", self.system, self.serial,
            fields=FieldChoice(precision=self._options.fields_precision),
        )  # fmt: skip
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

    def reason(self, status: Status) -> str:
        """See :class:`Steps`; with the load factor, the place and advice."""
        t, options = self.equilibrium.loading.t, self._options
        if status is Status.OK:
            return "ok" if self._stopped else self._unreached()
        if status is Status.LEFT:
            return f"{self._slider_exit.reason} after t = {t:.6g}"
        if self.followed.steps == options.max_steps:
            return with_hint(
                f"not at the end after {options.max_steps} arc-length steps, t = {t:.6g}",
                "increase max_steps or arc_length, or choose a stop_value that is reached",
            )
        h = options.t_end / options.load_steps
        culprit = not_finite(self.serial, t + h * np.array([0.5**_HALVINGS, 0.5, 1.0]))
        if culprit:
            return f"{culprit} after t = {t:.6g}"
        where = moves_most(self.serial, self.system) if status in ITERATED else ""
        text = self._inverted if status is Status.INSIDE_OUT else status.value
        hints = STABILISED if options.stabilise else STATICS
        return with_hint(f"{text} at t = {t:.6g}{where}", hints.get(status))

    def _unreached(self) -> str:
        """True if the run came to ``t_end`` before the column had its value (collective)."""
        options = self._options
        wanted, last = options.stop_value, options.stop_value + self._beyond()
        return with_hint(
            f"stop_value {wanted:g} of {options.stop_column} not reached: {last:g} at "
            f"t = {options.t_end:g}",
            "increase t_end, or change the sign of stop_value if the column moves away from it",
        )

    def look_back(self, reason: str, history: Mapping[str, FloatArray]) -> None:
        """See :class:`Steps`."""
        if reason == "ok":
            self.cautions.say(self._targets.missed)
        self.cautions.say(locked_shapes(self.serial, self.system))
        self.cautions.say(doubtful_state(self.serial, self.system))

    def summary(self) -> dict[str, Any]:
        """See :class:`Steps`."""
        solves = self.system.linear.counts
        return {
            "steps": self.followed.steps,
            "rejected_steps": self.followed.rejected,
            "linear_solver": "iterative" if solves.setups else "direct",
            "linear_solves": solves.solves,
            "linear_iterations": solves.iterations,
            "linear_hierarchies": solves.setups,
            "critical_points": [point.summary() for point in self.followed.critical],
            "buckling": self._factors,
            "output_at": self._targets.met,
            "linear": None,
        }


class _LinearSolutions(StaticSteps):
    """Linear solutions from the start for each requested load factor, and for the end."""

    def __init__(
        self, model: Model, options: StaticOptions, comm: MPI.Intracomm, restart: Restart | None
    ) -> None:
        """See :class:`StaticSteps`."""
        self._neglected: dict[str, float] = {}
        super().__init__(model, options, comm, restart)

    def begin(self) -> None:
        """Store the load factors, and the state from which all solutions start."""
        self._left = sorted({*self._targets.values.get(LOAD, ()), self._options.t_end})
        self._from = self.equilibrium.keep()

    @property
    def completed(self) -> None:
        """See :class:`Steps`."""

    def _next(self, stopping: Callable[[], bool]) -> Status:
        """Compute one solution and its estimated linearisation error."""
        equilibrium, t = self.equilibrium, self._left.pop(0)
        failed = self.system.linear.counts.failed
        solution = solve_linear(equilibrium, self._from, t)
        if solution is None:
            return self.equilibrium.unsolved(failed)
        values = solution.columns(equilibrium, self._columns)
        part = solution.neglected(equilibrium)
        self._neglected |= {"neglected": part, "largest": solution.size}
        if t == self._options.t_end and part > _NEGLECTED:
            self.cautions.say([_too_large(part, solution.size)])
        self.followed.steps += 1
        self._targets.note((), t)
        self.recorder.record_values(self.followed.steps, values)
        self.done = not self._left
        return Status.OK

    def record_failure(self) -> None:
        """Record nothing: there is no solution."""

    def finish(self) -> None:
        """Compute nothing: linear solutions have no buckling loads."""

    def summary(self) -> dict[str, Any]:
        """See :class:`Steps`."""
        return super().summary() | {"linear": self._neglected or None}

    def _settled(self, model: Model) -> Status:
        """Keep the start, which need not be an equilibrium, after checking the model."""
        self._check_linear(model)
        return Status.OK

    def _check_linear(self, model: Model) -> None:
        """Raise for probes and contacts without first-order meaning: energies, opening or closing.

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
