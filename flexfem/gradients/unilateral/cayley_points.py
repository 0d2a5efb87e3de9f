# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact points on nodes that rotate by Cayley vectors over a step, as energy-momentum has them.

Forces f over a step act as ``R1^T f`` and ``R1^T (s x f)`` with the mean arm ``s = (R0 + R1) a/2``,
see ``contact.obstacles.carried.add_over_cayley_step``. The spin of a step is ``R0 phi``, with the
Cayley vector phi, ``dphi = S theta_1 - S^T theta_0``, ``S = 1 + phi~/2 + phi phi^T/4``.
"""

from __future__ import annotations

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.carriers import CarriedPoints
from flexfem.gradients.equations.node_maps import applied, rotations, transposed
from flexfem.gradients.unilateral.point_maps import END, START, NodePoints
from flexfem.lie import so3

__all__ = ["CayleyPoints"]


class CayleyPoints(NodePoints):
    """Points of this rank on the nodes of one block, over a step; see the base class."""

    @classmethod
    def of(cls, carried: CarriedPoints) -> CayleyPoints:
        """Those of a block at the trial state of a step."""
        block, local = carried.block, carried.local
        phi = block.increment[local, 3:] * carried.turns
        S = np.eye(3) + 0.5 * so3.skew(phi) + 0.25 * np.einsum("ka,kb->kab", phi, phi)
        turns = np.stack([rotations(one[local]) for one in (block.frames0, block.frames)])
        return cls(carried, turns, phi, np.stack([-S.swapaxes(1, 2), S]))

    @property
    def _mean_arms(self) -> FloatArray:
        """(k, 3) in inertial axes, zero of nodes without rotations."""
        turns = self.turns[START] + self.turns[END]
        return 0.5 * self.carried.turns * applied(turns, self.carried.arms)

    def add_loads(self, forces: FloatArray, couples: FloatArray, out: FloatArray) -> None:
        """See :class:`NodePoints`."""
        moments = transposed(self.turns[END], np.cross(self._mean_arms, forces))
        every = [transposed(self.turns[END], forces), moments + self._mean(couples)]
        np.add.at(out, self.carried.local, np.concatenate(every, axis=1))

    def ways(self, twists: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See :class:`NodePoints`."""
        own = twists[self.carried.local]
        ways = applied(self.turns[END], own[:, :3])
        ways += np.cross(applied(self.turns[END], own[:, 3:]), self._mean_arms)
        turned = applied(self.turns[START] + self.turns[END], own[:, 3:])
        return ways, 0.5 * self.carried.turns * turned

    def turning(self, forces: FloatArray, couples: FloatArray) -> FloatArray:
        """See :class:`NodePoints`."""
        found = np.zeros((2, len(forces), 6, 3))
        if not self.carried.turns:
            return found
        last, arms = self.turns[END].swapaxes(1, 2), so3.skew(self.carried.arms)
        pull = last @ so3.skew(forces)
        for end in (START, END):
            found[end, :, 3:] = 0.5 * pull @ self.turns[end] @ arms
            found[end, :, 3:] += 0.5 * so3.skew(transposed(self.turns[end], couples))
        moments = transposed(self.turns[END], np.cross(self._mean_arms, forces))
        found[END, :, :3] = so3.skew(transposed(self.turns[END], forces))
        found[END, :, 3:] += so3.skew(moments)
        return found
