# SPDX-License-Identifier: LGPL-3.0-or-later
"""Data of the cables of a rank."""

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray

__all__ = ["Cables"]


@dataclass(frozen=True)
class Cables:
    """Cables of this rank.

    Attributes:
        nodes: (m, 2) local nodes.
        numbers: (m, 6) of :mod:`flexfem.families.cable_net.kernels`.
        mass: (m,) of the cables, kg; fittings: (m, 2) masses at their nodes that they bring along.
        body: (m,) number of the body.
    """

    nodes: IndexArray
    numbers: FloatArray
    mass: FloatArray
    fittings: FloatArray
    body: IntArray

    def measured(self, loop: object, *state: FloatArray | float) -> FloatArray:
        """Numbers (m,) of the cables that a loop finds in a state."""
        out = np.empty(len(self.nodes))
        loop(self.nodes, self.numbers, *state, out)  # type: ignore[operator]  # a compiled loop
        return out
