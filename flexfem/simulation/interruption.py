# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs that a signal ends on all ranks alike."""

from pathlib import Path

from mpi4py import MPI

import numpy as np

from flexfem.launch import Interrupted, StopSignals
from flexfem.simulation.outcome import Outcome

__all__ = ["Agreement", "interruption"]


class Agreement:
    """What all ranks know of signals that some have received, and of progress that one shows.

    Attributes:
        show: the first rank wants to show the state, for which it may need the others.
    """

    def __init__(self, comm: MPI.Intracomm) -> None:
        """Make room for the message."""
        self._comm, self._flags = comm, np.zeros(2, dtype=np.int32)
        self.show = False

    def on(self, signals: StopSignals, due: bool = False) -> int:
        """Number of the signal that a rank has received, 0 for none (collective).

        Args:
            signals: of this rank.
            due: this rank wants to show the state.
        """
        if self._comm.size == 1:
            self.show = due
            return signals.received
        self._flags[:] = signals.received, due
        self._comm.Allreduce(MPI.IN_PLACE, self._flags, op=MPI.MAX)
        self.show = bool(self._flags[1])
        return int(self._flags[0])


def interruption(
    signal: int, reason: str, checkpoint: Path | None = None, outcome: Outcome | None = None
) -> Interrupted:
    """The exception that ends a run, and says how to go on from Python."""
    more = "" if checkpoint is None else f', go on with restart="{checkpoint}"'
    stop = Interrupted(signal, reason + more, reason=reason, checkpoint=checkpoint)
    stop.outcome = outcome
    return stop
