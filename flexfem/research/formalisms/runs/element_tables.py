# SPDX-License-Identifier: LGPL-3.0-or-later
"""Element matrices in a moving frame as tables: files and text."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import fields
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem import _checks, launch
from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.analyses.dynamics import RunOptions
from flexfem.io.tables.table import write_table
from flexfem.research.formalisms.description.matrix_study import ElementMatrixStudy
from flexfem.research.formalisms.element_matrices import ElementMatrices, element_matrices
from flexfem.simulation.run.guard import guarded
from flexfem.simulation.run.outcome import Outcome, Results, conclude

__all__ = ["tabulate_elements"]

#: Names in the paper, by attribute.
_TITLES = {
    "m": "m", "c": "c", "k": "k", "k_epsilon": "k(eps)", "k_omega": "k(omega)",
    "q_epsilon": "q_i(eps)", "q_omega": "q_i(omega)", "m_origin": "m_Oi",
}  # fmt: skip
#: Rows of a matrix that is printed as a whole.
_PRINTED = 12


def tabulate_elements(
    study: ElementMatrixStudy, options: RunOptions, *, case: str = "matrices",
    results: Results | None = None, comm: MPI.Intracomm | None = None,
) -> Outcome:  # fmt: skip
    """Compute the element matrices of a study (collective).

    Writes ``matrices.csv`` with one entry a line and ``summary.json``; prints the matrices, or
    their largest entries if they are large, unless the options ask for quiet. There is no motion,
    so no history and no headline results, and options of steps are not used.

    Args:
        study: the same on every rank.
        options: output folder and quiet.
        case: name for the summary.
        results: not called.
        comm: communicator, all ranks by default.

    Raises:
        InputError: a mistake in the study, or a run that is to be resumed (a ValueError).
        OSError: the results cannot be written.
    """
    _checks.instance("tabulate_elements", "options", options, RunOptions)
    comm, begin = comm or MPI.COMM_WORLD, time.perf_counter()
    if options.restart is not None:
        raise InputError("element matrices: there is no motion to be resumed, leave out --restart")
    with guarded(options, comm):
        try:
            study.validate()
            found = {
                key: element_matrices(body, study.omega, study.epsilon, study.number)
                for key, body in study.bodies.items()
            }
        except ValueError as error:  # on every rank, the data being the same
            raise InputError(str(error)) from error
        rows = [row for key, one in found.items() for row in _rows(study, key, one)]
        if options.output is not None:
            write_table(options.output / "matrices.csv", rows, comm)
        if not options.quiet:
            launch.say("\n\n".join(_text(study, key, one) for key, one in found.items()))
        summary: dict[str, Any] = {
            "case": case, "ranks": comm.size, "multipliers": 0, "steps": 0, "rejected_steps": 0,
            "unknowns": sum(len(one.components) for one in found.values()),
            "newton_iterations": 0, "factorizations": 0, "residual_evaluations": 0,
            "wall_seconds": time.perf_counter() - begin, "wall_seconds_setup": 0.0,
            "omega": list(study.omega), "epsilon": list(study.epsilon), "status": "ok",
            "results": {},
        }  # fmt: skip
        return conclude(summary, {}, None, options, comm)


def _parts(one: ElementMatrices) -> Iterator[tuple[str, FloatArray]]:
    """Matrices and vectors by their titles, all with two dimensions."""
    for part in fields(one):
        if part.name in _TITLES:
            value = getattr(one, part.name)
            yield _TITLES[part.name], value.reshape(len(value), -1)


def _rows(
    study: ElementMatrixStudy, key: tuple[str, ...], one: ElementMatrices
) -> Iterator[dict[str, Any]]:
    """One row for each entry; points and components of rows, and of columns if there are such."""
    labels = dict(zip(study.labels, key, strict=True))
    for title, values in _parts(one):
        square = values.shape[0] == values.shape[1]
        for (i, j), value in np.ndenumerate(values):
            row = labels | {"matrix": title, "row": i, "column": j, "value": float(value)}
            row |= {f"row_{axis}": float(x) for axis, x in zip("xyz", one.points[i], strict=True)}
            row["row_component"] = int(one.components[i])
            for k, axis in enumerate("xyz"):
                row[f"column_{axis}"] = float(one.points[j, k]) if square else ""
            row["column_component"] = int(one.components[j]) if square else j
            yield row


def _text(study: ElementMatrixStudy, key: tuple[str, ...], one: ElementMatrices) -> str:
    """Matrices for the screen; of large ones their size and largest entry."""
    told = zip(study.labels, key, strict=True)
    named = ", ".join(f"{label} {value}" for label, value in told)
    lines = [f"{named}: {len(one.components)} displacements"]
    for title, values in _parts(one):
        if len(values) > _PRINTED:
            size = " x ".join(map(str, values.shape))
            lines.append(f"  {title}: {size}, largest entry {np.abs(values).max():.6g}")
            continue
        lines.append(f"  {title}")
        shown = values.T if values.shape[1] == 1 else values
        lines += ["    " + " ".join(f"{value:12.5g}" for value in row) for row in shown]
    return "\n".join(lines)
