# SPDX-License-Identifier: LGPL-3.0-or-later
"""Outcome of an analysis."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from mpi4py import MPI

import numpy as np

from flexfem._faults import FAILURES, FunctionError, current, noted
from flexfem._memory import peak
from flexfem._types import FloatArray
from flexfem.io.summary import write_summary
from flexfem.io.view.document import View, view
from flexfem.la.counting_comm import Sent
from flexfem.options import Settings, meant
from flexfem.simulation.run.guard import agreed, folder_is_lost
from flexfem.system.system import System

__all__ = ["Outcome", "Results", "conclude", "summary_of"]

#: Headline results from the columns of the history.
Results = Callable[[Mapping[str, FloatArray]], Mapping[str, float]]


class Columns(dict[str, FloatArray]):
    """Columns of a history by their names; what is none of them is told in one line."""

    def __missing__(self, name: str) -> NoReturn:
        """Raise KeyError."""
        known = meant(str(name), self) or f"there are {', '.join(self)}"
        empty = "it is empty here, of several ranks the first has all columns"
        raise KeyError(f'the history has no column "{name}": {known if self else empty}')


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run.

    Attributes:
        status: "ok" or the reason of failure.
        summary: contents of ``summary.json``.
        history: columns of the history, angles unwrapped, without rows if nothing was accepted;
            no columns on other ranks than the first.
        folder: of the results; None of a run that wrote nothing.
    """

    status: str
    summary: Mapping[str, Any]
    history: Mapping[str, FloatArray] = field(default_factory=dict)
    folder: Path | None = None

    def __post_init__(self) -> None:
        """Let the history name columns that it does not have."""
        object.__setattr__(self, "history", Columns(self.history))

    def show(
        self, *, frames: int | None = None, fields: Sequence[str] | None = None, height: int = 620
    ) -> View:
        """Make the page of the results, see :func:`flexfem.view`; a notebook shows it.

        Raises:
            ValueError: the run wrote no results, or nothing that can be shown.
        """
        if self.folder is None:
            raise ValueError(
                'Outcome.show: the run wrote no results; give it a folder, output="results/a"'
            )
        return view(self.folder, frames=frames, fields=fields, height=height)

    def __repr__(self) -> str:
        """Status and sizes in one line, for interactive work."""
        rows = len(next(iter(self.history.values()), ()))
        steps = self.summary.get("steps", 0)
        return (
            f"{type(self).__name__}({self.status!r}, {steps} steps, history of {rows} rows: "
            f"{', '.join(self.history)})"
        )


def conclude(
    summary: dict[str, Any], history: Mapping[str, FloatArray], results: Results | None,
    options: Settings, comm: MPI.Intracomm,
) -> Outcome:  # fmt: skip
    """Add options and headline results to a summary; write it if there is a folder (collective).

    The history is empty on other ranks than the first. An error after the end of the run becomes
    its status, if that was "ok" before.
    """
    faults = current()
    summary["options"] = options.recorded
    if len(history.get("t", ())) and results is not None:
        try:
            summary["results"] = dict(results(history))
        except FAILURES as error:
            noted(f"results of case '{summary['case']}'", results, error)
    _tell(summary, comm)
    if options.output is not None and not folder_is_lost(comm):
        with faults.files():
            write_summary(options.output / "summary.json", summary, comm)
    _tell(summary, comm)
    outcome = Outcome(summary["status"], summary, history, options.output)
    faults.outcome = outcome
    return outcome


def _tell(summary: dict[str, Any], comm: MPI.Intracomm) -> None:
    """Set the status to the error of a rank (collective)."""
    error = agreed(current(), comm)
    later = summary["status"] == "ok" or isinstance(error, FunctionError)
    if error is not None and later and str(error) not in summary["status"]:
        summary["status"] = str(error)


def summary_of(system: System, case: str, reason: str) -> dict[str, Any]:
    """Return the part of ``summary.json`` common to all analyses (collective).

    Sizes, counts and status; messages and bytes are those of the rank that sends most, memory
    (bytes) is that of the rank with most.
    """
    counters, traffic, comm = system.counters, system.traffic, system.comm
    per_iteration = np.array(traffic.sent) / max(traffic.iterations, 1)
    comm.Allreduce(MPI.IN_PLACE, per_iteration, op=MPI.MAX)
    sent = Sent(*per_iteration.tolist())
    eliminations = {one for one in comm.allgather(traffic.elimination) if one}
    return {
        "case": case,
        "ranks": system.comm.size,
        "unknowns": system.unknowns,
        "multipliers": system.multipliers,
        "shared_rows": system.constraints.shared_size,
        "largest_shared_front": comm.allreduce(traffic.largest_front, op=MPI.MAX),
        "multiplier_elimination": ", ".join(sorted(eliminations)),
        "messages_per_iteration": sent.messages,
        "bytes_per_iteration": sent.bytes,
        "reductions_per_iteration": sent.reductions,
        "reduced_bytes_per_iteration": sent.reduced_bytes,
        "steps": 0,
        "rejected_steps": 0,
        "newton_iterations": counters.newton_iterations,
        "factorizations": counters.factorizations,
        "residual_evaluations": counters.residual_evaluations,
        "peak_memory": comm.allreduce(peak(), op=MPI.MAX),
        "status": reason,
        "results": {},
    }
