# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lie-group generalized-alpha method for constrained systems of index 3.

Brüls, Cardona, Arnold, "Lie group generalized-alpha time integration of constrained flexible
multibody systems", Mech. Mach. Theory 48 (2012) 121-137, with the coefficients of Chung and Hulbert
(1993).

Rigid bodies move on SE(3), where the method is of second order in positions, velocities and
multipliers from the first step on. Nodes of beams move on R^3 x SO(3): their translations are
integrated in inertial axes, which keeps the linear momentum of a flexible body, whereas SE(3)
rotates it by the error of the scheme (flying spaghetti, 40 elements, step 5e-3: the ends are off by
0.008 within 15 s instead of 0.028). Equations and Newton steps are in the nodes' own axes in both.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from math import inf
from typing import ClassVar

import numpy as np

from flexfem._types import FloatArray
from flexfem.constraints.elements.states import StateStep, state_step
from flexfem.core.nodes.prediction import Prediction
from flexfem.core.state import State
from flexfem.core.status import Status
from flexfem.integrators.ended_accelerations import count_ended, ended_state, restore_ended
from flexfem.integrators.integrator import Integrator, discard, predictions
from flexfem.integrators.split.step import Split
from flexfem.solvers.newton.iteration import Equations
from flexfem.solvers.newton.policy import Policy
from flexfem.system.mechanics import END_POINT, EndPoint
from flexfem.system.moving_apart import predict_apart
from flexfem.system.system import Shifts, System

__all__ = ["TURN_LIMIT", "GeneralizedAlpha", "StepLaws", "predict_step", "step_laws"]

#: Rotation of a flexible body in a step, over ``1 - rho_inf``, beyond which unresolved axial
#: vibrations grow, see ``GeneralizedAlpha.turn_limit``.
TURN_LIMIT = 0.75
#: Number of step sizes whose coefficients are kept.
_SIZES = 32


@dataclass(frozen=True)
class StepLaws:
    """Coefficients of steps of one size.

    Attributes:
        shifts: factors of the iteration matrix.
        scale: () their ``scale``; NumPy takes an array in half the time of a number.
        predict: (7,) laws, one for each ``Prediction``.
        rates: (2,) derivatives of velocity and acceleration by the increment.
        accept: (3,) law of acceptance, see ``core.nodes.frame_kernels``.
        states: step of the states of force elements.
    """

    shifts: Shifts
    scale: FloatArray
    predict: tuple[FloatArray, FloatArray, FloatArray]
    rates: FloatArray
    accept: FloatArray
    states: StateStep


@dataclass
class GeneralizedAlpha(Integrator):
    """Coefficients of the scheme, and the unilateral forces of the system that it was prepared for.

    Derived classes have the same coefficients: those of steps are results of :func:`step_laws`,
    whose argument is the spectral radius alone.

    Attributes:
        rho_inf: spectral radius at infinite frequency, 0 (annihilates) to 1 (no dissipation).
        split: forces that act by impulses, None without any.
    """

    rho_inf: float = 0.9
    split: Split | None = field(default=None, repr=False, compare=False)

    order: ClassVar[int] = 2

    def __post_init__(self) -> None:
        """Check the spectral radius.

        Raises:
            ValueError: it lies outside [0, 1].
        """
        if not 0.0 <= self.rho_inf <= 1.0:
            raise ValueError(f"GeneralizedAlpha: rho_inf must lie in [0, 1], got {self.rho_inf}")

    @property
    def alpha_m(self) -> float:
        """Weight of the old acceleration-like variable."""
        return (2.0 * self.rho_inf - 1.0) / (self.rho_inf + 1.0)

    @property
    def alpha_f(self) -> float:
        """Weight of the old acceleration."""
        return self.rho_inf / (self.rho_inf + 1.0)

    @property
    def gamma(self) -> float:
        """Newmark's gamma."""
        return 0.5 + self.alpha_f - self.alpha_m

    @property
    def beta(self) -> float:
        """Newmark's beta."""
        return 0.25 * (self.gamma + 0.5) ** 2

    @property
    def weight(self) -> float:
        """Factor of the mean forces of a step in its equations, see ``integrators.split.step``."""
        return _weight(self.rho_inf)

    @property
    def unseen(self) -> float:
        """Share of impulses in the velocities after a step that its equations do not see."""
        return 1.0 - self.gamma / (2.0 * self.beta)

    def prepare(self, system: System) -> None:
        """See :meth:`Integrator.prepare`."""
        self.split = Split.of(system)

    def state(self, system: System) -> State:
        """See :meth:`Integrator.state`."""
        own = ended_state(system)
        return own if self.split is None else own | self.split.state()

    def restore(self, system: System, state: State) -> None:
        """See :meth:`Integrator.restore`."""
        restore_ended(system, state)
        if self.split is not None:
            self.split.restore(state)

    def shifts(self, h: float) -> Shifts:
        """Factors of the iteration matrix at step size ``h`` (s)."""
        return step_laws(self.rho_inf, h).shifts

    @property
    def turn_limit(self) -> float:
        """See :attr:`Integrator.turn_limit`.

        Translations are integrated in inertial axes. If a body is stiff along one axis and soft
        across it, accelerations that alternate along the stiff axis, by ``-rho_inf`` from step to
        step, get components across it as the axes rotate, and velocities across it components along
        it. For radii of 0.9, 0.8, 0.7 and 0.5 they grow from rotations of 0.72, 0.76, 0.80 and 0.90
        times ``1 - rho_inf`` on, with 0.9 and a rotation of 0.12 by 1.062 in every step.
        """
        return TURN_LIMIT * (1.0 - self.rho_inf)

    def _equations(self, h: float, tolerance: float) -> Equations:
        """Return the equations solved at the end of a step of size ``h`` (s), to a tolerance."""
        return self._mechanics

    @property
    def _mechanics(self) -> EndPoint:
        return self.split or END_POINT

    def solve(self, system: System, policy: Policy, h: float) -> Status:
        """See :meth:`Integrator.solve`."""
        laws, start, split = step_laws(self.rho_inf, h), system.time, self.split
        if split is not None and not split.begin(h, self.weight, self.unseen):
            return Status.SINGULAR
        equations = self._equations(h, policy.tolerance)
        system.set_time(start + h)
        status = Status.DIVERGED
        for restart in predictions(system, partial(predict_step, system, laws, split)):
            attempt = partial(policy.solve, laws.shifts, restart, equations)
            if split is None:
                status = attempt()
            else:
                status = split.solve(laws.shifts, attempt, restart, lambda block: block.kick(h))
            if status is Status.OK:
                return status
        discard(system, start)
        return status

    def error(self, system: System, policy: Policy, h: float) -> float:
        """See :meth:`Integrator.error`.

        The acceleration-like variable belongs to the time ``t + (alpha_m - alpha_f) h`` (Arnold,
        Brüls, Cardona 2015), so that the error of a step is ``(1/6 - beta - (alpha_m - alpha_f)/2)
        h^3`` times the rate of the acceleration, estimated as its change over ``h``: the estimate
        of Zienkiewicz and Xie (1991) with the constant of this scheme.

        Multiplied by the mass matrix and the inverse of the iteration matrix the estimate is
        unchanged for slow motions, and has the right size for vibrations that the step does not
        resolve (as in Hairer and Wanner, Solving ODEs II, section IV.8). It then satisfies the
        constraints.
        """
        constant = 1.0 / 6.0 - self.beta - 0.5 * (self.alpha_m - self.alpha_f)
        laws = step_laws(self.rho_inf, h)
        for part in system.parts:
            part.block.jump_to_step(laws.accept, constant * h * h)
        shifts = laws.shifts
        END_POINT.multiply_mass(system, shifts.acceleration * shifts.scale)
        if not policy.again(np.zeros(system.constraints.size))[0]:
            return inf
        return system.largest_step()

    def accept(self, system: System, h: float) -> None:
        """See :meth:`Integrator.accept`."""
        rows, laws = system.constraints, step_laws(self.rho_inf, h)
        count_ended(system)
        if self.split is None:
            np.divide(rows.multipliers, laws.scale, out=rows.forces)
        else:
            self.split.accept(laws.shifts)
        system.accept(laws.accept, h)
        if self.split is not None:
            self.split.accepted()

    def begin_parts(self, system: System) -> "GeneralizedAlpha":
        """See :meth:`Integrator.begin_parts`.

        The acceleration-like variable is ``alpha_m - alpha_f`` of a step ahead of the acceleration,
        which is unknown after a kink. With the radius 1 it is the acceleration: the trapezoidal
        rule, which makes no error in the impulse of loads that are linear in time.
        """
        for part in system.parts:
            part.block.lead_auxiliary(part.block.accelerations, 0.0)
        return replace(self, rho_inf=1.0)

    def end_parts(self, system: System, before: Sequence[FloatArray], ratio: float) -> None:
        """See :meth:`Integrator.end_parts`."""
        for part, accelerations in zip(system.parts, before, strict=True):
            part.block.lead_auxiliary(accelerations, (self.alpha_m - self.alpha_f) * ratio)


def predict_step(
    system: System, laws: StepLaws, split: Split | None, prediction: Prediction
) -> None:
    """Start a step of the given laws with the predicted trial state."""
    whole, rows = laws.predict[prediction], system.constraints

    def predict(share: float) -> None:
        law = whole
        if share < 1.0:
            law = whole.copy()
            law[:2] *= share  # of the increments
        system.predict(law, laws.rates)
        if split is not None and split.steady and prediction is Prediction.ACCELERATION:
            split.continue_impulses(share)

    predict_apart(system, predict)
    if split is None:
        np.multiply(rows.forces, laws.scale, out=rows.multipliers)
    else:
        split.predict(laws.shifts)
    rows.elements.begin(laws.states)


@lru_cache(maxsize=_SIZES)
def _weight(rho_inf: float) -> float:
    """See ``GeneralizedAlpha.weight``."""
    scheme = GeneralizedAlpha(rho_inf)
    return (1.0 - scheme.alpha_m) / (1.0 - scheme.alpha_f) / (2.0 * scheme.beta)


@lru_cache(maxsize=_SIZES)
def step_laws(rho_inf: float, h: float) -> StepLaws:
    """Coefficients of steps of size ``h`` (s).

    With n the increment: ``a = n/(beta h^2) - v0/(beta h) - (1/2 - beta)/beta a0``,
    ``v = v0 + (1 - gamma) h a0 + gamma h a`` and
    ``(1 - alpha_f) w + alpha_f w0 = (1 - alpha_m) a + alpha_m a0``.
    """
    scheme = GeneralizedAlpha(rho_inf)
    beta, gamma, alpha_m, alpha_f = scheme.beta, scheme.gamma, scheme.alpha_m, scheme.alpha_f
    weight = (1.0 - alpha_m) / (1.0 - alpha_f)
    scale = beta * h * h
    accept = np.array([1.0 / scale, -1.0 / (beta * h), -(0.5 - beta) / beta])
    curved = np.array(
        [
            h,
            0.5 * h * h,
            1.0 - gamma / beta,
            h * (1.0 - 0.5 * gamma / beta),
            weight * accept[1],
            weight * accept[2] + alpha_m / (1.0 - alpha_f),
            -alpha_f / (1.0 - alpha_f),
        ]
    )
    plain, rest = curved.copy(), curved.copy()
    plain[1], rest[:2] = 0.0, 0.0
    shifts = Shifts(gamma / (beta * h), weight / scale, scale)
    rates = np.array([shifts.velocity, shifts.acceleration])
    states = state_step(h, alpha_m, alpha_f, gamma)
    return StepLaws(shifts, np.array(scale), (rest, plain, curved), rates, accept, states)
