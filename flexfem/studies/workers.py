# SPDX-License-Identifier: LGPL-3.0-or-later
"""Processes that stay: each runs cases one after the other, and only the first waits for a start.

A worker is ``python -m flexfem.cli.worker``. Runs on several ranks start anew, by ``mpirun``.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import subprocess
import time
from collections.abc import Hashable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Self

from flexfem import _beside, launch
from flexfem.io.run_log import run_log
from flexfem.options import Option
from flexfem.studies.processes import python_command

__all__ = ["Answer", "Workers"]

#: Seconds between two looks at the processes, and those that one may take to end after a signal,
#: and without a run.
_PAUSE, _PATIENCE, _LEAVE = 0.05, 60.0, 5.0
#: Start of the line that is an :class:`Answer`.
_ANSWER = b"flexfem: run ended with code"


class Answer(NamedTuple):
    """What a worker says when a run has ended.

    Attributes:
        code: exit code of the run.
        stays: whether it takes another one.
    """

    code: int
    stays: bool

    def line(self) -> bytes:
        """As it is sent."""
        return b"%s %d %d\n" % (_ANSWER, self.code, self.stays)

    @classmethod
    def found(cls, line: bytes) -> Answer | None:
        """Read a line; None if it is another one."""
        if not line.startswith(_ANSWER):
            return None
        code, stays = line.removeprefix(_ANSWER).split()
        return cls(int(code), stays == b"1")


class Workers:
    """Processes that run cases, several at a time; signals of a terminal do not reach them.

    They start when they are first needed and stay for later runs, so that a run costs little more
    than its steps; runs on several ranks have processes of their own. Studies start workers unless
    they are given some, which several studies may share, one after the other::

        with ff.Workers(jobs=4) as workers:
            for spin in ("fast", "slow"):
                options = {"spin": spin}
                rows = ff.sweep("heavy_top", {"dt": [1e-3, 2e-3]}, options=options, workers=workers)
                print(spin, [row["centre_x"] for row in rows.run()])

    A worker that dies, by a signal or ``sys.exit`` in a case, fails its run only: another one takes
    its place, as of those that have become large or old.

    Attributes:
        jobs: number of runs at the same time.
        ranks: MPI ranks of each.
    """

    def __init__(self, jobs: int | None = None, ranks: int = 1) -> None:
        """Check the numbers; nothing is started.

        Args:
            jobs: runs at the same time; as many as there are cores for their ranks by default.
            ranks: MPI ranks of each run.

        Raises:
            TypeError: A number has the wrong type.
            ValueError: It is out of range, there is no mpirun, or this program itself has ranks.
        """
        self.ranks = _count("ranks", ranks)
        self.jobs = _count(
            "jobs", max(len(launch.cores()) // self.ranks, 1) if jobs is None else jobs
        )
        if launch.launched_in_parallel():
            raise ValueError("a sweep is one process: its runs have ranks of their own")
        python_command([], self.ranks)
        self._environment = launch.environment_of_runs()
        if self.jobs > 1:  # they compile beside each other already
            self._environment.setdefault(_beside.SWITCH, "0")
        self._workers: list[_Process] = []

    def __enter__(self) -> Self:
        """Return the pool."""
        return self

    def __exit__(self, *_: object) -> None:
        """End all processes."""
        self.stop()

    @property
    def running(self) -> list[Any]:
        """Keys of the runs that have not ended."""
        return [worker.key for worker in self._workers if worker.busy]

    @property
    def full(self) -> bool:
        """No more may run."""
        return len(self.running) >= self.jobs

    def start(self, key: Hashable, arguments: Sequence[str], log: Path) -> None:
        """Start ``flexfem run ARGUMENTS``, whose output is written to a file."""
        with run_log(log):
            pass
        for worker in [worker for worker in self._workers if not worker.busy]:
            if worker.takes(key, arguments, log):
                return
            worker.kill()  # it has ended since its last run
            self._workers.remove(worker)
        kind = _Worker if self.ranks == 1 else _SingleRun
        worker = kind(self._environment, self.ranks)
        self._workers.append(worker)
        worker.takes(key, arguments, log)

    def ended(self) -> list[tuple[Any, int]]:
        """Runs that have ended since the last call with their exit codes; waits for a moment."""
        busy = [worker for worker in self._workers if worker.busy]
        select.select([w.pipe for w in busy if w.pipe is not None], [], [], _PAUSE)
        done = []
        for worker in busy:
            key, code = worker.key, worker.code()
            if code is not None:
                done.append((key, code))
        for worker in [worker for worker in self._workers if worker.dead]:
            worker.kill()
            self._workers.remove(worker)
        return done

    def stop(self, number: int = signal.SIGTERM) -> None:
        """Interrupt all runs, end the processes, and kill those that do not end."""
        for worker in self._workers:
            worker.dismiss(number)
        end = time.monotonic() + _PATIENCE
        try:
            while time.monotonic() < end and not all(worker.over() for worker in self._workers):
                time.sleep(_PAUSE)
        finally:
            for worker in self._workers:
                worker.kill()
            self._workers.clear()


class _Process:
    """A process, or a group of ranks, with one run or none.

    Attributes:
        key: of its run.
        busy: True while it has one.
        dead: True if it has ended, or is about to.
        pipe: which can be read when there is news; None without one.
    """

    _process: subprocess.Popen[bytes] | None = None

    def __init__(self, environment: dict[str, str], ranks: int) -> None:
        """Nothing is started yet."""
        self._environment, self._ranks = environment, ranks
        self.key: Hashable = None
        self.busy, self.dead = False, False
        self.pipe: Any = None

    def takes(self, key: Hashable, arguments: Sequence[str], log: Path) -> bool:
        """Give it a run; False if it is not there any more."""
        raise NotImplementedError

    def code(self) -> int | None:
        """The exit code of its run, that of the process if it has died; None while it runs."""
        raise NotImplementedError

    def dismiss(self, number: int) -> None:
        """Ask it to end: by a signal if it has a run."""
        if self.busy and self._process is not None:
            self._process.send_signal(number)

    def over(self) -> bool:
        """True if it has ended."""
        return self._process is None or self._process.poll() is not None

    def kill(self) -> None:
        """End it in any case."""
        if self._process is not None:
            if not self.over():
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()

    def _popen(self, arguments: Sequence[str], **streams: Any) -> subprocess.Popen[bytes]:
        """Start Python, on its ranks, out of reach of the signals of a terminal."""
        return subprocess.Popen(
            python_command(arguments, self._ranks), env=self._environment, process_group=0,
            bufsize=0, stderr=subprocess.STDOUT, **streams,
        )  # fmt: skip


class _SingleRun(_Process):
    """The processes of one run on several ranks."""

    def takes(self, key: Hashable, arguments: Sequence[str], log: Path) -> bool:
        """Start the run."""
        with run_log(log) as stream:
            self._process = self._popen(
                ["-m", "flexfem", "run", *arguments], stdin=subprocess.DEVNULL, stdout=stream
            )
        self.key, self.busy = key, True
        return True

    def code(self) -> int | None:
        """The exit code."""
        assert self._process is not None
        code = self._process.poll()
        self.busy, self.dead = code is None, code is not None
        return code


class _Worker(_Process):
    """A process that stays."""

    _process: subprocess.Popen[bytes]

    def __init__(self, environment: dict[str, str], ranks: int) -> None:
        """Start it."""
        super().__init__(environment, ranks)
        self._process = self._popen(
            ["-m", "flexfem.cli.worker"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        self._tasks, self.pipe = self._process.stdin, self._process.stdout
        os.set_blocking(self.pipe.fileno(), False)
        self._read, self._log = b"", Path()

    def takes(self, key: Hashable, arguments: Sequence[str], log: Path) -> bool:
        """Send it the run; False if it has died while it had none."""
        assert self._tasks is not None
        if self.over():
            return False
        task = [str(Path.cwd()), str(log.absolute()), list(arguments)]
        with contextlib.suppress(OSError):  # it has died just now, which its code tells
            self._tasks.write(json.dumps(task).encode() + b"\n")
        self.key, self.busy, self._log = key, True, log
        return True

    def code(self) -> int | None:
        """Its answer, else the exit code of the process if it has died."""
        gone = self._process.poll()  # before the last look at what it has written
        while data := self._available():
            self._read += data
        *lines, self._read = self._read.split(b"\n")
        answers = [answer for line in lines if (answer := Answer.found(line))]
        rest = [line for line in lines if Answer.found(line) is None]
        self._keep([*rest, self._read] if gone is not None and self._read else rest)
        self.dead = gone is not None or not all(answer.stays for answer in answers)
        self.busy = gone is None and not answers
        return answers[0].code if answers else gone

    def _available(self) -> bytes:
        try:
            return os.read(self.pipe.fileno(), 1 << 16)
        except BlockingIOError:
            return b""

    def _keep(self, lines: Sequence[bytes]) -> None:
        """Add what comes before the run to its log: errors of imports."""
        if lines:
            with run_log(self._log, append=True) as stream:
                stream.write(b"".join(line + b"\n" for line in lines))

    def dismiss(self, number: int) -> None:
        """Ask it to end: by a signal where it runs, and by the end of its input."""
        self._close_tasks()
        super().dismiss(number)

    def kill(self) -> None:
        """End it, at once if it has a run, and close the pipes."""
        self._close_tasks()
        if not self.busy:  # it ends by itself
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_LEAVE)
        super().kill()
        self.pipe.close()

    def _close_tasks(self) -> None:
        assert self._tasks is not None
        with contextlib.suppress(OSError):
            self._tasks.close()


def _count(name: str, value: int) -> int:
    """A number of processes.

    Raises:
        TypeError, ValueError: It is none.
    """
    try:
        count: int = Option(name, int, 1, "of a sweep", minimum=1).check(value)
    except (TypeError, ValueError) as error:
        raise type(error)(f"sweep: {name} {error}") from None
    return count
