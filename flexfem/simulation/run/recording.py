# SPDX-License-Identifier: LGPL-3.0-or-later
"""Results of a run: history, ParaView fields, progress."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Protocol

import numpy as np

from flexfem._checks import InputError
from flexfem._faults import current
from flexfem._types import FloatArray
from flexfem.core.state import State
from flexfem.io.atomic import raise_together
from flexfem.io.paraview.field_output import FieldOutput
from flexfem.io.progress import Progress
from flexfem.io.summary import remove_summary
from flexfem.io.tables.compressed_history import CompressedHistoryWriter, StoredHistory
from flexfem.io.tables.history import AngleColumns, FolderLostError, HistoryWriter
from flexfem.io.tables.history_files import open_history
from flexfem.io.vtu.field_choice import EVERYTHING, FieldChoice
from flexfem.layout.numbered_model import NumberedModel
from flexfem.options import Settings, field_names
from flexfem.simulation.run.guard import agreed, refuse
from flexfem.simulation.run.monitor import Monitor
from flexfem.system.measure.probes import ProbeRecorder
from flexfem.system.system import System

__all__ = ["Recorder", "Records", "closing_table", "last_record"]

#: Relative difference below which times are equal.
_SAME = 1e-9


def last_record(state: State, columns: int) -> FloatArray:
    """Time and columns of the last record before a checkpoint.

    Raises:
        InputError: the checkpoint does not contain them.
    """
    row = state.values.get("history")
    if row is None or row.shape != (1 + columns,) or not 0.0 <= row[0] < np.inf:
        raise InputError(f"checkpoint: the last time and {columns} columns are missing")
    return row


class Records(Protocol):
    """Interface of history, fields and progress of a run for the run loop."""

    @property
    def due(self) -> bool:
        """True if this rank shows progress and :meth:`show` is due."""

    def show(self) -> None:
        """Show progress with data of the accepted state (collective)."""

    def state(self) -> State:
        """Return the state from which records resume, after flushing the table (collective).

        Raises:
            OSError: on all ranks; the disk write failed.
        """

    def close(self) -> None:
        """Write the remaining records (collective)."""

    def history(self) -> Mapping[str, FloatArray]:
        """Columns recorded so far, on the first rank."""

    def release(self) -> None:
        """Close the table as it is, on this rank alone, after an unexpected error."""


@contextmanager
def closing_table(recorder: Records) -> Iterator[None]:
    """Context that closes the table of a run after any error, without communication."""
    try:
        yield
    finally:
        recorder.release()


class Recorder:
    """History, fields and progress of one run."""

    def __init__(
        self, system: System, serial: NumberedModel, settings: Settings, every: int, end: float,
        *, resume: State | None = None, unit: str = "s", measures: Sequence[str] = (),
        varies: bool = False,
    ) -> None:  # fmt: skip
        """Open the files (collective).

        Args:
            system: system whose accepted states are recorded.
            serial: serial data of its model.
            settings: output folder, and options of progress.
            every: number of steps between two outputs of fields.
            end: time (s) or load factor at the end.
            resume: result of :meth:`state` of an earlier run that is resumed: its records up to
                there are kept. None begins a new table.
            unit: of ``end``; empty for a load factor.
            measures: further columns of each record, before those of the probes.
            varies: True if the step size varies, which is then shown.

        Raises:
            InputError: a probe has a column of these names, or fails, or the files of the earlier
                run cannot be continued; they are not changed.
        """
        self._system, self._every = system, every
        self._probes = ProbeRecorder(system, serial)
        self._columns = [*measures, *self._probes.columns]
        taken = [name for name in measures if name in self._probes.columns]
        if taken:
            raise InputError(f"column '{taken[0]}' of a probe: the analysis has one of this name")
        self._measures: list[FloatArray] = []  # of the records not yet flushed
        self._angles = AngleColumns(self._columns, self._probes.unwrap)
        self._rows: list[FloatArray] = []  # the last one, where the table holds them
        self._stored: StoredHistory | None = None
        self._time, self._h, self._varies = 0.0, 0.0, varies  # of the last record
        self._unseen = True  # no progress shown yet
        self._measured, self._first_measure = np.empty(0), (*measures, "")[0]
        self._faults = current()
        self._probes.check(system.time)
        refuse(self._faults, system.comm)
        self._monitor = Monitor(system, serial.model, self._probes, moving=unit == "s")
        self._table: HistoryWriter | CompressedHistoryWriter | None = None
        self._fields: FieldOutput | None = None
        self._broken = False  # rows are missing in the table
        row = np.zeros(1) if resume is None else last_record(resume, len(self._columns))
        if resume is not None:
            self._probes.restore(resume.values.get("sums", np.empty(0)))
        start = None if resume is None else float(row[0])
        if settings.output is not None:
            # an InputError must not change files: the table is cut last
            names = field_names(getattr(settings, "fields", "all"))
            chosen = FieldChoice(names, getattr(settings, "fields_precision", EVERYTHING.precision))
            self._fields = FieldOutput(settings.output, system, serial, start, chosen)
            format = getattr(settings, "history_format", "csv")
            self._table = open_history(settings.output, format, self._columns, system.comm, start)
            if isinstance(self._table, CompressedHistoryWriter):
                self._stored = StoredHistory(self._table.path, ["t", *self._columns])
        if resume is not None:
            self._continue(row)
        if settings.output is not None:
            remove_summary(settings.output / "summary.json", system.comm)
        quiet = settings.quiet or system.comm.rank != 0
        self._progress = Progress(
            end, not quiet, t_start=start or 0.0, unit=unit, how=settings.progress
        )

    def _continue(self, row: FloatArray) -> None:
        """Continue the rows of an earlier run, or begin with its state."""
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
        """Record the accepted state of a step, with its measures."""
        self._keep(measures)
        due = step % self._every == 0 or last
        if due or self._probes.full:  # the table never has fewer records than the fields
            self._flush()
        if due:
            self._write_fields(step)

    def _write_fields(self, step: int) -> None:
        """Write the accepted state, unless something has failed (collective)."""
        if self._fields is not None and agreed(self._faults, self._system.comm) is None:
            with self._faults.files():
                self._fields.write(self._system.time, step)

    @property
    def due(self) -> bool:
        """True if this rank shows progress and :meth:`show` is due."""
        return self._progress.due

    def show(self) -> None:
        """Show progress with data of the accepted state (collective)."""
        begin, first = time.perf_counter(), self._unseen
        words, self._unseen = self._monitor.words(), False
        # the first call loads compiled code
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

    def record_values(self, step: int, values: FloatArray) -> None:
        """Record columns, given on the first rank, and the fields of the trial state."""
        self._flush()
        system = self._system
        self._h, self._time = system.time - self._time, system.time
        if system.comm.rank == 0:
            row = self._angles.unwrap(values)
            row = np.concatenate([[system.time], row])
            if self._table is not None:
                self._table.extend([row])
            self._remember([row])
        if self._fields is not None:
            self._fields.write(system.time, step)

    def record_between(self, measures: FloatArray | None = None) -> None:
        """Record the accepted state of a part of a step in the history."""
        self._keep(measures)
        if self._probes.full:
            self._flush()

    @property
    def balances(self) -> bool:
        """True if a probe records the balance of all energies."""
        return self._probes.energies is not None

    def follow(self) -> None:
        """Sum the work up to an accepted state that is not recorded."""
        self._probes.follow()

    def record_last(self, step: int, measures: FloatArray | None = None) -> None:
        """Record the last accepted state before a failure, which may be within the step."""
        system = self._system
        system.reset()
        system.interface.update()
        system.constraints.accept()
        if system.time > self._time:
            self.record(step, last=True, measures=measures)
        else:
            self._write_fields(step - 1)

    def state(self) -> State:
        """Return the state from which records resume, after flushing the table (collective).

        No checkpoint is ever ahead of the table. Time and probes of the last record, with
        continuous angles, are on the first rank.

        Raises:
            OSError: on all ranks; the disk write failed.
        """
        error: Exception | None = None
        try:
            self._flush()
            if self._table is not None:
                self._table.sync()
        except OSError as exc:
            error = exc
        if self._broken:
            error = self._faults.error
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
        rows = []
        for (t, values), measures in zip(self._probes.flush(), own, strict=False):
            row = self._angles.unwrap(np.concatenate([measures, values]))
            rows.append(np.concatenate([[t], row]))
        self._write(rows)
        self._remember(rows)
        if self._table is not None and self._table.lost:
            self._recover(self._table)

    def _remember(self, rows: Sequence[FloatArray]) -> None:
        """Keep rows in memory, only the last one where the table holds them."""
        if self._stored is None:
            self._rows += rows
        elif rows:
            self._rows = [rows[-1]]

    def _write(self, rows: Sequence[FloatArray]) -> None:
        """Append rows to the table, unless a disk write has failed."""
        try:
            if self._table is not None and rows:
                self._table.extend(rows)
        except OSError as error:
            self._faults.note(error)
            self._broken = True
            self._drop_table()

    def _drop_table(self) -> None:
        """Close the table after a failed disk write; buffered rows are lost."""
        table, self._table = self._table, None
        with suppress(OSError):
            if table is not None:
                table.close()

    def _recover(self, table: HistoryWriter | CompressedHistoryWriter) -> None:
        """Write the table again if it was removed; the run ends then."""
        replaced = table.path.exists()
        self._faults.note(FolderLostError(table.path.parent, replaced))
        if replaced:
            self._broken = True
            self._drop_table()
            return
        with self._faults.files():
            table.write_anew(self._rows)

    def release(self) -> None:
        """Close the table as it is, on this rank alone, after an unexpected error."""
        self._progress.close()
        self._drop_table()

    def close(self) -> None:
        """Write the remaining records."""
        self._flush()
        self._show(())
        self._progress.close()
        with self._faults.files():
            if self._table is not None:
                self._table.close()
        with self._faults.files():
            if self._fields is not None:
                self._fields.close()

    def history(self) -> Mapping[str, FloatArray]:
        """Columns recorded so far, on the first rank; without rows before the first record."""
        if self._system.comm.rank:
            return {}
        if self._stored is not None:
            return self._stored
        table = np.array(self._rows).reshape(-1, 1 + len(self._columns))
        return dict(zip(["t", *self._columns], table.T.copy(), strict=True))
