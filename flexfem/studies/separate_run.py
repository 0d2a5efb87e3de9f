# SPDX-License-Identifier: LGPL-3.0-or-later
"""Run a case in processes of its own, on any number of ranks, from Python."""

from __future__ import annotations

import signal
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexfem import _checks
from flexfem.launch import Interrupted, environment_of_runs
from flexfem.options import value_text
from flexfem.studies.processes import python_command

if TYPE_CHECKING:
    from flexfem.simulation.run.outcome import Outcome

__all__ = ["run_case"]

#: Exit code of wrong input.
_USAGE = 2


def run_case(
    case: str | Path, ranks: int = 1, *, output: str | Path | None = None, **options: Any
) -> Outcome:
    """Run a case as ``mpirun -n RANKS flexfem run CASE`` does, and read its results.

    The calling process needs no MPI: a notebook runs a case on several ranks with it. Interrupting
    it interrupts the run, which ends in good order.

    Args:
        case: name of a shipped case, or path of a file that defines ``CASE``.
        ranks: number of MPI ranks.
        output: folder of the results; ``results/<name>`` below the working folder by default.
        **options: options of the case and its analysis, ``dt=1e-3`` for ``--dt 1e-3``, and
            ``smoke=True`` and the like.

    Returns:
        The outcome, whose status shows a failed run.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: There is no mpirun, or the command line or the model is not admissible.
        RuntimeError: The run ended without a summary; with what it printed.
        Interrupted: The run was interrupted (a KeyboardInterrupt); ``outcome`` holds its results.
    """
    _checks.instance("run_case", "case", case, (str, Path))
    if isinstance(ranks, bool) or not isinstance(ranks, int) or ranks < 1:
        raise ValueError(f"run_case: ranks must be a whole number above 0, got {ranks!r}")
    name = Path(case).stem
    folder = Path("results") / name if output is None else Path(output)
    arguments = [str(case), "--output", str(folder)]
    for key, value in options.items():
        arguments += _flag(key, value)
    summary = folder / "summary.json"
    before = _changed(summary)
    process = subprocess.Popen(
        python_command(["-m", "flexfem", "run", *arguments], ranks),
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment_of_runs(),
        start_new_session=True,  # signals of this process's terminal are passed on below, once
    )  # fmt: skip
    interrupted = False
    while True:
        try:
            printed, _ = process.communicate()
            break
        except KeyboardInterrupt:
            process.send_signal(signal.SIGINT)
            interrupted = True
    if process.returncode == _USAGE:
        raise ValueError(printed.strip().removeprefix("error: "))
    if _changed(summary) == before:  # there is none, or it is that of an earlier run
        if interrupted:
            raise KeyboardInterrupt
        raise RuntimeError(
            f"run_case: the run ended with exit code {process.returncode}:\n{printed.strip()}"
        )
    outcome = _outcome(folder)
    if interrupted:
        stop = Interrupted(signal.SIGINT, outcome.status)
        stop.outcome = outcome
        raise stop
    return outcome


def _changed(file: Path) -> int | None:
    """Return the time when a file was written, None if there is none."""
    return file.stat().st_mtime_ns if file.exists() else None


def _flag(key: str, value: Any) -> list[str]:
    """An option as on a command line."""
    flag = key.replace("_", "-")
    if value is None:
        return []
    if isinstance(value, bool):
        if key in ("quiet", "smoke"):  # these have no opposite
            return [f"--{flag}"] if value else []
        return [f"--{flag}" if value else f"--no-{flag}"]
    return [f"--{flag}={value_text(value)}"]


def _outcome(folder: Path) -> Outcome:
    """Return the outcome that the run has left."""
    from flexfem.io import read_history, read_summary
    from flexfem.io.tables.history_files import history_file
    from flexfem.simulation.run.outcome import Outcome

    summary, table = read_summary(folder / "summary.json"), history_file(folder)
    history = {} if table is None else read_history(table)
    return Outcome(summary["status"], summary, history, folder)
