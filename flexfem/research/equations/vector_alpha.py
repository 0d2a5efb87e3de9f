# SPDX-License-Identifier: LGPL-3.0-or-later
"""Generalized-alpha method for equations of motion in a vector of coordinates.

Chung, Hulbert, "A time integration algorithm for structural dynamics with improved numerical
dissipation", J. Appl. Mech. 60 (1993) 371-375, in the form with an acceleration-like variable of
Arnold and Brüls (2007), which keeps the second order of multipliers of index 3 as well. The
equations hold at the end of the step; they are scaled by ``beta h^2`` and so are the multipliers,
so that the condition of the iteration matrix does not depend on the step.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.sparse

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.core.status import Status
from flexfem.integrators.generalized_alpha import GeneralizedAlpha
from flexfem.research.equations.vector_equations import Motion, VectorEquations
from flexfem.research.equations.vector_stepper import MOST_ITERATIONS, SLOW, VectorStepper, factor

__all__ = ["VectorAlpha"]

#: Forward differences of the fourth order for a first, of the third for a second derivative.
_FIRST = np.array([-25.0 / 12.0, 4.0, -3.0, 4.0 / 3.0, -0.25])
_SECOND = np.array([35.0 / 12.0, -26.0 / 3.0, 9.5, -14.0 / 3.0, 11.0 / 12.0])
#: Constraints (m, rad) and their rates that count as satisfied at the start.
_VIOLATED = 1e-6


class VectorAlpha(VectorStepper):
    """The scheme with its state; see :class:`Stepper`."""

    def begin(self, equations: VectorEquations, options: Any) -> Status:
        """See :class:`Stepper`."""
        self._set(equations, options)
        q, v = (np.array(x, dtype=np.float64) for x in equations.start())
        n, m = equations.size, equations.multipliers
        a, multipliers = np.zeros(n), np.zeros(m)
        rhs = -self._residual(0.0, q, v, a, multipliers)
        zero = equations.tangent(0.0, q, v, a, multipliers, 0.0, 0.0)
        matrix = equations.tangent(0.0, q, v, a, multipliers, 0.0, 1.0)
        stiffness = _square(zero, n)
        matrix = matrix - stiffness  # residual of the accelerations, and the constraints
        if m:
            rhs[n:] = -self._constraint_rates(q, v, options.dt)
        solve = factor(matrix)
        self.counters["factorizations"] += 1
        x = None if solve is None else solve(rhs)
        if x is None or not np.isfinite(x).all():
            return Status.SINGULAR
        self.motion = Motion(0.0, q, v, x[:n], x[n:])
        self._w = x[:n].copy()
        return Status.OK

    def _set(self, equations: VectorEquations, options: Any) -> None:
        self._equations = equations
        self._scheme = GeneralizedAlpha(options.rho_inf)
        self._tolerance, self._matrix = options.tolerance, options.iteration_matrix
        self._kept = None

    def _residual(self, *state: Any) -> FloatArray:
        self.counters["residual_evaluations"] += 1
        return self._equations.residual(*state)

    def _constraint_rates(self, q: FloatArray, v: FloatArray, h: float) -> FloatArray:
        """Second derivative of the constraints along a motion of constant velocity."""
        eq, n = self._equations, self._equations.size
        rows = []
        for k in range(5):
            a, multipliers = np.zeros(n), np.zeros(eq.multipliers)
            rows.append(self._residual(k * h, eq.add(q, k * h * v), v, a, multipliers)[n:])
        phi = np.array(rows)
        rates = _FIRST @ phi / h
        for what, values in (("constraint", phi[0]), ("rate of constraint", rates)):
            k = int(np.argmax(np.abs(values)))
            limit = _VIOLATED * (1.0 if what == "constraint" else 1.0 + 1e3 * np.abs(v).max())
            if not abs(values[k]) <= limit:
                raise InputError(
                    f"{what} {k} of the equations is {values[k]:.3g} at the start; start with "
                    "coordinates and velocities that satisfy it"
                )
        return _SECOND @ phi / h**2

    def _attempt(self, h: float, fresh: bool) -> Status:
        """One step; with ``fresh`` matrices in every iteration."""
        eq, old, scheme = self._equations, self.motion, self._scheme
        beta, gamma = scheme.beta, scheme.gamma
        scale, weight = beta * h * h, (1.0 - scheme.alpha_m) / (1.0 - scheme.alpha_f)
        rest = (scheme.alpha_m * self._w - scheme.alpha_f * old.a) / (1.0 - scheme.alpha_f)
        n, t = eq.size, old.t + h
        step = h * old.v + 0.5 * h * h * self._w  # predicted increment
        forces, last = scale * old.multipliers, np.inf
        fresh = fresh or self._matrix == "updated"
        fresh = fresh or (self._matrix == "auto" and eq.linear and not eq.constant)
        for iteration in range(MOST_ITERATIONS):
            w = (step - h * old.v) / scale - (0.5 - beta) / beta * self._w
            v = old.v + h * ((1.0 - gamma) * self._w + gamma * w)
            a = weight * w + rest
            q, multipliers = eq.add(old.q, step), forces / scale
            r = self._residual(t, q, v, a, multipliers)
            if not np.isfinite(r).all():
                return Status.DIVERGED
            exact = fresh or self._kept != h
            if exact:
                state = (t, q, v, a, multipliers, gamma / (beta * h), weight / scale)
                if not self._renew(h, scale, state):
                    return Status.SINGULAR
            r[:n] *= scale
            delta = self._solve(-r)
            self.counters["newton_iterations"] += 1
            step, forces = step + delta[:n], forces + delta[n:]
            size = float(np.abs(delta).max(initial=0.0))
            if (eq.linear and (exact or eq.constant)) or size <= self._tolerance:
                break
            if size > 2.0 * last and iteration > 2:
                return Status.DIVERGED
            if size > SLOW * last and self._matrix == "auto":
                self._kept = None
            last = size
        else:
            return Status.NOT_CONVERGED
        w = (step - h * old.v) / scale - (0.5 - beta) / beta * self._w
        v = old.v + h * ((1.0 - gamma) * self._w + gamma * w)
        self.motion = Motion(t, eq.add(old.q, step), v, weight * w + rest, forces / scale)
        self._w = w
        if not np.isfinite(self.motion.q).all():
            return Status.DIVERGED
        return Status.OK

    def _renew(self, h: float, scale: float, state: tuple[Any, ...]) -> bool:
        """Factorise the iteration matrix of a state; False if it is singular."""
        n, m = self._equations.size, self._equations.multipliers
        rows = np.concatenate([np.full(n, scale), np.ones(m)])
        columns = np.concatenate([np.ones(n), np.full(m, 1.0 / scale)])
        matrix = self._equations.tangent(*state)
        if scipy.sparse.issparse(matrix):
            matrix = scipy.sparse.diags(rows) @ matrix @ scipy.sparse.diags(columns)
        else:
            matrix = rows[:, None] * matrix * columns
        return self._keep(matrix, h)

    def _memory(self) -> dict[str, FloatArray]:
        return {"motion_w": self._w}

    def _recall(self, state: Mapping[str, FloatArray]) -> None:
        self._w = np.array(state["motion_w"])


def _square(matrix: Any, n: int) -> Any:
    """A matrix with zeros outside its leading square."""
    if scipy.sparse.issparse(matrix):
        keep = scipy.sparse.diags((np.arange(matrix.shape[0]) < n).astype(float))
        return keep @ matrix @ keep
    out = matrix.copy()
    out[n:], out[:, n:] = 0.0, 0.0
    return out
