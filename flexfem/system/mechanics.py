# SPDX-License-Identifier: LGPL-3.0-or-later
"""The equations that a time integrator asks a system for, and their derivatives.

Most schemes state equilibrium at the end of a step: :class:`EndPoint`. A scheme with equations of
its own brings another object with the same methods and puts it into ``System.mechanics``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Protocol

import numpy as np

from flexfem._types import FloatArray

if TYPE_CHECKING:
    from flexfem.elements.request import TangentRequest
    from flexfem.system.system import BlockPart, PartStrains, Shifts, System

__all__ = ["EndPoint", "Mechanics"]


class Mechanics(Protocol):
    """Residuals of blocks and rows at the trial state, and their derivatives along local twists."""

    def evaluate(self, system: System, shifts: Shifts, strains: PartStrains) -> None:
        """Residuals of blocks, without constraint forces, and rows (collective)."""
        ...

    def correct(self, system: System, sign: float) -> float:
        """Apply the blocks' steps; largest entry on this rank (collective)."""
        ...

    def cells(
        self, system: System, part: BlockPart, shifts: Shifts, request: TangentRequest
    ) -> FloatArray:
        """Entries of the matrices of a part's elements and of forces inside them, flat."""
        ...

    def masses(self, system: System, part: BlockPart, shifts: Shifts) -> FloatArray:
        """Matrices (k, 6, 6) of a part's masses."""
        ...

    def forces(self, system: System, part: BlockPart, shifts: Shifts) -> FloatArray:
        """Matrices (k, 6, 6) of a part's forces."""
        ...

    def hessians(self, system: System, factor: FloatArray) -> FloatArray:
        """``sum_rows factor d(force gradient)``, (n_pairs, 12, 12)."""
        ...

    def add_cells(
        self, system: System, part: BlockPart, shifts: Shifts, request: TangentRequest,
        factor: float,
    ) -> None:  # fmt: skip
        """Add ``factor`` times the action of these matrices on a part's steps to its residual."""
        ...

    def origin(self, system: System, part: BlockPart) -> tuple[dict[str, FloatArray], FloatArray]:
        """What a part's matrices are computed from: arrays of its nodes, and numbers.

        The arrays are those that are worked with, the numbers are the same on all ranks.
        """
        ...

    def recall(
        self, system: System, part: BlockPart, nodes: Mapping[str, FloatArray], numbers: FloatArray
    ) -> None:
        """Put a part where :meth:`origin` found it; the accepted state may be lost."""
        ...


class EndPoint:
    """Equilibrium at the end of the step."""

    def evaluate(self, system: System, shifts: Shifts, strains: PartStrains) -> None:
        """See :class:`Mechanics`."""
        for part, own in zip(system.parts, strains, strict=True):
            part.add_residual(system.gravity, system.factors, shifts.scale, own)
        system.interface.update()
        system.constraints.evaluate(shifts.dynamics)

    def correct(self, system: System, sign: float) -> float:
        """See :class:`Mechanics`."""
        sizes = [part.block.correct(sign) for part in system.parts]
        # NumPy's maximum keeps a NaN, Python's may drop it
        return sizes[0] if len(sizes) == 1 else float(np.max(sizes, initial=0.0))

    def cells(
        self, system: System, part: BlockPart, shifts: Shifts, request: TangentRequest
    ) -> FloatArray:
        """See :class:`Mechanics`."""
        assert part.elements is not None
        values = part.elements.values(
            part.block, system.gravity, shifts.array, shifts.scale, request
        )
        if not part.line_forces:
            return values
        block, scale = part.block, shifts.scale * shifts.stiffness
        own = [forces.tangent(block, system.factors, scale) for forces in part.line_forces]
        return np.concatenate([values, *(matrices.ravel() for matrices in own)])

    def masses(self, system: System, part: BlockPart, shifts: Shifts) -> FloatArray:
        """See :class:`Mechanics`."""
        return part.masses.tangent(
            part.block, system.gravity, shifts.array, shifts.scale, shifts.local
        )

    def forces(self, system: System, part: BlockPart, shifts: Shifts) -> FloatArray:
        """See :class:`Mechanics`."""
        scale = shifts.scale * shifts.stiffness
        return part.forces.tangent(part.block, system.factors, scale)

    def hessians(self, system: System, factor: FloatArray) -> FloatArray:
        """See :class:`Mechanics`."""
        return system.constraints.hessians(factor)

    def add_cells(
        self, system: System, part: BlockPart, shifts: Shifts, request: TangentRequest,
        factor: float,
    ) -> None:  # fmt: skip
        """See :class:`Mechanics`."""
        assert part.elements is not None
        scale = factor * shifts.scale
        part.elements.add_action(part.block, system.gravity, shifts.array, scale, request)
        for forces in part.line_forces:
            forces.add_action(part.block, system.factors, scale * shifts.stiffness)

    def origin(self, system: System, part: BlockPart) -> tuple[dict[str, FloatArray], FloatArray]:
        """See :class:`Mechanics`."""
        return part.block.trial(), system.factors

    def recall(
        self, system: System, part: BlockPart, nodes: Mapping[str, FloatArray], numbers: FloatArray
    ) -> None:
        """See :class:`Mechanics`."""
        for name, values in part.block.trial().items():
            values[:] = nodes[name]
        system.factors[:] = numbers
