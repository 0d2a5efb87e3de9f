# SPDX-License-Identifier: LGPL-3.0-or-later
"""Accepted states of all steps of a motion, within a bound of memory.

If all of them do not fit, those at the starts of about ``sqrt(steps)`` blocks are kept, and the
states within a block are computed again when they are needed: going back once costs one motion
more, and ``3 sqrt(steps)`` states. Blocks grow where there are more steps than expected. Binomial
schedules (Griewank, Walther, ACM Trans. Math. Softw. 26 (2000) 19-45) need fewer states, and 2.5 to
3.5 motions.
"""

from __future__ import annotations

from collections.abc import Callable
from math import ceil, sqrt

from mpi4py import MPI

from flexfem._checks import InputError
from flexfem.core.state import State
from flexfem.system.system import System

__all__ = ["Records"]


class Records:
    """States after all steps, the start among them.

    Attributes:
        times: of the states, s.
    """

    def __init__(
        self, system: System, steps: int, memory: float, advance: Callable[[int], None]
    ) -> None:
        """Choose what is kept (collective).

        Args:
            system: at its start.
            steps: of the motion.
            memory: largest number of bytes on each rank.
            advance: takes one step, whose number it gets.

        Raises:
            InputError: the memory does not suffice.
        """
        self._system, self._advance = system, advance
        self._size = system.comm.allreduce(_bytes(system.state()), op=MPI.MAX)
        self._memory = memory
        self._length = 1 if (steps + 1) * self._size <= memory else ceil(sqrt(steps))
        self._check(steps)
        self.times: list[float] = []
        self._starts: dict[int, State] = {}
        self._kept: set[int] = set()
        self._near: dict[int, dict[int, State]] = {}

    def _check(self, steps: int) -> None:
        """Raise if blocks of these steps need too much."""
        if self._length > 1 and (least := 3 * self._length * self._size) > self._memory:
            raise InputError(
                f"gradient: the states of {steps} steps need {least / 1e9:.2g} GB of memory on a "
                f"rank, got {self._memory / 1e9:.2g} GB"
            )

    def add(self, state: State, time: float, *, keep: bool = False) -> None:
        """Add the state after the next step.

        Args:
            state: the state.
            time: its time, s.
            keep: True for one that is not computed again, whatever the memory.

        Raises:
            InputError: the memory does not suffice.
        """
        step = len(self.times)
        self.times.append(time)
        if keep:
            self._kept.add(step)
        if step % self._length and not keep:
            return
        self._starts[step] = _copied(state)
        most = self._memory / self._size
        while len(self._starts) - len(self._kept) > (most if self._length == 1 else most / 3.0):
            self._length *= 2
            self._check(step)
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

    def load(self, *steps: int) -> None:
        """Make states available, those of few blocks at a time (collective).

        The system is at another state after it.
        """
        if self._length == 1:
            return
        blocks = {step - step % self._length for step in steps}
        for block in sorted(blocks - self._near.keys()):
            for other in self._near.keys() - blocks:
                del self._near[other]
            self._system.restore(self._starts[block])
            self._near[block] = own = {block: self._starts[block]}
            for step in range(block + 1, min(block + self._length, len(self.times))):
                if step in self._kept:
                    self._system.restore(self._starts[step])
                else:
                    self._advance(step)
                own[step] = _copied(self._system.state())

    def state(self, step: int) -> State:
        """The state after a step, which is available."""
        if step in self._starts:
            return self._starts[step]
        return self._near[step - step % self._length][step]


def _bytes(state: State) -> int:
    """Memory of the arrays of a state on this rank."""
    rows = [values for arrays in state.rows.values() for values in arrays.values()]
    return sum(values.nbytes for values in (*state.values.values(), *rows))


def _copied(state: State) -> State:
    rows = {
        group: {name: values.copy() for name, values in arrays.items()}
        for group, arrays in state.rows.items()
    }
    return State({name: values.copy() for name, values in state.values.items()}, rows)
