# SPDX-License-Identifier: LGPL-3.0-or-later
"""Accepted accelerations of stiff damped bodies on which impulses act.

After an impulse the acceleration ``-M^-1 (C v + f)`` of a body with damping C is huge wherever ``h
C`` is larger than M. Schemes with ``rho_inf < 1`` move by ``(1/2 - beta/gamma) h^2`` times as much
in the next step: a thin shell that falls on its edge had 230 times its energy. The accelerations
with which a step with impulses ends are therefore those of an implicit step,

``w = -(M + h C)^-1 (C v + f)``,  which lack  ``y = -h C w``:  ``M w = -(C v + f) + y``.

The next step gives y back: in its equations, at the end, stands

``M w(n) + C v(n) + f + c y = b F``,  ``c = b - 1 + k``,  ``k = 1 - gamma/(2 beta)``,

with F, b and n of ``integrators.split.step``. With ``rho_inf = 1`` c is 1, y cancels and energy and
momenta are those of the trapezoidal rule, and at rest ``f = F`` with any radius. With the velocity
``v(n) + k W`` at the end the impulses are

``(M + s h C) W = h F + (h/b) (h C w(n) - c y)``,  ``s = 1 - k/b``.

A step after one without impulses does not give y back: stiff modes come to rest in it, as in an
implicit step. The work of y is what their damping does not take then.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.state import State
from flexfem.integrators.split.impulse import zero_increments
from flexfem.system.mechanics import VISCOUS
from flexfem.system.system import GYROSCOPIC, System

__all__ = ["StiffDamping"]


class StiffDamping:
    """Forces that accepted accelerations lack.

    Attributes:
        lacking: True if there are some, which the present step gives back.
    """

    def __init__(self, system: System) -> None:
        """Begin without such forces."""
        self._system = system
        self._forces = [np.zeros_like(part.block.owned_residual) for part in system.parts]
        self._factor, self.lacking = 0.0, False
        self._withheld = False  # forces that are not given back
        self._rates: list[FloatArray] = []  # velocities at the begin of such a step

    def begin(self, factor: float) -> None:
        """Begin a step at the accepted state, in whose equations the forces have a factor."""
        self._factor = factor
        if self._withheld:
            self._rates = self._velocities()

    def give_back(self, scale: float) -> None:
        """Add the forces, times a scale, to the blocks' residuals of the step."""
        if self.lacking:
            for part, own in zip(self._system.parts, self._forces, strict=True):
                part.block.owned_residual[:] += self._factor * scale * own

    def lead(self, h: float, weight: float) -> None:
        """Set the residuals of the impulses of a step of size h, s, without F (collective).

        Args:
            h: size of the step, s.
            weight: b.
        """
        self._damp([part.block.acceleration for part in self._system.parts], -h / weight)
        self.give_back(1.0 / weight)

    def leave(self, h: float) -> None:
        """Keep what accepted accelerations lack from which the blocks' steps are subtracted.

        Collective. The steps, m/s^2, are impulses over h, s.
        """
        self._damp([part.block.step.copy() for part in self._system.parts], h)
        self._keep(and_earlier=self.lacking)
        self.lacking, self._withheld = True, False

    def end(self, h: float, *, acting: bool) -> None:
        """End a step at the accepted state (collective).

        Args:
            h: size of the step, s.
            acting: True if there were impulses.
        """
        if self._withheld:
            self._withhold(h)
        if not (acting or self.lacking):
            self._withheld = False
            return
        self._damp([part.block.acceleration for part in self._system.parts], -h)
        self._keep()
        self.lacking, self._withheld = acting, not acting

    def recall(self, h: float, *, lacking: bool) -> None:
        """Find the forces at an accepted state again, after a step of size h, s (collective).

        Args:
            h: size of the step, s.
            lacking: True if there are some.
        """
        self.lacking, self._withheld = lacking, False
        if lacking:
            self._damp([part.block.acceleration for part in self._system.parts], -h)
            self._keep()

    def state(self) -> State:
        """The forces, by which the next step goes on."""
        blocks = [part.block.name for part in self._system.parts]
        rows = {name: {"lacking": own} for name, own in zip(blocks, self._forces, strict=True)}
        flags = np.array([float(self.lacking), float(self._withheld)])
        return State({"lacking": flags}, rows)

    def restore(self, state: State) -> None:
        """Restore a result of :meth:`state`."""
        self.lacking, self._withheld = (bool(flag) for flag in state.values["lacking"])
        for part, own in zip(self._system.parts, self._forces, strict=True):
            own[:] = state.rows[part.block.name]["lacking"]

    def _velocities(self) -> list[FloatArray]:
        """Velocities (n_owned, width) of the blocks."""
        blocks = [part.block for part in self._system.parts]
        return [block.velocity[: block.owned, : block.width].copy() for block in blocks]

    def _withhold(self, h: float) -> None:
        """Count the work over a step of size h, s, of forces that it has not given back."""
        every = zip(self._forces, self._rates, self._velocities(), strict=True)
        for total, (own, a, b) in zip(self._system.withheld, every, strict=True):
            # accelerations at the begin of a step have half of the weight
            total[:] += 0.25 * h * np.einsum("ni,ni->n", own, a + b)

    def _damp(self, rates: list[FloatArray], factor: float) -> None:
        """Set the residuals to a factor times C times twists (n, 6) of each block (collective)."""
        for part, own in zip(self._system.parts, rates, strict=True):
            part.block.step[:] = own
        with zero_increments(self._system):
            VISCOUS.multiply_mass(self._system, factor, GYROSCOPIC)

    def _keep(self, *, and_earlier: bool = False) -> None:
        """Store the residuals as the forces, in place of the earlier ones or beside them."""
        for part, own in zip(self._system.parts, self._forces, strict=True):
            if not and_earlier:
                own[:] = 0.0
            own[:] += part.block.owned_residual
