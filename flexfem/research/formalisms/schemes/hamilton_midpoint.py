# SPDX-License-Identifier: LGPL-3.0-or-later
"""Symplectic midpoint method with constraints, for Hamilton's equations.

The implicit midpoint rule of q' = dH/dp, p' = -dH/dq + Q, with constraints on positions and on
velocities at the end of each step as in RATTLE (Andersen, J. Comput. Phys. 52 (1983) 24-34; Hairer,
Lubich, Wanner, "Geometric Numerical Integration", 2006, VII.1):

    p_m = p_0 + h/2 (f(q_m, p_m) - G(q_0)^T lambda),   q_1 = q_0 + h dH/dp(q_m, p_m),
    p_1 = p_m + h/2 (f(q_m, p_m) - G(q_1)^T mu),       Phi(q_1) = 0,   G(q_1) dH/dp(q_1, p_1) = Phi'

with f = -dH/dq + Q. The Legendre transformation is used in the direction in which it needs no
inverse matrix: dH/dp at the midpoint is the mean velocity v of the step, and its momenta are
p_m = dL/dq'(q_m, v). Only the velocities at the end of the step take a mass matrix. The scheme is
of second order and has no numerical dissipation: ``rho_inf`` means nothing to it.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.core.status import Status
from flexfem.research.equations.vector_equations import Motion, VectorEquations
from flexfem.research.equations.vector_stepper import MOST_ITERATIONS, SLOW, VectorStepper, factor
from flexfem.research.formalisms.formalism import accelerations, saddle
from flexfem.research.formalisms.motion import FormalismMotion

__all__ = ["HamiltonMidpoint"]


class HamiltonMidpoint(VectorStepper):
    """The scheme with its state; see :class:`Stepper`.

    Attributes:
        momenta: p (n,) that belong to ``motion``.
    """

    def begin(self, equations: VectorEquations, options: Any) -> Status:
        """See :class:`Stepper`."""
        self._set(equations, options)
        model = self._equations.model
        q, v = (part.copy() for part in self._equations.start())
        a = accelerations("hamilton", model, q, v)
        if not np.isfinite(a).all():
            return Status.SINGULAR
        self.motion = Motion(0.0, q, v, a, np.zeros(model.constraints))
        self.momenta = model.vector("momentum", q, v)
        return Status.OK

    def _set(self, equations: VectorEquations, options: Any) -> None:
        if not isinstance(equations, FormalismMotion):
            raise InputError(f"HamiltonMidpoint: {type(equations).__name__} is no FormalismMotion")
        self._equations = equations
        self._tolerance, self._matrix = options.tolerance, options.iteration_matrix

    def _attempt(self, h: float, fresh: bool) -> Status:
        """One step; with ``fresh`` matrices in every iteration."""
        model, old = self._equations.model, self.motion
        n, t = model.size, old.t + h
        G0 = model.jacobian(old.q)
        # in the equations times h, the unknown is h^2/2 lambda
        step, forces = h * old.v + 0.5 * h * h * old.a, 0.5 * h * h * old.multipliers
        last, fresh = np.inf, fresh or self._matrix == "updated"
        for _ in range(MOST_ITERATIONS):
            p, f = self._midpoint(h, step)
            r = h * (p - self.momenta) - 0.5 * h * h * f + forces @ G0
            r = np.concatenate([r, model.gaps(old.q + step, t)])
            if not np.isfinite(r).all():
                return Status.DIVERGED
            if (fresh or self._kept != h) and not self._renew(h, step, G0):
                return Status.SINGULAR
            delta = self._solve(-r)
            self.counters["newton_iterations"] += 1
            step, forces = step + delta[:n], forces + delta[n:]
            size = float(np.abs(delta).max(initial=0.0))
            if size <= self._tolerance:
                break
            if size > SLOW * last and self._matrix == "auto":
                self._kept = None
            last = size
        else:
            return Status.NOT_CONVERGED
        return self._accept(h, step, 2.0 * forces / h**2)

    def _midpoint(self, h: float, step: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Momenta dL/dq' and forces -dH/dq + Q at the middle of the step."""
        model, old = self._equations.model, self.motion
        q, v = old.q + 0.5 * step, step / h
        self.counters["residual_evaluations"] += 1
        f = model.vector("force", q, v) + model.forces(q, old.t + 0.5 * h)
        return model.vector("momentum", q, v), f

    def _renew(self, h: float, step: FloatArray, G0: FloatArray) -> bool:
        """Factorise the iteration matrix of a state; False if it is singular."""
        model, old = self._equations.model, self.motion
        q, v = old.q + 0.5 * step, step / h
        K = model.matrix("hamilton", (1.0, 0.5 * h, -0.25 * h * h, -0.5 * h), q, v)
        change = np.zeros_like(K)
        none = np.zeros(model.constraints)
        model.add_constraint_stiffness(q, old.t + 0.5 * h, none, change)
        G1 = model.jacobian(old.q + step)
        return self._keep(saddle(K + 0.25 * h * h * change, G1, G0), h)

    def _accept(self, h: float, step: FloatArray, multipliers: FloatArray) -> Status:
        """Momenta and velocities at the end of the step."""
        model, old = self._equations.model, self.motion
        n, t, q = model.size, old.t + h, old.q + step
        p, f = self._midpoint(h, step)
        M, G = model.matrix("hamilton", (1.0,), q, old.v), model.jacobian(q)
        solve = factor(saddle(M, G))
        self.counters["factorizations"] += 1
        if solve is None:
            return Status.SINGULAR
        x = solve(np.concatenate([p + 0.5 * h * f, model.prescribed_rates(t)]))
        v = x[:n]
        if not np.isfinite(x).all():
            return Status.DIVERGED
        self.momenta = M @ v
        self.motion = Motion(t, q, v, (v - old.v) / h, multipliers)
        return Status.OK

    def _memory(self) -> dict[str, FloatArray]:
        return {"motion_p": self.momenta}

    def _recall(self, state: Mapping[str, FloatArray]) -> None:
        self.momenta = np.array(state["motion_p"])
