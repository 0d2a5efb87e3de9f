# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modified Newton policies: when bodies are refactorised, and steps refined."""

from collections.abc import Callable
from math import inf

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.state import State
from flexfem.core.status import Status
from flexfem.solvers.frozen.refine import Refined
from flexfem.solvers.frozen.solver import FrozenSolver
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.solvers.newton.iteration import (
    Equations,
    NewtonOptions,
    iterate,
)
from flexfem.solvers.newton.policy import UpdatedPolicy
from flexfem.system.mechanics import END_POINT, Mechanics, SolveAgain
from flexfem.system.system import PartStrains, Shifts, System

__all__ = ["AutoPolicy", "FrozenPolicy"]

#: Contraction above which ``auto`` renews the factors, unless the step solved the exact linearised
#: equations: Newton's method itself is then slow, e.g. when contacts open and close. To renew the
#: factors of some bodies only is cheaper and pays at less.
_SLOW = 0.5
#: Contraction above which steps are refined by the action of the exact tangent: ``frozen`` needs
#: about as many iterations as a fresh matrix, ``auto`` takes the cheaper plain steps while they
#: converge.
_REFINE_FROZEN, _REFINE_AUTO = 0.005, 0.1
#: Relative defect of the frozen operator below which refinement ends, as a part of the former.
_RELAX = 0.2
#: Contraction up to which the multipliers' system is kept within a step, and, for refined steps,
#: their size up to which it is kept, m or rad, or their motion alone, whatever the forces are.
_WELL, _NEAR, _STILL = 0.02, 0.01, 1e-4
#: Error of the kept matrices of bodies in contact, relative to the step, above which they are
#: renewed before the next step, if all corrections of so many steps had it: refinement needs more
#: sweeps than that is worth. Stresses of impacts come and go within a step.
_STALE, _OLD = 0.1, 2
#: Number of tolerances below which the second step is no measure of the contraction: rotations of
#: stiff directions are of second order in the first step, and vanish in the third.
_CLOSE = 100.0


class _Attempt:
    """Iterations of one step: the request of the next one to the solver, and its results.

    Attributes:
        refine: True to correct steps by the exact tangent's action.
        defect: relative error of the frozen operator in the last refined step.
        stale: least of that of the kept matrices alone, beside contacts.
    """

    def __init__(
        self, frozen: FrozenSolver, slow: float | None, limit: float, tolerance: float,
        refine: bool, defect: float,
    ) -> None:  # fmt: skip
        """Store the contractions that renew factors (``slow``) and refine steps (``limit``).

        Iterations stop at ``tolerance``; ``refine`` and ``defect`` are those of the last step.
        """
        self._frozen, self._slow, self._limit, self._tolerance = frozen, slow, limit, tolerance
        self.refine, self.defect, self.stale = refine, defect, inf
        self._keep_interface, self._renewed = False, 0.0
        self._touched = self._cut = False
        self._coarse = True  # no correction has been below the tolerance
        frozen.begin_step()
        self._refined: Refined | None = None

    def step(self, shifts: Shifts, strains: PartStrains) -> tuple[bool, FloatArray]:
        """See ``LinearStep``."""
        frozen = self._frozen
        success, change, self._refined = frozen.step(
            shifts, strains, keep_interface=self._keep_interface,
            refine=self.refine and not self._cut, contraction=frozen.secants.contraction,
        )  # fmt: skip
        if self._refined is not None:
            self.stale = min(self.stale, self._refined.stale)
        if success and frozen.sprung and not self._cut and frozen.system.repels:
            change = -frozen.secants.improve(-change)
        return success, change

    def observe(
        self, iteration: int, size: float, motion: float, contraction: float, part: float,
        strains: PartStrains,
    ) -> None:  # fmt: skip
        """See ``Observer``; the decision is the same on all ranks.

        After a correction that contacts have cut short, the next one is not refined: it is far from
        the solution, and may be cut again.

        While contacts are closed in a step, contraction is no measure of the factors: they open and
        close. Steps are refined first, and factors renewed only where that is not accurate while
        the iteration converges.

        The error of kept factors of the multipliers' system after a step is of second order in its
        motion (m, rad), however large the multipliers' step is, and is corrected by refinement.
        """
        frozen, tolerance = self._frozen, self._tolerance
        self._cut = part < 1.0
        if self._cut:
            frozen.secants.forget()
        self._touched = self._touched or frozen.sprung
        if self._refined is not None and (size > tolerance or self._coarse):
            # that of corrections which contacts ask for below the tolerance is one of rounding
            self.defect, self._coarse = self._refined.defect, size > tolerance
        if self.refine:
            near = size <= _NEAR or motion <= _STILL
        else:
            near = contraction < _WELL and motion**2 <= tolerance
        self._keep_interface = frozen.keepable and near
        if iteration < 2 or (iteration == 2 and size <= _CLOSE * tolerance):
            return
        if contraction > self._limit:
            self.refine = True
        exact = self._refined is not None and self._refined.exact
        if self._slow is None or exact or self._renewed >= 1.0 or size <= tolerance:
            return
        if frozen.exact:
            return  # rigid bodies alone have no factors
        if self._touched and (self._refined is None or contraction >= 1.0):
            return  # factors of a state far from the solution are worse than old ones
        worst = frozen.worst(self._refined)
        if contraction > self._slow * worst.share:
            self._renewed += worst.share
            frozen.renew(worst, strains)


class FrozenPolicy:
    """Policy that keeps factors for each step size; a fresh matrix is the fallback."""

    #: contraction at which the factors are refreshed within a step
    slow: float | None = None
    #: contraction above which steps are refined
    limit = _REFINE_FROZEN

    def __init__(
        self, system: System, options: NewtonOptions, tangent: TangentSolver,
        mechanics: Mechanics = END_POINT,
    ) -> None:  # fmt: skip
        """Set up the frozen solver (collective)."""
        self._system, self._options = system, options
        self._mechanics = mechanics
        self._fallback = UpdatedPolicy(system, options, tangent, mechanics)
        self._frozen = FrozenSolver(system, mechanics)
        self._again: SolveAgain = self._frozen.again
        # initial values of the next step
        self._refine, self._defect, self._stale, self._failed = False, 0.0, 0, False

    @property
    def tolerance(self) -> float:
        """See :class:`Policy`."""
        return self._options.tolerance

    @property
    def frozen(self) -> FrozenSolver:
        """Solver with the kept factors."""
        return self._frozen

    def solve(
        self, shifts: Shifts, restart: Callable[[], None], equations: Equations | None = None
    ) -> Status:
        """See :class:`Policy`."""
        frozen, equations = self._frozen, equations or self._mechanics
        self._again = frozen.again
        if frozen.shifts is not shifts and frozen.shifts != shifts:
            frozen.use(shifts, self._system.accepted_strains())
        elif self._failed and self.slow is not None and not self._system.timed:
            # a restarted run computes them again, with initial strains of its own time
            frozen.factor(shifts, self._system.accepted_strains())
            self._refine = False  # plain steps may do again
        elif self._stale >= _OLD and self.slow is not None and not self._system.timed:
            frozen.factor(shifts, self._system.accepted_strains())
            self._stale = 0
        self._failed = False
        attempt = _Attempt(
            frozen, self.slow, self.limit, self._options.tolerance, self._refine, self._defect
        )
        status = iterate(
            self._system, shifts, attempt.step, self._options, attempt.observe, equations,
            frozen.again,
        )  # fmt: skip
        self._refine, self._defect = attempt.refine, attempt.defect
        self._stale = self._stale + 1 if _STALE < attempt.stale < inf else 0
        if status is Status.OK:
            self._refine = self._refine and self._defect > _RELAX * self.limit
            return status
        system = self._system
        if frozen.rubbing or (frozen.sprung and system.repels and not system.thin):
            return status  # not for want of factors: smaller steps are the remedy
        system.counters.fallbacks += 1
        self._failed = True  # its factors would fail in the next step, too
        restart()
        self._again = self._fallback.again
        return self._fallback.solve(shifts, restart, equations)

    def again(self, values: FloatArray) -> tuple[bool, FloatArray]:
        """See :class:`Policy`."""
        return self._again(values)

    def state(self) -> State:
        """See :class:`Policy`."""
        own = {
            "refine": np.array([float(self._refine), self._defect]),
            "failed": np.array([float(self._failed)]),
            "stale": np.array([float(self._stale)]),
        }
        return self._frozen.state() | State(own, optional=frozenset(own))

    def restore(self, state: State) -> None:
        """See :class:`Policy`."""
        self._frozen.restore(state)
        if "refine" in state.values:
            self._refine, self._defect = (
                bool(state.values["refine"][0]),
                float(state.values["refine"][1]),
            )
        if "failed" in state.values:
            self._failed = bool(state.values["failed"][0])
        if "stale" in state.values:
            self._stale = int(state.values["stale"][0])


class AutoPolicy(FrozenPolicy):
    """Policy that keeps factors, and renews them after slow contraction or a failed step."""

    slow = _SLOW
    limit = _REFINE_AUTO
