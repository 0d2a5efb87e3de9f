# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checkpoints of a run, and restart from them.

The contents of a checkpoint are given by ``state()`` of the simulation and of its parts; this
module checks that file and model belong together, and keeps the latest files.
"""

import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

from mpi4py import MPI

import flexfem
from flexfem import _checks
from flexfem._checks import InputError
from flexfem.analyses.dynamics import MAX_STEPS, RunOptions
from flexfem.analyses.relaxation import RelaxationOptions
from flexfem.analyses.statics import StaticOptions
from flexfem.core.state import Numbering, State
from flexfem.io.atomic import raise_together
from flexfem.io.hdf5.checkpoint import Checkpoint, remove_files, write_checkpoint
from flexfem.layout.numbered_model import NumberedModel
from flexfem.simulation.run.guard import folder_is_lost
from flexfem.simulation.run.time_grid import TimeGrid
from flexfem.system.fingerprint import fingerprint
from flexfem.system.system import System

__all__ = ["Checkpoints", "Restart", "SavedState"]

_NAME = re.compile(r"checkpoint_\d{6,}\.h5|\.checkpoint_\d{6,}\.h5\.tmp")
#: Options of the analyses that have checkpoints.
_Options = RunOptions | RelaxationOptions | StaticOptions
#: Number of files of one run that are kept.
_KEEP = 2


class _Restorable(Protocol):
    """Interface of a system, or of its simulation, for restarts."""

    def state(self) -> State: ...

    def restore(self, state: State) -> None: ...


class _Stateful(_Restorable, Protocol):
    """Interface of a simulation for checkpoints."""

    system: System


class SavedState:
    """The state in a checkpoint.

    Attributes:
        path: the file.
        state: contents of the file, after :meth:`restore`.
    """

    def __init__(self, path: Path, comm: MPI.Intracomm) -> None:
        """Check the file (collective).

        Raises:
            InputError: it is not an intact checkpoint of this version.
        """
        self._comm, self._file = comm, Checkpoint(path, comm)
        self.path, self.state = self._file.path, State()
        version = self._entry("flexfem", str)
        if version != flexfem.__version__:
            raise self._file.refuse(
                f"was written by flexfem {_checks.show(version)[1:-1]}, this is "
                f"{flexfem.__version__}; continue with that version, or start a new run"
            )

    def _entry(self, name: str, kind: type) -> Any:
        """Return the entry of a name in the header.

        Raises:
            InputError: there is no such entry.
        """
        value = self._file.header.get(name)
        if not isinstance(value, kind) or isinstance(value, bool):
            raise self._file.refuse(f"its header has no {name}")
        return value

    def check(self, serial: NumberedModel | Mapping[str, str]) -> None:
        """Compare the model with the one that was run (collective).

        Args:
            serial: serial data of the model, or the fingerprint of other equations.

        Raises:
            InputError: they differ.
        """
        other, self._model = list[str](), self._entry("model", dict)
        if self._comm.rank == 0:  # the model is the same on all ranks
            then, now = self._model, _fingerprint(serial)
            other = [name for name in now if then.get(name) != now[name]]
        other = self._comm.bcast(other)
        if other:
            raise self._file.refuse(
                f"belongs to another model, other {', '.join(other)}; continue with the case and "
                "the options that wrote it"
            )

    def refuse(self, why: str) -> InputError:
        """The exception that says why the file will not do."""
        return self._file.refuse(why)

    def restore(self, target: _Restorable, system: System) -> None:
        """Restore a system, or its simulation, from the checkpoint (collective).

        Raises:
            InputError: the file is incomplete.
        """
        expected, self.state = target.state(), self._file.read(system.numberings())
        reason = expected.misfit(self.state) or system.doubts(self.state)
        raise_together(self._comm, self._file.refuse(reason) if reason else None)
        try:
            target.restore(self.state)
        except KeyError as error:
            raise self._file.refuse(f"{error} is missing") from error
        except (IndexError, TypeError, ValueError) as error:  # of values: the same on all ranks
            raise self._file.refuse(" ".join(str(error).split())) from error


class Restart(SavedState):
    """A checkpoint from which a run is resumed.

    Attributes:
        grid: instants of the run that wrote it.
        step: last completed step.
    """

    def __init__(self, options: _Options, comm: MPI.Intracomm) -> None:
        """Check the file named by the options (collective).

        Raises:
            InputError: it is not an intact checkpoint of this version, or does not fit the options.
        """
        assert options.restart is not None
        super().__init__(options.restart, comm)
        file = self._file
        written = self._entry("options", dict)
        for name in options.RESTART_AGREES:
            then, now = written.get(name), getattr(options, name)
            if then != now:
                shown = then if isinstance(then, str | float) else _checks.show(then)
                raise file.refuse(f"was written with {name} = {shown}, not {now}")
        self.grid = self._grid()
        self.step: int = self._entry("step", int)
        if not 0 <= self.step <= MAX_STEPS:
            raise file.refuse(f"its header has the step {_checks.show(self.step)}")
        self._check_end(options)

    def _grid(self) -> TimeGrid:
        grid = self._entry("grid", list)
        plain = len(grid) == 2 and not any(isinstance(number, bool) for number in grid)
        if plain and isinstance(grid[0], int | float) and isinstance(grid[1], int):
            span, count = grid
            if 0.0 < span <= sys.float_info.max and 0 < count <= MAX_STEPS:
                return TimeGrid(float(span), count)
        raise self._file.refuse(f"its header has the grid {_checks.show(grid)}")

    def check_time(self, t: float) -> None:
        """Check that the state is that of the step, or of a part of the next one.

        Raises:
            InputError: the state is another one.
        """
        low, high = self.grid.time(self.step), self.grid.time(self.step + 1)
        if not low - 1e-6 * self.grid.h <= t <= high:
            raise self._file.refuse(f"is at t = {t:g} s, which is not that of its step {self.step}")

    def _check_end(self, options: _Options) -> None:
        """Refuse a run that is complete already; for load steps the state is checked."""
        if isinstance(options, StaticOptions):
            return
        if isinstance(options, RelaxationOptions):
            end, over = f"max_iterations = {options.max_iterations}", options.max_iterations
            reached = f"iteration {self.step}"
        else:
            end, over = f"t_end = {options.t_end:g} s", self.grid.steps(options.t_end)
            reached = f"t = {self.grid.time(self.step):g} s"
        if over <= self.step:
            raise self._file.refuse(f"is at {reached} already, {end} leaves nothing to do")


class Checkpoints:
    """Writer of the checkpoints of one run, of which the last two are kept."""

    def __init__(
        self, simulation: _Stateful, serial: NumberedModel | Mapping[str, str],
        options: _Options, grid: TimeGrid, restart: Restart | None,
    ) -> None:  # fmt: skip
        """Store the common data of all checkpoints of the run.

        Args:
            simulation: simulation whose state is written.
            serial: serial data of its model, or the fingerprint of other equations.
            options: options of the run; without an output folder nothing is written.
            grid: instants of the run.
            restart: checkpoint from which the run was resumed, if any.
        """
        self._simulation, self._folder, self._serial = simulation, options.output, serial
        self._numberings: dict[str, Numbering] = {}
        self._header = {
            "flexfem": flexfem.__version__,
            "options": {name: getattr(options, name) for name in options.RESTART_AGREES},
            "grid": (grid.span, grid.count),
        }
        self._kept = [] if restart is None else [restart.path.absolute()]

    def _prepare(self) -> None:
        """Compute the data that only runs with checkpoints need (collective)."""
        system = self._simulation.system
        self._numberings = system.numberings()
        if system.comm.rank == 0:
            self._header["model"] = _fingerprint(self._serial)

    def write(self, step: int, records: State) -> Path | None:
        """Write the accepted state (collective).

        Args:
            step: last completed step.
            records: state of the recorder.

        Returns:
            The file, None without an output folder, or if another run has taken the folder.

        Raises:
            OSError: on all ranks, if it cannot be written; earlier files are kept.
        """
        comm = self._simulation.system.comm
        if self._folder is None or folder_is_lost(comm):
            return None
        if not self._numberings:
            self._prepare()
        path = self._folder / f"checkpoint_{step:06d}.h5"
        state = self._simulation.state() | records
        write_checkpoint(path, comm, {**self._header, "step": step}, state, self._numberings)
        mine = path.absolute()
        self._kept = [*(p for p in self._kept if p != mine), mine][-_KEEP:]
        if comm.rank == 0:
            remove_files(self._folder, _NAME, self._kept)
        return path


def _fingerprint(serial: NumberedModel | Mapping[str, str]) -> Mapping[str, str]:
    """Return the texts by which a checkpoint is compared."""
    return serial if isinstance(serial, Mapping) else fingerprint(serial)
