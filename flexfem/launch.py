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
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, NamedTuple, Self, TextIO

from flexfem._packages import require

# MPICH and derivatives, PMIx launchers, Open MPI.
_RANK_VARIABLES = ("PMI_RANK", "PMIX_RANK", "OMPI_COMM_WORLD_RANK")
_SIZE_VARIABLES = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE")
_LOCAL_VARIABLES = ("MPI_LOCALNRANKS", "OMPI_COMM_WORLD_LOCAL_SIZE")


def rank() -> int:
    """This process's rank as its launcher set it, 0 without a launcher."""
    return next((int(os.environ[name]) for name in _RANK_VARIABLES if name in os.environ), 0)


def launched_in_parallel() -> bool:
    """Return True if a launcher started more than one rank, by the variables of the environment."""
    started = ranks_started()
    if started is not None:
        return started > 1
    return any(name in os.environ for name in _RANK_VARIABLES)  # PMIx does not give the size


def ranks_started() -> int | None:
    """Return the number of ranks started by the launcher; None if unknown."""
    return max(
        (int(os.environ[name]) for name in _SIZE_VARIABLES if name in os.environ), default=None
    )


def ranks() -> int:
    """Number of ranks of a process that uses MPI, 1 before it does."""
    if "mpi4py.MPI" not in sys.modules:
        return 1
    from mpi4py import MPI

    return MPI.COMM_WORLD.size


def _local_ranks() -> int:
    """Ranks on this computer, one where the launcher does not give them."""
    return next((int(os.environ[name]) for name in _LOCAL_VARIABLES if name in os.environ), 1)


def ranks_here() -> tuple[int, int]:
    """Ranks on this computer, one where the launcher does not give them, and all ranks."""
    here, started = _local_ranks(), ranks_started()
    if started is None and launched_in_parallel():
        from mpi4py import MPI

        started = MPI.COMM_WORLD.size
    return here, max(here, started or 1)


def cores() -> set[int]:
    """Numbers of the cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return set(os.sched_getaffinity(0))
    return set(range(os.cpu_count() or 1))


def sleep_while_waiting() -> None:
    """Let ranks of MPICH sleep while they wait, where a computer has more of them than cores.

    They poll otherwise, and keep those from working for which they wait. MPI reads this variable
    when it starts, and the user's value is kept.
    """
    if _local_ranks() > len(cores()):
        os.environ.setdefault("MPIR_CVAR_ENABLE_HEAVY_YIELD", "1")


def say(text: str, *, error: bool = False) -> None:
    """Print one text on rank 0; whoever reads no further (``| head``) does not end a run."""
    if rank() != 0:
        return
    stream = sys.stderr if error else sys.stdout
    try:
        _write_line(stream, text)
    except OSError:
        # nobody reads, or the terminal is gone: the rest of the stream's buffer must be written
        # somewhere when the process ends
        os.dup2(os.memfd_create("unread"), stream.fileno())


def tell(text: str) -> None:
    """Print a line on stderr, on this rank."""
    _write_line(sys.stderr, text)


def _write_line(stream: TextIO, text: str) -> None:
    """Print by one write: when all ranks are ended, a second one would be lost."""
    stream.write(f"{text}\n")
    stream.flush()


def program(name: str) -> str | None:
    """Path of a program of this Python's environment, else of the first on PATH; None without.

    The ``mpirun`` beside the interpreter belongs to its MPI.
    """
    return shutil.which(name, path=str(Path(sys.executable).parent)) or shutil.which(name)


#: Variables set by launchers for their processes, and those for the threads of each: all libraries
#: look at the first where they have no variable of their own.
_LAUNCHED = ("PMI", "HYDI_", "MPI_LOCAL", "OMPI_")
_SETTINGS = "OMPI_MCA_"
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def limit_threads() -> None:
    """One thread of BLAS and OpenMP for this rank, where the environment asks for none.

    By themselves they take a thread for each core on every rank, which then wait for one another.
    In libraries that are loaded already, such as NumPy's, the number is set by a call; others read
    the environment.
    """
    given = any(os.environ.get(name) for name in _THREADS)
    if not os.environ.get(_THREADS[0]):  # an empty one asks for none either
        os.environ[_THREADS[0]] = "1"
    if given or "numpy" not in sys.modules:
        return
    try:
        from threadpoolctl import threadpool_limits
    except ImportError:  # runs say that it is missing
        return
    threadpool_limits(1)


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


#: Tags of messages to the other ranks: this one has come to a run, has left the program, or says
#: what is wrong on it before a run.
_COME, LEFT, _SAID = 30001, 30002, 30003
#: Seconds between looks at messages, and those that ranks leave a lower one to say what is wrong.
LOOK, _FIRST = 1e-3, 0.5
#: Seconds after which others do not come: they may wait for this rank in a collective call.
_PATIENCE = 2.0
#: Seconds that launchers have to forward what ranks have printed: they drop it when one ends all.
_FORWARD = 0.1
#: Prefix of the last line of a program, by its exit code.
_BEGINNINGS = {1: "failed", 2: "error"}


class Failure(NamedTuple):
    """Error on a rank, as it is printed.

    Attributes:
        message: Text of the error, empty without one.
        code: The exit code for it.
        trace: Python's traceback where it is asked for, to be printed first.
    """

    message: str
    code: int = 2
    trace: str = ""

    def __str__(self) -> str:
        """Return the printed text: the message in one line, after the traceback."""
        line = f"{_BEGINNINGS[self.code]}: {' '.join(self.message.split())}"
        return f"{self.trace.rstrip()}\n{line}" if self.trace else line


def first_message(message: str) -> str:
    """The first message that is not empty on any rank; see :func:`first_failure`."""
    return first_failure(Failure(message)).message


def first_failure(own: Failure) -> Failure:
    """The first rank's failure that is one.

    Collective when launched in parallel. A rank with a message does not wait for ever: others may
    wait for it in a collective call of the failed part. It then prints its message and ends all
    ranks.

    Args:
        own: Error on this rank, if any.
    """
    if not launched_in_parallel():
        return own
    comm = require("mpi4py.MPI").COMM_WORLD
    others = [rank for rank in range(comm.size) if rank != comm.rank]
    sent = [comm.isend(own, other, tag=_SAID) for other in others]
    said = {comm.rank: own}
    end = time.monotonic() + _PATIENCE if own.message else float("inf")
    while len(said) < comm.size:
        _hear(comm, [other for other in others if other not in said], said)
        if len(said) < comm.size and time.monotonic() > end:
            _end_with(said, comm.rank)
        time.sleep(LOOK if len(said) < comm.size else 0.0)
    for request in sent:
        request.wait()
    return next((said[rank] for rank in sorted(said) if said[rank].message), own)


def _hear(comm: Any, others: list[int], said: dict[int, Failure]) -> None:
    """Receive the messages of others; ends all ranks if one has left without any."""
    for other in others:
        left = comm.iprobe(source=other, tag=LEFT)  # first: the last message precedes it
        if comm.iprobe(source=other, tag=_SAID):
            said[other] = comm.recv(source=other, tag=_SAID)
        elif left:
            _end_without(other)


def _end_with(said: dict[int, Failure], own: int) -> None:
    """End all ranks, of which some do not come; the lowest with an error prints it."""
    failure = said[own]
    if any(other.message for rank, other in said.items() if rank < own):
        time.sleep(_FIRST)
    else:
        tell(str(failure))
    abort(failure.code)
    os._exit(failure.code)  # the request to end takes its time


def meet() -> None:
    """Wait until all ranks come to the same run; ends all if one has left for good (collective)."""
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    others = [rank for rank in range(comm.size) if rank != comm.rank]
    sent = [comm.isend(None, other, tag=_COME) for other in others]
    while others:
        for other in list(others):
            if comm.iprobe(source=other, tag=_COME):
                comm.recv(source=other, tag=_COME)
                others.remove(other)
            elif comm.iprobe(source=other, tag=LEFT):
                _end_without(other)
        time.sleep(LOOK if others else 0.0)
    MPI.Request.waitall(sent)


def _end_without(other: int) -> None:
    """End all ranks, as this one would wait for ever for another that has left."""
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    if any(not comm.iprobe(source=lower, tag=LEFT) for lower in range(comm.rank)):
        time.sleep(_FIRST)  # a lower rank says so
    else:
        text = f"failed: rank {other} of {comm.size} has exited before a run of all ranks"
        tell(text)
    abort(1)
    os._exit(1)  # the request to end takes its time


def abort(code: int) -> None:
    """End all ranks with this exit code; returns when this process is the only one.

    The caller has printed the reason: the message of MPI is left out.
    """
    if not (launched_in_parallel() or "mpi4py.MPI" in sys.modules):
        return
    from mpi4py import MPI

    if MPI.COMM_WORLD.size > 1:
        sys.stdout.flush()
        sys.stderr.flush()
        time.sleep(_FORWARD)
        told = os.dup(2)
        os.dup2(os.memfd_create("aborted"), 2)
        MPI.COMM_WORLD.Abort(code)
        os.dup2(told, 2)  # the request to end may take its time


def excepthook(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Print the traceback, then end the other ranks, which may wait for this one for ever."""
    sys.__excepthook__(kind, error, trace)
    abort(1)


#: Signals that ask a run to end, and seconds within which a second one counts as the same: a
#: launcher may forward a signal that the terminal has sent already.
_SIGNALS, _SAME = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP), 1.0


class Interrupted(KeyboardInterrupt):
    """A run was interrupted and has ended in good order on all ranks.

    Attributes:
        number: of the signal.
        code: exit code of a process that ends for this reason.
        reason: where it was interrupted, the first part of the message.
        checkpoint: checkpoint to resume from, None without.
        outcome: result of the run until then, an ``Outcome``; None if unknown.
    """

    outcome: Any = None

    def __init__(
        self, number: int, message: str, *, reason: str = "", checkpoint: Path | None = None
    ) -> None:
        """Note the signal's number and the message to the user."""
        super().__init__(message)
        self.code = 128 + number
        self.number, self.reason, self.checkpoint = number, reason or message, checkpoint


class Ended(KeyboardInterrupt):
    """A signal has ended the process where nothing is to be kept.

    Attributes:
        code: exit code of the process.
    """

    def __init__(self, number: int) -> None:
        """Note the signal's number."""
        super().__init__()
        self.code = 128 + number


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Raise :class:`Ended` on SIGTERM and SIGHUP, as Python does on SIGINT, while it is entered.

    Signals that are ignored, or have a handler of somebody else, stay as they are.
    """
    taken = []
    if threading.current_thread() is threading.main_thread():
        taken = [n for n in _SIGNALS if signal.getsignal(n) == signal.SIG_DFL]
    for number in taken:
        signal.signal(number, _end)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, signal.SIG_DFL)


def _end(number: int, frame: FrameType | None) -> None:
    raise Ended(number)


@contextmanager
def signals_kept() -> Iterator[None]:
    """Put the handlers of signals that ask to end back, where libraries have set their own."""
    former = {number: signal.getsignal(number) for number in _SIGNALS}
    try:
        yield
    finally:
        if threading.current_thread() is threading.main_thread():
            for number, handler in former.items():
                if handler is not None:  # not of Python
                    signal.signal(number, handler)


class StopSignals:
    """Notes SIGINT, SIGTERM and SIGHUP while it is entered, for a run to end at its next step.

    Where SIGHUP is ignored, as under ``nohup``, it stays so: the run outlives its terminal. A
    second signal ends at once (KeyboardInterrupt), in case the run hangs. Only the main thread of
    a process receives signals; in others nothing is noted.

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
            self._former = {
                number: signal.signal(number, self._note)
                for number in _SIGNALS
                if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN
            }
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
