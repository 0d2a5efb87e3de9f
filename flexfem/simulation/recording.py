# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a run leaves: history, ParaView fields, progress."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.io.field_output import FieldOutput
from flexfem.io.history import HistoryWriter
from flexfem.io.progress import Progress
from flexfem.io.summary import remove_summary
from flexfem.options import Settings
from flexfem.system.assembly import Assembly
from flexfem.system.probes import ProbeRecorder
from flexfem.system.system import System

__all__ = ["Recorder"]


class Recorder:
    """History, fields and progress of one run."""

    def __init__(
        self, system: System, serial: Assembly, settings: Settings, every: int, end: float
    ) -> None:
        """Open the files (collective).

        Args:
            system: whose accepted states are recorded.
            serial: serial data of its model.
            settings: where to write, and whether to show progress.
            every: fields are written every that many steps.
            end: time (s) or load factor at the end.
        """
        self._system, self._every = system, every
        self._probes = ProbeRecorder(system, serial)
        self._rows: list[FloatArray] = []
        self._time = 0.0  # of the last record
        self._table = self._fields = None
        if settings.output is not None:
            remove_summary(settings.output / "summary.json", system.comm)
            self._table = HistoryWriter(
                settings.output / "history.csv", self._probes.columns, system.comm,
                self._probes.unwrap,
            )  # fmt: skip
            self._fields = FieldOutput(settings.output, system, serial)
        quiet = settings.quiet or system.comm.rank != 0
        self._progress = Progress(end, not quiet)

    def record(self, step: int, last: bool = False) -> None:
        """Note the accepted state of a step."""
        system = self._system
        self._time = system.time
        self._probes.record(system.time)
        due = step % self._every == 0 or last
        if due or self._probes.full:  # the table is never behind the fields
            self._flush()
        if due and self._fields is not None:
            self._fields.write(system.time, step)
        counters = system.counters
        self._progress.update(system.time, counters.newton_iterations, counters.factorizations)

    def record_between(self) -> None:
        """Note the accepted state of a part of a step in the history."""
        self._time = self._system.time
        self._probes.record(self._system.time)
        if self._probes.full:
            self._flush()

    def record_last(self, step: int) -> None:
        """Note the state reached before a step that failed, which may lie within the step."""
        system = self._system
        system.reset()
        system.interface.update()
        system.constraints.accept()
        if system.time > self._time:
            self.record(step, last=True)
        elif self._fields is not None:
            self._fields.write(system.time, step - 1)

    def _flush(self) -> None:
        for t, values in self._probes.flush():
            self._rows.append(np.concatenate([[t], values]))
            if self._table is not None:
                self._table.write(t, values)

    def close(self) -> None:
        """Write what is left."""
        self._flush()
        self._progress.close()
        if self._table is not None:
            self._table.close()
        if self._fields is not None:
            self._fields.close()

    def history(self) -> dict[str, FloatArray]:
        """Columns recorded so far, on the first rank."""
        if not self._rows:
            return {}
        table = np.array(self._rows)
        columns = dict(zip(["t", *self._probes.columns], table.T.copy(), strict=True))
        for name in self._probes.unwrap:
            columns[name] = np.unwrap(columns[name])
        return columns
