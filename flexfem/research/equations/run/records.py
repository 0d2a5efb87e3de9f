# SPDX-License-Identifier: LGPL-3.0-or-later
"""History, pictures and progress of a run of equations of motion."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from mpi4py import MPI

import numpy as np

from flexfem._faults import current
from flexfem._types import FloatArray
from flexfem.analyses.dynamics import RunOptions
from flexfem.core.state import State
from flexfem.io.atomic import raise_together
from flexfem.io.paraview.paraview_state import write_paraview_state
from flexfem.io.progress import Progress
from flexfem.io.summary import remove_summary
from flexfem.io.tables.compressed_history import CompressedHistoryWriter, StoredHistory
from flexfem.io.tables.history import AngleColumns, FolderLostError, HistoryWriter
from flexfem.io.tables.history_files import open_history
from flexfem.io.vtu.field_choice import FieldChoice
from flexfem.io.vtu.series import VtuSeries
from flexfem.research.equations.run.stepping import SteppedEquations
from flexfem.research.equations.vector_equations import Motion
from flexfem.simulation.run.guard import agreed
from flexfem.simulation.run.recording import last_record

__all__ = ["EquationRecords"]

#: Series that a run of a multibody model may have left in the folder.
_OF_MODELS = (
    "beams", "beam_surfaces", "shells", "floating_bodies", "floating_lines", "rigid_bodies",
    "joints", "reactions", "contact_surfaces", "cables",
)  # fmt: skip


class EquationRecords:
    """History, pictures and progress of one run."""

    def __init__(
        self,
        simulation: SteppedEquations,
        options: RunOptions,
        comm: MPI.Intracomm,
        resume: State | None,
    ) -> None:
        """Open the history; with a saved state ``resume`` it continues after that instant."""
        self._simulation, self._equations = simulation, simulation.equations
        self._comm, self._every, equations = comm, options.every, simulation.equations
        self._columns = list(equations.columns)
        self._angles = AngleColumns(self._columns, list(equations.angles))
        self._rows: list[FloatArray] = []
        self._folder, self._choice = options.output, FieldChoice(precision=options.fields_precision)
        self._table: HistoryWriter | CompressedHistoryWriter | None = None
        self._stored: StoredHistory | None = None
        self._series: dict[str, VtuSeries] = {}
        self._opened = False  # ParaView's script is written
        self._faults, self._broken = current(), False  # broken: the table lacks rows
        row = None if resume is None else last_record(resume, len(self._columns))
        self._resume = start = None if row is None else float(row[0])
        if options.output is not None:
            self._table = open_history(
                options.output, options.history_format, self._columns, comm, start
            )
            if isinstance(self._table, CompressedHistoryWriter):
                self._stored = StoredHistory(self._table.path, ["t", *self._columns])
            remove_summary(options.output / "summary.json", comm)
        if row is not None:
            self._angles.previous = row[1:].copy()
            kept = [] if self._table is None else list(self._table.kept)
            if self._table is not None and not kept:
                self._table.write(row[0], row[1:])
            self._rows = kept or [row]
        self._progress = Progress(
            options.t_end, not options.quiet and comm.rank == 0, t_start=start or 0.0,
            how=options.progress,
        )  # fmt: skip

    @property
    def due(self) -> bool:
        """See :class:`Records`."""
        return self._progress.due

    def show(self) -> None:
        """See :class:`Records`."""
        stepper = self._simulation.stepper
        counters, t = stepper.counters, stepper.motion.t
        self._progress.update(t, counters["newton_iterations"], counters["factorizations"])

    def record(self, step: int, last: bool = False) -> None:
        """Note the accepted state (collective)."""
        motion = self._simulation.stepper.motion
        row = self._angles.unwrap(self._simulation.observed())
        self._rows.append(np.concatenate([[motion.t], row]))
        self._write(motion.t, row)
        if last or step % self._every == 0:
            self.picture(step)
        if last:
            self.show()

    def _write(self, t: float, row: FloatArray) -> None:
        """Append a row to the table, as long as the disk takes them."""
        table = self._table
        try:
            if table is not None:
                table.write(t, row)
        except OSError as error:
            self._faults.note(error)
            self._table, self._broken = None, True

    def picture(self, step: int) -> None:
        """Write the pictures, unless something has failed (collective)."""
        self._look_after_the_table()
        if self._folder is not None and agreed(self._faults, self._comm) is None:
            with self._faults.files():
                self._picture(self._folder, step, self._simulation.stepper.motion)

    def _look_after_the_table(self) -> None:
        """Write the table again where it was removed; the run ends then."""
        table = self._table
        if table is not None and table.lost:
            self._faults.note(FolderLostError(table.path.parent, table.path.exists()))
            self._broken = table.path.exists()
            if self._broken:
                table.close()
                self._table = None
                return
            with self._faults.files():
                table.write_anew(self._rows)

    def _picture(self, folder: Path, step: int, motion: Motion) -> None:
        """Write the pictures (collective); the first rank has all data."""
        for name, seen in self._equations.pictures(motion).items():
            if name not in self._series:
                self._series[name] = VtuSeries(
                    folder, name, self._comm, resume=self._resume, fields=self._choice
                )
            mine = slice(None) if self._comm.rank == 0 else slice(0)
            self._series[name].write(
                motion.t, step, seen.points[mine], seen.cells[mine], seen.cell_type,
                {key: values[mine] for key, values in seen.point_data.items()},
                {key: values[mine] for key, values in seen.cell_data.items()},
            )  # fmt: skip
        if self._series and not self._opened:
            write_paraview_state(folder, self._comm)
            self._opened = True

    def state(self) -> State:
        """See :class:`Records`."""
        error: Exception | None = self._faults.error if self._broken else None
        try:
            if self._table is not None:
                self._table.sync()
        except OSError as exc:
            error = exc
        raise_together(self._comm, error)
        return State({"history": self._rows[-1]})

    def close(self) -> None:
        """See :class:`Records`."""
        self._progress.close()
        self._look_after_the_table()
        with self._faults.files():
            if self._table is not None:
                self._table.close()
        with self._faults.files():
            if self._folder is not None and agreed(self._faults, self._comm) is None:
                for name in _OF_MODELS:
                    if name not in self._series:
                        VtuSeries(self._folder, name, self._comm).close()
            for series in self._series.values():
                series.close()

    def history(self) -> Mapping[str, FloatArray]:
        """See :class:`Records`."""
        if self._comm.rank or not self._rows:
            return {}
        if self._stored is not None:
            return self._stored
        table = np.array(self._rows)
        return dict(zip(["t", *self._columns], table.T.copy(), strict=True))

    def release(self) -> None:
        """See :class:`Records`."""
        self._progress.close()
        if self._table is not None:
            with suppress(OSError):
                self._table.close()
