# SPDX-License-Identifier: LGPL-3.0-or-later
"""Equations of motion with their scheme in time, as runs and checkpoints use them."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem._faults import FAILURES, ReturnError, noted, where
from flexfem._types import FloatArray
from flexfem.analyses.dynamics import RunOptions
from flexfem.core.state import Numbering, State, counts
from flexfem.core.status import Status
from flexfem.research.equations.vector_alpha import VectorAlpha
from flexfem.research.equations.vector_equations import Stepper, VectorEquations

__all__ = ["SteppedEquations"]

#: Halvings of a step that fails.
_HALVINGS = 6


class _Replicated:
    """The part of a system that checkpoints need: nothing is distributed."""

    def __init__(self, comm: MPI.Intracomm) -> None:
        self.comm = comm

    def numberings(self) -> dict[str, Numbering]:
        """No rows but the values that are the same on every rank."""
        return {}

    def doubts(self, state: State) -> str:
        """No rows that could be wrong."""
        return ""


class SteppedEquations:
    """Equations with their scheme in time.

    Attributes:
        status: True if there was a consistent start.
        steps, rejected: accepted (partial) steps and rejected ones.
    """

    def __init__(
        self, equations: VectorEquations, options: RunOptions, comm: MPI.Intracomm
    ) -> None:
        """Nothing is evaluated before :meth:`begin` or :meth:`restore`."""
        self.equations, self.options = equations, options
        self.system: Any = _Replicated(comm)
        self.stepper: Stepper = equations.stepper or VectorAlpha()
        self.status, self.steps, self.rejected = Status.OK, 0, 0

    def begin(self) -> None:
        """Start at t = 0."""
        self.status = Status.DIVERGED  # unless all functions can be called
        # values that are not finite become a status
        with np.errstate(all="ignore"), self._functions():
            self.status = self.stepper.begin(self.equations, self.options)

    @contextmanager
    def _functions(self) -> Iterator[None]:
        """Collect failures of the user's functions within."""
        try:
            yield
        except FAILURES as error:
            if not (where(error) or isinstance(error, ReturnError)):
                raise
            noted(type(self.equations).__name__, self.equations, error)

    def observed(self) -> FloatArray:
        """The columns of the history at the accepted state."""
        row = np.full(len(self.equations.columns), np.nan)
        with self._functions():
            row[:] = self.equations.observe(self.stepper.motion)
        return row

    def advance(self, h: float, t: float) -> Status:
        """One step, or parts of it, to time ``t``; one in which a function fails diverges."""
        status = Status.DIVERGED
        with np.errstate(all="ignore"), self._functions():
            status = self._advance(h, _HALVINGS)
        if status is Status.OK:
            self.stepper.motion.t = t
        return status

    def _advance(self, h: float, halvings: int) -> Status:
        status = self.stepper.step(h)
        if status is Status.OK:
            self.steps += 1
            return status
        self.rejected += 1
        if not halvings or self.equations.linear:
            return status
        first = self._advance(0.5 * h, halvings - 1)
        return first if first is not Status.OK else self._advance(0.5 * h, halvings - 1)

    def state(self) -> State:
        """All that the next step depends on."""
        counts = np.array([self.steps, self.rejected], dtype=np.float64)
        return State({"steps": counts, **self.stepper.state()})

    def restore(self, state: State) -> None:
        """Continue from the return value of :meth:`state`."""
        self.steps, self.rejected = counts("steps", state.values["steps"])
        self.stepper.restore(self.equations, self.options, state.values)
