# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs that a signal, or functions that differ between ranks, end on all ranks alike."""

from pathlib import Path

from mpi4py import MPI

import numpy as np

from flexfem._faults import current
from flexfem._types import FloatArray
from flexfem.launch import Interrupted, StopSignals
from flexfem.simulation.outcome import Outcome

__all__ = ["Agreement", "interruption"]


_NONE: FloatArray = np.empty(0)
#: Values that differ by less than this part may be rounded by other computers.
_ALIKE = 1e-9


class Agreement:
    """What all ranks know of signals and errors on some, and of progress that one shows.

    Attributes:
        show: the first rank wants to show the state, for which it may need the others.
        failed: a function of the user's, or a file, has failed on a rank.
        differs: values that all ranks should have alike are not.
    """

    def __init__(self, comm: MPI.Intracomm) -> None:
        """Make room for the message."""
        self._comm, self._flags = comm, np.zeros(6)
        self._faults = current()
        self.show = self.failed = self.differs = False

    def on(self, signals: StopSignals, due: bool = False, values: FloatArray = _NONE) -> int:
        """Number of the signal that a rank has received, 0 for none (collective).

        Args:
            signals: of this rank.
            due: this rank wants to show the state.
            values: numbers that should be the same on every rank.
        """
        if self._comm.size == 1:
            self.show, self.failed = due, self._faults.error is not None
            return signals.received
        checksum, size = _checksum(values)
        failed = self._faults.error is not None
        self._flags[:] = signals.received, due, failed, checksum, -checksum, size
        self._comm.Allreduce(MPI.IN_PLACE, self._flags, op=MPI.MAX)
        received, show, any_failed, most, negative_least, largest = self._flags.tolist()
        self.show, self.failed = bool(show), bool(any_failed)
        self.differs = most + negative_least > _ALIKE * largest
        return int(received)


def _checksum(values: FloatArray) -> tuple[float, float]:
    """A sum of numbers with weights of their own, and how large it may get; 0 for what is none."""
    finite = np.where(np.isfinite(values), values, 0.0)
    weights = 1.5 + np.cos(np.arange(len(values)))
    return float(weights @ finite), float(weights @ np.abs(finite))


def interruption(
    signal: int, reason: str, checkpoint: Path | None = None, outcome: Outcome | None = None
) -> Interrupted:
    """The exception that ends a run, and says how to go on from Python."""
    more = "" if checkpoint is None else f', go on with restart="{checkpoint}"'
    stop = Interrupted(signal, reason + more, reason=reason, checkpoint=checkpoint)
    stop.outcome = outcome
    return stop
