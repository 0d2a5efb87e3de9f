# SPDX-License-Identifier: LGPL-3.0-or-later
"""Full Newton policy: the iteration matrix is assembled and factorised in every iteration."""

from collections.abc import Callable
from typing import Protocol

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.core.state import State
from flexfem.core.status import Status
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.solvers.newton.iteration import Equations, NewtonOptions, iterate
from flexfem.system.mechanics import END_POINT, Mechanics
from flexfem.system.system import PartStrains, Shifts, System

__all__ = ["MaterialPolicy", "Policy", "UpdatedPolicy"]


class Policy(Protocol):
    """Policy of the solution of the equations of one step.

    Attributes:
        tolerance: largest step of an iteration at which it stops, see ``NewtonOptions``.
    """

    @property
    def tolerance(self) -> float:
        """See above."""
        ...

    def solve(
        self, shifts: Shifts, restart: Callable[[], None], equations: Equations | None = None
    ) -> Status:
        """Iterate from the predicted state.

        Args:
            shifts: factors of the scheme.
            restart: function that returns to the predicted state for a second attempt.
            equations: the equations to be solved; None for the mechanics of the policy.
        """
        ...

    def again(self, values: FloatArray) -> tuple[bool, FloatArray]:
        """Solve with the matrix used last, see ``SolveAgain``."""
        ...

    def state(self) -> State:
        """Return the state of the policy from step to step."""
        ...

    def restore(self, state: State) -> None:
        """Restore a result of :meth:`state` (collective); overwrites the system's trial state."""
        ...


class UpdatedPolicy:
    """Policy with a new matrix and factorisation in every iteration.

    It uses the stresses of the accepted state, continued along the steps: those of the prediction
    and of iterates far from equilibrium are unrelated to those of the solution.
    """

    def __init__(
        self, system: System, options: NewtonOptions, tangent: TangentSolver,
        mechanics: Mechanics = END_POINT,
    ) -> None:  # fmt: skip
        """Store the arguments; the iteration matrix is that of ``mechanics``."""
        self._system, self._options, self._tangent = system, options, tangent
        self._mechanics = mechanics

    @property
    def tolerance(self) -> float:
        """See :class:`Policy`."""
        return self._options.tolerance

    def solve(
        self, shifts: Shifts, restart: Callable[[], None], equations: Equations | None = None
    ) -> Status:
        """See :class:`Policy`."""
        return iterate(
            self._system, shifts, self._fresh_step, self._options, None,
            equations or self._mechanics, self._tangent.again, thin=False,
        )  # fmt: skip

    def _fresh_step(self, shifts: Shifts, strains: PartStrains) -> tuple[bool, FloatArray]:
        return self._tangent.step(shifts, strains, self._mechanics)

    def again(self, values: FloatArray) -> tuple[bool, FloatArray]:
        """See :class:`Policy`."""
        return self._tangent.again(values)

    def state(self) -> State:
        """Do nothing: the policy has no state."""
        return State()

    def restore(self, state: State) -> None:
        """Do nothing: the policy has no state."""


class MaterialPolicy(UpdatedPolicy):
    """Policy with a new matrix without geometric stiffness in every iteration, for studies of it.

    Newton's method converges linearly then; the matrix with it is the fallback.
    """

    def __init__(
        self, system: System, options: NewtonOptions, tangent: TangentSolver,
        mechanics: Mechanics = END_POINT,
    ) -> None:  # fmt: skip
        """Refuse systems whose matrices have no geometric stiffness.

        Raises:
            InputError: there are no beams and no shells.
        """
        super().__init__(system, options, tangent, mechanics)
        if not any(part.elements is not None and part.elements.stressed for part in system.parts):
            raise InputError(
                "iteration_matrix 'material' leaves out the geometric stiffness of beams and "
                "shells, but the model has none"
            )

    def solve(
        self, shifts: Shifts, restart: Callable[[], None], equations: Equations | None = None
    ) -> Status:
        """See :class:`Policy`."""
        status = iterate(
            self._system,
            shifts,
            self._unstressed_step,
            self._options,
            None,
            equations or self._mechanics,
            self._tangent.again,
        )
        if status is Status.OK:
            return status
        self._system.counters.fallbacks += 1
        restart()
        return super().solve(shifts, restart, equations)

    def _unstressed_step(self, shifts: Shifts, _: PartStrains) -> tuple[bool, FloatArray]:
        return self._tangent.step(shifts, self._system.unstressed(), self._mechanics)
