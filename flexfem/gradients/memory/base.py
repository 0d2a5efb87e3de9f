# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a motion carries from step to step beside its nodes: memories, such as states of laws.

The numbers s of a memory follow the motion, ``s1 = N(s0, q1, v1, w1, p)``, and act in the equations
of a step, ``F(q1, v1, w1, L1, s0, p) = 0``. Backwards the sums sb of all later influences of s1 are
influences of the motion first, ``qb += N_q^T sb`` and so on, and become, behind the solution z and
mu of a step, those of s0: ``N_s^T sb - F_s^T (z, mu)``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.constraints.elements.states import StateStep
from flexfem.gradients.equations.step_tangent import BlockVectors
from flexfem.gradients.equations.values import Equations
from flexfem.simulation.motion.stepping import Simulation
from flexfem.system.mechanics import END_POINT, Mechanics
from flexfem.system.system import Shifts

__all__ = ["Memories", "Memory", "StepEnd"]


@dataclass(frozen=True)
class StepEnd:
    """The end of a step, at whose trial state the system is, with its equations linearised.

    Or a state whose accelerations are computed again, with the factors of its equations there.

    Attributes:
        number: of the step.
        shifts: factors of the scheme.
        states: step of the states of force elements.
        mechanics: its equations.
        imposed: these equations with other outputs of controllers, by their numbers, over the whole
            step; None where outputs act at its end alone.
    """

    number: int
    shifts: Shifts
    states: StateStep
    mechanics: Mechanics = END_POINT
    imposed: Callable[[Mapping[int, FloatArray]], Equations] | None = None


class Memory:
    """Numbers that are carried; all methods are collective, and do nothing unless told otherwise.

    Attributes:
        owned: (n,) numbers that count on this rank; others are those of another rank.
        measured: names of columns of the motion that they follow.
    """

    measured: Sequence[str] = ()
    owned: BoolArray = np.zeros(0, dtype=np.bool_)

    def start(self, simulation: Simulation) -> FloatArray:
        """Numbers (n,) at the accepted state of a simulation of the model, or one like it."""
        return np.zeros(0)

    def take(self, end: StepEnd) -> None:
        """Linearise at the end of a step."""

    def equations(self, change: FloatArray) -> Equations | None:
        """Changes of the equations at the end of a step by those of the numbers before it (n,)."""
        return None

    def ahead(self, change: FloatArray, moves: Sequence[BlockVectors]) -> FloatArray:
        """Changes (n,) at the end of a step.

        Args:
            change: (n,) before the step.
            moves: changes of positions and of rates at its end, as local twists; see
                ``gradients.equations.step_tangent``.
        """
        return change

    def arrive(self, step: int, change: FloatArray, measured: FloatArray) -> FloatArray:
        """Changes (n,) after a step, at whose accepted state the system is.

        Args:
            step: its number.
            change: (n,) at the end of the step.
            measured: changes of the measured columns.
        """
        return change

    def weights(self, step: int, sums: FloatArray) -> FloatArray:
        """Derivatives by the measured columns after a step, the same on all ranks.

        Args:
            step: its number.
            sums: (n,) of influences of the numbers after it.
        """
        return np.zeros(0)

    def gather(self, sums: FloatArray) -> Sequence[BlockVectors] | None:
        """Derivatives by positions and by rates at the end of a step; see :meth:`ahead`."""
        return None

    def back(self, sums: FloatArray, z: BlockVectors, mu: FloatArray) -> FloatArray:
        """Sums (n,) of influences of the numbers before a step.

        Args:
            sums: (n,) those of the numbers after it.
            z: factors of the equations of the blocks.
            mu: (r,) those of the rows.
        """
        return sums

    def recall(self, simulation: Simulation, step: int) -> None:
        """Give a simulation of another model the numbers of the motion before a step."""

    def moved(self, simulation: Simulation, end: StepEnd, change: FloatArray) -> FloatArray:
        """Numbers (n,) of another model after a step of the motion.

        Args:
            simulation: with the numbers of the motion before the step, and its motion at the end.
            end: of the step.
            change: of its measured columns from those of the motion, on the first rank.
        """
        return np.zeros(0)


class Memories(Memory):
    """Several of them, one after the other.

    Attributes:
        parts: they.
    """

    def __init__(self, parts: Sequence[Memory]) -> None:
        """Join them."""
        self.parts = list(parts)
        self.owned = np.concatenate([Memory.owned, *(part.owned for part in self.parts)])
        self._ends = np.cumsum([len(part.owned) for part in self.parts])

    def _split(self, numbers: FloatArray) -> list[tuple[Memory, FloatArray]]:
        """Each memory with its part of the numbers."""
        return list(zip(self.parts, np.split(numbers, self._ends)[:-1], strict=True))

    def start(self, simulation: Simulation) -> FloatArray:
        """See :class:`Memory`."""
        return _joined([part.start(simulation) for part in self.parts])

    def take(self, end: StepEnd) -> None:
        """See :class:`Memory`."""
        for part in self.parts:
            part.take(end)

    def equations(self, change: FloatArray) -> Equations | None:
        """See :class:`Memory`."""
        total: Equations | None = None
        for part, own in self._split(change):
            found = part.equations(own)
            if total is None or found is None:
                total = total or found
            else:
                blocks = [a + b for a, b in zip(total[0], found[0], strict=True)]
                total = blocks, total[1] + found[1]
        return total

    def ahead(self, change: FloatArray, moves: Sequence[BlockVectors]) -> FloatArray:
        """See :class:`Memory`."""
        return _joined([part.ahead(own, moves) for part, own in self._split(change)])

    def arrive(self, step: int, change: FloatArray, measured: FloatArray) -> FloatArray:
        """See :class:`Memory`."""
        return _joined([part.arrive(step, own, measured) for part, own in self._split(change)])

    def weights(self, step: int, sums: FloatArray) -> FloatArray:
        """See :class:`Memory`."""
        return _joined([part.weights(step, own) for part, own in self._split(sums)])

    def gather(self, sums: FloatArray) -> Sequence[BlockVectors] | None:
        """See :class:`Memory`."""
        total: list[BlockVectors] | None = None
        for part, own in self._split(sums):
            found = part.gather(own)
            if found is not None and total is not None:
                total = [
                    [a + b for a, b in zip(first, second, strict=True)]
                    for first, second in zip(total, found, strict=True)
                ]
            elif found is not None:
                total = list(found)
        return total

    def back(self, sums: FloatArray, z: BlockVectors, mu: FloatArray) -> FloatArray:
        """See :class:`Memory`."""
        return _joined([part.back(own, z, mu) for part, own in self._split(sums)])

    def recall(self, simulation: Simulation, step: int) -> None:
        """See :class:`Memory`."""
        for part in self.parts:
            part.recall(simulation, step)

    def moved(self, simulation: Simulation, end: StepEnd, change: FloatArray) -> FloatArray:
        """See :class:`Memory`."""
        return _joined([part.moved(simulation, end, change) for part in self.parts])


def _joined(parts: Sequence[FloatArray]) -> FloatArray:
    return np.concatenate([np.zeros(0), *parts])
