# SPDX-License-Identifier: LGPL-3.0-or-later
"""Interruption of a run on all ranks: by a signal, or by functions that differ between ranks."""

from pathlib import Path

from mpi4py import MPI

import numpy as np

from flexfem._faults import current
from flexfem._types import FloatArray
from flexfem.launch import Interrupted, StopSignals
from flexfem.simulation.run.functions_alike import NONE, FunctionsAlike
from flexfem.simulation.run.outcome import Outcome

__all__ = ["Agreement", "interruption"]


class Agreement:
    """Exchange between ranks of signals and errors on some, and of requests to show progress.

    Attributes:
        show: True if the first rank is to show the state, for which it may need the others.
        failed: True if a user-defined function or a file has failed on a rank, or functions differ
            between ranks that should be the same.
    """

    def __init__(self, comm: MPI.Intracomm, functions: FunctionsAlike | None = None) -> None:
        """Allocate the messages; ``functions`` are compared as well."""
        self._comm, self._functions = comm, functions
        self._own = np.zeros(3 if functions is None else 3 + functions.count)
        self._every = np.zeros((comm.size, len(self._own)))
        self._faults = current()
        self.show = self.failed = False

    def on(self, signals: StopSignals, due: bool = False, outputs: FloatArray = NONE) -> int:
        """Number of the signal that a rank has received, 0 for none (collective).

        Args:
            signals: signals that this rank has received.
            due: True if this rank is to show the state.
            outputs: outputs of controllers, which should be the same on all ranks.
        """
        failed = self._faults.error is not None
        if self._comm.size == 1:
            self.show, self.failed = due, failed
            return signals.received
        self._own[:3] = signals.received, due, failed
        if self._functions is not None:
            self._own[3:] = self._functions.checksums(outputs)
        self._comm.Allgather(self._own, self._every)
        received, show, any_failed = self._every[:, :3].max(axis=0).tolist()
        self.show, self.failed = bool(show), bool(any_failed)
        functions = self._functions
        if functions is not None and not self.failed and functions.differ(self._every[:, 3:]):
            functions.note(outputs)
            self.failed = True
        return int(received)


def interruption(
    signal: int, reason: str, checkpoint: Path | None = None, outcome: Outcome | None = None
) -> Interrupted:
    """Exception that ends a run, with advice on how to resume it from Python."""
    more = "" if checkpoint is None else f', go on with restart="{checkpoint}"'
    stop = Interrupted(signal, reason + more, reason=reason, checkpoint=checkpoint)
    stop.outcome = outcome
    return stop
