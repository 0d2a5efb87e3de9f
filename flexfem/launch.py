# SPDX-License-Identifier: LGPL-3.0-or-later
"""The process among its MPI ranks: who prints, and how all ranks end together.

MPI itself is imported only where ranks must talk, so that ``--help`` and wrong options stay quick.
"""

import os
import sys
from types import TracebackType

# MPICH and derivatives, PMIx launchers, Open MPI.
_RANK_VARIABLES = ("PMI_RANK", "PMIX_RANK", "OMPI_COMM_WORLD_RANK")
_SIZE_VARIABLES = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE")


def rank() -> int:
    """This process's rank as its launcher set it, 0 without a launcher."""
    return next((int(os.environ[name]) for name in _RANK_VARIABLES if name in os.environ), 0)


def launched_in_parallel() -> bool:
    """Whether a launcher started more than one rank, as far as the environment tells."""
    sizes = [int(os.environ[name]) for name in _SIZE_VARIABLES if name in os.environ]
    if sizes:
        return max(sizes) > 1
    return any(name in os.environ for name in _RANK_VARIABLES)  # PMIx does not tell the size


def say(text: str, *, error: bool = False) -> None:
    """Print one text on rank 0."""
    if rank() == 0:
        print(text, file=sys.stderr if error else sys.stdout, flush=True)


def first_message(message: str) -> str:
    """The first message that is not empty on any rank; collective when launched in parallel."""
    if not launched_in_parallel():
        return message
    from mpi4py import MPI

    return next(filter(None, MPI.COMM_WORLD.allgather(message)), "")


def abort(code: int) -> None:
    """End all ranks with this exit code; returns when this process is the only one."""
    if not (launched_in_parallel() or "mpi4py.MPI" in sys.modules):
        return
    from mpi4py import MPI

    if MPI.COMM_WORLD.size > 1:
        sys.stdout.flush()
        sys.stderr.flush()
        MPI.COMM_WORLD.Abort(code)


def excepthook(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Print the traceback, then end the other ranks, which may wait for this one for ever."""
    sys.__excepthook__(kind, error, trace)
    abort(1)
