# SPDX-License-Identifier: LGPL-3.0-or-later
"""Context of all runs: lock of the output folder, and an orderly end after any error."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields

from mpi4py import MPI

from flexfem import launch
from flexfem._checks import InputError
from flexfem._faults import Faults, current, watched
from flexfem.io.atomic import first_error, raise_together
from flexfem.io.folder_lock import FolderLock
from flexfem.io.tables.history import FolderLostError
from flexfem.launch import Interrupted
from flexfem.options import Settings

__all__ = ["agreed", "folder_is_lost", "guarded", "reason_of", "refuse"]

#: Options that may differ between ranks, and types of values that are compared.
_OWN, _PLAIN = ("quiet", "progress"), (bool, int, float, str)
#: Seconds by which ranks may differ in finding the same input error.
_PATIENCE = 10.0


@contextmanager
def guarded(options: Settings, comm: MPI.Intracomm) -> Iterator[Faults]:
    """Lock the output folder for a run and handle its errors (collective).

    At its end, errors of user-defined functions and files on one rank are raised on all.

    Raises:
        InputError: options differ between ranks, another run has the folder, or a user-defined
            function failed at the start.
        FunctionError: one failed later.
        OSError: the results cannot be written.
    """
    _check_options(options, comm)
    with _own_folder(options, comm), watched() as faults:
        try:
            yield faults
        except InputError as refused:
            if _all_come(comm):
                refuse(faults, comm)  # it is the reason, if there is one
            else:
                refused.alone = True
            raise
        except Interrupted as stop:
            if error := agreed(faults, comm):
                stop.reason += f"; {error}"
            raise
        error = agreed(faults, comm)
        if error is not None:
            error.outcome = faults.outcome  # type: ignore[attr-defined]
            raise error


def _all_come(comm: MPI.Intracomm) -> bool:
    """Return False if other ranks remain in a call that failed on one (collective otherwise)."""
    barrier, end = comm.Ibarrier(), time.monotonic() + _PATIENCE
    while not barrier.Test():
        if time.monotonic() > end:
            return False
        time.sleep(launch.LOOK)
    return True


def _check_options(options: Settings, comm: MPI.Intracomm) -> None:
    """Refuse options that differ between ranks, which would compute different steps (collective).

    Options of printing may differ; folders and files may have other names on other computers.

    Raises:
        InputError: names the option and its values, on all ranks.
    """
    if comm.size == 1:
        return
    if comm.size == MPI.COMM_WORLD.size:
        launch.meet()
    name = type(options).__name__
    every = comm.allgather(
        {"class": name}
        | {
            field.name: str(value)
            for field in fields(options)
            if field.name not in _OWN and isinstance(value := getattr(options, field.name), _PLAIN)
        }
    )
    for rank, given in enumerate(every):
        for option, value in given.items():
            if value != (first := every[0].get(option)):
                raise InputError(
                    f"{name}: {option} of rank 0 is {first}, of rank {rank} {value}; give all "
                    "ranks the same options"
                )


@contextmanager
def _own_folder(options: Settings, comm: MPI.Intracomm) -> Iterator[None]:
    if options.output is None:
        yield
        return
    lock, error = FolderLock(options.output), None
    try:
        if comm.rank == 0:
            try:
                lock.take()
            except InputError as exc:
                error = exc
        raise_together(comm, error)
        yield
    finally:
        lock.release()


def agreed(faults: Faults, comm: MPI.Intracomm) -> Exception | None:
    """The error of the first rank that has one, None without errors (collective)."""
    return first_error(comm, faults.error)


def folder_is_lost(comm: MPI.Intracomm) -> bool:
    """Return True if another run has taken the output folder (collective)."""
    error = agreed(current(), comm)
    return isinstance(error, FolderLostError) and error.replaced


def refuse(faults: Faults, comm: MPI.Intracomm) -> None:
    """Raise recorded errors before anything is computed or written (collective).

    Raises:
        InputError: on all ranks.
    """
    error = agreed(faults, comm)
    if error is not None:
        raise InputError(str(error)) from error


def reason_of(faults: Faults, comm: MPI.Intracomm, when: str, otherwise: Callable[[], str]) -> str:
    """Return the error of a rank with its time, else the status of the run (collective)."""
    error = agreed(faults, comm)
    return otherwise() if error is None else f"{error}{when}"
