# SPDX-License-Identifier: LGPL-3.0-or-later
"""Records of pairs of points and obstacles.

An obstacle is carried by four points, its origin and one on each of its axes, at the same distance.
Places fixed to it are means of these, with weights whose sum is 1: they move, and a force on them
acts on the carrier, as those of the four points. Pairs are those of ``primitives.data`` with five
points, the one that touches and the four; what they do is a response with more numbers than those
of cells.
"""

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.primitives.data import Pairs
from flexfem.kernels.records import Float1D, Float2D, Record

__all__ = ["AXES", "CURVES", "FIELD_NUMBERS", "SHARES", "FieldPairs", "FieldState"]

#: Kind of the pairs, none of cells: the first side is one point.
_KIND = -1
#: Signed weights of the five points: 1, and those of the place on the obstacle less its sign.
SHARES = 11
#: For equilibria, as all that follows, 0 for steps: derivative of the potential by the distance
#: times the second one of the distance by positions, N/m, 9 numbers.
CURVES = 16
#: How the weights of a point change with its position, for the points on the axes, 1/m, 9 numbers.
AXES = 25
#: Numbers of a pair that acts; the first ones are those of ``primitives.data``.
FIELD_NUMBERS = 34


@dataclass(frozen=True)
class FieldPairs:
    """Pairs of a point and an obstacle, each a group.

    Attributes:
        pairs: With the five points, shape (m, 5), in the order of the points.
        fields: Numbers of the obstacles, shape (m,).
    """

    pairs: Pairs
    fields: IntArray

    @classmethod
    def of(
        cls, points: IntArray, fields: IntArray, weight: FloatArray, touch: FloatArray,
        dhat: FloatArray, kappa: FloatArray,
    ) -> "FieldPairs":  # fmt: skip
        """Pairs with points (m, 5) and the attributes of ``Pairs``."""
        count = len(fields)
        pairs = Pairs(
            kind=np.full(count, _KIND), points=np.ascontiguousarray(points),
            weight=weight, touch=touch, dhat=dhat, kappa=kappa, starts=np.arange(count + 1),
            keys=points[:, 0] * (fields.max(initial=0) + 1) + fields,
        )  # fmt: skip
        return cls(pairs, fields)

    @property
    def count(self) -> int:
        """Number of pairs."""
        return len(self.fields)


class FieldState(Record):
    """Where pairs are at one instant.

    Attributes:
        points: Positions of all points, shape (n, 3), metres.
        distance: Distance of each pair, negative inside of the obstacle, shape (m,), metres.
        feet: Weights of the closest point of the obstacle, shape (m, 4); NaN where it is not known,
            far away.
        places: Weights of the point itself, shape (m, 4).
    """

    points: Float2D
    distance: Float1D
    feet: Float2D
    places: Float2D
