# SPDX-License-Identifier: LGPL-3.0-or-later
"""Data of a curve in a file, and the curve made of it."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexfem._types import FloatArray
from flexfem.mesh.nurbs.basis import greville
from flexfem.mesh.nurbs.checks import MAX_DEGREE
from flexfem.mesh.nurbs.curve import NurbsCurve

__all__ = ["CurveParts", "finished"]

#: Knots closer than this, relative to the range of the parameter, are one.
_SAME = 1e-12


@dataclass(frozen=True)
class CurveParts:
    """A curve as its file has it.

    Attributes:
        number: Its number in the file.
        name: Of the curve, "" without one.
        degree: Of the basis.
        knots: Clamped or not, shape (n + p + 1,).
        points: Control points, metres, shape (n, 3).
        weights: Of the control points, shape (n,).
        ends: Parameters where the curve begins and ends; None for the whole of it.
    """

    number: str
    name: str
    degree: int
    knots: FloatArray
    points: FloatArray
    weights: FloatArray
    ends: tuple[float, float] | None = None


def finished(path: Path, parts: CurveParts) -> NurbsCurve:
    """Return the curve with clamped knots between its ends.

    Raises:
        ValueError: It is none of those that `NurbsCurve` can be.
    """
    owner = f'curve file "{path}": curve {parts.number}'
    p, t, n = parts.degree, parts.knots, len(parts.points)
    if not 1 <= p <= MAX_DEGREE:
        raise ValueError(f"{owner}: degree must be between 1 and {MAX_DEGREE}, got {p}")
    if n < p + 1 or len(t) != n + p + 1 or len(parts.weights) != n:
        raise ValueError(
            f"{owner}: {n} points, {len(parts.weights)} weights and {len(t)} knots do not make a "
            f"curve of degree {p}"
        )
    size = t[-1] - t[0]
    if (np.diff(t) < 0.0).any() or not size > 0.0 or (parts.weights <= 0.0).any():
        raise ValueError(f"{owner}: knots must not decrease, and weights must be positive")
    first, last = (float(t[p]), float(t[n])) if parts.ends is None else parts.ends
    outside = first < t[p] - _SAME * size or last > t[n] + _SAME * size
    if outside or not last - first > _SAME * size:
        raise ValueError(f"{owner}: it has no part between the parameters {first:g} and {last:g}")
    inner = t[(t > first + _SAME * size) & (t < last - _SAME * size)]
    clamped = np.concatenate([np.full(p + 1, first), inner, np.full(p + 1, last)])
    points, weights = parts.points, parts.weights
    if len(clamped) != len(t) or np.abs(clamped - t).max() > _SAME * size:
        points, weights = _represented(parts, clamped)
        t = clamped
    try:
        return NurbsCurve(p, t, points, weights)
    except ValueError as error:
        raise ValueError(f"{owner}: {error}") from None


def _represented(parts: CurveParts, knots: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points and weights of the same curve, between the ends of knots whose basis holds it."""
    from scipy.interpolate import BSpline
    from scipy.sparse.linalg import splu

    p, w = parts.degree, parts.weights[:, np.newaxis]
    at = greville(p, knots)
    values = BSpline(parts.knots, np.hstack([w * parts.points, w]), p)(at)
    found = splu(BSpline.design_matrix(at, knots, p).tocsc()).solve(values)
    return found[:, :3] / found[:, 3:], found[:, 3]
