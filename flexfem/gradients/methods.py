# SPDX-License-Identifier: LGPL-3.0-or-later
"""Methods of optimisation with gradients: those of SciPy, MMA of NLopt, IPOPT."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexfem import _checks
from flexfem._packages import require
from flexfem._types import FloatArray

__all__ = ["Task", "method_of"]

#: Values (k,) of objective and constraints at scaled parameters (n,), and derivatives (k, n).
Function = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
#: Where a method ends (n,), whether it has converged, and its own words.
Ended = tuple[FloatArray, bool, str]


@dataclass(frozen=True)
class Task:
    """What a method is to solve.

    Attributes:
        of: the objective and the constraints.
        start: parameters to begin with, (n,).
        low: their least values, (n,).
        high: their largest values, (n,).
        between: least and largest value of each constraint, None for none.
        most: largest number of evaluations.
        tolerance: relative change of the objective at which the method ends.
    """

    of: Function
    start: FloatArray
    low: FloatArray
    high: FloatArray
    between: Sequence[tuple[float | None, float | None]]
    most: int
    tolerance: float

    def objective(self, x: FloatArray) -> float:
        """Value of the objective."""
        return float(self.of(x)[0][0])

    def slope(self, x: FloatArray) -> FloatArray:
        """Its derivatives (n,)."""
        found: FloatArray = self.of(x)[1][0]
        return found

    @property
    def inequalities(self) -> list[tuple[int, float, float]]:
        """Number of the value, its limit, and a factor with which the difference is to be >= 0.

        Factors are one over the size of the limit: methods end by absolute violations.
        """
        return [
            (k, limit, sign / (abs(limit) or 1.0))
            for k, pair in enumerate(self.between, start=1)
            for limit, sign in zip(pair, (1.0, -1.0), strict=True)
            if limit is not None
        ]

    def violation(self, values: FloatArray) -> float:
        """Largest part by which a constraint is exceeded, over its limit; 0 if none is."""
        return max(
            (-factor * (values[k] - at) for k, at, factor in self.inequalities),
            default=0.0,
        )


def method_of(name: str | None, *, constrained: bool) -> Callable[[Task], Ended]:
    """The method of a name.

    Raises:
        InstallationError: its package is missing.
        ValueError: there is none of this name, or it has no constraints.
    """
    chosen = name or ("SLSQP" if constrained else "L-BFGS-B")
    known = {name for name in _METHODS if name != "L-BFGS-B" or not constrained}
    if chosen not in known:
        names = ", ".join(f'"{one}"' for one in _METHODS if one in known)
        raise ValueError(f"minimize: method must be one of {names}, got {_checks.show(chosen)}")
    package, method = _METHODS[chosen]
    require(package)
    return method


def _scipy(task: Task, method: str, options: dict[str, float], size: float = 1.0) -> Ended:
    """A method of ``scipy.optimize``, to which the objective is given over a size."""
    from scipy.optimize import Bounds, minimize

    found = minimize(
        lambda x: task.objective(x) / size, task.start, jac=lambda x: task.slope(x) / size,
        bounds=Bounds(task.low, task.high), constraints=_constraints(task), method=method,
        options={"maxiter": task.most, "ftol": task.tolerance, **options},
    )  # fmt: skip
    return found.x, bool(found.success), str(found.message)


def _lbfgsb(task: Task) -> Ended:
    """Quasi-Newton method with bounds (Byrd et al., SIAM J. Sci. Comput. 16 (1995) 1190)."""
    return _scipy(task, "L-BFGS-B", {"maxfun": task.most, "gtol": 0.0})


def _slsqp(task: Task) -> Ended:
    """Sequential quadratic programming (Kraft 1988).

    It ends by absolute changes, and takes constraints for incompatible beside an objective of many
    digits: it is given the objective over its size at the start.
    """
    return _scipy(task, "SLSQP", {}, abs(task.objective(task.start)) or 1.0)


def _mma(task: Task) -> Ended:
    """Moving asymptotes, globally convergent (Svanberg, SIAM J. Optim. 12 (2002) 555)."""
    nlopt = require("nlopt")
    found = nlopt.opt(nlopt.LD_MMA, len(task.start))
    found.set_min_objective(_of_nlopt(task, 0, 0.0, 1.0))
    for k, limit, factor in task.inequalities:  # at most zero
        found.add_inequality_constraint(_of_nlopt(task, k, limit, -factor), 1e-8)
    found.set_lower_bounds(task.low)
    found.set_upper_bounds(task.high)
    found.set_ftol_rel(task.tolerance)
    found.set_maxeval(task.most)
    best = found.optimize(task.start)
    code = found.last_optimize_result()
    words = {
        1: "success", 2: "the stopping value is reached", 3: "the objective changes no more",
        4: "parameters change no more", 5: "the largest number of evaluations is reached",
    }  # fmt: skip
    return np.asarray(best), 0 < code < 5, words.get(code, f"NLopt ended with {code}")


def _of_nlopt(
    task: Task, k: int, limit: float, factor: float
) -> Callable[[FloatArray, FloatArray], float]:
    """A function of NLopt, which writes derivatives into its second argument."""

    def called(x: FloatArray, slopes: FloatArray) -> float:
        values, by = task.of(x)
        if slopes.size:
            slopes[:] = factor * by[k]
        return factor * float(values[k] - limit)

    return called


def _ipopt(task: Task) -> Ended:
    """Interior-point method (Waechter, Biegler, Math. Program. 106 (2006) 25), limited memory."""
    cyipopt = require("cyipopt")
    found = cyipopt.minimize_ipopt(
        task.objective, task.start, jac=task.slope,
        bounds=list(zip(task.low, task.high, strict=True)), constraints=_constraints(task),
        tol=task.tolerance, options={"max_iter": task.most, "print_level": 0, "sb": "yes"},
    )  # fmt: skip
    message = found.message
    return found.x, bool(found.success), message.decode() if isinstance(message, bytes) else message


def _constraints(task: Task) -> list[dict[str, Any]]:
    """Inequalities in the form of SciPy, each at least zero."""
    return [
        {
            "type": "ineq",
            "fun": lambda x, k=k, at=limit, factor=factor: factor * (task.of(x)[0][k] - at),
            "jac": lambda x, k=k, factor=factor: factor * task.of(x)[1][k],
        }
        for k, limit, factor in task.inequalities
    ]


_METHODS: dict[str, tuple[str, Callable[[Task], Ended]]] = {
    "L-BFGS-B": ("scipy", _lbfgsb), "SLSQP": ("scipy", _slsqp), "MMA": ("nlopt", _mma),
    "IPOPT": ("cyipopt", _ipopt),
}  # fmt: skip
