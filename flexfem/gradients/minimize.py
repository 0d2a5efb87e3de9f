# SPDX-License-Identifier: LGPL-3.0-or-later
"""Minimisation of a number of a motion over parameters of its model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.gradients.gradient import Differentiation
from flexfem.gradients.motion.functionals import Functional
from flexfem.gradients.motion.parameters import Build, Values, checked_values, named, plain
from flexfem.gradients.states.analyses import Options
from flexfem.io.tables.table import write_table

__all__ = ["Optimum", "minimize"]

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
    objective: str | Functional,
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
    output: Path | str | None = None,
    comm: MPI.Intracomm | None = None,
) -> Optimum:
    """Minimise a number of a motion, of equilibria or of modes by ``scipy.optimize``.

    All ranks call it; each iteration of the method takes one motion and its adjoint::

        found = ff.minimize(build, "rms:deflection", {"damping": 10.0}, options)

    Args:
        build: model of the parameters' values.
        objective: see :func:`gradient`.
        start: values of all parameters to begin with, numbers or arrays (n,).
        options: of the motions, the equilibria or the modes.
        bounds: least and largest value of parameters by name, None for none.
        constraints: functionals with their bounds; they need the method SLSQP.
        cost: a number to be added that depends on the parameters alone: takes them by name and
            returns it with its derivatives by name.
        scale: changes of parameters that are alike; their sizes at the start by default.
        method: "L-BFGS-B", or "SLSQP", which is the default with constraints.
        most: largest number of gradients.
        tolerance: relative change of the objective at which the method ends.
        output: folder of ``optimisation.csv``, with a row for each gradient; None for none.
        comm: communicator, all ranks by default.

    Raises:
        InputError, TypeError, ValueError: as :func:`gradient`; a name that is no parameter.
        StoppedError: a motion failed.
        OSError: the table cannot be written.
    """
    values = checked_values(start)
    problem = _Problem(build, (objective, constraints), values, options, comm)
    problem.cost, problem.most = cost, most
    problem.scale = _scales(values, scale or {})
    problem.output = None if output is None else Path(output)
    return problem.solved(method, _limits(values, bounds or {}), tolerance)


class _EnoughError(Exception):
    """The largest number of gradients is reached."""


class _Problem:
    """Objective and constraints as functions of scaled parameters, each computed once."""

    cost: Cost | None
    most: int
    scale: Values
    output: Path | None

    def __init__(
        self, build: Build, wanted: tuple[str | Functional, Sequence[Constraint]], values: Values,
        options: Options, comm: MPI.Intracomm | None,
    ) -> None:  # fmt: skip
        objective, constraints = wanted
        self._start = values
        self._between = [(low, high) for _, low, high in constraints]
        of = [objective, *(one for one, *_ in constraints)]
        self._differentiation = Differentiation(build, of, options, comm=comm)
        self._comm = comm or MPI.COMM_WORLD
        self._last: tuple[bytes, FloatArray, FloatArray] | None = None
        self._best: tuple[float, FloatArray] | None = None
        self.history: list[dict[str, float]] = []

    def solved(self, method: str | None, limits: Values, tolerance: float) -> Optimum:
        """Call the method."""
        from scipy.optimize import Bounds
        from scipy.optimize import minimize as scipy_minimize

        method = method or ("SLSQP" if self._between else "L-BFGS-B")
        if method not in ("L-BFGS-B", "SLSQP") or (self._between and method != "SLSQP"):
            known = '"SLSQP"' if self._between else '"L-BFGS-B" or "SLSQP"'
            raise ValueError(f"minimize: method must be {known}, got {_checks.show(method)}")
        low, high = (self._flat(limits, k) for k in range(2))
        begin = self._flat(self._start, None)
        options = {"maxiter": self.most, "ftol": tolerance}
        if method == "L-BFGS-B":
            options |= {"maxfun": self.most, "gtol": 0.0}
        try:
            found = scipy_minimize(
                lambda x: self._of(x)[0][0], begin, jac=lambda x: self._of(x)[1][0],
                bounds=Bounds(low, high), constraints=self._constraints(), method=method,
                options=options,
            )  # fmt: skip
            success, message = bool(found.success), str(found.message)
            best = found.x
        except _EnoughError:
            success, message = False, f"{self.most} gradients were computed"
            assert self._best is not None
            best = self._best[1]
        value = self._of(best, again=True)[0][0]
        return Optimum(
            plain(self._named(best)), float(value), len(self.history), success, message,
            self.history,
        )  # fmt: skip

    def _constraints(self) -> list[dict[str, Any]]:
        """Inequalities of ``scipy.optimize``, each at least zero."""
        found = []
        for k, (low, high) in enumerate(self._between, 1):
            for limit, sign in ((low, 1.0), (high, -1.0)):
                if limit is not None:
                    found.append({
                        "type": "ineq",
                        "fun": lambda x, k=k, at=limit, s=sign: s * (self._of(x)[0][k] - at),
                        "jac": lambda x, k=k, s=sign: s * self._of(x)[1][k],
                    })  # fmt: skip
        return found

    def _of(self, x: FloatArray, *, again: bool = False) -> tuple[FloatArray, FloatArray]:
        """Values (k,) and derivatives (k, n) of objective and constraints (collective)."""
        key = np.ascontiguousarray(x).tobytes()
        if self._last is not None and self._last[0] == key:
            return self._last[1:]
        if len(self.history) >= self.most and not again:
            raise _EnoughError
        current = self._named(x)
        found = self._differentiation.at(current)
        names = [one.name for one in self._differentiation.functionals]
        values = np.array([found.value[name] for name in names])
        slopes = np.array([self._scaled(found.gradient[name]) for name in names])
        if self.cost is not None:
            more, by = self.cost(**plain(current))
            values[0] += more
            slopes[0] += self._scaled(by)
        self._last = key, values, slopes
        if self._best is None or values[0] < self._best[0]:
            self._best = float(values[0]), np.array(x)
        self._record(
            {"objective": float(values[0])} | dict(zip(names[1:], values[1:], strict=True))
        )
        return values, slopes

    def _record(self, row: dict[str, float]) -> None:
        """Add a row to the history and to its table."""
        self.history.append(row)
        if self.output is not None and self._comm.rank == 0:
            self.output.mkdir(parents=True, exist_ok=True)
            write_table(self.output / "optimisation.csv", self.history)

    def _named(self, x: FloatArray) -> Values:
        """Values by name of scaled parameters."""
        found = named(self._start, np.asarray(x, dtype=np.float64))
        return {name: value * self.scale[name] for name, value in found.items()}

    def _scaled(self, by: Mapping[str, npt.ArrayLike]) -> FloatArray:
        """Derivatives by scaled parameters, (n,); those that are missing are zero."""
        return np.concatenate([
            np.broadcast_to(by.get(name, 0.0), value.shape).ravel() * self.scale[name].ravel()
            for name, value in self._start.items()
        ])  # fmt: skip

    def _flat(self, values: Values, column: int | None) -> FloatArray:
        """Scaled parameters (n,) of values, or of a column of limits."""
        return np.concatenate([
            np.broadcast_to(
                values[name] if column is None else values[name][column], value.shape
            ).ravel() / self.scale[name].ravel()
            for name, value in self._start.items()
        ])  # fmt: skip


def _scales(values: Values, given: Mapping[str, npt.ArrayLike]) -> Values:
    """Scale of each parameter, of its shape.

    Raises:
        ValueError: a name is no parameter, or a scale is not positive.
    """
    _check_names("scale", values, given)
    found = {}
    for name, value in values.items():
        own = np.asarray(given.get(name, np.where(value == 0.0, 1.0, np.abs(value))), dtype=float)
        if not (own > 0.0).all() or not np.isfinite(own).all():
            raise ValueError(f"minimize: scale of {name} must be positive, got {_checks.show(own)}")
        found[name] = np.broadcast_to(own, value.shape).copy()
    return found


def _limits(values: Values, given: Mapping[str, tuple[float | None, float | None]]) -> Values:
    """Least and largest value (2,) of each parameter.

    Raises:
        ValueError: a name is no parameter, or a value is outside at the start.
    """
    _check_names("bounds", values, given)
    found = {}
    for name, value in values.items():
        low, high = given.get(name, (None, None))
        limits = np.array([-np.inf if low is None else low, np.inf if high is None else high])
        if not ((limits[0] <= value) & (value <= limits[1])).all():
            raise ValueError(
                f"minimize: {name} must lie within its bounds at the start, got "
                f"{_checks.show(value)}"
            )
        found[name] = limits
    return found


def _check_names(what: str, values: Values, given: Mapping[str, Any]) -> None:
    for name in given:
        if name not in values:
            raise ValueError(f'minimize: {what} names "{name}", which is no parameter')
