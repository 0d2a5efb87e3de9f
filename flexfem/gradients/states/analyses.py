# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numbers of statics, of modes and of linear models with their derivatives."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.analyses.dynamics import RunOptions
from flexfem.analyses.modes import LinearOptions, ModeOptions
from flexfem.analyses.statics import StaticOptions
from flexfem.gradients.motion.functionals import Functional, parse
from flexfem.gradients.motion.parameters import Build, Values, check_once
from flexfem.gradients.motion.support import check_columns
from flexfem.gradients.states.buckling import BucklingLoads
from flexfem.gradients.states.modes import Frequencies
from flexfem.gradients.states.neighbours import by_name, parameters_alone, parameters_of
from flexfem.gradients.states.path import Equilibria
from flexfem.gradients.states.responses import Response, Responses
from flexfem.gradients.states.statics import gradients_of_columns
from flexfem.model.model import Model
from flexfem.simulation.equilibria.targets import LOAD

__all__ = ["Eigenvalue", "Found", "Options", "found_at", "numbers_of"]

#: Options of what has derivatives.
Options = RunOptions | StaticOptions | ModeOptions | LinearOptions
#: Kinds of eigenvalues.
_OF_STATICS, _OF_MODES = ("buckling",), ("frequency", "damping")


@dataclass(frozen=True)
class Eigenvalue:
    """A number such as ``buckling:1``, or a mean such as ``frequency:1-2``.

    Attributes:
        name: text in tables.
        kind: what stands before the colon.
        numbers: what stands behind it, from 1.
    """

    name: str
    kind: str
    numbers: range

    def mean(self, of: Callable[[int], FloatArray]) -> FloatArray:
        """Mean of a function of the numbers."""
        return np.asarray(np.mean([of(number) for number in self.numbers], axis=0))

    def mean_of(self, values: Sequence[float] | FloatArray) -> float:
        """Mean of the values, from the first one, with these numbers."""
        return float(np.mean([values[number - 1] for number in self.numbers]))


#: A number of an analysis.
Number = Functional | Eigenvalue | Response


@dataclass(frozen=True)
class Found:
    """Numbers with their derivatives.

    Attributes:
        value: by name.
        gradient: by the names of the numbers and of the parameters.
        history: on the first rank.
        middle: reading of ``time.perf_counter`` between both halves.
        factorizations: before and after that.
    """

    value: Mapping[str, float]
    gradient: Mapping[str, Mapping[str, float | FloatArray]]
    history: Mapping[str, FloatArray]
    middle: float
    factorizations: tuple[int, int]


def numbers_of(
    of: str | Functional | Sequence[str | Functional], ks_rho: float | None, options: Options
) -> list[Number]:
    """The numbers of an analysis by their names.

    Raises:
        TypeError: the options are those of another one.
        ValueError: there are none, two have the same name, or one is not of the form of the
            analysis.
    """
    others = StaticOptions, ModeOptions, LinearOptions
    if not isinstance(options, RunOptions) and type(options) not in others:
        raise TypeError(
            "gradient: options must be RunOptions, StaticOptions, ModeOptions or LinearOptions, "
            f"got {_checks.show(options)}"
        )
    every = [of] if isinstance(of, str | Functional) else list(of)
    if not every:
        raise ValueError("gradient: nothing to derive, name functionals")
    found = [_number(one, ks_rho, options) for one in every]
    check_once([one.name for one in found])
    return found


def _number(one: str | Functional, ks_rho: float | None, options: Options) -> Number:
    if isinstance(options, LinearOptions):
        return Response.of(one) if isinstance(one, str) else one
    name = one.strip() if isinstance(one, str) else one.name
    kind, _, text = name.partition(":")
    statics, modes = isinstance(options, StaticOptions), isinstance(options, ModeOptions)
    if isinstance(one, str) and kind in (_OF_MODES if modes else _OF_STATICS if statics else ()):
        first, _, last = text.partition("-")
        last = last or first
        if not (first.isdecimal() and last.isdecimal() and 1 <= int(first) <= int(last)):
            raise ValueError(
                f"gradient: '{name}' must end with a number from 1, or a first and a last one, as "
                f"in {kind}:1 or {kind}:1-2"
            )
        return Eigenvalue(name, kind, range(int(first), int(last) + 1))
    if modes:
        raise ValueError(
            f"gradient: with ModeOptions numbers are frequency:1, damping:1 and so on, got {name}"
        )
    return parse(one, ks_rho) if isinstance(one, str) else one


def found_at(
    model: Model, numbers: Sequence[Number], wrt: tuple[Build, Values],
    options: StaticOptions | ModeOptions | LinearOptions, comm: MPI.Intracomm,
) -> Found:  # fmt: skip
    """Numbers of equilibria, modes or linear models with their derivatives (collective).

    Args:
        model: at the values of the parameters.
        numbers: see :func:`numbers_of`.
        wrt: function that builds the model, and these values.
        options: of the analysis.
        comm: communicator.
    """
    if isinstance(options, LinearOptions):
        wanted = [one for one in numbers if not isinstance(one, Eigenvalue)]
        return _of_linear_model(model, wanted, wrt, options, comm)
    eigenvalues = [one for one in numbers if isinstance(one, Eigenvalue)]
    if isinstance(options, ModeOptions):
        return _of_modes(model, eigenvalues, wrt, options, comm)
    functionals = [one for one in numbers if isinstance(one, Functional)]
    return _of_equilibria(model, (functionals, eigenvalues), wrt, options, comm)


def _of_equilibria(
    model: Model, numbers: tuple[Sequence[Functional], Sequence[Eigenvalue]],
    wrt: tuple[Build, Values], options: StaticOptions, comm: MPI.Intracomm,
) -> Found:  # fmt: skip
    """Columns, and buckling loads (collective)."""
    functionals, loads = numbers
    names = [name for one in functionals for name in one.columns]
    check_columns(model, [name for name in names if name != LOAD])
    if options.stop_column != "none" and loads:
        raise InputError(
            f"gradient: {loads[0].name} is not differentiated with a stop_column, on which the "
            "last equilibrium depends"
        )
    path = Equilibria(model, options, comm)
    done, middle = path.system.counters.factorizations, time.perf_counter()
    found = gradients_of_columns(path, functionals, parameters_of(*wrt))
    rows = {one.name: row for one, row in zip(functionals, found, strict=True)}
    own = {one.name: one.value(path.history) for one in functionals if path.history}
    value: dict[str, float] = comm.bcast(own)
    if loads:
        buckling = BucklingLoads(path, [one.numbers for one in loads])
        changes = buckling.gradients(parameters_alone(*wrt))
        rows |= {one.name: one.mean(changes.__getitem__) for one in loads}
        value |= {one.name: one.mean_of(buckling.loads) for one in loads}
    more = path.system.counters.factorizations - done
    gradient = {name: by_name(row, wrt[1]) for name, row in rows.items()}
    return Found(value, gradient, path.history, middle, (done, more))


def _of_modes(
    model: Model, numbers: Sequence[Eigenvalue], wrt: tuple[Build, Values], options: ModeOptions,
    comm: MPI.Intracomm,
) -> Found:  # fmt: skip
    """Frequencies and damping ratios (collective)."""
    found = Frequencies(model, options, comm, [one.numbers for one in numbers])
    middle = time.perf_counter()
    changes, modes = found.gradients(parameters_alone(*wrt)), found.modes

    def by_parameters(k: int) -> FloatArray:
        """Derivatives of a damping ratio, ``- Re lambda / |lambda|``."""
        own, change = complex(modes.eigenvalues[k - 1]), changes[k]
        by_size = own.real * (np.conj(own) * change).real / abs(own) ** 3
        return np.asarray(by_size - change.real / abs(own))

    values = {"frequency": modes.frequencies, "damping": modes.damping}
    rows_of = {"frequency": lambda k: changes[k].imag / (2.0 * np.pi), "damping": by_parameters}
    value = {one.name: one.mean_of(values[one.kind]) for one in numbers}
    rows = {one.name: one.mean(rows_of[one.kind]) for one in numbers}
    history = {} if comm.rank else {
        "t": np.arange(1.0, len(found.modes) + 1.0), "frequency": found.modes.frequencies,
        "damping_ratio": found.modes.damping,
    }  # fmt: skip
    gradient = {name: by_name(row, wrt[1]) for name, row in rows.items()}
    return Found(value, gradient, history, middle, (0, 0))


def _of_linear_model(
    model: Model, numbers: Sequence[Functional | Response], wrt: tuple[Build, Values],
    options: LinearOptions, comm: MPI.Intracomm,
) -> Found:  # fmt: skip
    """Frequency responses, and functions of these (collective)."""
    functionals = [one for one in numbers if isinstance(one, Functional)]
    every = {one.name: one for one in numbers if isinstance(one, Response)}
    every |= {name: Response.of(name) for one in functionals for name in one.columns}
    wanted = list(every.values())
    responses = Responses(model, options, comm, wanted)
    middle = time.perf_counter()
    changes = responses.gradients(parameters_alone(*wrt))
    value: dict[str, float] = {}
    rows: dict[str, FloatArray] = {}
    for one, own, change in zip(wanted, responses.values, changes, strict=True):
        value[one.name] = one.number(complex(own))
        rows[one.name] = one.change(complex(own), change)
    history = {"t": np.zeros(1)} | {name: np.array([own]) for name, own in value.items()}
    for made in functionals:
        value[made.name] = made.value(history)
        slopes = np.asarray(made.derivative(history)).reshape(len(made.columns))
        rows[made.name] = slopes @ np.array([rows[name] for name in made.columns])
    chosen = [one.name for one in numbers]
    gradient = {name: by_name(rows[name], wrt[1]) for name in chosen}
    kept = {} if comm.rank else history
    return Found({name: value[name] for name in chosen}, gradient, kept, middle, (0, 0))
