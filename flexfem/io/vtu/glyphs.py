# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures of joints by their kinds, at unit size with the axis along z."""

from __future__ import annotations

from flexfem.io.vtu.surfaces import Surface, box, cylinder, joined, sphere

__all__ = ["glyph"]

_X, _Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
_EYE = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def _rod(radius: float, length: float) -> Surface:
    return cylinder(radius, length, _Z, sides=16)


def _thread() -> Surface:
    """A rod with rings, for a screw."""
    rings = (_rod(0.42, 0.12).moved(_EYE, (0.0, 0.0, z)) for z in (-0.7, -0.35, 0.0, 0.35, 0.7))
    return joined(_rod(0.22, 2.4), *rings)


_BALL, _BEAD, _CUBE = sphere(0.5, refinements=2), sphere(0.25, refinements=1), box((0.5, 0.5, 0.5))
_CROSS = joined(_rod(0.18, 1.8), cylinder(0.18, 1.8, _X, sides=16))
_DISC, _PLATE = _rod(0.7, 0.2), box((2.0, 2.0, 0.2))
_GLYPHS = {
    "actuator": _rod(0.3, 1.6),
    "bushing": _rod(0.7, 0.8),
    "clampedline": _CUBE,
    "constantvelocity": joined(_BALL, _rod(0.2, 1.8)),
    "cylindrical": _rod(0.25, 2.4),
    "distance": _BEAD,
    "gear": _DISC,
    "linepart": _BEAD,
    "planar": joined(_PLATE, _rod(0.3, 0.8)),
    "pointonline": joined(box((0.2, 0.2, 3.0)), _BALL),
    "pointonplane": joined(_PLATE, _BALL),
    "prescribedangle": _DISC,
    "prescribeddistance": _BEAD,
    "prismatic": box((0.4, 0.4, 2.4)),
    "revolute": _rod(0.4, 1.2),
    "rigid": box((0.8, 0.8, 0.8)),
    "rigidnodes": box((0.8, 0.8, 0.8)),
    "screw": _thread(),
    "sliding": joined(box((0.8, 0.8, 0.8)), _BALL),
    "spherical": _BALL,
    "springdamper": _BEAD,
    "torsionalspringdamper": _DISC,
    "universal": _CROSS,
}


def glyph(kind: str) -> Surface:
    """The picture of a kind of joint such as "Revolute"; a cube for those that have none."""
    return _GLYPHS.get(kind.lower().replace("_", ""), _CUBE)
