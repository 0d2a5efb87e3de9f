# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a run leaves: history, ParaView fields, progress."""

import time
from collections.abc import Sequence

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.core.state import State
from flexfem.io.atomic import raise_together
from flexfem.io.field_output import FieldOutput
from flexfem.io.history import AngleColumns, HistoryWriter
from flexfem.io.progress import Progress
from flexfem.io.summary import remove_summary
from flexfem.options import Settings
from flexfem.simulation.monitor import Monitor
from flexfem.system.assembly import Assembly
from flexfem.system.probes import ProbeRecorder
from flexfem.system.system import System

__all__ = ["Recorder"]

#: Relative difference of times that are the same.
_SAME = 1e-9


class Recorder:
    """History, fields and progress of one run."""

    def __init__(
        self, system: System, serial: Assembly, settings: Settings, every: int, end: float,
        *, resume: State | None = None, unit: str = "s", measures: Sequence[str] = (),
        varies: bool = False,
    ) -> None:  # fmt: skip
        """Open the files (collective).

        Args:
            system: whose accepted states are recorded.
            serial: serial data of its model.
            settings: where to write, and whether to show progress.
            every: fields are written every that many steps.
            end: time (s) or load factor at the end.
            resume: what :meth:`state` returned where an earlier run is continued: its records up
                to there are kept. None begins anew.
            unit: of ``end``; empty for a load factor.
            measures: columns that come with each record, before those of the probes.
            varies: the size of the steps, which is shown then.

        Raises:
            InputError: a probe has a column of these names, or what the earlier run left cannot be
                continued; it is left as it was.
        """
        self._system, self._every = system, every
        self._probes = ProbeRecorder(system, serial)
        self._columns = [*measures, *self._probes.columns]
        taken = [name for name in measures if name in self._probes.columns]
        if taken:
            raise InputError(f"column '{taken[0]}' of a probe: the analysis has one of this name")
        self._measures: list[FloatArray] = []  # of the records not yet flushed
        self._angles = AngleColumns(self._columns, self._probes.unwrap)
        self._rows: list[FloatArray] = []
        self._time, self._h, self._varies = 0.0, 0.0, varies  # of the last record
        self._unseen = True  # nothing was shown yet
        self._measured, self._first_measure = np.empty(0), (*measures, "")[0]
        self._monitor = Monitor(system, serial.model, self._probes, moving=unit == "s")
        self._table = self._fields = None
        row = np.zeros(1) if resume is None else resume.values["history"]
        start = None if resume is None else float(row[0])
        if settings.output is not None:
            # an InputError leaves everything as it was: the table is cut last
            self._fields = FieldOutput(settings.output, system, serial, start)
            self._table = HistoryWriter(
                settings.output / "history.csv", self._columns, system.comm, resume=start
            )
        if resume is not None:
            self._probes.restore(resume.values["sums"])
            self._continue(row)
        if settings.output is not None:
            remove_summary(settings.output / "summary.json", system.comm)
        quiet = settings.quiet or system.comm.rank != 0
        self._progress = Progress(
            end, not quiet, t_start=start or 0.0, unit=unit, how=settings.progress
        )

    def _continue(self, row: FloatArray) -> None:
        """Go on after the rows of an earlier run, or begin with the state it left."""
        self._time, self._angles.previous = float(row[0]), row[1:].copy()
        comm, error = self._system.comm, None
        if comm.rank == 0 and self._table is not None:
            kept = self._table.kept
            if len(kept) and kept[-1, 0] < row[0] * (1.0 - _SAME):
                error = InputError(
                    f"history of the output folder ends at t = {kept[-1, 0]:g} s, before the "
                    f"checkpoint at t = {row[0]:g} s: it is that of another run"
                )
                self._table.close()
            self._rows = list(kept)
            if not len(kept):
                self._table.write(row[0], row[1:])
        if comm.rank == 0 and not self._rows:
            self._rows = [row]
        raise_together(comm, error)

    def record(self, step: int, last: bool = False, measures: FloatArray | None = None) -> None:
        """Note the accepted state of a step, and the measures that come with it."""
        system = self._system
        self._keep(measures)
        due = step % self._every == 0 or last
        if due or self._probes.full:  # the table is never behind the fields
            self._flush()
        if due and self._fields is not None:
            self._fields.write(system.time, step)

    @property
    def due(self) -> bool:
        """This rank shows progress, and it is time for :meth:`show`."""
        return self._progress.due

    def show(self) -> None:
        """Show progress with what is known of the accepted state (collective)."""
        begin, first = time.perf_counter(), self._unseen
        words, self._unseen = self._monitor.words(), False
        # the first time loads compiled code
        self._show(words, 0.0 if first else time.perf_counter() - begin)

    def _show(self, words: Sequence[str], cost: float = 0.0) -> None:
        counters, own = self._system.counters, []
        if self._varies and self._h:
            own.append(f"step {self._h:.3g}")
        if len(self._measured):
            own.append(f"{self._first_measure} {self._measured[0]:.3g}")
        self._progress.update(
            self._time, counters.newton_iterations, counters.factorizations, [*own, *words], cost
        )

    def record_between(self, measures: FloatArray | None = None) -> None:
        """Note the accepted state of a part of a step in the history."""
        self._keep(measures)
        if self._probes.full:
            self._flush()

    def record_last(self, step: int, measures: FloatArray | None = None) -> None:
        """Note the state reached before a step that failed, which may lie within the step."""
        system = self._system
        system.reset()
        system.interface.update()
        system.constraints.accept()
        if system.time > self._time:
            self.record(step, last=True, measures=measures)
        elif self._fields is not None:
            self._fields.write(system.time, step - 1)

    def state(self) -> State:
        """What the records go on from; brings the table to disk first (collective).

        No checkpoint is ever ahead of the table. Time and probes of the last record, angles
        continued, are known to the first rank.

        Raises:
            OSError: on all ranks; the disk does not take it.
        """
        error = None
        try:
            self._flush()
            if self._table is not None:
                self._table.sync()
        except OSError as exc:
            error = exc
        raise_together(self._system.comm, error)
        row = self._rows[-1] if self._rows else np.empty(0)
        return State({"history": row, "sums": self._probes.state()})

    def _keep(self, measures: FloatArray | None) -> None:
        now = self._system.time
        self._h, self._time = now - self._time, now
        self._measured = np.empty(0) if measures is None else measures
        self._probes.record(self._system.time)
        self._measures.append(self._measured)

    def _flush(self) -> None:
        own, self._measures = self._measures, []
        for (t, values), measures in zip(self._probes.flush(), own, strict=False):
            row = self._angles.unwrap(np.concatenate([measures, values]))
            self._rows.append(np.concatenate([[t], row]))
            if self._table is not None:
                self._table.write(t, row)

    def close(self) -> None:
        """Write what is left."""
        self._flush()
        self._show(())
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
        return dict(zip(["t", *self._columns], table.T.copy(), strict=True))
