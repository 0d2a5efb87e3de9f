# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs that a signal ends on all ranks alike."""

import shlex
from pathlib import Path

from mpi4py import MPI

import numpy as np

from flexfem.launch import Interrupted, StopSignals
from flexfem.simulation.outcome import Outcome

__all__ = ["Agreement", "interruption"]


class Agreement:
    """What all ranks know of signals that some of them have received."""

    def __init__(self, comm: MPI.Intracomm) -> None:
        """Make room for the message."""
        self._comm, self._flag = comm, np.zeros(1, dtype=np.int32)

    def on(self, signals: StopSignals) -> int:
        """Number of the signal that a rank has received, 0 for none (collective)."""
        if self._comm.size == 1:
            return signals.received
        self._flag[0] = signals.received
        self._comm.Allreduce(MPI.IN_PLACE, self._flag, op=MPI.MAX)
        return int(self._flag[0])


def interruption(
    signal: int, reason: str, checkpoint: Path | None, outcome: Outcome | None = None
) -> Interrupted:
    """The exception that ends a run, and says how to go on."""
    more = ""
    if checkpoint is not None:
        more = f", go on with --restart {shlex.quote(str(checkpoint))}"
    stop = Interrupted(signal, reason + more)
    stop.outcome = outcome
    return stop
