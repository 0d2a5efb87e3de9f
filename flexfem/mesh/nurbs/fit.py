# SPDX-License-Identifier: LGPL-3.0-or-later
"""Splines through and close to given points and functions."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.mesh.geometry.frames import CORNER_ANGLE
from flexfem.mesh.nurbs.basis import clamped, greville, uniform_knots
from flexfem.mesh.nurbs.checks import OWNER, count
from flexfem.mesh.nurbs.refine import Basis, interpolate

# A function is compared with its fit at this many places of each element
_SAMPLES = 12
# Number of elements at which the search ends
_MOST_ELEMENTS = 5000
# Distances from a straight line relative to coordinates that are taken for rounding errors
_ROUND_OFF = 1e-14


class Path:
    """Data that a curve is fitted to: a function of [0, 1] or points in order."""

    def __init__(self, path: Callable[[FloatArray], npt.ArrayLike] | npt.ArrayLike) -> None:
        """Take a function of u (n,) that returns points (n, 3), or the points.

        Raises:
            TypeError: neither a function nor numbers.
            ValueError: points of a wrong shape, or neighbours that coincide.
        """
        self.function = path if callable(path) else None
        self.points = np.zeros((0, 3)) if callable(path) else check_points(path)

    def at(self, u: FloatArray) -> FloatArray:
        """Return the values of the function at u (n,), shape (n, 3)."""
        assert self.function is not None
        return _checks.array(OWNER, "result of the function", self.function(u), (len(u), 3))

    def samples(self, breaks: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return parameters (n,) and points (n, 3) for comparison with elements."""
        if self.function is None:
            return chord_parameters(self.points), self.points
        inside = np.linspace(0.0, 1.0, _SAMPLES, endpoint=False)
        u = np.append(breaks[:-1, None] + np.diff(breaks)[:, None] * inside, breaks[-1])
        return u, self.at(u)


def check_points(points: npt.ArrayLike) -> FloatArray:
    """Return at least two points, of which no neighbours coincide.

    Raises:
        TypeError: they do not consist of numbers.
        ValueError: wrong shape, too few, or neighbours that coincide.
    """
    x = _checks.array(OWNER, "points", points, (-1, 3))
    if len(x) < 2:
        raise ValueError(f"{OWNER}: two points are needed at least, got {len(x)}")
    same = np.linalg.norm(np.diff(x, axis=0), axis=1) <= 1e-12 * np.ptp(x, axis=0).max()
    if same.any():
        i = int(np.argmax(same))
        raise ValueError(
            f"{OWNER}: points {i} and {i + 1} coincide at {_checks.show(x[i].tolist())}"
        )
    return x


def chord_parameters(points: FloatArray) -> FloatArray:
    """Return the chord lengths from the first point over the whole one, shape (n,)."""
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    result: FloatArray = along / along[-1]
    return result


def corner_points(points: FloatArray, corners: Sequence[int] | None) -> IntArray:
    """Return the indices of corners in order: the given ones, or the sharp turns.

    Raises:
        ValueError: a given one is no inner point.
    """
    if corners is None:
        chords = np.diff(points, axis=0)
        chords /= np.linalg.norm(chords, axis=1)[:, None]
        cosines = np.einsum("ij,ij->i", chords[:-1], chords[1:])
        return np.flatnonzero(cosines < np.cos(CORNER_ANGLE)).astype(np.int64) + 1
    for i in corners:
        if not 0 < count("corners", i) < len(points) - 1:
            raise ValueError(f"{OWNER}: corner {i} is no inner point of {len(points)}")
    return np.unique(np.asarray(corners, dtype=np.int64))


def through(points: FloatArray, degree: int, corners: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return knots and control points of the curve through points; see `NurbsCurve.through`."""
    u = chord_parameters(points)
    ends = np.concatenate([[0], corners, [len(points) - 1]])
    knots, control = [np.repeat(0.0, degree + 1)], [points[:1]]
    for first, last in pairwise(ends):
        piece = slice(first, last + 1)
        coefficients = _interpolating(u[piece], points[piece], degree)
        knots += [u[first + 1 : last], np.repeat(u[last], degree)]
        control.append(coefficients[1:])
    return np.concatenate([*knots, u[-1:]]), np.concatenate(control)


def _interpolating(u: FloatArray, points: FloatArray, degree: int) -> FloatArray:
    """Return the coefficients of the smooth spline through points with the knots u inside.

    The deviation from the chord is interpolated, so that a straight line is exact.
    """
    knots = clamped(degree, u)
    along = ((greville(degree, knots) - u[0]) / (u[-1] - u[0]))[:, None]
    line = (1.0 - along) * points[0] + along * points[-1]
    place = ((u - u[0]) / (u[-1] - u[0]))[:, None]
    rest = points - (1.0 - place) * points[0] - place * points[-1]
    rest[np.abs(rest) <= _ROUND_OFF * np.abs(points).max()] = 0.0
    if not rest.any():  # a straight line, as members of trusses are: nothing to solve for
        bend = np.zeros_like(line)
    elif len(u) <= degree:
        from scipy.interpolate import make_interp_spline

        m = len(u) - 1
        ends = np.repeat(u[[0, -1]], m + 1)
        polynomial = make_interp_spline(u, rest, k=m, t=ends)
        bend = interpolate((degree, knots), polynomial(greville(degree, knots)))
    else:
        bend = _least_jumps(u, rest, degree, knots)
    result: FloatArray = line + bend
    result[[0, -1]] = points[[0, -1]]
    return result


def _least_jumps(u: FloatArray, values: FloatArray, degree: int, knots: FloatArray) -> FloatArray:
    """Return the interpolating spline whose p-th derivative has the least jumps at the knots.

    The conditions of the constrained least-squares problem, with the jumps as unknowns too.
    """
    from scipy import sparse
    from scipy.interpolate import BSpline
    from scipy.sparse.linalg import spsolve

    at_points = BSpline.design_matrix(u, knots, degree)
    size = at_points.shape[1]
    slope: Any = sparse.identity(size, format="csr")
    for q in range(degree, 0, -1):
        # Differences of the coefficients are the coefficients of the derivative
        s = degree - q
        gap = knots[s + 1 + q : len(knots) - s - 1] - knots[s + 1 : len(knots) - s - 1 - q]
        slope = sparse.diags_array(np.mean(np.diff(u)) / gap) @ (slope[1:] - slope[:-1])
    jumps = slope[1:] - slope[:-1]
    system = sparse.block_array(
        [
            [sparse.identity(jumps.shape[0]), -jumps, None],
            [-jumps.T, None, at_points.T],
            [None, at_points, None],
        ],
        format="csc",
    )
    known = np.zeros((system.shape[0], values.shape[1]))
    known[-len(u) :] = values
    solution = np.asarray(spsolve(system, known))
    return solution[jumps.shape[0] : jumps.shape[0] + size]


def fit(
    path: Path, degree: int, elements: object, tolerance: object
) -> tuple[FloatArray, FloatArray]:
    """Return knots and control points of a curve close to a path; see `NurbsCurve.fit`."""
    from scipy.interpolate import BSpline

    if elements is None and tolerance is None:
        raise ValueError(f"{OWNER}: fit needs elements or tolerance")
    allowed = np.inf
    if tolerance is not None:
        allowed = _checks.number(OWNER, "tolerance", tolerance, positive=True)
    number = 1 if elements is None else count("elements", elements)
    most = _MOST_ELEMENTS
    if path.function is None:
        most = len(path.points) - degree
    while True:
        basis = degree, uniform_knots(degree, number)
        points = _fitted(path, basis)
        error = deviation(path, np.unique(basis[1]), BSpline(basis[1], points, degree))
        if error <= allowed:
            return basis[1], points
        if elements is not None or number >= most:
            raise ValueError(
                f"{OWNER}: {number} elements of degree {degree} miss the path by {error:.3g} m, "
                f"tolerance is {allowed:g}"
            )
        number = min(number + max(number // 2, 1), most)


def _fitted(path: Path, basis: Basis) -> FloatArray:
    """Return the control points of the curve on the given basis."""
    if path.function is not None:
        return interpolate(basis, path.at(greville(*basis)))
    from scipy.interpolate import BSpline

    degree, knots = basis
    size = len(knots) - degree - 1
    x = path.points
    matrix = BSpline.design_matrix(chord_parameters(x), knots, degree).toarray()
    fixed = matrix[:, [0]] * x[0] + matrix[:, [-1]] * x[-1]
    inside, _, rank, _ = np.linalg.lstsq(matrix[:, 1:-1], x - fixed, rcond=None)
    if len(x) < size or rank < size - 2:
        raise ValueError(
            f"{OWNER}: {len(x)} points are too few for {size - degree} elements of degree {degree}"
        )
    return np.concatenate([x[:1], inside, x[-1:]])


def deviation(
    path: Path, breaks: FloatArray, position: Callable[[FloatArray], FloatArray]
) -> float:
    """Return the largest distance of a path from a curve at the same parameters, metres.

    Args:
        path: Function or points.
        breaks: Ends of the curve's elements, from 0 to 1.
        position: Function of parameters (n,) that returns points of the curve, shape (n, 3).
    """
    u, x = path.samples(breaks)
    return float(np.linalg.norm(position(u) - x, axis=1).max())
