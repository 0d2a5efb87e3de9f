# SPDX-License-Identifier: LGPL-3.0-or-later
"""Profiles of disk cams as periodic splines: pitch curves of rollers, support functions of planes.

Both are sampled densely on the profile and interpolated by periodic cubic splines, whose error is
of fourth order in the distance of samples.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from flexfem import _checks
from flexfem._faults import FAILURES, located
from flexfem._types import FloatArray

__all__ = ["pitch_curve", "profile_spline", "spline_pieces", "support_curve"]

#: Pieces of a spline, and samples of the profile from which their ends are interpolated.
_PIECES, _SAMPLES = 720, 5760
#: Distance of the first and the last point, relative to the size, that makes one of them of both.
_SAME = 1e-9


def profile_spline(owner: str, profile: Any) -> Any:
    """Periodic spline of the points (x, y) of a profile, by a parameter from 0 to 2 pi.

    Args:
        owner: the cam in messages.
        profile: function of the angle (rad) that returns the radius (m), or points (n, 2).

    Raises:
        TypeError: a function does not return numbers.
        ValueError: it fails, radii are not positive, or points do not surround the centre.
    """
    from scipy.interpolate import CubicSpline

    if callable(profile):
        angles = np.linspace(0.0, 2.0 * np.pi, _SAMPLES + 1)
        radii = _radii(owner, profile, angles)
        points = radii[:, np.newaxis] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        points[-1] = points[0]
        return CubicSpline(angles, points, bc_type="periodic")
    points = np.asarray(profile)
    if np.linalg.norm(points[-1] - points[0]) > _SAME * np.abs(points).max():
        points = np.concatenate([points, points[:1]])
    points[-1] = points[0]
    if len(points) < 5:
        raise ValueError(f"{owner}: profile must have four points at least, got {len(points) - 1}")
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    if (np.diff(way) <= 0.0).any():
        raise ValueError(f"{owner}: neighbours of profile must be at different places")
    return CubicSpline(way * (2.0 * np.pi / way[-1]), points, bc_type="periodic")


def _radii(owner: str, profile: Callable[[float], Any], angles: FloatArray) -> FloatArray:
    """Radii of a profile, m, the same at both ends of a turn."""
    try:
        found = [_checks.returned_number("profile", profile(float(angle))) for angle in angles]
    except FAILURES as error:
        raise ValueError(f"{owner}: profile: {located(profile, error)}") from error
    radii = np.array(found)
    if not (np.isfinite(radii).all() and radii.min() > 0.0):
        at = int(np.argmin(np.nan_to_num(radii, nan=-np.inf)))
        raise ValueError(
            f"{owner}: profile must be positive, got {radii[at]:.6g} at {angles[at]:.6g} rad"
        )
    if abs(radii[-1] - radii[0]) > 1e-6 * radii[0]:
        raise ValueError(
            f"{owner}: profile must close after a turn, got {radii[0]:.6g} and {radii[-1]:.6g} m"
        )
    return radii


def _samples(curve: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points of a profile, unit normals outwards and curvatures (positive: convex), (n, ...)."""
    at = np.linspace(0.0, 2.0 * np.pi, _SAMPLES, endpoint=False)
    points, first, second = curve(at), curve(at, 1), curve(at, 2)
    speed = np.linalg.norm(first, axis=1)
    normals = np.stack([first[:, 1], -first[:, 0]], axis=1) / speed[:, np.newaxis]
    bends = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / speed**3
    return points, normals, bends


def pitch_curve(owner: str, curve: Any, radius: float) -> FloatArray:
    """Radii (m) of the path of a roller's centre around the cam at equal angles from -pi to pi.

    Args:
        owner: the cam in messages.
        curve: spline of the profile.
        radius: of the roller, m; zero for a point.

    Raises:
        ValueError: the profile does not surround the centre once counter-clockwise, or has hollows
            that bend more than the roller.
    """
    points, normals, bends = _samples(curve)
    if radius > 0.0 and (1.0 + radius * bends).min() <= 0.0:
        raise ValueError(
            f"{owner}: radius of {radius:.6g} m must be less than that of the hollows of the "
            f"profile, {-1.0 / bends.min():.6g} m"
        )
    points = points + radius * normals
    angles = np.unwrap(np.arctan2(points[:, 1], points[:, 0]))
    steps = np.diff(np.concatenate([angles, angles[:1] + 2.0 * np.pi]))
    if (steps <= 0.0).any() or abs(angles[-1] + steps[-1] - angles[0] - 2.0 * np.pi) > 1e-9:
        raise ValueError(
            f"{owner}: profile must surround the marker once, counter-clockwise about the axis, "
            "each direction from there meeting it once"
        )
    return _at_equal_angles(angles, np.linalg.norm(points, axis=1))


def support_curve(owner: str, curve: Any) -> FloatArray:
    """Distances (m) of tangent planes from the centre at equal angles of their normals.

    Raises:
        ValueError: the profile is not convex, so that a plane cannot follow it.
    """
    points, normals, bends = _samples(curve)
    if bends.min() <= 0.0:
        raise ValueError(
            f"{owner}: profile must be convex for a flat follower, and counter-clockwise about the "
            f"axis; it has a curvature of {bends.min():.6g} 1/m"
        )
    angles = np.unwrap(np.arctan2(normals[:, 1], normals[:, 0]))
    return _at_equal_angles(angles, np.einsum("ni,ni->n", points, normals))


def _at_equal_angles(angles: FloatArray, values: FloatArray) -> FloatArray:
    """Values of a periodic function at equal angles, from those at increasing ones."""
    from scipy.interpolate import CubicSpline

    closed = np.append(angles, angles[0] + 2.0 * np.pi), np.append(values, values[0])
    found = CubicSpline(*closed, bc_type="periodic")
    at = np.linspace(-np.pi, np.pi, _PIECES, endpoint=False)
    return np.asarray(found(angles[0] + (at - angles[0]) % (2.0 * np.pi)))


def spline_pieces(values: FloatArray) -> FloatArray:
    """Coefficients (n, 4), constant first, of the periodic cubic spline through such values."""
    from scipy.interpolate import CubicSpline

    at = np.linspace(-np.pi, np.pi, len(values) + 1)
    spline = CubicSpline(at, np.append(values, values[0]), bc_type="periodic")
    return np.ascontiguousarray(spline.c[::-1].T)
