# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of the parts of a NURBS curve."""

import numpy as np

from flexfem import _checks
from flexfem._memory import LINE_NODE, check_run
from flexfem._types import FloatArray
from flexfem.mesh.nurbs.basis import bernstein_powers, extraction, knot_spans, power_table, rational

#: Subject of the messages
OWNER = "NurbsCurve"
#: Beyond it, coefficients in powers of xi lose too many digits
MAX_DEGREE = 7

# Smallest ratio of speeds inside an element, and of an element's speed to the curve's size
_STANDSTILL = 1e-8


def count(what: str, value: object) -> int:
    """Return a positive integer.

    Raises:
        TypeError: `value` is no integer.
        ValueError: `value` is not positive.
    """
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)):
        raise TypeError(f"{OWNER}: {what} must be an integer, got {_checks.show(value)}")
    _checks.countable(OWNER, what, int(value))
    if value < 1:
        raise ValueError(f"{OWNER}: {what} must be positive, got {value}")
    check_run(f"{OWNER}: a step with {value} {what}", float(value), LINE_NODE)
    return int(value)


def check_degree(value: object) -> int:
    """Return a degree between 1 and `MAX_DEGREE`.

    Raises:
        TypeError: `value` is no integer.
        ValueError: `value` is out of range.
    """
    degree = count("degree", value)
    if degree > MAX_DEGREE:
        raise ValueError(f"{OWNER}: degree must be {MAX_DEGREE} at most, got {degree}")
    return degree


def check_knots(degree: int, knots: object, points: int) -> FloatArray:
    """Return the knots of `points` control points.

    Raises:
        TypeError: the knots do not consist of numbers.
        ValueError: their number is wrong, they decrease, are not clamped, or one inside is
            repeated more than `degree` times.
    """
    t = _checks.array(OWNER, "knots", knots, (-1,))
    if points < degree + 1:
        raise ValueError(f"{OWNER}: degree {degree} needs {degree + 1} points, got {points}")
    if len(t) != points + degree + 1:
        raise ValueError(
            f"{OWNER}: {points} points of degree {degree} need {points + degree + 1} knots, "
            f"got {len(t)}"
        )
    if (np.diff(t) < 0.0).any():
        raise ValueError(f"{OWNER}: knots must not decrease, got {_checks.show(t.tolist())}")
    values, times = np.unique(t, return_counts=True)
    if len(values) < 2 or times[0] != degree + 1 or times[-1] != degree + 1:
        raise ValueError(
            f"{OWNER}: the first and the last knot must appear {degree + 1} times each, got "
            f"{_checks.show(t.tolist())}"
        )
    if times[1:-1].max(initial=0) > degree:
        worst = values[1:-1][np.argmax(times[1:-1])]
        raise ValueError(
            f"{OWNER}: a knot inside may appear {degree} times at most, got {worst:g} "
            f"{times[1:-1].max()} times"
        )
    return t


def check_speed(degree: int, knots: FloatArray, points: FloatArray, weights: FloatArray) -> None:
    """Check that the curve stands still nowhere.

    Raises:
        ValueError: the derivative vanishes at one of a number of places in each element.
    """
    spans = knot_spans(degree, knots)
    nodes = spans[:, None] + np.arange(-degree, 1)
    xi = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 2 * degree + 3))
    shape = weights[nodes][:, :, None] * (extraction(degree, knots) @ bernstein_powers(degree))
    weighted = np.einsum("dnj,mIj->dmnI", power_table(degree + 1, xi, 1), shape)
    slopes = np.einsum("mnI,mIc->mnc", rational(weighted)[1], points[nodes])
    speeds = np.linalg.norm(slopes, axis=-1)
    size = np.ptp(points, axis=0).max()
    still = speeds <= _STANDSTILL * np.maximum(speeds.max(axis=1), size * 1e-4)[:, None]
    if still.any():
        e, n = np.unravel_index(int(np.argmax(still)), still.shape)
        u = (1.0 - xi[n]) * knots[spans[e]] + xi[n] * knots[spans[e] + 1]
        raise ValueError(f"{OWNER}: the curve has a zero derivative at parameter {u:g}")


def check_order(degree: int, order: int) -> None:
    """Raise unless a continuity is a whole number between 0 and p - 1."""
    _checks.instance(OWNER, "continuity", order, int)
    if not 0 <= order < degree:
        raise ValueError(
            f"{OWNER}: continuity must lie between 0 and {degree - 1} at degree {degree}, got "
            f"{order}"
        )
