# SPDX-License-Identifier: LGPL-3.0-or-later
"""Internal variables of elements, such as those of viscoelastic and plastic solids."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.state import State
from flexfem.gradients.equations.step_tangent import BlockVectors, collected, put_steps
from flexfem.gradients.equations.values import Equations
from flexfem.gradients.memory.base import Memory, StepEnd
from flexfem.layout.elements import HistoryDerivatives, HistoryElements
from flexfem.simulation.motion.stepping import Simulation
from flexfem.system.system import System

__all__ = ["HistoryMemory"]


@dataclass(frozen=True)
class _Part:
    """A part with internal variables.

    Attributes:
        number: of the part.
        derivatives: of its elements.
        numbers: place of its variables.
    """

    number: int
    derivatives: HistoryDerivatives
    numbers: slice


class HistoryMemory(Memory):
    """Internal variables of all cells of a rank."""

    def __init__(self, system: System, state: Callable[[int], State]) -> None:
        """Find them (collective).

        Args:
            system: of the motion.
            state: the accepted state after a step.
        """
        self._system, self._state = system, state
        self._parts, end, self._scale = list[_Part](), 0, 0.0
        for k, part in enumerate(system.parts):
            if isinstance(part.elements, HistoryElements) and part.elements.remembering:
                derivatives, start = part.elements.history_derivatives(), end
                assert derivatives is not None  # others are refused
                end += len(_variables(part.elements))
                self._parts.append(_Part(k, derivatives, slice(start, end)))
        self.owned = np.full(end, True)

    def start(self, simulation: Simulation) -> FloatArray:
        """See :class:`Memory`."""
        found = [np.zeros(0)]
        for elements in self._elements(simulation):
            found.append(_variables(elements))
        return np.concatenate(found)

    def take(self, end: StepEnd) -> None:
        """See :class:`Memory`."""
        self._scale = end.shifts.scale

    def equations(self, change: FloatArray) -> Equations:
        """See :class:`Memory`."""
        system = self._system
        self._clear()
        for one in self._parts:
            block = system.parts[one.number].block
            one.derivatives.add_forces(block, change[one.numbers], self._scale)
        return self._collected(), np.zeros(system.constraints.size)

    def ahead(self, change: FloatArray, moves: Sequence[BlockVectors]) -> FloatArray:
        """See :class:`Memory`."""
        put_steps(self._system, moves[0])
        found = np.zeros_like(change)
        for one in self._parts:
            block = self._system.parts[one.number].block
            found[one.numbers] = one.derivatives.ahead(block, change[one.numbers])
        return found

    def gather(self, sums: FloatArray) -> Sequence[BlockVectors]:
        """See :class:`Memory`."""
        self._clear()
        for one in self._parts:
            one.derivatives.add_ends(self._system.parts[one.number].block, sums[one.numbers])
        found = self._collected()
        return found, [np.zeros_like(own) for own in found]

    def back(self, sums: FloatArray, z: BlockVectors, mu: FloatArray) -> FloatArray:
        """See :class:`Memory`."""
        put_steps(self._system, z)
        found = np.zeros_like(sums)
        for one in self._parts:
            block = self._system.parts[one.number].block
            found[one.numbers] = one.derivatives.before(sums[one.numbers])
            found[one.numbers] -= self._scale * one.derivatives.powers(block)
        return found

    def recall(self, simulation: Simulation, step: int) -> None:
        """See :class:`Memory`."""
        state = self._state(step - 1)
        simulation.system.set_time(float(state.values["time"][0]))
        for elements in self._elements(simulation):
            elements.restore_history({name: state.rows[name]["z"] for name in elements.history()})

    def moved(self, simulation: Simulation, end: StepEnd, change: FloatArray) -> FloatArray:
        """See :class:`Memory`."""
        found = [np.zeros(0)]
        for elements in self._elements(simulation):
            derivatives = elements.history_derivatives()
            assert derivatives is not None
            found.append(derivatives.ended())
        return np.concatenate(found)

    def _elements(self, simulation: Simulation) -> list[HistoryElements]:
        """Elements with internal variables of a simulation."""
        every: list[Any] = [simulation.system.parts[one.number].elements for one in self._parts]
        return [own for own in every if isinstance(own, HistoryElements)]

    def _clear(self) -> None:
        for part in self._system.parts:
            part.block.residual[:] = 0.0

    def _collected(self) -> BlockVectors:
        """Residuals of the blocks with those of ghosts (collective)."""
        for part in self._system.parts:
            part.block.add_ghosts()
        return collected(self._system)


def _variables(elements: HistoryElements) -> FloatArray:
    """Accepted internal variables (n,)."""
    values = [own.ravel() for _, own in elements.history().values()]
    return np.concatenate([np.zeros(0), *values])
