# SPDX-License-Identifier: LGPL-3.0-or-later
"""Common parts of schemes for equations in a vector of coordinates."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg

from flexfem._types import FloatArray
from flexfem.core.state import counts
from flexfem.core.status import Status
from flexfem.research.equations.vector_equations import Motion, VectorEquations

__all__ = ["MOST_ITERATIONS", "SLOW", "VectorStepper", "factor"]

MOST_ITERATIONS = 20
#: Contraction above which a kept matrix is renewed.
SLOW = 0.3


class VectorStepper:
    """State, counts and kept matrix of a scheme; see :class:`Stepper`.

    A scheme brings ``begin``, ``_set``, which takes the equations and options, ``_attempt``, a step
    with a kept or with fresh matrices, and its memory besides the motion.

    Attributes:
        motion: the accepted state.
        counters: counts of the run.
    """

    motion: Motion
    _matrix: str

    def __init__(self) -> None:
        """Nothing yet: ``begin`` or :meth:`restore` make the state."""
        self.counters = {"newton_iterations": 0, "factorizations": 0, "residual_evaluations": 0}
        self._solve: Any = None
        self._kept: float | None = None  # step of the kept matrix

    def _set(self, equations: VectorEquations, options: Any) -> None:
        raise NotImplementedError

    def _attempt(self, h: float, fresh: bool) -> Status:
        """One step; with ``fresh`` matrices in every iteration."""
        raise NotImplementedError

    def _memory(self) -> dict[str, FloatArray]:
        """Return the memory of the scheme besides the motion."""
        raise NotImplementedError

    def _recall(self, state: Mapping[str, FloatArray]) -> None:
        """Restore the return value of :meth:`_memory`."""
        raise NotImplementedError

    def step(self, h: float) -> Status:
        """See :class:`Stepper`."""
        status = self._attempt(h, False)
        if status is not Status.OK and self._matrix != "updated":
            status = self._attempt(h, True)  # a kept matrix is no reason to fail
        return status

    def _keep(self, matrix: Any, h: float) -> bool:
        """Factorise the iteration matrix of a step; False if it is singular."""
        self._solve = factor(matrix)
        self.counters["factorizations"] += 1
        self._kept = None if self._solve is None else h
        return self._solve is not None

    def state(self) -> Mapping[str, FloatArray]:
        """See :class:`Stepper`."""
        m = self.motion
        return {
            "motion_t": np.array([m.t]), "motion_q": m.q, "motion_v": m.v, "motion_a": m.a,
            "motion_multipliers": m.multipliers, **self._memory(),
            "motion_counters": np.array(list(self.counters.values()), dtype=np.float64),
        }  # fmt: skip

    def restore(
        self, equations: VectorEquations, options: Any, state: Mapping[str, FloatArray]
    ) -> None:
        """See :class:`Stepper`."""
        self._set(equations, options)
        self._solve = self._kept = None
        names = ("q", "v", "a", "multipliers")
        t = float(state["motion_t"][0])
        self.motion = Motion(t, *(np.array(state[f"motion_{name}"]) for name in names))
        self._recall(state)
        numbers = counts("motion_counters", state["motion_counters"])
        self.counters = dict(zip(self.counters, numbers, strict=True))


def factor(matrix: Any) -> Any:
    """Function that solves with a dense or sparse matrix; None if it is singular."""
    if scipy.sparse.issparse(matrix):
        try:
            return scipy.sparse.linalg.splu(matrix.tocsc()).solve
        except RuntimeError:
            return None
    (getrf, getrs) = scipy.linalg.get_lapack_funcs(("getrf", "getrs"), (matrix,))
    lu, pivots, info = getrf(matrix)
    if info != 0 or not np.isfinite(lu).all():
        return None
    return lambda b: getrs(lu, pivots, b)[0]
