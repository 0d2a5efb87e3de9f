# SPDX-License-Identifier: LGPL-3.0-or-later
"""Path following: displacements and load parameter together, over limit points.

The iteration is Riks' with Ramm's plane: the first step of length ds goes along the path's tangent,
and all further ones stay normal to it (Riks, Int. J. Solids Struct. 15 (1979) 529-551; Ramm, in:
Nonlinear Finite Element Analysis in Structural Mechanics, Springer 1981, 63-89). Lengths are root
mean squares over the nodes of displacements, relative to the size of the model, and of rotations
in rad; the load does not enter them (Crisfield, Comput. Struct. 13 (1981) 55-62), so that its unit
does not matter. An iteration solves twice with one factorisation.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.status import Status
from flexfem.solvers.statics.equilibrium import Equilibrium
from flexfem.system.mechanics import END_POINT

__all__ = ["ArcLength"]


class ArcLength:
    """Steps along an equilibrium path.

    Attributes:
        slope: derivative of the load parameter along the path at the last :meth:`aim`.
    """

    def __init__(self, equilibrium: Equilibrium) -> None:
        """Start without a direction."""
        self._equilibrium = equilibrium
        system = equilibrium.system
        self._count = sum(part.block.size_global for part in system.parts)
        self._direction: list[FloatArray] | None = None
        self._multipliers = np.zeros(system.constraints.size)
        self.slope = 0.0

    def aim(self, previous: "ArcLength | None" = None) -> bool:
        """Find the tangent at the present equilibrium (collective).

        Args:
            previous: step whose direction is continued; None for growing load.

        Returns:
            False if the matrix is singular or nothing depends on the load parameter.
        """
        equilibrium = self._equilibrium
        END_POINT.evaluate(equilibrium.system, equilibrium.shifts)
        solution = self._by_load()
        if solution is None:
            return False
        blocks, multipliers = solution
        length = self._product(blocks, blocks) ** 0.5
        if not (np.isfinite(length) and length > 0.0):
            return False
        # the solution is to be subtracted
        sign = -1.0
        before = previous._direction if previous is not None else None
        if before is not None and self._product(blocks, before) > 0.0:
            sign = 1.0
        self._direction = [sign / length * block for block in blocks]
        self._multipliers = sign / length * multipliers
        self.slope = -sign / length
        return True

    def point_along(self, motion: list[FloatArray]) -> None:
        """Set a direction of constant load: blocks' steps (n_owned, width)."""
        length = self._product(motion, motion) ** 0.5
        self._direction = [x / length for x in motion]
        self._multipliers[:] = 0.0
        self.slope = 0.0

    def largest_turn(self) -> float:
        """Largest rotation (rad) and relative displacement per unit of length."""
        self._put(1.0)
        size, turn, _ = self._equilibrium.measure(np.zeros(0))
        return max(size, turn)

    def step(self, ds: float) -> Status:
        """Take a predictor along the direction and correct normal to it (collective)."""
        equilibrium = self._equilibrium
        self._put(1.0)
        equilibrium.move(ds, self._multipliers, -self.slope)
        return equilibrium.iterate(self._bordered_step)

    def _put(self, factor: float) -> None:
        assert self._direction is not None
        for part, direction in zip(self._equilibrium.system.parts, self._direction, strict=True):
            part.block.owned_step[:] = factor * direction

    def _by_load(self) -> tuple[list[FloatArray], FloatArray] | None:
        """``A^-1 dr/dt`` with a fresh factorisation; rows must have been evaluated."""
        equilibrium = self._equilibrium
        system, tangent, shifts = equilibrium.system, equilibrium.tangent, equilibrium.shifts
        blocks, rows = equilibrium.loading.derivative(shifts)
        equilibrium.assemble()
        system.counters.factorizations += 1
        if not tangent.factor() or not tangent.solve(blocks, rows):
            return None
        steps = [part.block.owned_step.copy() for part in system.parts]
        return steps, tangent.multiplier_step

    def _bordered_step(self) -> tuple[bool, FloatArray, float]:
        """Step normal to the direction: ``dz = -A^-1 r - dt A^-1 dr/dt``."""
        system, tangent = self._equilibrium.system, self._equilibrium.tangent
        assert self._direction is not None
        residuals = [part.block.owned_residual.copy() for part in system.parts]
        values = system.constraints.values.copy()
        solution = self._by_load()
        along = 0.0 if solution is None else self._product(self._direction, solution[0])
        if solution is None or along == 0.0 or not tangent.solve(residuals, values):
            return False, np.zeros(system.constraints.size), 0.0
        steps = [part.block.owned_step for part in system.parts]
        by_load, multipliers = solution
        load = -self._product(self._direction, steps) / along
        for part, change in zip(system.parts, by_load, strict=True):
            part.block.owned_step[:] += load * change
        return True, tangent.multiplier_step + load * multipliers, load

    def _product(self, a: list[FloatArray], b: list[FloatArray]) -> float:
        """Mean over all nodes of the products of relative displacements and of rotations."""
        size = self._equilibrium.size
        local = 0.0
        for x, y in zip(a, b, strict=True):
            local += float((x[:, :3] * y[:, :3]).sum()) / size**2 + float(
                (x[:, 3:] * y[:, 3:]).sum()
            )
        return float(self._equilibrium.system.comm.allreduce(local)) / self._count
