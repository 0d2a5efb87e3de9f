# SPDX-License-Identifier: LGPL-3.0-or-later
"""The frozen solver of a rank as sequences of compiled loops, between messages to other ranks.

They do what ``FrozenSolver.prepare`` and its solve do, by the same loops in the same order. There
are none where a rank's own rows of the multipliers' system are not a narrow band: its factorisation
takes longer than the calls then. So other ranks may have none; the messages are the same.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from flexfem._types import FloatArray
from flexfem.kernels.sequence import (
    Call,
    Number,
    Step,
    all_true,
    copy,
    in_one_array,
    sequence,
)
from flexfem.solvers.frozen.bodies import FlexibleBodies, RigidBodies
from flexfem.solvers.frozen.interface import MultiplierSystem
from flexfem.system.system import Shifts, System

__all__ = ["FrozenSequences"]


class FrozenSequences:
    """Sequences for the factors in use.

    Attributes:
        correction: (r,) of the multipliers by the last solve.
    """

    def __init__(
        self, system: System, multipliers: MultiplierSystem,
        rigid: Sequence[RigidBodies], flexible: Sequence[FlexibleBodies],
    ) -> None:  # fmt: skip
        """Write down the calls of all loops; the multipliers' system has been factorised once."""
        self._system, self._multipliers = system, multipliers
        self._rates, self._scale = np.zeros(3), Number(1.0)
        self._shifts: Shifts | None = None  # those written there
        self._values = np.zeros(system.constraints.size)
        self._rigid, self._flexible = rigid, flexible
        self.correction = multipliers.correction
        inversions = [one.inversion(self._rates, self._scale) for one in rigid]
        factorisation, tests = multipliers.factorisation()
        tests += [calls[1] for calls in inversions]
        self._regular = Call(all_true, in_one_array(tests))
        inverting = [call for calls in inversions for call in calls]
        self._factors: list[Step] = [*inverting, *factorisation, self._regular]
        solution = self._solve(system.constraints.values, beyond=False, anew=True)
        self._prepare_and_solve = sequence([*self._factors, *solution])

    @classmethod
    def of(
        cls, system: System, multipliers: MultiplierSystem,
        rigid: Sequence[RigidBodies], flexible: Sequence[FlexibleBodies],
    ) -> FrozenSequences | None:  # fmt: skip
        """Make them, None where there are none."""
        if not (multipliers.banded and all(one.plain for one in rigid)):
            return None
        return cls(system, multipliers, rigid, flexible)

    def prepare(self, shifts: Shifts) -> bool:
        """See ``FrozenSolver.prepare`` (collective)."""
        self._use(shifts)
        self._prepare()
        return self._multipliers.factor_shared(bool(self._regular.result[0]))

    def prepare_and_solve(self, shifts: Shifts) -> FloatArray | None:
        """What both do for the rows' values; None if the system is singular (collective)."""
        self._use(shifts)
        self._prepare_and_solve()
        return self.correction if self._regular.result[0] else None

    def _use(self, shifts: Shifts) -> None:
        if shifts is not self._shifts:
            self._shifts = shifts
            self._rates[:] = shifts.array
            self._scale.set(shifts.scale)

    def solve(self, values: FloatArray, *, beyond: bool) -> FloatArray:
        """See ``FrozenSolver._solve`` (collective)."""
        if values is self._system.constraints.values and not beyond:
            self._at_rows()
            return self.correction
        self._values[:] = values
        (self._beyond if beyond else self._again)()
        return self.correction

    @cached_property
    def _prepare(self) -> Callable[[], None]:
        return sequence(self._factors)

    @cached_property
    def _at_rows(self) -> Callable[[], None]:
        return sequence(self._solve(self._system.constraints.values, beyond=False))

    @cached_property
    def _again(self) -> Callable[[], None]:
        return sequence(self._solve(self._values, beyond=False))

    @cached_property
    def _beyond(self) -> Callable[[], None]:
        return sequence(self._solve(self._values, beyond=True))

    def _solve(self, values: FloatArray, *, beyond: bool, anew: bool = False) -> list[Step]:
        """Steps of a solve with the given values of rows, with new factors of shared ones."""
        steps: list[Step] = []
        bodies: list[RigidBodies | FlexibleBodies] = [*self._rigid, *self._flexible]
        for one in bodies:
            steps.append(Call(copy, one.group.part.block.residual, one.group.own.right))
        regular = self._regular.result if anew else None
        steps += self._multipliers.solution(values, bodies, beyond=beyond, regular=regular)
        rows = self._system.constraints
        for one in bodies:
            own, nodes = one.group.own, one.group.part.interface_nodes
            steps.append(rows.forces_call(self.correction, nodes, own.right))
        for flexible in self._flexible:
            steps += flexible.solution()
        for rigid in self._rigid:
            steps += rigid.solution()
        return steps
