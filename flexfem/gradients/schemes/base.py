# SPDX-License-Identifier: LGPL-3.0-or-later
"""A step of a time integrator, linearised: influences go back over it, and changes ahead.

The adjoint and the tangent of a motion know of its integrator by these alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

from mpi4py import MPI

from flexfem._types import FloatArray
from flexfem.core.state import State
from flexfem.gradients.equations.carried import Carried
from flexfem.gradients.equations.linearized import Derivatives, LinearizedStep
from flexfem.gradients.equations.node_maps import StepMaps
from flexfem.gradients.equations.step_tangent import BlockVectors
from flexfem.gradients.equations.values import Equations, SystemEquations
from flexfem.gradients.memory.base import Memories, StepEnd
from flexfem.gradients.renewals.grid import Grid
from flexfem.simulation.motion.stepping import Simulation
from flexfem.system.mechanics import Mechanics
from flexfem.system.system import Shifts, System

__all__ = ["SIZE", "Ahead", "Recursion", "SizeChange", "States", "Steps", "StoppedError", "Stored"]

#: Relative difference of sizes of steps.
SIZE = 1e-3


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

    def factors(self, solution: FloatArray) -> list[Equations]:
        """Factors of the equations in a result of :meth:`back`.

        Those at the trial state are first, and those at :meth:`neighbours` follow.
        """
        return [self.linear.parts(solution)]

    def neighbours(self) -> Iterator[SystemEquations]:
        """Go to states beside the trial state at which there are equations, too, and return to it.

        Each is collective, and yields its equations. There are none by default.
        """
        return iter(())

    def ahead(
        self, carried: Sequence[Carried], changes: Equations,
        size: tuple[SizeChange, float] | None, beside: Sequence[Equations] = (),
    ) -> Ahead:  # fmt: skip
        """Go over the step (collective).

        Args:
            carried: changes of the state before it.
            changes: of the equations at a fixed state.
            size: what its size changes, and its change, s; None if that counts as given.
            beside: changes of those at :meth:`neighbours`.
        """
        ...


class StoppedError(RuntimeError):
    """The motion could not be computed to its end."""


class Stored(Protocol):
    """What is stored of every state of a motion."""

    @property
    def comm(self) -> MPI.Intracomm:
        """Communicator."""
        ...

    def state(self) -> State:
        """The accepted state, without copies."""
        ...

    def restore(self, state: State) -> None:
        """Return to a result of :meth:`state` (collective)."""


class States(Protocol):
    """A motion with its states.

    Attributes:
        simulation, system: at one of the states.
        grid: of all steps.
        memories: what is carried beside the nodes.
        times: of the states, s.
        known: state of the controllers after each of them.
    """

    simulation: Simulation
    system: System
    grid: Grid
    memories: Memories
    times: FloatArray
    known: list[dict[str, FloatArray]]

    def state(self, step: int) -> State:
        """The accepted state after a step."""
        ...

    def lacking(self, step: int) -> float:
        """Size of the step before one, s, that has left a part of damping to it; else 0."""
        ...

    def frames(self, step: int, block: str) -> FloatArray:
        """Frames (n, 12) of a block there."""
        ...


class Steps(Protocol):
    """Steps of a motion as its integrator takes them.

    Attributes:
        stored: what is stored of states.
        from_start: True if forces depend on the start of a step.
        matrices: of the linearised equations that are compared with differences.
    """

    matrices: ClassVar[Sequence[int]]

    @property
    def stored(self) -> Stored:
        """See the class."""
        ...

    @property
    def from_start(self) -> bool:
        """See the class."""
        ...

    def begin(self, simulation: Simulation) -> None:
        """Begin the first step of a model at its start (collective)."""

    def shifts(self, step: int) -> Shifts:
        """Factors of the equations of a step."""
        ...

    def mechanics(self, step: int) -> Mechanics:
        """Equations of a step of the motion."""
        ...

    def end(self, step: int) -> StepEnd:
        """The end of a step, for memories."""
        ...

    def size_change(self, over: Recursion) -> SizeChange:
        """What the size of a step changes, at whose end it is linearised (collective).

        Its end stays.
        """
        ...

    def at_time(self, step: int, later: float) -> Equations:
        """Equations of a step by ``later``, s, than it was, of the same size (collective)."""
        ...

    def recall(self, step: int) -> None:
        """Tell the integrator what the step before one, to be taken again, has left to it."""

    def recover(self, step: int) -> None:
        """Go from the accepted state before a step to the trial state at its end (collective)."""

    def beside(self, simulation: Simulation, step: int) -> Mechanics:
        """Bring another model to the same trial state; its equations there (collective).

        Its blocks are at the motion's accepted state before the step, and the motion is at the
        trial state.
        """
        ...

    def tangent(self) -> Derivatives:
        """Derivatives of the equations of a step (collective)."""
        ...

    def over(self, step: int, linear: LinearizedStep) -> Recursion:
        """A step, at whose trial state the system is."""
        ...

    def product(
        self, step: int, linear: LinearizedStep, matrix: int, direction: BlockVectors
    ) -> Equations:
        """Product of one of the matrices, which have been taken, with local twists (collective)."""
        ...

    def move(self, step: int, matrix: int, direction: BlockVectors) -> None:
        """Move the trial state as this matrix says, by local twists (collective)."""
