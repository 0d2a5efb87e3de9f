# SPDX-License-Identifier: LGPL-3.0-or-later
"""Damping of dynamic relaxation: the factors of its next step.

A step is ``v <- keep v - smooth M^-1 (r - r_before) - push M^-1 r``. Along a motion with eigenvalue
``lambda`` of ``M^-1 K`` it is stable for ``(push + 2 smooth) lambda < 2 (1 + keep)``.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Protocol

__all__ = ["DAMPINGS", "Accelerated", "Damping", "Kinetic", "Motion", "Viscous"]

#: Rayleigh's quotient below which viscous damping does not fall.
_SLOWEST = 1e-6
#: Largest viscous damping.
_MOST = 1.9
#: Part of the change of forces in a step that accelerated relaxation removes.
_SMOOTH = 0.5
#: Number of successive steps with forces against the motion after which the momentum is dropped.
_ROW = 3


@dataclass(frozen=True)
class Motion:
    """Energies from which damping is chosen.

    Attributes:
        energy: kinetic energy of the last step.
        uphill: work of the residual in the velocity it meets; positive where energy is gained.
    """

    energy: float
    uphill: float


class Damping(Protocol):
    """Factors of steps.

    Attributes:
        stable: largest eigenvalue of ``M^-1 K`` below which all steps are stable.
        slow: True if :meth:`learn` needs Rayleigh's quotient of the slow motion.
        memory: two numbers on which the next factors depend besides the motion.
    """

    stable: float
    slow: bool
    memory: list[float]

    def factors(self, motion: Motion) -> tuple[float, float, float]:
        """``keep``, ``smooth`` and ``push`` of the next step; all stops where ``keep`` is 0."""
        ...

    def learn(self, quotient: float) -> None:
        """Update for Rayleigh's quotient of the motion since masses were renewed."""
        ...

    def stop(self) -> None:
        """Update after all velocities were set to zero."""
        ...


class Accelerated:
    """Momentum that grows until forces oppose the motion; quick vibrations are damped at once.

    Nesterov's accelerated gradient, with the momentum dropped where forces work against the motion
    (O'Donoghue, Candes, Found. Comput. Math. 15 (2015) 715-732), for several successive steps, so
    that a contact that closes does not stop all motion. The part of the change of forces that steps
    take away (there all of it) is a damping in proportion to the stiffness: vibrations excited by
    contacts and snapping folds are damped within some steps, while slow motions continue.
    """

    stable, slow = 4.0 / (1.0 + 2.0 * _SMOOTH), False

    def __init__(self) -> None:
        """At rest; ``memory`` has the steps since, and the last successive ones against forces."""
        self.memory = [0.0, 0.0]

    def factors(self, motion: Motion) -> tuple[float, float, float]:
        """See :class:`Damping`."""
        steps, row = self.memory
        row = row + 1.0 if motion.uphill > 0.0 else 0.0
        if row >= _ROW:
            steps = row = 0.0
        keep = steps / (steps + 3.0)
        self.memory = [steps + 1.0, row]
        return keep, _SMOOTH * keep, 1.0

    def learn(self, quotient: float) -> None:
        """See :class:`Damping`."""

    def stop(self) -> None:
        """See :class:`Damping`."""
        self.memory = [0.0, 0.0]


class Viscous:
    """Critical damping of the present motion, ``c = 2 sqrt(lambda)`` with Rayleigh's quotient.

    Underwood, in: Computational Methods for Transient Analysis, 1983; Papadrakakis, Comput. Methods
    Appl. Mech. Eng. 25, 1981.
    """

    stable, slow = 4.0, True

    def __init__(self) -> None:
        """At rest; ``memory`` has the quotient."""
        self.memory = [0.0, 0.0]

    def factors(self, motion: Motion) -> tuple[float, float, float]:
        """See :class:`Damping`."""
        if motion.energy == 0.0:
            return 0.0, 0.0, 0.5
        damping = min(2.0 * sqrt(max(self.memory[0], _SLOWEST)), _MOST)
        return (2.0 - damping) / (2.0 + damping), 0.0, 2.0 / (2.0 + damping)

    def learn(self, quotient: float) -> None:
        """See :class:`Damping`."""
        self.memory = [quotient, 0.0]

    def stop(self) -> None:
        """See :class:`Damping`."""


class Kinetic:
    """Kinetic damping: all velocities are set to zero at each peak of the kinetic energy.

    Cundall, 1976; Barnes, Int. J. Space Struct. 14, 1999.
    """

    stable, slow = 4.0, False

    def __init__(self) -> None:
        """At rest; ``memory`` has the energy before the last step."""
        self.memory = [0.0, 0.0]

    def factors(self, motion: Motion) -> tuple[float, float, float]:
        """See :class:`Damping`."""
        peak, self.memory = motion.energy < self.memory[0], [motion.energy, 0.0]
        if peak or motion.energy == 0.0:
            self.memory = [0.0, 0.0]
            return 0.0, 0.0, 0.5
        return 1.0, 0.0, 1.0

    def learn(self, quotient: float) -> None:
        """See :class:`Damping`."""

    def stop(self) -> None:
        """See :class:`Damping`."""


#: By the names of the option.
DAMPINGS: dict[str, type[Accelerated] | type[Viscous] | type[Kinetic]] = {
    "accelerated": Accelerated,
    "viscous": Viscous,
    "kinetic": Kinetic,
}
