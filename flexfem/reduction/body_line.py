# SPDX-License-Identifier: LGPL-3.0-or-later
"""Smooth lines of bodies, on which sliders run."""

from dataclasses import dataclass

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.core.marker import line_points

__all__ = ["BodyLine", "rest_axes"]


@dataclass(frozen=True, eq=False)
class BodyLine:
    """Places along a line of an elastic body, and their displacement per coordinate of the body.

    Attributes:
        points: (p, 3) at rest from the line's start to its end, body axes, m; two at least.
        displacement: (p, 3, n) displacement of the points per coordinate, in nonlinear bodies also
            per product of rotations, see ``ElasticPolynomial``.
        rotation: (p, 3, n) small rotation of the body there per coordinate, body axes.
    """

    points: FloatArray
    displacement: FloatArray
    rotation: FloatArray

    def __post_init__(self) -> None:
        """Check the arrays against each other.

        Raises:
            TypeError: an array does not consist of numbers.
            ValueError: shapes that do not belong together, values that are not finite, fewer than
                two points, or neighbours at one place.
        """
        points = line_points("BodyLine", self.points)
        shape = (len(points), 3, -1)
        moves = _checks.array("BodyLine", "displacement", self.displacement, shape)
        turns = _checks.array("BodyLine", "rotation", self.rotation, moves.shape)
        _checks.assign(self, points=points, displacement=moves, rotation=turns)

    @property
    def arrays(self) -> dict[str, FloatArray]:
        """All arrays by name."""
        names = ("points", "displacement", "rotation")
        return {name: getattr(self, name) for name in names}


def rest_axes(tangents: FloatArray) -> FloatArray:
    """Axes (p, 3, 3) along a line: the first along it, with the smallest rotation along the way."""
    x = tangents / np.linalg.norm(tangents, axis=1)[:, np.newaxis]
    y = np.cross(np.eye(3)[np.argmin(np.abs(x[0]))], x[0])
    axes = np.empty((len(x), 3, 3))
    for i, e1 in enumerate(x):
        y = y - e1 * (e1 @ y)
        y /= np.linalg.norm(y)
        axes[i] = np.stack([e1, y, np.cross(e1, y)], axis=1)
    return axes
