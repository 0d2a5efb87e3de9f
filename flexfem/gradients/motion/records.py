# SPDX-License-Identifier: LGPL-3.0-or-later
"""Accepted states of all steps of a motion, within a bound of memory.

Those that do not fit go to a file. Without a folder for it those at the starts of about
``sqrt(steps)`` blocks are kept, and the states within a block are computed again when they are
needed: going back once costs one motion more, and ``3 sqrt(steps)`` states. Blocks grow where there
are more steps than expected, or where fewer states fit. In a block that does not fit as a whole,
snapshots are where the binomial schedule of Griewank and Walther (ACM Trans. Math. Softw. 26 (2000)
19-45) has them: three states suffice for any motion, and steps are computed again several times.
"""

from __future__ import annotations

import tempfile
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from itertools import takewhile
from math import ceil, sqrt
from os import SEEK_END
from pathlib import Path

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._packages import require
from flexfem._types import FloatArray
from flexfem.core.state import State
from flexfem.gradients.schemes.base import Stored

__all__ = ["MEMORY", "Records", "Storage"]

#: Largest number of bytes for states on each rank.
MEMORY = 2e9
#: Fewest states: a start, both ends of a step, and the state before while they are computed again.
_FEWEST = 4
_SCHEDULES = "checkpoint_schedules"


@dataclass(frozen=True)
class Storage:
    """Where states go.

    Attributes:
        memory: largest number of bytes on each rank.
        scratch: folder of a file for those that do not fit, which is removed in the end; None if
            they are computed again.

    Raises:
        ValueError: memory is not a number from 0 on.
    """

    memory: float = MEMORY
    scratch: str | Path | None = None

    def __post_init__(self) -> None:
        """Check the memory."""
        if not self.memory >= 0.0:
            raise ValueError(f"gradient: memory must be a number of bytes, got {self.memory}")


class Records:
    """States after all steps, the start among them.

    Attributes:
        times: of the states, s.
        repeated: steps that were taken again.
    """

    def __init__(
        self, stored: Stored, steps: int, storage: Storage, advance: Callable[[int], None]
    ) -> None:
        """Choose what is kept (collective).

        Args:
            stored: what there is of every state, at its start.
            steps: of the motion.
            storage: where states go.
            advance: takes one step, whose number it gets.

        Raises:
            InputError: the memory does not suffice, or the folder cannot be written.
            InstallationError: there are no binomial schedules, which few states need.
        """
        self._stored, self._advance = stored, advance
        self._size = stored.comm.allreduce(_bytes(stored.state()), op=MPI.MAX)
        self._memory, self._file = storage.memory, _file(stored.comm, storage.scratch)
        fit = (steps + 1) * self._size <= self._memory or self._file is not None
        self._length = 1 if fit else ceil(sqrt(steps))
        self._check()
        self.times: list[float] = []
        self.repeated = 0
        self._starts: dict[int, State] = {}
        self._kept: set[int] = set()
        self._snapshots: dict[int, State] = {}
        self._near: dict[int, State] = {}

    def _check(self) -> None:
        """Raise if the fewest states need too much, or a schedule of them is missing."""
        if self._length > 1 and (least := _FEWEST * self._size) > self._memory:
            raise InputError(
                f"gradient: {_FEWEST} states of the motion need {least / 1e9:.2g} GB of memory on "
                f"a rank, got {self._memory / 1e9:.2g} GB"
            )
        # besides the starts, a third of them, and what is at hand
        if self._length > 1 and self._length + _FEWEST > self._memory / self._size / 1.5:
            require(_SCHEDULES)

    def add(self, state: State, time: float, *, keep: bool = False) -> None:
        """Add the state after the next step.

        Args:
            state: the state.
            time: its time, s.
            keep: True for one that is not computed again, whatever the memory.

        Raises:
            InputError, InstallationError: see above.
        """
        step = len(self.times)
        self.times.append(time)
        if keep:
            self._kept.add(step)
        if step % self._length and not keep:
            return
        most = self._memory / self._size
        if self._file is not None and len(self._starts) + 1 > most:
            self._file.write(step, state)
            return
        self._starts[step] = _copied(state)
        while self._file is None and len(self._starts) - len(self._kept) > (
            most if self._length == 1 else most / 3.0
        ):
            self._length *= 2
            self._check()
            self._starts = {
                k: one
                for k, one in self._starts.items()
                if k % self._length == 0 or k in self._kept
            }

    def change(self, state: State) -> None:
        """Replace the state that was added last."""
        last = len(self.times) - 1
        if last in self._starts:
            self._starts[last] = _copied(state)
        elif self._file is not None:
            self._file.write(last, state)

    def load(self, *steps: int) -> None:
        """Make the states from the first of some steps to the last available (collective).

        The motion is at another state after it.
        """
        first, last = min(steps), max(steps)
        wanted = range(first, last + 1)
        if self._length == 1 or not (missing := [k for k in wanted if not self._has(k)]):
            return
        # going back, what lies behind is not needed any more; nor, forwards, are blocks before
        start = max(k for k in self._starts if k <= first)
        self._near = {k: one for k, one in self._near.items() if k in wanted or k == first - 1}
        self._snapshots = {k: one for k, one in self._snapshots.items() if start <= k <= last}
        self._pass(max(k for k in range(start, first + 1) if self._has(k)), missing[-1], first)

    def _pass(self, begin: int, end: int, first: int) -> None:
        """Take steps again; states from the first on stay at hand, and snapshots on the way."""
        self._stored.restore(self.state(begin))
        self._near[begin] = self.state(begin)
        room = int(self._memory / self._size) - len(self._starts.keys() - self._kept)
        room -= _FEWEST - 1
        kept = begin in self._starts or begin in self._snapshots
        free = max(1, room - len(self._snapshots) + kept)
        done = begin
        for stretch in _stretches(end - begin, free):
            if done not in self._starts and len(self._snapshots) < room:
                self._snapshots[done] = self._near[done]
            for step in range(done + 1, done + stretch + 1):
                self._take(step)
                if step - 1 < first:  # which the step needed
                    del self._near[step - 1]
            done += stretch

    def _take(self, step: int) -> None:
        """Go on by one step, whose end is at hand then."""
        if step in self._starts:  # between jumps, whatever the memory
            self._stored.restore(self._starts[step])
        else:
            self._advance(step)
            self.repeated += 1
        self._near[step] = _copied(self._stored.state())

    def _has(self, step: int) -> bool:
        """Whether a state is available."""
        return step in self._starts or step in self._snapshots or step in self._near

    def state(self, step: int) -> State:
        """The state after a step, which is available."""
        for states in (self._starts, self._snapshots, self._near):
            if step in states:
                return states[step]
        assert self._file is not None
        return self._file.read(step)


def _stretches(steps: int, snapshots: int) -> list[int]:
    """Numbers of steps after each of which a snapshot is best, on the way back over all of them."""
    if snapshots >= steps:
        return [1] * steps
    library = require(_SCHEDULES)
    moves = iter(library.MultistageCheckpointSchedule(steps, snapshots, 0))
    forward = takewhile(lambda move: isinstance(move, library.Forward), moves)
    return [move.n1 - move.n0 for move in forward]


class _StateFile:
    """States of this rank in a file without a name, which ends with the process."""

    #: States that stay in memory after they were read: both ends of a step, and another model's.
    _RECENT = 4

    def __init__(self, folder: str | Path) -> None:
        """Create the file; raises OSError."""
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115
        weakref.finalize(self, self._file.close)
        self._layouts: dict[int, tuple[int, State]] = {}
        self._recent: dict[int, State] = {}

    def write(self, step: int, state: State) -> None:
        """Append a state, in place of an earlier one of the same step."""
        self._recent.pop(step, None)
        place = self._file.seek(0, SEEK_END)
        for values in _arrays(state):
            self._file.write(np.ascontiguousarray(values).data.cast("B") if values.size else b"")
        # of the arrays only what they look like
        self._layouts[step] = place, _mapped(state, lambda values: np.broadcast_to(
            np.zeros((), values.dtype), values.shape
        ))  # fmt: skip

    def read(self, step: int) -> State:
        """The state of a step."""
        if step in self._recent:
            return self._recent[step]
        place, layout = self._layouts[step]
        self._file.seek(place)
        found = _mapped(layout, lambda like: np.frombuffer(
            bytearray(self._file.read(like.size * like.itemsize)), like.dtype
        ).reshape(like.shape))  # fmt: skip
        while len(self._recent) >= self._RECENT:
            del self._recent[next(iter(self._recent))]
        self._recent[step] = found
        return found


def _file(comm: MPI.Intracomm, folder: str | Path | None) -> _StateFile | None:
    """A file in a folder (collective).

    Raises:
        InputError: it cannot be created.
    """
    if folder is None:
        return None
    made, fault = None, ""
    try:
        made = _StateFile(folder)
    except OSError as error:
        fault = error.strerror or str(error)
    if fault := max(comm.allgather(fault)):
        raise InputError(f"gradient: the scratch folder {folder} cannot be written: {fault}")
    return made


def _arrays(state: State) -> list[FloatArray]:
    """All arrays of a state."""
    rows = [values for arrays in state.rows.values() for values in arrays.values()]
    return [*state.values.values(), *rows]


def _mapped(state: State, change: Callable[[FloatArray], FloatArray]) -> State:
    """A state of changed arrays, in the order of :func:`_arrays`."""
    values = {name: change(own) for name, own in state.values.items()}
    rows = {
        group: {name: change(own) for name, own in arrays.items()}
        for group, arrays in state.rows.items()
    }
    return State(values, rows)


def _bytes(state: State) -> int:
    """Memory of the arrays of a state on this rank."""
    return sum(values.nbytes for values in _arrays(state))


def _copied(state: State) -> State:
    return _mapped(state, np.copy)
