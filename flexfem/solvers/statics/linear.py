# SPDX-License-Identifier: LGPL-3.0-or-later
"""Linear statics about the unloaded initial state, with an estimate of the linearisation error."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray
from flexfem.solvers.statics.equilibrium import Equilibrium, Snapshot
from flexfem.system.mechanics import END_POINT

__all__ = ["LinearSolution", "solve_linear"]

#: Displacement (relative) or rotation (rad) of central differences of columns: their error is of
#: the order of its square, that of rounding 1e-16 over it.
_SMALL = 1e-4
#: Size of a solution without loads, from rounding: it has no nonlinear part.
_ROUNDING = 1e-12
#: Upper limit of the reported relative change by the next iteration.
_MOST = 1e9


@dataclass(frozen=True)
class LinearSolution:
    """Displacements and multipliers in proportion to the loads.

    Attributes:
        start: the state to which they are relative.
        t: load parameter.
        steps: (n_owned, width) of each block, local twists; multipliers: those of the rows.
        size: largest displacement, relative to the model's size, or rotation, rad.
    """

    start: Snapshot
    t: float
    steps: list[FloatArray]
    multipliers: FloatArray
    size: float

    def move(self, equilibrium: Equilibrium, factor: float) -> None:
        """Bring the system from the start to a multiple of the solution (collective)."""
        equilibrium.restore(self.start)
        equilibrium.loading.set(self.t)
        for part, steps in zip(equilibrium.system.parts, self.steps, strict=True):
            part.block.owned_step[:] = steps
        equilibrium.move(factor, self.multipliers, 0.0)
        equilibrium.strains = equilibrium.system.present
        equilibrium.react()
        equilibrium.system.interface.update()

    def columns(
        self, equilibrium: Equilibrium, look: Callable[[], Mapping[str, float]]
    ) -> FloatArray:
        """Columns of the history to first order in the solution, on the first rank (collective).

        Args:
            equilibrium: of the model.
            look: the columns at the trial state (collective).
        """
        share = _SMALL / self.size if self.size > 0.0 else 1.0
        values = []
        for factor in (0.0, share, -share):
            self.move(equilibrium, factor)
            values.append(np.array(list(look().values())))
        rates: FloatArray = (values[1] - values[2]) / (2.0 * share)
        return values[0] + rates

    def neglected(self, equilibrium: Equilibrium) -> float:
        """Return the change by one more iteration, relative to the solution (collective)."""
        self.move(equilibrium, 1.0)
        found = _step_size(equilibrium)
        self.move(equilibrium, 1.0)
        if self.size <= _ROUNDING:
            return 0.0
        return 1.0 if found is None else float(min(found / self.size, _MOST))


def solve_linear(equilibrium: Equilibrium, start: Snapshot, t: float) -> LinearSolution | None:
    """Displacements from a start under the loads at ``t``, None without any (collective)."""
    system, tangent, loading = equilibrium.system, equilibrium.tangent, equilibrium.loading
    equilibrium.restore(start)
    loading.set(t, fraction=0.0)  # loads have no part in the stiffness
    END_POINT.evaluate(system, equilibrium.shifts)
    equilibrium.assemble()
    system.counters.factorizations += 1
    factored = tangent.factor()
    loading.set(t)
    if not factored:
        return None
    END_POINT.evaluate(system, equilibrium.shifts)
    system.counters.newton_iterations += 1
    residuals = [part.block.owned_residual.copy() for part in system.parts]
    success = tangent.solve(residuals, system.constraints.values.copy())
    multipliers = tangent.multiplier_step.copy()
    size, _, failed = equilibrium.measure(multipliers, success)
    if failed or not np.isfinite(size):
        return None
    steps = [-part.block.owned_step.copy() for part in system.parts]
    return LinearSolution(start, t, steps, -multipliers, size)


def _step_size(equilibrium: Equilibrium) -> float | None:
    """Size of Newton's step at the present state, None without any (collective)."""
    system = equilibrium.system
    END_POINT.evaluate(system, equilibrium.shifts)
    system.counters.newton_iterations += 1
    success, change = equilibrium.tangent.step(equilibrium.shifts, equilibrium.strains)
    size, _, failed = equilibrium.measure(change, success)
    return None if failed or not np.isfinite(size) else size
