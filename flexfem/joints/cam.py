# SPDX-License-Identifier: LGPL-3.0-or-later
"""Disk cam and its follower."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from flexfem import _checks
from flexfem._fields import declared, number, one_of, settled, vector
from flexfem._types import FloatArray
from flexfem.core.joint import AxisJoint, unit
from flexfem.core.laws import limit
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term
from flexfem.core.user_function import FunctionKind, UserFunction
from flexfem.joints.cam_profile import pitch_curve, profile_spline, spline_pieces, support_curve

__all__ = ["Cam"]

_FOLLOWERS = ("point", "roller", "flat")


def _profile(owner: str, what: str, value: Any) -> Any:
    """Return a checked function of the angle, or points."""
    return value if callable(value) else _checks.array(owner, what, value, (-1, 2))


@declared
class Cam(AxisJoint):
    """Keeps marker b on the profile of a disk cam that turns with marker a; one constraint.

    The profile lies in the plane across the axis through marker a, which it surrounds; places along
    the axis do not matter. It is a smooth closed curve: a periodic cubic spline. The follower needs
    a guide, such as ``Prismatic``. With a stiffness it is pressed off by a spring where it would
    enter the cam, and may lift off.

    Attributes:
        axis: fixed in marker a, inertial axes at the start.
        profile: function of the angle (rad) about the axis that returns the radius (m), or points
            (n, 2) of the profile in the plane, counter-clockwise, m.
        zero: direction of the angle zero and of the first coordinate of points, inertial axes at
            the start.
        follower: "point", a knife edge at marker b; "roller", whose centre is marker b; "flat", a
            plane through marker b.
        radius: of the roller, m.
        normal: of a flat follower, away from the cam; fixed in marker b, inertial axes at the
            start.
        stiffness: N/m across the profile; None for a constraint, which pulls as well.
        damping: N s/m.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: an unknown follower, a radius without a roller, a normal without a flat
            follower, damping without stiffness; a profile that does not surround the marker, that
            a roller cannot follow, or a flat follower on one that is not convex.
    """

    profile: Callable[[float], float] | Sequence[Sequence[float]] | FloatArray = settled(
        default=None
    )
    zero: Sequence[float] = vector(default=(1.0, 0.0, 0.0), nonzero=True, as_given=True)
    follower: str = one_of(_FOLLOWERS, default="point")
    radius: float = number(default=0.0, nonnegative=True)
    normal: Sequence[float] | None = vector(default=None, nonzero=True, as_given=True)
    stiffness: float | None = number(default=None, positive=True)
    damping: float = number(default=0.0, nonnegative=True)

    def __post_init__(self) -> None:
        """Check the arguments against one another, and the profile."""
        super().__post_init__()
        _checks.assign(self, profile=_profile(self.owner, "profile", self.profile))
        for name, given, kind in (
            ("radius", self.radius > 0.0, "roller"), ("normal", self.normal is not None, "flat")
        ):  # fmt: skip
            if given != (self.follower == kind):
                raise ValueError(f"{self.owner}: {name} goes with a {kind} follower, only there")
        if self.damping and self.stiffness is None:
            raise ValueError(f"{self.owner}: damping needs a stiffness, got {self.damping:g} alone")
        if abs(float(np.dot(unit(self.zero), self.direction))) > 0.99:
            raise ValueError(f"{self.owner}: zero must be across the axis")
        _checks.assign(self, _pieces=self._curve())

    _pieces: ClassVar[FloatArray]

    def _curve(self) -> FloatArray:
        """Coefficients of the spline of the radius, or of the distance of the plane, by angle."""
        curve = profile_spline(self.owner, self.profile)
        if self.follower == "flat":
            return spline_pieces(support_curve(self.owner, curve))
        return spline_pieces(pitch_curve(self.owner, curve, self.radius))

    def turned(self, turns: Sequence[FloatArray]) -> dict[str, FloatArray]:
        """See :meth:`Joint.turned`."""
        found = {"axis": turns[0] @ self.direction, "zero": turns[0] @ unit(self.zero)}
        if self.normal is not None:
            found["normal"] = turns[1] @ unit(self.normal)
        return found

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        axis = self.direction
        across = unit(np.cross(axis, unit(self.zero)))
        first = np.cross(across, axis)
        plane = tuple(np.concatenate([a.rotation.T @ first, a.rotation.T @ across]).tolist())
        pieces, count = self._pieces.tobytes(), len(self._pieces)
        if self.normal is None:
            function = _on_curve(pieces, count, plane)
        else:
            normal = tuple((b.rotation.T @ unit(self.normal)).tolist())
            function = _on_plane(pieces, count, plane, normal)
        user = UserFunction.checked(self.owner, "profile", function, FunctionKind.POSE)
        law = None
        if self.stiffness is not None:
            law = limit(0.0, None, self.stiffness, self.damping)
        return (Row((Term(RowKind.FUNCTION, function=user),), 0.0, law),)


@lru_cache(maxsize=256)
def _on_curve(pieces: bytes, count: int, plane: tuple[float, ...]) -> Callable[..., Any]:
    """Function of the relative pose: distance of b from the curve, across it near there, m.

    Args:
        pieces: coefficients of the spline of its radius.
        count: number of pieces.
        plane: two directions across the axis, in the axes of marker a.
    """
    table, width = np.frombuffer(pieces).reshape(count, 4), 2.0 * np.pi / count
    x0, x1, x2, y0, y1, y2 = plane

    def profile(p, R):  # type: ignore[no-untyped-def]
        x = x0 * p[0] + x1 * p[1] + x2 * p[2]
        y = y0 * p[0] + y1 * p[1] + y2 * p[2]
        angle = math.atan2(y, x)
        low, high = 0, count
        while high - low > 1:
            middle = (low + high) // 2
            if angle < middle * width - math.pi:
                high = middle
            else:
                low = middle
        s = angle - (low * width - math.pi)
        c0, c1, c2, c3 = table[low, 0], table[low, 1], table[low, 2], table[low, 3]
        radius = c0 + s * (c1 + s * (c2 + s * c3))
        slope = (c1 + s * (2.0 * c2 + 3.0 * s * c3)) / radius
        return (math.sqrt(x * x + y * y) - radius) / math.sqrt(1.0 + slope * slope)

    return profile


@lru_cache(maxsize=256)
def _on_plane(
    pieces: bytes, count: int, plane: tuple[float, ...], normal: tuple[float, ...]
) -> Callable[..., Any]:
    """Function of the relative pose: distance of the plane through b from the cam, m.

    Args:
        pieces: coefficients of the spline of the distance of tangents from the centre.
        count: number of pieces.
        plane: two directions across the axis, in the axes of marker a.
        normal: of the plane in the axes of marker b.
    """
    table, width = np.frombuffer(pieces).reshape(count, 4), 2.0 * np.pi / count
    x0, x1, x2, y0, y1, y2 = plane
    n0, n1, n2 = normal

    def profile(p, R):  # type: ignore[no-untyped-def]
        m0 = R[0][0] * n0 + R[0][1] * n1 + R[0][2] * n2
        m1 = R[1][0] * n0 + R[1][1] * n1 + R[1][2] * n2
        m2 = R[2][0] * n0 + R[2][1] * n1 + R[2][2] * n2
        u = x0 * m0 + x1 * m1 + x2 * m2
        v = y0 * m0 + y1 * m1 + y2 * m2
        x = x0 * p[0] + x1 * p[1] + x2 * p[2]
        y = y0 * p[0] + y1 * p[1] + y2 * p[2]
        angle = math.atan2(v, u)
        low, high = 0, count
        while high - low > 1:
            middle = (low + high) // 2
            if angle < middle * width - math.pi:
                high = middle
            else:
                low = middle
        s = angle - (low * width - math.pi)
        away = table[low, 0] + s * (table[low, 1] + s * (table[low, 2] + s * table[low, 3]))
        return (x * u + y * v) / math.sqrt(u * u + v * v) - away

    return profile
