# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints that are locked during a motion: their rows keep the values that they have then."""

from collections.abc import Sequence

import numpy as np

from flexfem._types import FloatArray
from flexfem.gradients.equations.carried import Carried
from flexfem.gradients.equations.step_tangent import put_steps
from flexfem.gradients.equations.values import Equations
from flexfem.gradients.renewals.renewal import Renewal
from flexfem.system.system import System

__all__ = ["Hold"]


class Hold(Renewal):
    """New targets of rows, ``target = c(q)``, which are carried as long as they are held."""

    def take(self) -> None:
        """See :class:`Renewal`.

        Rows are those behind the event, and held ones have new targets.
        """
        rows = self._system.constraints
        self._to_state()
        self._take_maps()
        self._held = rows.held & rows.rigid & (np.abs(rows.sums() - rows.targets) <= _SAME)

    def _to_trial(self) -> None:
        """See :class:`Renewal`."""
        self._to_state()

    def equations(self, system: System, restitution: FloatArray | None = None) -> Equations:
        """See :class:`Renewal`."""
        rows = system.constraints
        system.interface.update()
        rows.place_markers()
        blocks = [np.zeros_like(part.block.owned_step) for part in system.parts]
        return blocks, (rows.sums() - rows.targets) * self._held

    def _back(
        self, carried: Sequence[Carried], targets: FloatArray, forces: FloatArray
    ) -> Equations:
        """See :class:`Renewal`."""
        factors, system = targets * self._held, self._system
        targets[self._held] = 0.0
        for part in system.parts:
            part.block.residual[:] = 0.0
        system.add_constraint_forces(factors)
        for own, by, part in zip(carried, self.maps, system.parts, strict=True):
            own.q += by.hold(part.block.owned_residual.copy())
        return [np.zeros_like(own.q) for own in carried], -factors

    def _ahead(
        self, carried: Sequence[Carried], targets: FloatArray, forces: FloatArray,
        changes: Equations,
    ) -> None:  # fmt: skip
        """See :class:`Renewal`."""
        put_steps(self._system, [own.q for own in carried])
        rows = self._system.constraints
        moved = rows.changes(self._system.interface.steps) + changes[1]
        targets[self._held] = moved[self._held]


#: Largest distance of a row that is held from its target, m or rad, where it is locked.
_SAME = 1e-12
