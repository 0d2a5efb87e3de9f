# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs of mechanisms whose equations come from energies, and the costs of the formalisms."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from mpi4py import MPI

from flexfem import _checks, launch
from flexfem.analyses.dynamics import RunOptions
from flexfem.io.summary import write_summary
from flexfem.io.tables.table import write_table
from flexfem.research.equations.run.simulate import simulate_equations
from flexfem.research.formalisms.description.mechanism import Mechanism
from flexfem.research.formalisms.description.study import FormalismStudy
from flexfem.research.formalisms.equations import MechanismEquations
from flexfem.research.formalisms.runs.costs import cost_rows, energy_rows
from flexfem.research.formalisms.runs.findings import findings, table_text
from flexfem.research.formalisms.runs.motion import SchemedMotion, SideBySide
from flexfem.simulation.run.outcome import Outcome, Results

__all__ = ["compare_formalisms", "simulate_mechanism"]


class _Source:
    """Source of equations that the driver runs."""

    drivers: Mapping[str, str] = Mechanism.drivers

    def __init__(self, mechanism: Mechanism, formalisms: tuple[str, ...]) -> None:
        self._mechanism, self._formalisms = mechanism, formalisms

    def validate(self) -> None:
        """Check the declaration."""
        self._mechanism.validate()

    def equations(self, comm: MPI.Intracomm) -> Any:
        """The equations, the same on every rank (collective)."""
        model = MechanismEquations(self._mechanism)
        if len(self._formalisms) == 1:
            return SchemedMotion(model, self._formalisms[0])
        return SideBySide(model, self._formalisms)


def simulate_mechanism(
    mechanism: Mechanism, options: RunOptions, *, case: str = "mechanism",
    results: Results | None = None, comm: MPI.Intracomm | None = None,
) -> Outcome:  # fmt: skip
    """Run a mechanism by its formalism and write the results (collective).

    Args:
        mechanism: the same on every rank.
        options: step size, end, output folder and so on.
        case: name for the summary.
        results: function of the history's columns that returns the headline results.
        comm: communicator, all ranks by default.

    Returns:
        The outcome, the same status on every rank.

    Raises:
        InputError: a mistake in the mechanism or an option without meaning here (a ValueError).
        OSError: the results cannot be written.
    """
    source = _Source(mechanism, (mechanism.formalism,))
    return simulate_equations(source, options, case=case, results=results, comm=comm)


def compare_formalisms(
    study: FormalismStudy, options: RunOptions, *, case: str = "study",
    results: Results | None = None, comm: MPI.Intracomm | None = None,
) -> Outcome:  # fmt: skip
    """Run the first mechanism of a study by all its formalisms, and measure their costs.

    Writes the files of a run, ``table.csv`` of the formalisms and ``energies.csv`` of kinetic
    energy and energy of accelerations; prints both and the findings in them unless the options ask
    for quiet (collective). Arguments, result and errors as of `simulate_mechanism`.
    """
    _checks.instance("compare_formalisms", "options", options, RunOptions)
    comm = comm or MPI.COMM_WORLD
    source = _SourceOfStudy(study)
    outcome = simulate_equations(source, options, case=case, results=results, comm=comm)
    if outcome.status != "ok":
        return outcome
    begin = time.perf_counter()
    rows = cost_rows(study, options, comm)
    energies = energy_rows(study, comm)
    text = findings(rows, study.labels, energies)
    summary = {
        **outcome.summary, "table": rows, "energies": energies, "findings": text,
        "wall_seconds_table": time.perf_counter() - begin,
    }  # fmt: skip
    if options.output is not None:
        write_table(options.output / "table.csv", rows, comm)
        write_table(options.output / "energies.csv", energies, comm)
        write_summary(options.output / "summary.json", summary, comm)
    if not options.quiet:
        launch.say(f"{table_text(rows)}\n\n{table_text(energies)}\n\n{text}")
    return replace(outcome, summary=summary)


class _SourceOfStudy(_Source):
    """The first mechanism of a study."""

    def __init__(self, study: FormalismStudy) -> None:
        super().__init__(study.first, tuple(study.formalisms))
        self._study = study

    def validate(self) -> None:
        """Check the whole study."""
        self._study.validate()

    def equations(self, comm: MPI.Intracomm) -> Any:
        """Side by side even for one formalism: the columns say which it is."""
        return SideBySide(MechanismEquations(self._mechanism), self._formalisms)
