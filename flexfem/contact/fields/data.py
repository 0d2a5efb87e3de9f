# SPDX-License-Identifier: LGPL-3.0-or-later
"""Records of pairs of points and obstacles, and of their contact forces."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.kernels.records import Float1D, Float2D, Int1D, Record

__all__ = [
    "ARM", "BEND", "FIELDS", "GAP", "LOAD", "NORMAL", "POTENTIAL", "SLOPE", "FieldPairs",
    "FieldResponse", "FieldState",
]  # fmt: skip

#: Direction of the force on the point, inertial axes, 3 numbers.
NORMAL = 0
#: Place on the obstacle that gets the opposite force, in the axes of its carrier, m, 3 numbers.
ARM = 3
#: Distance less the touch distance at the end, m.
GAP = 6
#: Potential at the end, J.
POTENTIAL = 7
#: Stiffness along the normal, N/m: that of the tangent.
SLOPE = 8
#: For equilibria, as all that follows: the force, which turns with the obstacle; 0 for steps.
LOAD = 9
#: Derivative of the potential by the distance times the second one of the distance, inertial axes,
#: N/m, 9 numbers.
BEND = 12
#: Numbers of a pair that acts.
FIELDS = 21


class FieldPairs(Record):
    """Pairs of a point and an obstacle.

    Attributes:
        points: Rows of the positions, shape (m,).
        fields: Numbers of the obstacles, shape (m,).
        touch: Distance at which they touch, the radius of the point, shape (m,), metres.
        dhat: Gap below which they repel, shape (m,), metres.
        kappa: Stiffness of the barrier, shape (m,), N/m^3.
        weight: Area of the point, shape (m,), square metres.
    """

    points: Int1D
    fields: Int1D
    touch: Float1D
    dhat: Float1D
    kappa: Float1D
    weight: Float1D

    @property
    def count(self) -> int:
        """Number of pairs."""
        return len(self.points)


class FieldState(Record):
    """Where pairs are at one instant.

    Attributes:
        points: Positions of all points, shape (n, 3), metres.
        frames: Frames of the carriers of the obstacles, shape (f, 12).
        distance: Distance of each pair, negative inside of the obstacle, shape (m,), metres.
        arms: Closest point of the obstacle in the axes of its carrier, shape (m, 3), metres; NaN
            where it is not known, far away.
    """

    points: Float2D
    frames: Float2D
    distance: Float1D
    arms: Float2D


class FieldResponse(Record):
    """What pairs do at a trial state.

    Attributes:
        count: Number of pairs that act, shape (1,); they are the first rows of what follows.
        pairs: Their numbers, shape (m,).
        numbers: Normal, arm, gap, potential and tangent, shape (m, FIELDS).
        forces: Forces on the points, inertial axes, shape (m, 3), newtons.
    """

    count: Int1D
    pairs: Int1D
    numbers: Float2D
    forces: Float2D

    @classmethod
    def of(cls, pairs: FieldPairs) -> "FieldResponse":
        """Memory for the response of all pairs."""
        return cls(
            count=np.zeros(1, np.int64), pairs=np.empty(pairs.count, np.int64),
            numbers=np.empty((pairs.count, FIELDS)), forces=np.empty((pairs.count, 3)),
        )  # fmt: skip

    def rows(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """Numbers of the pairs that act (k,), their data (k, FIELDS) and forces (k, 3)."""
        k = int(self.count[0])
        return self.pairs[:k], self.numbers[:k], self.forces[:k]
