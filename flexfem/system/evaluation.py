# SPDX-License-Identifier: LGPL-3.0-or-later
"""Equilibrium at the end of a step as sequences of compiled loops."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from flexfem._types import FloatArray
from flexfem.constraints.batch import Constraints
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.nodes.frame_kernels import accept, correct
from flexfem.core.nodes.prediction import Misses
from flexfem.kernels.compiled import kernel
from flexfem.kernels.sequence import (
    Call,
    Number,
    Step,
    in_one_array,
    largest_entry,
    sequence,
)

__all__ = ["Evaluation", "largest_misses"]


class Evaluation:
    """Residuals of all blocks, with the forces of all rows, by the present stresses.

    Attributes:
        gravity: array of the system that the sequences read.
        before, after: sequences of what comes before the rows, and after them.
        whole: all of it.
    """

    def __init__(
        self, blocks: Sequence[FrameBlock], rows: Constraints, gravity: FloatArray, scale: Number,
        before: Sequence[Step], after: Sequence[Step],
    ) -> None:  # fmt: skip
        """Write down the calls of all loops.

        Args:
            blocks: all blocks.
            rows: all rows.
            gravity: see the attribute.
            scale: factor of the residuals.
            before: residuals of blocks, and the exchange of interface nodes.
            after: forces of the rows.
        """
        self.gravity, self._rows, self._scale, self._blocks = gravity, rows, scale, blocks
        self.before, self.after = sequence(before), sequence(after)
        self.whole: Callable[[], None] = sequence([*before, *rows.steps, *after, *rows.checks])
        spread = [block.spread_step for block in blocks if block.has_ghosts]
        moves = [Call(correct, block.nodes.memory, -1.0) for block in blocks]
        self._largest = Call(largest_entry, in_one_array(moves))
        self._move = sequence([*spread, *moves, self._largest])
        self._h, self._law, misses = Number(0.0), np.zeros(3), np.zeros((len(blocks), 3))
        ends = [
            Call(accept, block.nodes.memory, self._law, self._h, block.owned) for block in blocks
        ]
        for end, own in zip(ends, misses, strict=True):
            end.write_to(own)
        self._misses = Call(largest_misses, misses)
        self._accept = sequence([*ends, self._misses])

    def use(self, scale: float, dynamics: FloatArray) -> None:
        """Use the factors of a scheme from now on, see ``Shifts``."""
        self._scale.set(scale)
        self._rows.use(dynamics)

    def move(self) -> float:
        """Subtract the blocks' steps; largest entry on this rank (collective)."""
        self._move()
        return float(self._largest.result[0])

    def accept(self, law: FloatArray, h: float) -> Misses:
        """Accept the trial state of all blocks, see ``core.nodes.frame_kernels.accept``.

        Returns:
            Largest errors of the predictions on this rank.
        """
        for block in self._blocks:
            block.settle()
        self._law[:] = law
        self._h.set(h)
        self._accept()
        misses: Misses = tuple(self._misses.result.tolist())
        return misses


@kernel
def largest_misses(misses: FloatArray) -> Misses:
    """Largest ones of the blocks (n, 3), which are not negative."""
    rest, plain, curved = 0.0, 0.0, 0.0
    for own in misses:
        rest, plain, curved = max(rest, own[0]), max(plain, own[1]), max(curved, own[2])
    return rest, plain, curved
