# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checkpoints of a run, and what it takes to go on from one.

What a checkpoint holds is said by ``state()`` of the simulation and of what it consists of; here
are the checks that file and model belong together, and which files are kept.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

from mpi4py import MPI

import flexfem
from flexfem._checks import InputError
from flexfem.analyses.dynamics import RunOptions
from flexfem.analyses.relaxation import RelaxationOptions
from flexfem.analyses.statics import StaticOptions
from flexfem.core.state import Numbering, State
from flexfem.io.checkpoint import Checkpoint, remove_files, write_checkpoint
from flexfem.simulation.time_grid import TimeGrid
from flexfem.system.assembly import Assembly
from flexfem.system.fingerprint import fingerprint
from flexfem.system.system import System

__all__ = ["Checkpoints", "Restart", "SavedState"]

_NAME = re.compile(r"checkpoint_\d{6,}\.h5|\.checkpoint_\d{6,}\.h5\.tmp")
#: Of the analyses that have checkpoints.
_Options = RunOptions | RelaxationOptions | StaticOptions
#: Files of one run that are kept.
_KEEP = 2


class _Restorable(Protocol):
    """A system, or what steps it, as seen from here."""

    def restore(self, state: State) -> None: ...


class _Stateful(_Restorable, Protocol):
    """A simulation, as seen from here."""

    system: System

    def state(self) -> State: ...


class SavedState:
    """The state in a checkpoint.

    Attributes:
        path: the file.
        state: what the file holds, after :meth:`restore`.
    """

    def __init__(self, path: Path, comm: MPI.Intracomm) -> None:
        """Check the file (collective).

        Raises:
            InputError: it is no intact checkpoint of this version.
        """
        self._comm, self._file = comm, Checkpoint(path, comm)
        self.path, self.state = self._file.path, State()
        version = self._file.header["flexfem"]
        if version != flexfem.__version__:
            raise self._file.refuse(
                f"was written by flexfem {version}, this is {flexfem.__version__}; go on with that "
                "version, or start anew"
            )

    def check(self, serial: Assembly | Mapping[str, str]) -> None:
        """Compare the model with the one that was run (collective).

        Args:
            serial: serial data of the model, or the fingerprint of what is no multibody model.

        Raises:
            InputError: they differ.
        """
        other: list[str] = []
        if self._comm.rank == 0:  # the model is the same on all ranks
            then, now = self._file.header["model"], _fingerprint(serial)
            other = [name for name in now if then.get(name) != now[name]]
        other = self._comm.bcast(other)
        if other:
            raise self._file.refuse(
                f"belongs to another model, other {', '.join(other)}; go on with the case and the "
                "options that wrote it"
            )

    def refuse(self, why: str) -> InputError:
        """The exception that says why the file will not do."""
        return self._file.refuse(why)

    def restore(self, target: _Restorable, system: System) -> None:
        """Put a system, or what steps it, where the checkpoint left it (collective).

        Raises:
            InputError: the file lacks something.
        """
        self.state = self._file.read(system.numberings())
        try:
            target.restore(self.state)
        except KeyError as error:
            raise self._file.refuse(f"does not hold {error}") from error


class Restart(SavedState):
    """A checkpoint to go on from.

    Attributes:
        grid: instants of the run that wrote it.
        step: last completed step.
    """

    def __init__(self, options: _Options, comm: MPI.Intracomm) -> None:
        """Check the file named by the options (collective).

        Raises:
            InputError: it is no intact checkpoint of this version, or does not fit the options.
        """
        assert options.restart is not None
        super().__init__(options.restart, comm)
        file, header = self._file, self._file.header
        for name in options.RESTART_AGREES:
            then, now = header["options"].get(name), getattr(options, name)
            if then != now:
                raise file.refuse(f"was written with {name} = {then}, not {now}")
        self.grid = TimeGrid(*header["grid"])
        self.step: int = header["step"]
        self._check_end(options)

    def _check_end(self, options: _Options) -> None:
        """Refuse a run that has come to its end already; of load steps the state tells."""
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
    """Writes the checkpoints of one run; the last two are kept."""

    def __init__(
        self, simulation: _Stateful, serial: Assembly | Mapping[str, str],
        options: _Options, grid: TimeGrid, restart: Restart | None,
    ) -> None:  # fmt: skip
        """Note what all checkpoints of the run have in common.

        Args:
            simulation: whose state is written.
            serial: serial data of its model, or the fingerprint of what is no multibody model.
            options: of the run; without an output folder nothing is ever written.
            grid: its instants.
            restart: where the run goes on from, if it does.
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
        """What a run without checkpoints need not pay for (collective)."""
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
            The file, None without an output folder.

        Raises:
            OSError: on all ranks, if it cannot be written; the files before are still there.
        """
        if self._folder is None:
            return None
        if not self._numberings:
            self._prepare()
        path = self._folder / f"checkpoint_{step:06d}.h5"
        state = self._simulation.state() | records
        comm = self._simulation.system.comm
        write_checkpoint(path, comm, {**self._header, "step": step}, state, self._numberings)
        mine = path.absolute()
        self._kept = [*(p for p in self._kept if p != mine), mine][-_KEEP:]
        if comm.rank == 0:
            remove_files(self._folder, _NAME, self._kept)
        return path


def _fingerprint(serial: Assembly | Mapping[str, str]) -> Mapping[str, str]:
    """What a checkpoint is compared by."""
    return serial if isinstance(serial, Mapping) else fingerprint(serial)
