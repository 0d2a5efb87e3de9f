# SPDX-License-Identifier: LGPL-3.0-or-later
"""A model some of whose parameters are found before it is run, as of a case of an optimisation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from flexfem import _checks, launch
from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.analyses.analysis import Analysis
from flexfem.analyses.dynamics import DYNAMICS
from flexfem.analyses.modes import MODES
from flexfem.analyses.statics import STATICS
from flexfem.gradients.motion.parameters import Build, checked_values, plain
from flexfem.io.summary import write_summary
from flexfem.io.tables.table import write_table
from flexfem.options import Settings

if TYPE_CHECKING:
    from mpi4py import MPI

    from flexfem.simulation.run.outcome import Outcome, Results

__all__ = ["FoundParameters", "ParameterSearch", "search_and_run"]

#: Takes what is known after an iteration, by name.
Report = Callable[[Mapping[str, float]], None]

_ANALYSES = {one.name: one for one in (DYNAMICS, STATICS, MODES)}


@dataclass(frozen=True)
class FoundParameters:
    """What a search has found.

    Attributes:
        values: parameters, numbers or arrays (n,).
        results: headline results of the search.
        columns: more columns of ``parameters.csv`` by name, such as standard errors: values of
            parameters' shapes by their names.
    """

    values: Mapping[str, npt.ArrayLike]
    results: Mapping[str, float] = field(default_factory=dict)
    columns: Mapping[str, Mapping[str, npt.ArrayLike]] = field(default_factory=dict)


@dataclass(frozen=True, repr=False)
class ParameterSearch:
    """A model that is run with parameters that a search finds: what a case of it builds.

    A run calls ``find``, which may use :func:`minimize`, :func:`identify` or gradients alone. It
    writes ``iterations.csv`` with what ``find`` reports, ``parameters.csv`` with the values, into
    the folder ``start`` the results with those of the start, and its own with those found.

    Args:
        name: of the search.
        build: model of the parameters' values.
        start: values of all parameters to begin with, numbers or arrays (n,).
        find: called on all ranks with the search, the options of the run without output, and a
            function to which it may hand a row of numbers by name after each iteration.
        analysis: of the run, "dynamics", "statics" or "modes".
    """

    name: str
    build: Build
    start: Mapping[str, npt.ArrayLike]
    find: Callable[[ParameterSearch, Any, Report], FoundParameters]
    analysis: str = "dynamics"

    def __repr__(self) -> str:
        """Return the name in messages."""
        return f'ParameterSearch "{self.name}"'

    def __str__(self) -> str:
        """Parameters, then the model at the start."""
        sizes = ", ".join(f"{name} ({np.size(value)})" for name, value in self.start.items())
        return f"{self!r} of {sizes}\n{self.model(self.start)}"

    @property
    def drivers(self) -> Mapping[str, str]:
        """What runs it, by the name of its analysis."""
        return {self.analysis: "flexfem.gradients.parameter_search:search_and_run"}

    def model(self, values: Mapping[str, npt.ArrayLike]) -> Any:
        """The model of values of the parameters."""
        return self.build(**plain(checked_values(values)))

    def validate(self) -> None:
        """Check the model at the start.

        Raises:
            TypeError, ValueError: something is not admissible.
        """
        if self.analysis not in _ANALYSES:
            raise ValueError(
                f"{self!r}: analysis must be one of {', '.join(_ANALYSES)}, got {self.analysis}"
            )
        self.model(self.start).validate()


def search_and_run(
    search: ParameterSearch, options: Settings, *, case: str = "search",
    results: Results | None = None, comm: MPI.Intracomm | None = None,
) -> Outcome:  # fmt: skip
    """Find the parameters, and run the model with those of the start and those found (collective).

    Args:
        search: the same on every rank.
        options: of the analysis.
        case: name for the summary.
        results: function of the history's columns that returns headline results; those of the
            search are added.
        comm: communicator, all ranks by default.

    Returns:
        The outcome of the run with the parameters found, or of the search if that failed.

    Raises:
        InputError: a mistake in the model or the options, or something in it without derivative.
        OSError: the results cannot be written.
    """
    # cases that name searches are listed and explained without these
    from mpi4py import MPI

    from flexfem.gradients.motion.trajectory import StoppedError

    comm, analysis = comm or MPI.COMM_WORLD, _ANALYSES[search.analysis]
    _checks.instance(repr(search), "options", options, analysis.settings)
    if getattr(options, "restart", None) is not None:
        raise InputError(f"{search!r}: a search cannot go on from a checkpoint, leave restart out")
    progress = _Progress(options, comm)
    try:
        found = search.find(search, replace(options, output=None, quiet=True), progress)
    except StoppedError as error:
        return _stopped(str(error), options, case, comm)
    progress.write("parameters", _rows(search, found))
    if options.output is not None:
        before = replace(options, output=options.output / "start", quiet=True)
        _run(analysis, search.model(search.start), before, case, results)
    return _run(
        analysis, search.model(found.values), options, case,
        lambda history: {**(results(history) if results else {}), **found.results},
    )  # fmt: skip


def _run(
    analysis: Analysis, model: Any, options: Settings, case: str, results: Results | None
) -> Outcome:
    outcome: Outcome = analysis.run(model, options, case=case, results=results)
    return outcome


class _Progress:
    """Rows of a search, printed and written as they come."""

    def __init__(self, options: Settings, comm: MPI.Intracomm) -> None:
        self._options, self._comm = options, comm
        self._rows: list[dict[str, float]] = []

    def __call__(self, row: Mapping[str, float]) -> None:
        """Take a row, the same on every rank (collective)."""
        self._rows.append({"iteration": len(self._rows), **row})
        self.write("iterations", self._rows)
        if not self._options.quiet:
            launch.say(", ".join(f"{name} {value:.8g}" for name, value in self._rows[-1].items()))

    def write(self, name: str, rows: list[dict[str, Any]]) -> None:
        """Write a table into the folder of the results, if there is one (collective)."""
        if self._options.output is not None:
            write_table(self._options.output / f"{name}.csv", rows, self._comm)


def _rows(search: ParameterSearch, found: FoundParameters) -> list[dict[str, Any]]:
    """Rows of ``parameters.csv``, one for each number."""
    rows = []
    for name, value in checked_values(found.values).items():
        columns: dict[str, FloatArray] = {
            "start": np.ravel(search.start[name]), "found": np.ravel(value),
            **{more: np.ravel(by[name]) for more, by in found.columns.items()},
        }  # fmt: skip
        rows += [
            {"name": name, "index": k} | {more: float(one[k]) for more, one in columns.items()}
            for k in range(value.size)
        ]
    return rows


def _stopped(reason: str, options: Settings, case: str, comm: MPI.Intracomm) -> Outcome:
    """Outcome of a search that has failed."""
    from flexfem.simulation.run.outcome import Outcome

    summary = {"case": case, "ranks": comm.size, "status": reason, "results": {}}
    if options.output is not None:
        write_summary(options.output / "summary.json", summary, comm)
    return Outcome(reason, summary, folder=options.output)
