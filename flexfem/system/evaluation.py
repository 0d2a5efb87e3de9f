# SPDX-License-Identifier: LGPL-3.0-or-later
"""Equilibrium at the end of a step as sequences of compiled loops."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from flexfem.constraints.rows.kernels import add_forces
from flexfem.kernels.sequence import Call, Number, Step, clear, sequence
from flexfem.layout.elements import SequencedElements

if TYPE_CHECKING:
    from collections.abc import Callable

    from flexfem._types import FloatArray
    from flexfem.core.nodes.frame_block import FrameBlock
    from flexfem.layout.inner_forces import InnerForces
    from flexfem.system.system import BlockPart, Shifts, System

__all__ = ["Evaluation"]


class Evaluation:
    """Residuals of all blocks, with the forces of all rows, by the present stresses.

    They are those of ``BlockPart.add_residual``, ``Interface.update``, ``Constraints.evaluate`` and
    ``System.add_constraint_forces``, by the same loops in the same order.

    Attributes:
        gravity: array of the system that the sequences read.
        whole: all of it; the rest is without the rows, before and after them.
    """

    def __init__(self, system: System) -> None:
        """Write down the calls of all loops."""
        self.gravity, self._rows = system.gravity, system.constraints
        self._scale = Number(1.0)
        before: list[Step] = []
        for part in system.parts:
            before += self._residual(part, system)
        before += system.interface.steps_of_update
        after: list[Step] = [
            Call(
                add_forces, self._rows.own.memory, self._rows.multipliers, part.interface_nodes,
                part.block.residual,
            )
            for part in system.parts
            if len(part.interface_nodes)
        ]  # fmt: skip
        self.before, self.after = sequence(before), sequence(after)
        self.whole: Callable[[], None] = sequence([*before, *self._rows.steps, *after])

    def use(self, shifts: Shifts) -> None:
        """Use the factors of a scheme from now on."""
        self._scale.set(shifts.scale)
        self._rows.use(shifts.dynamics)

    def _residual(self, part: BlockPart, system: System) -> list[Step]:
        """Steps of ``BlockPart.add_residual``."""
        block, scale = part.block, self._scale
        steps: list[Step] = [Call(clear, block.residual)]
        elements = part.elements
        if isinstance(elements, SequencedElements):
            steps += elements.residual_calls(block, system.gravity, scale)
        elif elements is not None:
            steps.append(lambda: elements.add_residual(block, system.gravity, scale.value))
        if elements is not None:
            steps += [partial(self._add, one, block, system.factors) for one in part.line_forces]
            if block.has_ghosts:
                steps.append(block.add_ghosts)
        if len(part.masses.nodes):
            steps.append(part.masses.residual_call(block, system.gravity, scale))
        if len(part.forces.nodes):
            steps.append(part.forces.residual_call(block, system.factors, scale))
        if part.contacts is not None:
            contacts = part.contacts
            steps.append(lambda: contacts.add_residual(scale.value))
        return steps

    def _add(self, forces: InnerForces, block: FrameBlock, factors: FloatArray) -> None:
        """Add forces inside elements."""
        forces.add_residual(block, factors, self._scale.value)
