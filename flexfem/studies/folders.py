# SPDX-License-Identifier: LGPL-3.0-or-later
"""The folder of a study and those of its runs: existing results and their status."""

from __future__ import annotations

import json
import signal
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flexfem.io.summary import read_summary, write_summary
from flexfem.io.tables.history import read_history
from flexfem.io.tables.history_files import history_file
from flexfem.io.tables.table import write_table
from flexfem.options import value_text
from flexfem.studies.plan import PlannedRun
from flexfem.studies.reductions import Reduction

__all__ = ["RunFolder", "StudyFolder"]

#: Status in the summary of a run that can resume from a checkpoint.
_INTERRUPTED = "interrupted"
#: Exit code of a run with wrong input.
_REFUSED = 2


#: Counts of a summary in the last columns of the table.
_COUNTS = ("unknowns", "steps", "newton_iterations", "factorizations", "wall_seconds")


class RunFolder:
    """The folder of one run."""

    def __init__(self, folder: Path, run: PlannedRun) -> None:
        """Note the place; nothing is written."""
        self.path, self.run = folder / run.name, run
        self.log = self.path / "log.txt"
        self._record = self.path / "parameters.json"
        self._summary_file = self.path / "summary.json"
        self._died = ""

    def summary(self) -> dict[str, Any]:
        """Return the summary that the run wrote; empty if none, or with other options."""
        found = _read(self._summary_file) if _read(self._record) == self.run.record else {}
        plain = isinstance(found.get("status"), str) and isinstance(found.get("results", {}), dict)
        return found if plain else {}

    @property
    def finished(self) -> bool:
        """A run with these options has come to its end."""
        return bool(self.summary().get("status") == "ok")

    def prepare(self) -> list[str]:
        """Prepare the folder of a run, and return the arguments with which it starts or resumes."""
        if self.summary().get("status", "").startswith(_INTERRUPTED):
            files = sorted(self.path.glob("checkpoint_*.h5"), key=lambda p: (len(p.name), p.name))
            if files:
                return [f"--restart={files[-1]}"]
        self._summary_file.unlink(missing_ok=True)
        write_summary(self._record, self.run.record)
        return []

    def ended(self, code: int) -> None:
        """Note why a run has ended that leaves no summary."""
        if code == _REFUSED:  # a checkpoint that does not fit, perhaps: start over next time
            self._summary_file.unlink(missing_ok=True)
        self._died = f"failed with exit code {code}"
        if code < 0:
            self._died = f"killed by {signal.Signals(-code).name}"
        elif lines := self.log.read_text(errors="replace").strip().splitlines():
            self._died = lines[-1]

    def results(self, reductions: Sequence[Reduction]) -> dict[str, Any]:
        """Status, headline results, reduced columns, counts and times."""
        summary = self.summary()
        status = summary.get("status", self._died or "not run yet")
        row: dict[str, Any] = {"status": status}
        if not summary:
            return row
        own = dict(summary.get("results", {}))
        history = self._history() if reductions else {}
        for reduction in reductions:
            own[reduction.label] = reduction.of(history)
        taken = {*self.run.parameters, *row, "run", *_COUNTS}
        for name, value in own.items():
            row[f"result_{name}" if name in taken else name] = value
        for name in _COUNTS:
            row[name] = summary.get(name)
        return row

    def _history(self) -> Mapping[str, Any]:
        try:
            file = history_file(self.path)
            return {} if file is None else read_history(file)
        except (OSError, ValueError):
            return {}


class StudyFolder:
    """The folder of a study.

    Attributes:
        path: the folder.
        runs: folders of the runs.
        table: the table of results.
    """

    def __init__(
        self, path: Path, identity: Mapping[str, Any], runs: Sequence[PlannedRun]
    ) -> None:  # fmt: skip
        """Read the existing contents.

        Raises:
            ValueError: The folder belongs to another study, or to something else.
        """
        self.path, self._identity = path, dict(identity)
        self._file, self.table = path / "sweep.json", path / "sweep.csv"
        self.runs = [RunFolder(path, run) for run in runs]
        if path.exists() and not path.is_dir():
            raise ValueError(f"'{path}' is not a folder")
        if self._file.exists():
            found = _read(self._file)
            for key, value in self._identity.items():
                if found.get(key) != value:
                    raise ValueError(
                        f"folder '{path}' is that of another sweep, its {key}: "
                        f"{_told(found.get(key))}, not {_told(value)}"
                    )
        elif path.exists() and any(path.iterdir()):
            raise ValueError(f"folder '{path}' is not empty and not that of a sweep")

    def prepare(self) -> None:
        """Write the identity of the study.

        Raises:
            OSError: The folder cannot be written.
        """
        write_summary(self._file, self._identity)

    def write_table(self, results: Sequence[Mapping[str, Any]]) -> None:
        """Write the table, with results (one for each run) where there are any.

        Raises:
            OSError: It cannot be written.
        """
        rows = [
            {"run": folder.run.name, **_told_vectors(folder.run.parameters), **own}
            for folder, own in zip(self.runs, results, strict=True)
        ]
        names = list(dict.fromkeys(name for row in rows for name in row))
        names = [n for n in names if n not in _COUNTS] + [n for n in _COUNTS if n in names]
        write_table(self.table, [{name: row.get(name) for name in names} for row in rows])


def _told_vectors(values: Mapping[str, Any]) -> dict[str, Any]:
    """Values by option, vectors as they are typed."""
    return {
        name: value_text(value) if isinstance(value, tuple) else value
        for name, value in values.items()
    }


def _told(value: Any) -> str:
    return json.dumps(value) if isinstance(value, dict | list) else str(value)


def _read(path: Path) -> dict[str, Any]:
    """A summary; empty if there is none or it is damaged."""
    try:
        return read_summary(path)
    except ValueError:
        return {}
