# SPDX-License-Identifier: LGPL-3.0-or-later
"""Outboard link of a space manipulator: its two segments, and the motion of its base.

Data and manoeuvres of Kane, Ryan, Banerjee (1987); what is lost of the printed equations is derived
anew. Joint 1 rotates link L1 about the vertical n3 by psi1; joints 2 and 3 have parallel horizontal
axes across L1. With ``e = (cos psi1, sin psi1, 0)``: ``a3 = e x n3``,
``a1 = cos(psi2 + psi3) e + sin(psi2 + psi3) n3`` along the undeformed beam, root at
``l1 e + l2 (cos psi2 e + sin psi2 n3)``.
"""

from collections.abc import Callable
from math import cos, pi, sin

import numpy as np

from flexfem._types import FloatArray
from flexfem.options import Option
from flexfem.research.moving_base.base import PrescribedBase
from flexfem.research.moving_base.properties import BeamProperties, Piecewise

__all__ = [
    "LINK_OPTIONS",
    "Angle",
    "constant_angle",
    "manipulator_base",
    "outboard_link",
    "smooth_turn",
    "spin_up_angle",
]

#: An angle (rad), its rate and its acceleration at a time (s).
Angle = Callable[[float], tuple[float, float, float]]

#: Section properties of box and channel: unit, bound, values, and description.
_SECTIONS: dict[str, tuple[str | None, dict[str, float], float, float, str]] = {
    "area": ("m^2", {"above": 0.0}, 3.84e-4, 7.3e-5, "of the section"),
    "second_moment_2": ("m^4", {"above": 0.0}, 1.5e-7, 4.8746e-9, "resists u3"),
    "second_moment_3": ("m^4", {"above": 0.0}, 1.5e-7, 8.2181e-9, "resists u2"),
    "shear_ratio_2": (None, {"minimum": 1.0}, 2.09, 3.174, "area by shear area along a2"),
    "shear_ratio_3": (None, {"minimum": 1.0}, 2.09, 1.52, "area by shear area along a3"),
    "torsion_constant": ("m^4", {"above": 0.0}, 2.2e-7, 2.433e-11, "effective"),
    "warping_constant": ("m^6", {"minimum": 0.0}, 0.0, 5.0156e-13, "of the section"),
    "eccentricity_2": ("m", {}, 0.0, 0.0, "mass centre along a2"),
    "eccentricity_3": ("m", {}, 0.0, 0.01875, "mass centre along a3"),
}


def _section_option(segment: str, name: str) -> Option:
    unit, bound, box, channel, what = _SECTIONS[name]
    flag = f"{segment}_{name}".replace("channel_eccentricity_3", "eccentricity")
    value = box if segment == "box" else channel
    return Option(flag, float, value, f"{segment}: {what}", unit=unit, **bound)  # type: ignore[arg-type]


#: Options of a case that are arguments of :func:`outboard_link`.
LINK_OPTIONS = (
    Option("box_length", float, 8.0 / 3.0, "of the segment at the root", unit="m", above=0.0),
    Option("channel_length", float, 16.0 / 3.0, "of the outer segment", unit="m", above=0.0),
    Option("youngs_modulus", float, 6.895e10, "of both", unit="N/m^2", above=0.0),
    Option("shear_modulus", float, 2.6519e10, "of both", unit="N/m^2", above=0.0),
    Option("density", float, 2766.67, "of both", unit="kg/m^3", above=0.0),
    *(_section_option(segment, name) for segment in ("box", "channel") for name in _SECTIONS),
)


def outboard_link(eccentricity: float | None = None, **given: float) -> BeamProperties:
    """Box, 8/3 m, and channel, 16/3 m, of aluminium.

    Args:
        eccentricity: of the channel's mass centre along a3, m; None for 0.01875.
        given: other values than the published ones, by the names of ``LINK_OPTIONS``:
            ``box_length``, ``channel_length`` (m), ``youngs_modulus``, ``shear_modulus`` (N/m^2),
            ``density`` (kg/m^3), and ``area`` and all other properties of sections with ``box_``
            or ``channel_`` before.

    Raises:
        TypeError: an argument has no such name, or is no number.
        ValueError: a value is out of range.
    """
    if eccentricity is not None:
        given["eccentricity"] = eccentricity
    at = {option.name: option.default for option in LINK_OPTIONS}
    for option in LINK_OPTIONS:
        if option.name in given:
            at[option.name] = option.check(given.pop(option.name))
    for name in given:
        raise TypeError(f"outboard_link() got an unexpected keyword argument '{name}'")
    ends = (at["box_length"], at["box_length"] + at["channel_length"])

    def segments(name: str) -> tuple[float, float]:
        box, channel = (_section_option(segment, name).name for segment in ("box", "channel"))
        return at[box], at[channel]

    return BeamProperties(
        length=ends[1],
        youngs_modulus=at["youngs_modulus"],
        shear_modulus=at["shear_modulus"],
        mass_per_length=Piecewise(ends, [at["density"] * area for area in segments("area")]),
        **{name: Piecewise(ends, segments(name)) for name in _SECTIONS},
    )


def constant_angle(angle: float) -> Angle:
    """An angle (rad) that stays."""
    return lambda t: (angle, 0.0, 0.0)


def smooth_turn(start: float, by: float, duration: float) -> Angle:
    """From ``start`` by ``by`` (rad) within ``duration`` (s) along a cycloid, then constant."""
    w = 2.0 * pi / duration

    def angle(t: float) -> tuple[float, float, float]:
        if t >= duration:
            return start + by, 0.0, 0.0
        rate = by / duration
        return start + rate * (t - sin(w * t) / w), rate * (1.0 - cos(w * t)), rate * w * sin(w * t)

    return angle


def spin_up_angle(speed: float = 6.0, duration: float = 15.0) -> Angle:
    """From rest to ``speed`` (rad/s) within ``duration`` (s), with a cycloid of the speed."""
    w = 2.0 * pi / duration

    def angle(t: float) -> tuple[float, float, float]:
        if t >= duration:
            return speed * (t - 0.5 * duration), speed, 0.0
        rate = speed / duration
        return (
            rate * (0.5 * t * t + (cos(w * t) - 1.0) / w**2),
            rate * (t - sin(w * t) / w),
            rate * (1.0 - cos(w * t)),
        )

    return angle


def manipulator_base(
    psi1: Angle, psi2: Angle, psi3: Angle, *, link_1: float = 8.0, link_2: float = 8.0
) -> PrescribedBase:
    """Motion of the outboard link's root and axes.

    Args:
        psi1: rotation of the inner link about the vertical.
        psi2: of the outer rigid link about a horizontal axis.
        psi3: of the base relative to that link, about a parallel axis.
        link_1: length of the inner link, m.
        link_2: length of the outer rigid link, m.
    """

    def position(t: float) -> FloatArray:
        (p1, p2) = (psi(t)[0] for psi in (psi1, psi2))
        out = link_1 + link_2 * cos(p2)
        return np.array([out * cos(p1), out * sin(p1), link_2 * sin(p2)])

    def rotation(t: float) -> FloatArray:
        p1, p2, p3 = (psi(t)[0] for psi in (psi1, psi2, psi3))
        e, n3 = np.array([cos(p1), sin(p1), 0.0]), np.array([0.0, 0.0, 1.0])
        c, s = cos(p2 + p3), sin(p2 + p3)
        axes: FloatArray = np.stack([c * e + s * n3, -s * e + c * n3, np.cross(e, n3)], axis=1)
        return axes

    def velocity(t: float) -> FloatArray:
        (_, d1, _), (p2, d2, _), (p3, _, _) = psi1(t), psi2(t), psi3(t)
        across = -d1 * (link_1 + link_2 * cos(p2))
        return np.array([link_2 * d2 * sin(p3), link_2 * d2 * cos(p3), across])

    def acceleration(t: float) -> FloatArray:
        (_, d1, a1), (p2, d2, a2), (p3, d3, _) = psi1(t), psi2(t), psi3(t)
        return np.array(
            [
                link_2 * (a2 * sin(p3) + d2 * d3 * cos(p3)),
                link_2 * (a2 * cos(p3) - d2 * d3 * sin(p3)),
                -a1 * (link_1 + link_2 * cos(p2)) + d1 * link_2 * sin(p2) * d2,
            ]
        )

    def angular_velocity(t: float) -> FloatArray:
        (_, d1, _), (p2, d2, _), (p3, d3, _) = psi1(t), psi2(t), psi3(t)
        return np.array([d1 * sin(p2 + p3), d1 * cos(p2 + p3), d2 + d3])

    def angular_acceleration(t: float) -> FloatArray:
        (_, d1, a1), (p2, d2, a2), (p3, d3, a3) = psi1(t), psi2(t), psi3(t)
        s, c = sin(p2 + p3), cos(p2 + p3)
        return np.array([a1 * s + d1 * c * (d2 + d3), a1 * c - d1 * s * (d2 + d3), a2 + a3])

    return PrescribedBase(
        velocity=velocity, acceleration=acceleration, angular_velocity=angular_velocity,
        angular_acceleration=angular_acceleration, position=position, rotation=rotation,
    )  # fmt: skip
