# SPDX-License-Identifier: LGPL-3.0-or-later
"""Generalized-alpha method in independent coordinates, for Maggi's equations.

Constraints split the coordinates into dependent and independent ones. Only the latter are
integrated; the others follow from the constraints on positions, velocities and accelerations, all
of which hold to round-off at the end of every step. The equations are A^T (F - Q) = 0 with A a
basis of the null space of G, so that no multipliers appear; those that the derivative of A calls
for in the iteration matrix are recovered from the dependent rows.

The split is made again when the constraints no longer determine the dependent coordinates well. The
acceleration-like variable of the scheme is carried for all coordinates, so that a new split does
not disturb it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.core.state import counts
from flexfem.core.status import Status
from flexfem.integrators.generalized_alpha import GeneralizedAlpha
from flexfem.research.equations.vector_equations import Motion, VectorEquations
from flexfem.research.equations.vector_stepper import MOST_ITERATIONS, SLOW, VectorStepper
from flexfem.research.formalisms.formalism import Partition, accelerations, partition
from flexfem.research.formalisms.motion import FormalismMotion

__all__ = ["MaggiAlpha"]

_MOST_CLOSINGS = 12
#: Relative size of the last correction of dependent coordinates.
_CLOSED = 1e-12
#: Entry of A above which the coordinates are split again.
_LARGEST = 20.0


@dataclass
class _Point:
    """A state on the constraints, with the slopes of dependent by independent coordinates.

    They are the part of the basis A of the null space beside the identity.
    """

    q: FloatArray
    v: FloatArray
    a: FloatArray
    slopes: FloatArray


class MaggiAlpha(VectorStepper):
    """The scheme with its state; see :class:`Stepper`."""

    def begin(self, equations: VectorEquations, options: Any) -> Status:
        """See :class:`Stepper`."""
        self._set(equations, options)
        q, v = (part.copy() for part in self._equations.start())
        a = accelerations("maggi", self._equations.model, q, v)
        self._split_at(q)
        if not np.isfinite(a).all():
            return Status.SINGULAR
        self.motion = Motion(0.0, q, v, a, np.zeros(0))
        self._w = a.copy()
        return Status.OK

    def _set(self, equations: VectorEquations, options: Any) -> None:
        if not isinstance(equations, FormalismMotion):
            raise InputError(f"MaggiAlpha: {type(equations).__name__} is no FormalismMotion")
        self._equations = equations
        self._scheme = GeneralizedAlpha(options.rho_inf)
        self._tolerance, self._matrix = options.tolerance, options.iteration_matrix

    def _split_at(self, q: FloatArray) -> None:
        model = self._equations.model
        self._split: Partition = partition(model.jacobian(q), model.of_frames)
        self._kept = None

    def step(self, h: float) -> Status:
        """See :class:`Stepper`."""
        steep = not self._linearize(self.motion.q)
        if steep or np.abs(self._slopes).max(initial=0.0) > _LARGEST:
            self._split_at(self.motion.q)
        return super().step(h)

    def _attempt(self, h: float, fresh: bool) -> Status:
        """One step; with ``fresh`` matrices in every iteration."""
        old, scheme = self.motion, self._scheme
        free, bound = self._split.independent, self._split.dependent
        scale, weight = scheme.beta * h * h, (1.0 - scheme.alpha_m) / (1.0 - scheme.alpha_f)
        shifts = scheme.gamma / (scheme.beta * h), weight / scale
        step, last, t = h * old.v + 0.5 * h * h * self._w, np.inf, old.t + h
        fresh = fresh or self._matrix == "updated"
        for _ in range(MOST_ITERATIONS):
            point = self._close(h, step)
            if point is None:
                return Status.DIVERGED
            step = point.q - old.q
            F = self._equations.forces(t, point.q, point.v, point.a)
            self.counters["residual_evaluations"] += 1
            if not np.isfinite(F).all():
                return Status.DIVERGED
            exact = fresh or self._kept != h
            if exact and not self._renew(h, scale, (t, point, F, *shifts)):
                return Status.SINGULAR
            own = self._solve(-scale * (F[free] + F[bound] @ point.slopes))  # A^T F
            delta = np.empty(len(F))
            delta[free], delta[bound] = own, point.slopes @ own
            self.counters["newton_iterations"] += 1
            step = step + delta
            size = float(np.abs(delta).max(initial=0.0))
            if size <= self._tolerance:
                break
            if size > SLOW * last and self._matrix == "auto":
                self._kept = None
            last = size
        else:
            return Status.NOT_CONVERGED
        point = self._close(h, step)
        if point is None or not len(free):
            return Status.DIVERGED
        weighted = (1.0 - scheme.alpha_f) * point.a + scheme.alpha_f * old.a
        self._w = (weighted - scheme.alpha_m * self._w) / (1.0 - scheme.alpha_m)
        self.motion = Motion(t, point.q, point.v, point.a, np.zeros(0))
        return Status.OK

    def _close(self, h: float, step: FloatArray) -> _Point | None:
        """The state that the independent part of a step leads to; None where it has none."""
        model, old, scheme, split = self._equations.model, self.motion, self._scheme, self._split
        free, bound, t = split.independent, split.dependent, self.motion.t + h
        q = old.q + step
        for k in range(_MOST_CLOSINGS):
            if k % 3 == 0 and not self._linearize(q):
                return None
            change = self._inverse @ model.gaps(q, t)
            q[bound] -= change
            if not np.abs(change).max(initial=0.0) > _CLOSED * max(1.0, np.abs(q).max()):
                break
        else:
            return None
        if not np.isfinite(q).all() or (k and not self._linearize(q)):
            return None
        w = (q - old.q - h * old.v) / (scheme.beta * h * h)
        w -= (0.5 - scheme.beta) / scheme.beta * self._w
        v = old.v + h * ((1.0 - scheme.gamma) * self._w + scheme.gamma * w)
        a = (1.0 - scheme.alpha_m) * w + scheme.alpha_m * self._w - scheme.alpha_f * old.a
        a /= 1.0 - scheme.alpha_f
        v[bound] = self._slopes @ v[free] + self._inverse @ model.prescribed_rates(t)
        given = model.prescribed_accelerations(q, v, t)
        a[bound] = self._slopes @ a[free] + self._inverse @ given
        return _Point(q, v, a, self._slopes)

    def _linearize(self, q: FloatArray) -> bool:
        """Slopes of dependent by independent coordinates; False where there are none."""
        G, split = self._equations.model.jacobian(q), self._split
        try:
            self._inverse = np.linalg.inv(G[:, split.dependent])
        except np.linalg.LinAlgError:
            return False
        self._slopes = -self._inverse @ G[:, split.independent]
        return bool(np.isfinite(self._slopes).all())

    def _renew(self, h: float, scale: float, state: tuple[Any, ...]) -> bool:
        """Factorise the iteration matrix A^T (K + C + M) A of a state; False if it is singular."""
        t, point, F, dv, da = state
        multipliers = -self._inverse.T @ F[self._split.dependent]
        K = self._equations.force_tangent(t, point.q, point.v, point.a, multipliers, dv, da)
        free, bound, S = self._split.independent, self._split.dependent, point.slopes
        own = K[np.ix_(free, free)] + K[np.ix_(free, bound)] @ S
        own += S.T @ (K[np.ix_(bound, free)] + K[np.ix_(bound, bound)] @ S)
        return self._keep(scale * own, h)

    def _memory(self) -> dict[str, FloatArray]:
        return {
            "motion_w": self._w, "motion_dependent": self._split.dependent.astype(np.float64)
        }  # fmt: skip

    def _recall(self, state: Mapping[str, FloatArray]) -> None:
        self._w = np.array(state["motion_w"])
        dependent = np.array(counts("motion_dependent", state["motion_dependent"]), dtype=np.int64)
        if len(np.unique(dependent)) < len(dependent) or dependent.max(initial=0) >= len(self._w):
            raise ValueError('"motion_dependent" names coordinates that do not exist')
        self._split = Partition(dependent, np.setdiff1d(np.arange(len(self._w)), dependent))
