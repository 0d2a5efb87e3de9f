# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rolled and welded profiles: I-sections, channels, angles and T-sections.

Walls are plane and of constant thickness, with or without a fillet in the inner corners; toes are
sharp. Constants are those of the shape as it is, not of its middle lines: area and second moments
by integration, torsion and shear by Saint-Venant's problems (see ``saint_venant``).
"""

from functools import lru_cache
from itertools import pairwise

import numpy as np

from flexfem._types import FloatArray
from flexfem.materials.constants import Shape
from flexfem.materials.saint_venant import Cell, solve_section
from flexfem.materials.section_wall import Boundary

__all__ = ["angle_shape", "channel_shape", "i_shape", "t_shape"]

_Y, _Z = np.eye(2)


@lru_cache(maxsize=256)
def i_shape(width: float, height: float, web: float, flange: float, fillet: float) -> Shape:
    """Return the constants of a doubly symmetric I-section, the web along e3."""
    cells = []
    for y in (_Y, -_Y):
        for z in (_Z, -_Z):
            origin = 0.5 * height * -z
            cells += _corner(origin, y, z, flange, 0.5 * web, fillet)
            start, length = 0.5 * web + fillet, 0.5 * (width - web) - fillet
            cells += _strip(origin + start * y, y, z, length, flange)
        straight = height - 2.0 * (flange + fillet)
        cells += _strip(-0.5 * straight * _Z, _Z, y, straight, 0.5 * web, layer=web)
    return _shape(cells)


@lru_cache(maxsize=256)
def channel_shape(width: float, height: float, web: float, flange: float, fillet: float) -> Shape:
    """Return the constants of a channel, the web along e3 and the flanges towards +e2."""
    cells = []
    for z in (_Z, -_Z):
        origin = 0.5 * height * -z
        cells += _corner(origin, _Y, z, flange, web, fillet)
        start = web + fillet
        cells += _strip(origin + start * _Y, _Y, z, width - start, flange)
    straight = height - 2.0 * (flange + fillet)
    cells += _strip(-0.5 * straight * _Z, _Z, _Y, straight, web)
    return _shape(cells)


@lru_cache(maxsize=256)
def angle_shape(width: float, height: float, thickness: float, fillet: float) -> Shape:
    """Return the constants of an angle, legs towards +e2 (width) and +e3 (height)."""
    cells = _corner(0.0 * _Y, _Y, _Z, thickness, thickness, fillet)
    start = thickness + fillet
    cells += _strip(start * _Y, _Y, _Z, width - start, thickness)
    cells += _strip(start * _Z, _Z, _Y, height - start, thickness)
    return _shape(cells)


@lru_cache(maxsize=256)
def t_shape(width: float, height: float, web: float, flange: float, fillet: float) -> Shape:
    """Return the constants of a T-section, the flange on top (+e3)."""
    cells = []
    for y in (_Y, -_Y):
        origin = height * _Z
        cells += _corner(origin, y, -_Z, flange, 0.5 * web, fillet)
        start, length = 0.5 * web + fillet, 0.5 * (width - web) - fillet
        cells += _strip(origin + start * y, y, -_Z, length, flange)
        cells += _strip(0.0 * _Z, _Z, y, height - flange - fillet, 0.5 * web, layer=web)
    return _shape(cells)


def _shape(cells: list[Cell]) -> Shape:
    """Constants and boundary of the section that some cells fill."""
    found = solve_section(cells)
    boundary = Boundary(found.points, found.torsion, found.shear)
    k = found.shear_factors
    (i33, product), (_, i22) = found.moments
    if abs(product) < 1e-9 * (i22 + i33):  # round-off of sections with an axis of symmetry
        product = 0.0
    coupling = float(k[0, 1]) if product else 0.0
    y, z = (0.0 if abs(c) < 1e-9 * np.sqrt(found.area) else float(c) for c in found.shear_centre)
    return Shape(
        area=found.area,
        second_moments=(float(i22), float(i33)),
        torsion_constant=found.torsion_constant,
        shear_factors=(float(k[0, 0]), float(k[1, 1])),
        outline=found.points,
        boundaries=(boundary,),
        product=float(product),
        shear_coupling=coupling,
        shear_centre=(y, z),
        warping_constant=found.warping_constant,
    )


def _cell(*corners: FloatArray, centre: FloatArray | None = None) -> Cell:
    """A cell whose corners may be clockwise."""
    a, b, c, d = corners
    p, q = c - a, d - b
    anticlockwise = p[0] * q[1] > p[1] * q[0]
    return Cell(np.stack([a, b, c, d] if anticlockwise else [b, a, d, c]), centre)


def _corner(
    origin: FloatArray, u: FloatArray, v: FloatArray, across_u: float, across_v: float,
    fillet: float,
) -> list[Cell]:  # fmt: skip
    """Cells of the corner between two walls, or between half of a wall and another one.

    Args:
        origin: outer corner.
        u: unit vector along one wall.
        v: along the other one.
        across_u: thickness of the wall along u.
        across_v: along v.
        fillet: radius, or zero.
    """
    beside, above = across_v + fillet, across_u + fillet
    if not fillet:
        far = origin + beside * u
        return [_cell(origin, far, far + above * v, origin + above * v)]
    centre = origin + beside * u + above * v
    middle = centre - fillet * np.sqrt(0.5) * (u + v)
    right, top = origin + beside * u, origin + above * v
    return [
        _cell(origin, right, right + across_u * v, middle, centre=centre),
        _cell(top, origin, middle, top + across_v * u, centre=centre),
    ]


def _strip(
    start: FloatArray, u: FloatArray, v: FloatArray, length: float, thickness: float,
    layer: float | None = None,
) -> list[Cell]:  # fmt: skip
    """A straight wall along u; with cells of its whole thickness, the layer, at both ends."""
    end = thickness if layer is None else layer
    # round-off in lengths must not decide
    inner = [end, length - end] if length > 3.001 * end else [0.5 * length] * (length > 1.001 * end)
    stops, high = [0.0, *inner, length], thickness * v
    return [
        _cell(start + a * u, start + b * u, start + b * u + high, start + a * u + high)
        for a, b in pairwise(stops)
    ]
