# SPDX-License-Identifier: LGPL-3.0-or-later
"""The process among its MPI ranks: who prints, and how all ranks end together.

MPI itself is imported only where ranks must talk, so that ``--help`` and wrong options stay quick.
"""

import os
import shutil
import signal
import sys
import threading
import time
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, Self

# MPICH and derivatives, PMIx launchers, Open MPI.
_RANK_VARIABLES = ("PMI_RANK", "PMIX_RANK", "OMPI_COMM_WORLD_RANK")
_SIZE_VARIABLES = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE")


def rank() -> int:
    """This process's rank as its launcher set it, 0 without a launcher."""
    return next((int(os.environ[name]) for name in _RANK_VARIABLES if name in os.environ), 0)


def launched_in_parallel() -> bool:
    """Whether a launcher started more than one rank, as far as the environment tells."""
    started = ranks_started()
    if started is not None:
        return started > 1
    return any(name in os.environ for name in _RANK_VARIABLES)  # PMIx does not tell the size


def ranks_started() -> int | None:
    """How many ranks the launcher says it started; None where it does not tell."""
    return max(
        (int(os.environ[name]) for name in _SIZE_VARIABLES if name in os.environ), default=None
    )


def ranks() -> int:
    """Number of ranks of a process that uses MPI, 1 before it does."""
    if "mpi4py.MPI" not in sys.modules:
        return 1
    from mpi4py import MPI

    return MPI.COMM_WORLD.size


def say(text: str, *, error: bool = False) -> None:
    """Print one text on rank 0; whoever reads no further (``| head``) does not end a run."""
    if rank() != 0:
        return
    stream = sys.stderr if error else sys.stdout
    try:
        print(text, file=stream, flush=True)
    except BrokenPipeError:
        # what is still in the stream's buffer must go somewhere when the process ends
        os.dup2(os.memfd_create("unread"), stream.fileno())


def program(name: str) -> str | None:
    """Path of a program of this Python's environment, else of the first on PATH; None without.

    The ``mpirun`` beside the interpreter belongs to its MPI.
    """
    return shutil.which(name, path=str(Path(sys.executable).parent)) or shutil.which(name)


#: What launchers set for the processes they start, and what sets the threads of each.
_LAUNCHED = ("PMI", "HYDI_", "MPI_LOCAL", "OMPI_")
_SETTINGS = "OMPI_MCA_"
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def environment_of_runs() -> dict[str, str]:
    """Environment of processes that run beside each other: no launcher's marks, one thread each."""
    kept = {
        name: value
        for name, value in os.environ.items()
        if name.startswith(_SETTINGS) or not name.startswith(_LAUNCHED)
    }
    package = Path(__file__).resolve().parents[1]
    if package.name not in ("site-packages", "dist-packages"):  # a source tree
        kept["PYTHONPATH"] = os.pathsep.join(filter(None, [str(package), kept.get("PYTHONPATH")]))
    return kept | dict.fromkeys(_THREADS, "1")


def first_message(message: str) -> str:
    """The first message that is not empty on any rank; collective when launched in parallel."""
    if not launched_in_parallel():
        return message
    from flexfem.installation import require

    MPI = require("mpi4py.MPI")
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


#: Signals that ask a run to end, and seconds within which a second one counts as the same: a
#: launcher may pass on what the terminal has sent already.
_SIGNALS, _SAME = (signal.SIGINT, signal.SIGTERM), 1.0


class Interrupted(KeyboardInterrupt):
    """A run was asked to end and has ended in good order, on all ranks alike.

    Attributes:
        number: of the signal.
        code: exit code of a process that ends for this reason.
        reason: where it was interrupted, the first part of the message.
        checkpoint: what the run can go on from, None without.
        outcome: what the run came to until then, an ``Outcome``; None if it is not known.
    """

    outcome: Any = None

    def __init__(
        self, number: int, message: str, *, reason: str = "", checkpoint: Path | None = None
    ) -> None:
        """Note the signal's number and what to tell the user."""
        super().__init__(message)
        self.code = 128 + number
        self.number, self.reason, self.checkpoint = number, reason or message, checkpoint


class StopSignals:
    """Notes SIGINT and SIGTERM while it is entered, for a run to end at its next step.

    A second signal ends at once (KeyboardInterrupt), in case the run hangs. Only the main thread
    of a process receives signals; in others nothing is noted.

    Attributes:
        received: number of the first signal, 0 before.
    """

    def __init__(self) -> None:
        """Nothing is received yet."""
        self.received, self._since = 0, 0.0
        self._former: dict[int, Any] = {}

    def __enter__(self) -> Self:
        """Take over from the handlers that are there."""
        if threading.current_thread() is threading.main_thread():
            self._former = {number: signal.signal(number, self._note) for number in _SIGNALS}
        return self

    def __exit__(self, *_: object) -> None:
        """Put the former handlers back."""
        for number, handler in self._former.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.received and time.monotonic() > self._since + _SAME:
            raise KeyboardInterrupt
        if not self.received:
            self.received, self._since = number, time.monotonic()
