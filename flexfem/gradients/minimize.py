# SPDX-License-Identifier: LGPL-3.0-or-later
"""Minimisation of a number of a motion over parameters of its model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.gradients.gradient import Differentiation
from flexfem.gradients.methods import Task, method_of
from flexfem.gradients.motion.functionals import Functional
from flexfem.gradients.motion.parameters import (
    Build,
    Values,
    check_build,
    check_function,
    check_names,
    checked_values,
    flat,
    limits_of,
    named,
    plain,
    scales,
    sides_of,
)
from flexfem.gradients.states.analyses import Options
from flexfem.io.atomic import raise_together
from flexfem.io.evaluations import (
    Evaluation,
    append_evaluation,
    read_evaluations,
    write_evaluations,
)
from flexfem.io.tables.table import write_table

__all__ = ["Optimum", "minimize"]

#: File of all evaluations.
_FILE = "optimisation.jsonl"
#: Relative difference of two motions that count as the same, such as those on other ranks.
_SAME = 1e-6
#: Part of its limit by which a constraint may be exceeded at the best point.
_SLACK = 1e-6
#: A cost of the parameters themselves: its value, and its derivatives by name.
Cost = Callable[..., tuple[float, Mapping[str, npt.ArrayLike]]]
#: A functional with the least and the largest value that is allowed, None for none.
Constraint = tuple[str | Functional, float | None, float | None]


@dataclass(frozen=True)
class Optimum:
    """Result of a minimisation.

    Attributes:
        values: parameters, numbers or arrays (n,).
        value: of the objective.
        gradients: number of gradients that were computed.
        success: True if the method says that it has converged.
        message: its own words.
        history: of every gradient: the value, and those of the constraints by name.
    """

    values: Mapping[str, float | FloatArray]
    value: float
    gradients: int
    success: bool
    message: str
    history: Sequence[Mapping[str, float]] = field(repr=False)


def minimize(
    build: Build,
    objective: str | Functional | None,
    start: Mapping[str, npt.ArrayLike],
    options: Options,
    *,
    bounds: Mapping[str, tuple[float | None, float | None]] | None = None,
    constraints: Sequence[Constraint] = (),
    cost: Cost | None = None,
    scale: Mapping[str, npt.ArrayLike] | None = None,
    method: str | None = None,
    most: int = 100,
    tolerance: float = 1e-10,
    ks_rho: float | None = None,
    output: Path | str | None = None,
    restart: Path | str | None = None,
    report: Callable[[Mapping[str, float]], None] | None = None,
    comm: MPI.Intracomm | None = None,
) -> Optimum:
    """Minimise a number of a motion, of equilibria or of modes (collective).

    Each iteration of the method takes one motion and its adjoint::

        found = ff.minimize(build, "rms:deflection", {"damping": 10.0}, options)

    Args:
        build: model of the parameters' values.
        objective: a number, see :func:`gradient`; None for the cost alone.
        start: values of all parameters to begin with, numbers or arrays (n,).
        options: of the motions, the equilibria or the modes.
        bounds: least and largest value of parameters by name, None for none.
        constraints: functionals with their bounds, such as ``("ks:stress", None, 2e8)``.
        cost: a number to be added that depends on the parameters alone: takes them by name and
            returns it with its derivatives by name.
        scale: changes of parameters that are alike; their sizes at the start by default.
        method: "L-BFGS-B", which has no constraints, "SLSQP", which is the default with them (of
            SciPy), "MMA" (``pip install flexfem[nlopt]``) for many parameters and constraints, or
            "IPOPT" (``flexfem[ipopt]``).
        most: largest number of gradients, those of ``restart`` among them.
        tolerance: relative change of the objective at which the method ends.
        ks_rho: of "ks", one over the unit of the column.
        output: folder of ``optimisation.csv``, with a row for each gradient, and of
            ``optimisation.jsonl``, from which it can go on; None for none.
        restart: file ``optimisation.jsonl`` of one that was interrupted, with the same model and
            options: gradients that are in it are not computed again, so that the same method goes
            the same way and on.
        report: called on all ranks with each row of the table.
        comm: communicator, all ranks by default.

    Raises:
        InputError, TypeError, ValueError: as :func:`gradient`; a name that is no parameter; a file
            of other functions, parameters, models or options.
        InstallationError: the package of the method is missing.
        StoppedError: a motion failed.
        OSError: the files cannot be written.
    """
    values = checked_values(start)
    check_build("minimize", build, values)
    for what, given in (("cost", cost), ("report", report)):
        if given is not None:
            check_function("minimize", what, given)
    _checks.count("minimize", "most", most, 1)
    _checks.number("minimize", "tolerance", tolerance, nonnegative=True)
    solve = method_of(method, constrained=bool(constraints))
    if objective is None and (cost is None or not constraints):
        raise ValueError("minimize: without an objective give a cost and constraints")
    if objective is not None:
        _checks.instance("minimize", "objective", objective, (str, Functional))
    for one in constraints:
        _checks.instance("minimize", "a constraint", one, Sequence)
        sides_of(f"minimize: bounds of {_checks.show(one[0])}", one[1:])
    of = [*(() if objective is None else (objective,)), *(one for one, *_ in constraints)]
    once = [one for k, one in enumerate(of) if one not in of[:k]]  # one may have several bounds
    analysis = Differentiation(build, once, options, ks_rho=ks_rho, comm=comm)
    problem = _Problem(analysis, [once.index(one) for one in of], values, comm)
    problem.only_cost = objective is None
    problem.cost, problem.most = cost, most
    problem.scale = scales("minimize", values, scale or {})
    problem.output = None if output is None else Path(output)
    problem.report = report
    limits = limits_of("minimize", values, bounds or {})
    if restart is not None:
        problem.remember(Path(restart))
    between = [(low, high) for _, low, high in constraints]
    return problem.solved(solve, limits, between, tolerance)


class _EnoughError(Exception):
    """The largest number of gradients is reached."""


class _Problem:
    """Objective and constraints as functions of scaled parameters, each computed once."""

    cost: Cost | None
    only_cost: bool
    most: int
    scale: Values
    output: Path | None
    report: Callable[[Mapping[str, float]], None] | None

    def __init__(
        self, analysis: Differentiation, order: Sequence[int], values: Values,
        comm: MPI.Intracomm | None,
    ) -> None:  # fmt: skip
        self._analysis, self._start = analysis, values
        self._names = [analysis.functionals[k].name for k in order]
        self._comm = comm or MPI.COMM_WORLD
        self._kept = False  # there is a file of this run
        #: Evaluations without the cost by parameters, and with it by scaled ones.
        self._known: dict[bytes, Evaluation] = {}
        self._seen: dict[bytes, tuple[FloatArray, FloatArray]] = {}
        self._best: tuple[tuple[float, float], FloatArray] | None = None
        self._task: Task
        self.history: list[dict[str, float]] = []

    def remember(self, path: Path) -> None:
        """Take evaluations from a file, of which the first is compared (collective).

        Raises:
            InputError: on all ranks, if the file is not one of this minimisation.
        """
        found, error = None, None
        if self._comm.rank == 0:
            try:
                found = read_evaluations(path)
            except InputError as problem:
                error = problem
        raise_together(self._comm, error)
        names, rows = self._comm.bcast(found)
        size = sum(value.size for value in self._start.values())
        if names != self._names or any(len(row.at) != size for row in rows):
            raise InputError(
                f"minimize: restart '{path}' is of {_checks.show(', '.join(names))} by "
                f"{len(rows[0].at) if rows else 0} numbers, not of {', '.join(self._names)} by "
                f"{size}"
            )
        for row in rows[:1]:
            values = self._analysis.value(named(self._start, row.at))
            for name, there in zip(names, row.values, strict=True):
                if abs(values[name] - there) > _SAME * abs(there):
                    raise InputError(
                        f"minimize: restart '{path}' is of another model or other options: {name} "
                        f"is {there:.6g} there, {values[name]:.6g} here"
                    )
        self._known = {row.at.tobytes(): row for row in rows}

    def solved(
        self, method: Callable[[Task], tuple[FloatArray, bool, str]], limits: Values,
        between: Sequence[tuple[float | None, float | None]], tolerance: float,
    ) -> Optimum:  # fmt: skip
        """Call the method."""
        low, high = (self._flat(limits, k) for k in range(2))
        begin = self._flat(self._start, None)
        self._task = Task(self._of, begin, low, high, between, self.most, tolerance)
        try:
            best, success, message = method(self._task)
        except _EnoughError:
            assert self._best is not None
            best = self._best[1]
            success, message = False, f"{self.most} gradients were computed"
        value = self._of(best, again=True)[0][0]
        return Optimum(
            plain(self._named(best)), float(value), len(self.history), success, message,
            self.history,
        )  # fmt: skip

    def _of(self, x: FloatArray, *, again: bool = False) -> tuple[FloatArray, FloatArray]:
        """Values (k,) and derivatives (k, n) of objective and constraints (collective)."""
        key = np.ascontiguousarray(x).tobytes()
        if key in self._seen:
            return self._seen[key]
        if len(self.history) >= self.most and not again:
            raise _EnoughError
        current = self._named(x)
        found = self._evaluated(current)
        values = found.values.copy()
        slopes = np.array([self._scaled(named(self._start, row)) for row in found.slopes])
        if self.only_cost:
            values, slopes = np.append(0.0, values), np.vstack([np.zeros(x.size), slopes])
        if self.cost is not None:
            more, by = self._checked_cost(self.cost(**plain(current)))
            values[0] += more
            slopes[0] += self._scaled(by)
        self._seen[key] = values, slopes
        merit = (max(self._task.violation(values) - _SLACK, 0.0), float(values[0]))
        if self._best is None or merit < self._best[0]:
            self._best = merit, np.array(x)
        names = self._names if self.only_cost else self._names[1:]
        self._record(dict(zip(["objective", *names], values.tolist(), strict=True)))
        return values, slopes

    def _checked_cost(self, found: Any) -> tuple[float, Mapping[str, npt.ArrayLike]]:
        """A cost with its derivatives.

        Raises:
            ValueError: they are something else, or names are no parameters.
        """
        by: Mapping[str, npt.ArrayLike] | None = None
        with suppress(TypeError, ValueError):
            value, by = found
            value = float(value)
        if not isinstance(by, Mapping) or not isinstance(value, float) or not np.isfinite(value):
            raise ValueError(
                "minimize: cost must return a finite number and its derivatives by name, got "
                f"{_checks.show(found)}"
            )
        check_names("minimize", "the derivative of cost", self._start, by)
        return value, by

    def _evaluated(self, current: Values) -> Evaluation:
        """Values and derivatives by parameters, without the cost (collective)."""
        at = flat(self._start, current)
        if at.tobytes() not in self._known:
            found = self._analysis.at(current)
            new = Evaluation(
                at, np.array([found.value[name] for name in self._names]),
                np.array([flat(self._start, found.gradient[name]) for name in self._names]),
            )  # fmt: skip
            self._known[at.tobytes()] = new
            self._keep(new)
        return self._known[at.tobytes()]

    def _keep(self, new: Evaluation) -> None:
        """Add an evaluation to the file from which a minimisation can go on (collective)."""

        def write(folder: Path) -> None:
            if self._kept:
                append_evaluation(folder / _FILE, new)
            else:
                write_evaluations(folder / _FILE, self._names, list(self._known.values()))

        self._written(write)
        self._kept = True

    def _record(self, row: dict[str, float]) -> None:
        """Add a row to the history and to its table (collective)."""
        self.history.append(row)
        self._written(lambda folder: write_table(folder / "optimisation.csv", self.history))
        if self.report is not None:
            self.report(row)

    def _written(self, write: Callable[[Path], None]) -> None:
        """Write into the folder, on the first rank; all ranks raise its error (collective)."""
        if self.output is None:
            return
        error = None
        if self._comm.rank == 0:
            try:
                write(self.output)
            except OSError as problem:
                error = problem
        raise_together(self._comm, error)

    def _named(self, x: FloatArray) -> Values:
        """Values by name of scaled parameters."""
        found = named(self._start, np.asarray(x, dtype=np.float64))
        return {name: value * self.scale[name] for name, value in found.items()}

    def _scaled(self, by: Mapping[str, npt.ArrayLike]) -> FloatArray:
        """Derivatives by scaled parameters, (n,); those that are missing are zero."""
        every = {name: by.get(name, 0.0) for name in self._start}
        return flat(self._start, every) * flat(self._start, self.scale)

    def _flat(self, values: Values, column: int | None) -> FloatArray:
        """Scaled parameters (n,) of values, or of a column of limits."""
        chosen = {n: x if column is None else x[column] for n, x in values.items()}
        return flat(self._start, chosen) / flat(self._start, self.scale)
