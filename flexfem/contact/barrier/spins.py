# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spins of all points and couples on them, where contacts have friction.

Points fixed to nodes with rotations have the spins of these; points of triangles whose nodes have
none the tilts of the triangles; others no spin.
"""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.barrier.pairs import PointMotion
from flexfem.contact.carriers import Carriers
from flexfem.contact.dissipation.tilts import Tilts, add_spins, place_tilts, spread_couples

__all__ = ["Spins"]


class Spins:
    """Spins and couples of the points of this rank.

    Attributes:
        motion: of all points.
    """

    def __init__(
        self, carriers: Carriers, motion: PointMotion, triangles: IntArray, *, used: bool
    ) -> None:
        """Store the points.

        Args:
            carriers: of the points.
            motion: of all points.
            triangles: all triangles, (t, 3).
            used: False if no contact has friction: spins are zero then.
        """
        self._carriers, self.motion, self._used = carriers, motion, used
        count = len(motion.before)
        narrow = triangles[_still(carriers)[triangles].all(axis=1)] if used else triangles[:0]
        self._tilts = Tilts.of(narrow, count)
        self._steps = np.zeros((count, 3))
        self._away = np.ones(count, dtype=np.bool_)
        self._away[carriers.here] = False

    @property
    def triangles(self) -> IntArray:
        """Triangles (t, 3) whose tilts are the spins of their points, as nodes have none."""
        found: IntArray = self._tilts.triangles
        return found

    def begin(self) -> None:
        """Find the rates at the start of a step (collective)."""
        if self._used:
            self._carriers.rates(self.motion.rates, self.motion.spin_rates)
            self._carriers.share(self.motion.rates)
            place_tilts(self._tilts.memory, self.motion.before)
            add_spins(self._tilts.memory, self.motion.rates, self.motion.spin_rates)
            self._carriers.share(self.motion.spin_rates)

    def rates(self) -> tuple[FloatArray, FloatArray]:
        """Velocities and angular velocities (n, 3) of points at the trial state (collective)."""
        rates, spins = np.zeros((2, *self._steps.shape))
        self._carriers.rates(rates, spins)
        self._carriers.share(rates)
        add_spins(self._tilts.memory, rates, spins)
        self._carriers.share(spins)
        return rates, spins

    def update(self) -> None:
        """Find the spins of the step to the trial state (collective)."""
        motion = self.motion
        if self._used:
            place_tilts(self._tilts.memory, 0.5 * (motion.before + motion.after))
            self._carriers.spin(motion.spins)
            add_spins(self._tilts.memory, motion.after - motion.before, motion.spins)
            self._carriers.share(motion.spins)

    def of_steps(self, steps: FloatArray) -> FloatArray:
        """Changes of the spins (n, 3) by the blocks' steps, which move the points by ``steps``.

        Collective.
        """
        if self._used:
            self._carriers.turn(self._steps)
            add_spins(self._tilts.memory, steps, self._steps)
            self._carriers.share(self._steps)
        return self._steps

    def gather(self, couples: FloatArray, forces: FloatArray) -> None:
        """Add couples (n, 3) to those of the nodes' owners, and as forces on triangles."""
        if self._used:
            self._carriers.gather(couples)
            couples[self._away] = 0.0  # which their owners have
            spread_couples(self._tilts.memory, couples, forces)

    def add_couples(self, kind: int, couples: FloatArray) -> None:
        """Add gathered couples (n, 3) over a step to a block's residual."""
        if self._used:
            self._carriers.add_couples(kind, couples)


def _still(carriers: Carriers) -> BoolArray:
    """Points (n,) fixed to nodes without rotations."""
    still = np.zeros(len(carriers.serial.start), dtype=np.bool_)
    kinds = [kind for kind, one in carriers.by_kind.items() if not one.turns]
    still[: carriers.serial.carried] = np.isin(carriers.serial.kind, kinds)
    return still
