# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs in processes of their own, some at a time."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from flexfem import _beside
from flexfem.io.run_log import run_log
from flexfem.launch import environment_of_runs, program

__all__ = ["Processes", "cores", "run_command"]

#: Seconds between two looks at the processes, and those that one may take to end after a signal.
_PAUSE, _PATIENCE = 0.05, 60.0


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_command(arguments: Sequence[str], ranks: int) -> list[str]:
    """The command that runs a case with this very interpreter.

    Raises:
        ValueError: There is no mpirun for several ranks.
    """
    # -P: modules of the working folder are not imported in place of those of the libraries
    run = [sys.executable, "-P", "-m", "flexfem", "run", *arguments]
    if ranks == 1:
        return run
    mpirun = program("mpirun")
    if mpirun is None:
        raise ValueError(f"{ranks} ranks need mpirun, which is not on PATH")
    return [mpirun, "-n", str(ranks), *run]


class Processes:
    """Processes that run at the same time; signals of a terminal do not reach them.

    Attributes:
        running: tasks of the running processes.
    """

    def __init__(self, limit: int) -> None:
        """None runs yet; ``limit`` is the number of processes at the same time."""
        self._running: dict[Any, subprocess.Popen[bytes]] = {}
        self._limit = limit
        self._environment = environment_of_runs()
        if limit > 1:  # they compile beside each other already
            self._environment.setdefault(_beside.SWITCH, "0")

    @property
    def running(self) -> list[Any]:
        """Processes that are running."""
        return list(self._running)

    @property
    def full(self) -> bool:
        """No more may run."""
        return len(self._running) >= self._limit

    def start(self, key: Any, command: Sequence[str], log: Path) -> None:
        """Start a process whose output is written to a file."""
        with run_log(log) as stream:
            self._running[key] = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=stream, stderr=subprocess.STDOUT,
                env=self._environment, process_group=0,
            )  # fmt: skip

    def ended(self) -> list[tuple[Any, int]]:
        """Those that have ended since the last call with their exit codes; waits for a moment."""
        codes = [(key, process.poll()) for key, process in self._running.items()]
        done = [(key, code) for key, code in codes if code is not None]
        for key, _ in done:
            del self._running[key]
        if not done and self._running:
            time.sleep(_PAUSE)
        return done

    def stop(self, number: int = signal.SIGTERM) -> None:
        """Interrupt all, and kill those that do not end."""
        for process in self._running.values():
            process.send_signal(number)
        end = time.monotonic() + _PATIENCE
        try:
            while self._running and time.monotonic() < end:
                self.ended()
        finally:
            for process in self._running.values():
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            self._running.clear()
