# SPDX-License-Identifier: LGPL-3.0-or-later
"""When the iteration matrix is assembled and factorised.

``updated`` takes a fresh matrix in every iteration, ``material`` the same without geometric
stiffness. ``frozen`` keeps the factors of the bodies for each step size. ``auto`` does the same,
but refreshes them where the iteration contracts slowly. All fall back to the exact fresh matrix for
a step on which they fail; what then fails is left to the driver, which halves the step.
"""

from collections.abc import Callable
from typing import Protocol

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.core.state import State
from flexfem.core.status import Status
from flexfem.solvers.frozen import FrozenSolver
from flexfem.solvers.newton import Equations, NewtonOptions, PositionLevel, SolveAgain, iterate
from flexfem.solvers.tangent import TangentSolver
from flexfem.system.system import PartStrains, Shifts, System

__all__ = [
    "AutoPolicy",
    "FrozenPolicy",
    "MaterialPolicy",
    "Policy",
    "UpdatedPolicy",
    "create_policy",
]

#: Contraction above which ``auto`` renews the factors, unless the step solved the linearised
#: equations as it was: what contracts slowly then is Newton's method itself, where contacts open
#: and close for example. To renew those of some bodies costs less and pays at less.
_SLOW = 0.5
#: Contraction above which steps are refined by the action of the exact tangent: ``frozen`` keeps
#: close to the iterations of a fresh matrix, ``auto`` takes the cheaper plain steps while they do.
_REFINE_FROZEN, _REFINE_AUTO = 0.005, 0.1
#: What the frozen operator missed, relative to the step, below which refinement is given up again,
#: as a part of the former.
_RELAX = 0.2


_POSITIONS = PositionLevel()


class Policy(Protocol):
    """Solves the equations of one step.

    Attributes:
        tolerance: largest step of an iteration at which it stops, see ``NewtonOptions``.
    """

    @property
    def tolerance(self) -> float:
        """See above."""
        ...

    def solve(
        self, shifts: Shifts, restart: Callable[[], None], equations: Equations = _POSITIONS
    ) -> Status:
        """Iterate from the predicted state; ``restart`` returns to it for a second attempt."""
        ...

    def again(self, values: FloatArray) -> bool:
        """Blocks' steps for their residuals and row values (r,), with the matrix used last."""
        ...

    def state(self) -> State:
        """What it remembers from step to step."""
        ...

    def restore(self, state: State) -> None:
        """Take back what :meth:`state` returned (collective); spoils the system's trial state."""
        ...


class UpdatedPolicy:
    """A fresh matrix and factorisation in every iteration.

    It takes the stresses of the accepted state, continued along the steps: those of the prediction
    and of iterates far from equilibrium have nothing to do with those of the solution.
    """

    def __init__(self, system: System, options: NewtonOptions, tangent: TangentSolver) -> None:
        """Store what is needed."""
        self._system, self._options, self._tangent = system, options, tangent

    @property
    def tolerance(self) -> float:
        """See :class:`Policy`."""
        return self._options.tolerance

    def solve(
        self, shifts: Shifts, restart: Callable[[], None], equations: Equations = _POSITIONS
    ) -> Status:
        """See :class:`Policy`."""
        tangent = self._tangent
        return iterate(
            self._system, shifts, tangent.step, self._options, None, equations, tangent.again,
            thin=False,
        )  # fmt: skip

    def again(self, values: FloatArray) -> bool:
        """See :class:`Policy`."""
        return self._tangent.again(values)

    def state(self) -> State:
        """Nothing is remembered."""
        return State()

    def restore(self, state: State) -> None:
        """Nothing is remembered."""


class MaterialPolicy(UpdatedPolicy):
    """A fresh matrix without geometric stiffness in every iteration, to study what that is for.

    Newton's method converges linearly then; the matrix with it is the fallback.
    """

    def __init__(self, system: System, options: NewtonOptions, tangent: TangentSolver) -> None:
        """Refuse systems whose matrices have no geometric stiffness.

        Raises:
            InputError: there are no beams and no shells.
        """
        super().__init__(system, options, tangent)
        if not any(part.elements is not None and part.elements.stressed for part in system.parts):
            raise InputError(
                "iteration_matrix 'material' leaves out the geometric stiffness of beams and "
                "shells, of which there are none"
            )

    def solve(
        self, shifts: Shifts, restart: Callable[[], None], equations: Equations = _POSITIONS
    ) -> Status:
        """See :class:`Policy`."""
        status = iterate(
            self._system, shifts, self._step, self._options, None, equations, self._tangent.again
        )
        if status is Status.OK:
            return status
        self._system.counters.fallbacks += 1
        restart()
        return super().solve(shifts, restart, equations)

    def _step(self, shifts: Shifts, _: PartStrains) -> tuple[bool, FloatArray]:
        return self._tangent.step(shifts, self._system.unstressed())


class FrozenPolicy:
    """Factors kept for each step size; the fresh matrix is the fallback."""

    #: contraction at which the factors are refreshed within a step
    slow: float | None = None
    #: contraction above which steps are refined
    refine = _REFINE_FROZEN

    def __init__(self, system: System, options: NewtonOptions, tangent: TangentSolver) -> None:
        """Set up the frozen solver (collective)."""
        self._system, self._options = system, options
        self._fallback = UpdatedPolicy(system, options, tangent)
        self._frozen = FrozenSolver(system)
        self._again: SolveAgain = self._frozen.again

    @property
    def tolerance(self) -> float:
        """See :class:`Policy`."""
        return self._options.tolerance

    def solve(
        self, shifts: Shifts, restart: Callable[[], None], equations: Equations = _POSITIONS
    ) -> Status:
        """See :class:`Policy`."""
        frozen = self._frozen
        self._again = frozen.again
        if frozen.shifts != shifts:
            frozen.use(shifts, self._system.accepted_strains())
        frozen.keep_interface = False
        renewed = 0.0

        def observe(iteration: int, size: float, contraction: float, strains: PartStrains) -> None:
            nonlocal renewed
            tolerance = self._options.tolerance
            frozen.observe(size, contraction, tolerance)
            if iteration < 2:
                return
            if contraction > self.refine:
                frozen.refine = True
            if self.slow is None or frozen.exact or renewed >= 1.0 or size <= tolerance:
                return
            worst = frozen.worst()
            if contraction > self.slow * worst.share:
                renewed += worst.share
                frozen.renew(worst, strains)

        status = iterate(
            self._system, shifts, frozen.step, self._options, observe, equations, frozen.again
        )
        if status is Status.OK:
            frozen.refine = frozen.refine and frozen.defect > _RELAX * self.refine
            return status
        self._system.counters.fallbacks += 1
        restart()
        self._again = self._fallback.again
        return self._fallback.solve(shifts, restart, equations)

    def again(self, values: FloatArray) -> bool:
        """See :class:`Policy`."""
        return self._again(values)

    def state(self) -> State:
        """See :class:`Policy`."""
        return self._frozen.state()

    def restore(self, state: State) -> None:
        """See :class:`Policy`."""
        self._frozen.restore(state)


class AutoPolicy(FrozenPolicy):
    """Frozen factors, refreshed where the iteration contracts slowly."""

    slow = _SLOW
    refine = _REFINE_AUTO


def create_policy(
    name: str, system: System, options: NewtonOptions, tangent: TangentSolver
) -> Policy:
    """Policy of the given name: "updated", "material", "frozen" or "auto"."""
    kinds: dict[str, type[UpdatedPolicy] | type[FrozenPolicy]] = {
        "updated": UpdatedPolicy,
        "material": MaterialPolicy,
        "frozen": FrozenPolicy,
        "auto": AutoPolicy,
    }
    return kinds[name](system, options, tangent)
