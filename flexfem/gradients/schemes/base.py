# SPDX-License-Identifier: LGPL-3.0-or-later
"""A step of a time integrator, linearised: influences go back over it, and changes ahead.

The adjoint and the tangent of a motion know of its integrator by these alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from flexfem._types import FloatArray
from flexfem.gradients.equations.carried import Carried
from flexfem.gradients.equations.linearized import LinearizedStep
from flexfem.gradients.equations.node_maps import StepMaps
from flexfem.gradients.equations.step_tangent import BlockVectors
from flexfem.gradients.equations.values import Equations

__all__ = ["Ahead", "Recursion", "SizeChange"]


@dataclass(frozen=True)
class SizeChange:
    """What the size of a step changes at fixed increments.

    Attributes:
        rates: changes of v, a and w of each block's owned nodes, (3, n, w).
        equations: changes of the equations of blocks and rows.
    """

    rates: list[FloatArray]
    equations: Equations

    def along(self, carried: Sequence[Carried]) -> float:
        """Sums for each block times the changes of rates."""
        return sum(
            float((own.v * rates[0] + own.a * rates[1] + own.w * rates[2]).sum())
            for own, rates in zip(carried, self.rates, strict=True)
        )


@dataclass(frozen=True)
class Ahead:
    """Changes at the end of a step.

    Attributes:
        carried: of the accepted state after it.
        multipliers: (r,) of the rows' scaled forces.
        moves: of positions and of rates at the trial state, as local twists, for memories.
    """

    carried: list[Carried]
    multipliers: FloatArray
    moves: tuple[BlockVectors, BlockVectors]


class Recursion(Protocol):
    """A step, whose equations ``linear`` has at its end.

    Attributes:
        step: its number.
        linear: the linearised equations.
        maps: of the nodes of all blocks.
    """

    step: int
    linear: LinearizedStep
    maps: list[StepMaps]

    def arrive(self, carried: Sequence[Carried], memories: Sequence[BlockVectors] | None) -> None:
        """Turn sums of influences of the accepted state to those of the trial state, in place.

        Args:
            carried: sums of each block.
            memories: what memories take from positions and rates there, see
                ``memory.base.Memory.gather``.
        """

    def back(
        self, carried: Sequence[Carried], rows: FloatArray, guess: FloatArray | None,
        accuracy: float | None,
    ) -> FloatArray:  # fmt: skip
        """Go back over the step, in place (collective).

        Args:
            carried: sums of influences of the trial state, which become those of the state before.
            rows: (r,) influences of multipliers.
            guess: a solution to begin with.
            accuracy: relative one, None for that of all equations.

        Returns:
            The factors of its equations as a vector, see ``LinearizedStep.parts``.
        """
        ...

    def ahead(
        self, carried: Sequence[Carried], changes: Equations,
        size: tuple[SizeChange, float] | None,
    ) -> Ahead:  # fmt: skip
        """Go over the step (collective).

        Args:
            carried: changes of the state before it.
            changes: of the equations at a fixed state.
            size: what its size changes, and its change, s; None if that counts as given.
        """
        ...
