# SPDX-License-Identifier: LGPL-3.0-or-later
"""Signed distances of surfaces that users write, and the closest points of these surfaces.

Of an exact distance phi with the gradient n the closest point is c = x - phi n: phi(c) = 0 proves
it, since no point of the surface is nearer than |phi|. Other functions, as smooth unions of
several shapes, are near a distance only. There c moves along the tangent plane to the foot of x,
and back onto the surface along its normal, until x - c is normal (foot points: Hartmann, On the
curvature of curves and surfaces defined by normalforms, 1999). What counts is the way to c, the
true distance of the surface, not the value of the function. The length of the steps follows from
the last one (Barzilai and Borwein, Two-point step size gradient methods, 1988), as the curvature of
the surface is not known.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import FunctionType
from typing import TYPE_CHECKING, Any

import numpy as np

from flexfem import _checks
from flexfem._faults import FAILURES, ReturnError, located, noted
from flexfem._types import BoolArray, FloatArray

if TYPE_CHECKING:
    from flexfem.kernels.users.ufl_function import UFLFunction

__all__ = ["SignedDistance"]

#: Step of differences in parts of the size: what it cuts off is as large as round-off.
_DIFFERENCE = 6e-6
#: Weights of differences of second and of fourth order.
_COARSE, _FINE = np.array([0.5]), np.array([2.0, -0.25]) / 3.0
#: Value at c, in parts of that at x, below which c is the closest point.
_EXACT = 1e-9
#: Round-off of values in parts of the size.
_ROUND = 1e-14
#: Newton steps onto the surface, and steps along it, at most.
_ONTO, _ALONG = 30, 60
#: Way along the surface, in parts of the distance, at which c is found: the distance changes by the
#: square of it.
_SETTLED = 3e-8
#: Least part of a step along the surface, where it has an edge.
_LEAST = 1e-3
#: Samples of the checks along an edge of the box, and of the surface.
_GRID, _SAMPLES = 12, 200
#: Height over the surface, in parts of the size, at which its slope is checked, and bounds of it.
_HEIGHT, _LOWEST, _HIGHEST = 1e-3, 0.5, 2.0


class SignedDistance:
    """A signed distance, positive outside, and its surface.

    Attributes:
        owner: for messages.
        function: of points (k, 3), m, which returns distances (k,), m; or of a UFL vector, which
            returns a UFL scalar.
    """

    def __init__(self, owner: str, function: Callable[[Any], Any], box: FloatArray) -> None:
        """Check a function on a grid in a box.

        Args:
            owner: for messages.
            function: the function.
            box: lowest and highest coordinates (2, 3) of the surface, or of a part of it, m.

        Raises:
            ValueError: it fails, returns something else, has no surface in the box, or its slope
                there is not near 1.
        """
        self.owner, self.function = owner, function
        self._size = float(np.linalg.norm(box[1] - box[0]))
        self._compiled: UFLFunction | None = None
        try:
            if _in_ufl(function):
                self._compiled = _compiled(function)
            self._check(box)
        except ReturnError as error:
            raise ValueError(f"{owner}: {located(function, error)}") from None
        except FAILURES as error:
            raise ValueError(f"{owner}: distance: {located(function, error)}") from error

    def values(self, points: FloatArray) -> FloatArray:
        """Values (k,) at points (k, 3), m; NaN where the function fails in a run."""
        try:
            return self._values(points)
        except FAILURES as error:
            noted(self.owner, self.function, error)
            return np.full(len(points), np.nan)

    def gradients(self, points: FloatArray, *, fine: bool = True) -> FloatArray:
        """Gradients (k, 3) at points (k, 3): exact in UFL, otherwise by central differences.

        Fine ones are of fourth order: at a small distance from an edge the normal turns much in a
        step, and closest points beside the edge are farther away to first order.
        """
        weights = _FINE if fine else _COARSE
        if self._compiled is None:
            return self._differences(points, weights)
        found = self._compiled.evaluate(1, np.ascontiguousarray(points))
        # derivatives of roots are infinite where the function still has a slope on average
        bad = ~np.isfinite(found).all(axis=1)
        found[bad] = self._differences(points[bad], weights)
        return found

    def closest(
        self, points: FloatArray, reach: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Distances (k,) of the surface, positive outside, and its closest points (k, 3).

        Where no way leads to the surface, the distance is the value and the point NaN; so they are
        where the value says that the surface is farther away than ``reach`` (k,), m.
        """
        values = self.values(points)
        if reach is None:
            return self._closest(points, values)
        near = ~(values > _HIGHEST * reach)
        distances, feet = values.copy(), np.full(points.shape, np.nan)
        distances[near], feet[near] = self._closest(points[near], values[near])
        return distances, feet

    def _closest(self, points: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The same at points with known values (k,)."""
        normals, slopes = _units(self.gradients(points))
        feet = points - values[:, None] * normals
        left = self.values(feet)
        exact = np.abs(left) <= _EXACT * np.abs(values) + self._round(points)
        for _ in range(2):
            feet[exact] -= (left / slopes)[exact, None] * normals[exact]
            left[exact] = self.values(feet[exact])
        rest = ~exact & np.isfinite(values)
        if rest.any():
            feet[rest] = self._foot(points[rest], feet[rest])
        lost = np.isnan(feet).any(axis=1)
        ways = np.linalg.norm(points - feet, axis=1)
        return np.where(lost, values, np.copysign(ways, values)), feet

    def lost(self, point: FloatArray, value: float) -> ReturnError:
        """Error for a point near the surface whose closest point is not found."""
        return ReturnError(
            f"distance leads to no surface from {_place(point)}, where it is {value:.4g} m"
        )

    def _round(self, points: FloatArray) -> FloatArray:
        """Round-off (k,) of values at points (k, 3), m."""
        return _ROUND * (self._size + np.abs(points).max(axis=1, initial=0.0))

    def _values(self, points: FloatArray) -> FloatArray:
        """Values of finite size, or an exception."""
        if not len(points):
            return np.zeros(0)
        if self._compiled is None:
            given = self.function(np.array(points))
            found = _checks.returned("distance", given, (len(points),))
        else:
            found = self._compiled.evaluate(0, np.ascontiguousarray(points))[:, 0]
        if not np.isfinite(found).all():
            row = int(np.argmin(np.isfinite(found)))
            raise ReturnError(f"distance is {found[row]} at {_place(points[row])}")
        return np.array(found, dtype=np.float64)

    def _differences(self, points: FloatArray, weights: FloatArray) -> FloatArray:
        """Central differences by coordinates, of the values at one step, two steps, and so on."""
        step = _DIFFERENCE * self._size
        steps = step * (1.0 + np.arange(len(weights)))
        moves = np.stack([s * np.eye(3) for s in (*steps, *-steps)])
        found = self.values((points[:, None, None] + moves).reshape(-1, 3))
        ends = found.reshape(-1, 2, len(weights), 3)
        slopes: FloatArray = np.einsum("w,kwa->ka", weights, ends[:, 0] - ends[:, 1]) / step
        return slopes

    def _onto(self, points: FloatArray) -> FloatArray:
        """Points of the surface (k, 3) near others, by Newton's method; NaN where it fails."""
        found, current = points.copy(), points.copy()
        left, least = np.ones(len(points), dtype=np.bool_), np.full(len(points), np.inf)
        for _ in range(_ONTO):
            rows = np.flatnonzero(left)
            if not len(rows):
                break
            values, round_off = self.values(current[rows]), self._round(current[rows])
            better = np.abs(values) < least[rows]
            found[rows[better]] = current[rows[better]]
            least[rows[better]] = np.abs(values[better])
            on = np.abs(values) <= 0.03 * round_off
            left[rows] = ~on & (better | (least[rows] > round_off))
            normals, slopes = _units(self.gradients(current[rows], fine=False))
            current[rows] -= (values / slopes)[:, None] * normals
        found[~(least <= 1e3 * self._round(found))] = np.nan
        return found

    def _foot(self, points: FloatArray, start: FloatArray) -> FloatArray:
        """Foot points (k, 3) of points on the surface; NaN where no way leads to it."""
        feet = self._onto(start)
        way, part = np.linalg.norm(points - feet, axis=1), np.ones(len(points))
        old, left = np.full((2, len(points), 3), np.nan), np.isfinite(way)
        for _ in range(_ALONG):
            rows = np.flatnonzero(left)
            if not len(rows):
                break
            normals, _ = _units(self.gradients(feet[rows], fine=False))
            along = points[rows] - feet[rows]
            along -= np.einsum("ka,ka->k", along, normals)[:, None] * normals
            part[rows] = _part(part[rows], feet[rows] - old[0, rows], old[1, rows] - along)
            old[0, rows], old[1, rows] = feet[rows], along
            trial = self._onto(feet[rows] + part[rows, None] * along)
            found = np.linalg.norm(points[rows] - trial, axis=1)
            nearer = found < way[rows]
            moves = np.linalg.norm(along, axis=1) > _SETTLED * way[rows]
            feet[rows[nearer]], way[rows[nearer]] = trial[nearer], found[nearer]
            part[rows[~nearer]] *= 0.25
            left[rows] = moves & (part[rows] > _LEAST)
        return feet

    def _check(self, box: FloatArray) -> None:
        """Raise a ReturnError unless a surface of slope 1 lies in the box."""
        cell = (box[1] - box[0]) / _GRID
        steps = [box[0, a] + cell[a] * (np.arange(_GRID) + 0.5) for a in range(3)]
        points = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
        sizes = np.abs(self._values(points))
        near = np.argsort(sizes, kind="stable")[:_SAMPLES]
        near = near[sizes[near] <= _HIGHEST * np.linalg.norm(cell)]
        if not len(near):
            raise ReturnError(
                f"distance has no surface in the box from {_place(box[0])} to {_place(box[1])}: "
                f"it is {sizes.min():.3g} m there at least"
            )
        values, feet = self.closest(points[near])
        found = np.isfinite(feet).all(axis=1)
        if not found.any():
            raise self.lost(points[near[0]], values[0])
        self._check_slopes(points[near][found], feet[found])

    def _check_slopes(self, points: FloatArray, feet: FloatArray) -> None:
        """Raise where the value does not grow like the distance."""
        ways = points - feet
        lengths = np.linalg.norm(ways, axis=1)
        seen = lengths > _DIFFERENCE * self._size
        feet, ways, lengths = feet[seen], ways[seen], lengths[seen]
        heights = np.minimum(_HEIGHT * self._size, lengths)
        slopes = np.abs(self._values(feet + (heights / lengths)[:, None] * ways)) / heights
        bad: BoolArray = ~((slopes > _LOWEST) & (slopes < _HIGHEST))
        if bad.any():
            row = int(np.argmax(bad))
            raise ReturnError(
                f"distance changes by {slopes[row]:.3g} m per metre at {_place(feet[row])} of its "
                "surface, it must be a distance: divide it by the size of its gradient"
            )


def _in_ufl(function: Callable[[Any], Any]) -> bool:
    """Return True for a function that names something of UFL."""
    if "ufl" not in sys.modules or not isinstance(function, FunctionType):
        return False
    from flexfem.kernels.users.ufl_function import uses_ufl

    return uses_ufl(function)


def _compiled(function: Callable[[Any], Any]) -> UFLFunction:
    """Value and gradient of a function in UFL."""
    from flexfem.kernels.users.ufl_function import UFLFunction

    return UFLFunction.of_vector("distance", function, 3)


def _part(part: FloatArray, moved: FloatArray, turned: FloatArray) -> FloatArray:
    """Parts (k,) of the next steps along the surface, from what the last ones have done.

    Args:
        part: those to take where no step was made.
        moved: way of the foot points (k, 3), NaN before the first step.
        turned: by which what is to go became shorter (k, 3).
    """
    squares = np.einsum("ka,ka->k", moved, moved)
    shorter = np.einsum("ka,ka->k", moved, turned)
    known = (squares > 0.0) & (shorter > 0.0)
    found: FloatArray = np.where(
        known, np.clip(squares / np.where(known, shorter, 1.0), 0.01, 100.0), part
    )
    return found


def _units(vectors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Directions (k, 3) of vectors, z where one vanishes, and their lengths, which are not 0."""
    sizes = np.linalg.norm(vectors, axis=1)
    flat = ~(sizes > 1e-6)
    sizes = np.where(flat, 1.0, sizes)
    units = vectors / sizes[:, None]
    units[flat] = [0.0, 0.0, 1.0]
    return units, sizes


def _place(point: FloatArray) -> str:
    return "({:.4g}, {:.4g}, {:.4g})".format(*point)
