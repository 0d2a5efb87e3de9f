# SPDX-License-Identifier: LGPL-3.0-or-later
"""An analysis as a function of its parameters, with products of its Jacobian matrix.

For programs that differentiate compositions of functions: forwards with the linearised motion along
one direction of all parameters, backwards with one adjoint for the weighted sum of all results.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Protocol

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.analyses.dynamics import RunOptions
from flexfem.gradients.gradient import SOLVED, Differentiation, made_of
from flexfem.gradients.motion.exactness import linearized
from flexfem.gradients.motion.functionals import TIME, Functional, change, parse
from flexfem.gradients.motion.influence import NumberInfluence
from flexfem.gradients.motion.parameters import (
    Build,
    Values,
    check_once,
    flat,
    model_with,
    named,
    plain,
)
from flexfem.gradients.motion.records import Storage
from flexfem.gradients.motion.runs import forward
from flexfem.gradients.motion.support import check_columns
from flexfem.gradients.motion.trajectory import Motion
from flexfem.gradients.states.analyses import Options
from flexfem.model.model import Model
from flexfem.simulation.run.time_grid import TimeGrid

__all__ = ["Products", "Wanted", "products"]

#: Numbers such as "final:tip_z", and columns such as "tip_z".
Wanted = str | Functional | Sequence[str | Functional]


class Products(Protocol):
    """Results of an analysis as a function of its parameters.

    Attributes:
        names: of the results.
        shapes: of the results.
    """

    names: list[str]
    shapes: list[tuple[int, ...]]

    def value(self, values: Values) -> list[FloatArray]:
        """Results (collective)."""
        ...

    def forward(self, values: Values, direction: Values) -> list[FloatArray]:
        """Change of the results along a direction of the parameters (collective)."""
        ...

    def backward(self, values: Values, weights: Sequence[FloatArray]) -> Values:
        """Derivatives of the weighted sum of the results by the parameters (collective)."""
        ...


def products(
    model: Model | Build, of: Wanted, options: Options, ks_rho: float | None,
    comm: MPI.Intracomm | None,
) -> tuple[Products, bool]:  # fmt: skip
    """The function, and whether one result is wanted rather than several by name.

    Raises:
        TypeError, ValueError: see :func:`flexfem.gradient`.
    """
    if not isinstance(model, Model) and not callable(model):
        raise TypeError(
            f"gradient: give a Model or a function that builds one, got {_checks.show(model)}"
        )
    build = partial(model_with, model) if isinstance(model, Model) else model
    single = isinstance(of, str | Functional)
    every = [of] if isinstance(of, str | Functional) else list(of)
    kind = ProductsOfMotion if isinstance(options, RunOptions) else ProductsOfStates
    return kind(build, every, options, ks_rho, comm), single


class ProductsOfStates:
    """Numbers of equilibria or modes, each of which has its derivatives by all parameters."""

    def __init__(
        self, build: Build, of: Sequence[str | Functional], options: Options,
        ks_rho: float | None, comm: MPI.Intracomm | None,
    ) -> None:  # fmt: skip
        self._analysis = Differentiation(build, of, options, ks_rho=ks_rho, comm=comm)
        self.names = [one.name for one in self._analysis.functionals]
        self.shapes: list[tuple[int, ...]] = [() for _ in self.names]

    def value(self, values: Values) -> list[FloatArray]:
        """See :class:`Products`."""
        found = self._analysis.value(values)
        return [np.array(found[name]) for name in self.names]

    def forward(self, values: Values, direction: Values) -> list[FloatArray]:
        """See :class:`Products`."""
        return list(self._jacobian(values) @ flat(values, direction))

    def backward(self, values: Values, weights: Sequence[FloatArray]) -> Values:
        """See :class:`Products`."""
        return named(values, np.array(weights) @ self._jacobian(values))

    def _jacobian(self, values: Values) -> FloatArray:
        """Derivatives (results, parameters)."""
        found = self._analysis.at(values).gradient
        return np.array([flat(values, found[name]) for name in self.names])


class ProductsOfMotion:
    """Numbers and columns of a motion."""

    def __init__(
        self, build: Build, of: Sequence[str | Functional], options: Options,
        ks_rho: float | None, comm: MPI.Intracomm | None,
    ) -> None:  # fmt: skip
        assert isinstance(options, RunOptions)
        self._build, self._options, self._comm = build, options, comm
        self._results = [
            parse(one, ks_rho) if isinstance(one, str) and ":" in one else one for one in of
        ]
        rows = TimeGrid.of(options.dt, options.t_end).count + 1
        self.names = [one if isinstance(one, str) else one.name for one in self._results]
        check_once(self.names)
        for one in self._results if options.adaptive else ():
            if isinstance(one, str):
                raise InputError(
                    f'gradient: column "{one}" has as many rows as adaptive steps are taken; take '
                    f"equal steps, or a number such as final:{one}"
                )
        self.shapes: list[tuple[int, ...]] = [
            (rows,) if isinstance(one, str) else () for one in self._results
        ]
        columns = [(one,) if isinstance(one, str) else one.columns for one in self._results]
        self._columns = tuple(sorted({name for names in columns for name in names}))
        self._weights: Sequence[FloatArray] = ()
        total = Functional("weighted sum", self._columns, self._sum, self._slopes)
        self._analysis = Differentiation(build, total, options, comm=comm)

    def value(self, values: Values) -> list[FloatArray]:
        """See :class:`Products`."""
        motion = self._motion(values)
        history = motion.on_all_ranks(motion.history())
        return [
            history[one] if isinstance(one, str) else np.array(one.value(history))
            for one in self._results
        ]

    def forward(self, values: Values, direction: Values) -> list[FloatArray]:
        """See :class:`Products`.

        One number changes all parameters along the direction, so that two models are enough.
        """
        size = max(
            float((np.abs(way) / np.where(value == 0.0, 1.0, np.abs(value))).max(initial=0.0))
            for way, value in zip(direction.values(), values.values(), strict=True)
        )
        if size == 0.0:
            return [np.zeros(shape) for shape in self.shapes]

        def along(way: float) -> Model:
            return self._build(
                **plain({name: x + way / size * direction[name] for name, x in values.items()})
            )

        motion = self._motion(values)
        influence = NumberInfluence(motion, along, {"way": np.zeros(())}, "way")
        linear = linearized(motion, SOLVED)
        names = sorted({TIME, *self._columns})
        (changes,) = forward(motion, linear, names, [[(influence, size)]])
        columns = dict(zip(names, changes.T, strict=True))
        history = motion.on_all_ranks(motion.history())
        return [
            columns[one] if isinstance(one, str) else np.array(change(one, history, columns))
            for one in self._results
        ]  # fmt: skip

    def backward(self, values: Values, weights: Sequence[FloatArray]) -> Values:
        """See :class:`Products`."""
        self._weights = weights
        (found,) = self._analysis.at(values).gradient.values()
        return {name: np.asarray(own) for name, own in found.items()}

    def _motion(self, values: Values) -> Motion:
        made = made_of(self._build, values)
        check_columns(made, self._columns)
        motion = Motion(made, self._options, self._comm, Storage(), self._columns)
        for one, shape in zip(self._results, self.shapes, strict=True):
            if isinstance(one, str) and shape != motion.rows_at.shape:
                raise InputError(
                    f'gradient: column "{one}" has as many rows as steps are taken until an event '
                    f"ends the motion; take a number such as final:{one}"
                )
        return motion

    def _sum(self, history: Mapping[str, FloatArray]) -> float:
        """The weighted sum."""
        return sum(
            float(np.sum(weight * (history[one] if isinstance(one, str) else one.value(history))))
            for one, weight in zip(self._results, self._weights, strict=True)
        )

    def _slopes(self, history: Mapping[str, FloatArray]) -> FloatArray:
        """Derivatives of the weighted sum by the columns, (columns, rows)."""
        found = {name: np.zeros_like(history["t"]) for name in self._columns}
        for one, weight in zip(self._results, self._weights, strict=True):
            if isinstance(one, str):
                found[one] += weight
            else:
                for name, own in zip(one.columns, one.derivative(history), strict=True):
                    found[name] += weight * own
        return np.array(list(found.values()))
