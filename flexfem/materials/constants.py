# SPDX-License-Identifier: LGPL-3.0-or-later
"""Geometric constants of plane sections.

Section axes: y along e2, z along e3, origin at the centroid. Second moments are named after the
axis of the bending they resist: I22 = integral of z^2 (bending about e2) and I33 = integral of
y^2 (bending about e3).
"""

from dataclasses import dataclass
from math import exp, pi

import numpy as np

from flexfem._types import FloatArray
from flexfem.materials.section_wall import (
    Boundary,
    box_boundaries,
    rectangle_boundary,
    round_boundary,
)

# Riemann's zeta(5): the sum of 1/n^5 over odd n is 31/32 of it
_ZETA_5 = 1.0369277551433699263


@dataclass(frozen=True)
class Shape:
    """Geometry of a section.

    Attributes:
        area: Area, m^2.
        second_moments: (I22, I33), m^4.
        torsion_constant: Factor of G in the torsional stiffness, m^4.
        shear_factors: (k2, k3) for shear forces along e2 and e3.
        outline: Vertices (y, z) of the outer boundary, anticlockwise, the last one joined to the
            first, shape (k, 2), metres; None when unknown.
        boundaries: Outer boundary, and inner one of hollow shapes, with as many vertices.
        product: Integral of y z, m^4.
        shear_coupling: k23 where shear forces along e2 also shear along e3.
        shear_centre: (y, z), m.
        warping_constant: About the shear centre, m^6, as tables list it; the beams here warp freely
            and do not use it. None when unknown.
    """

    area: float
    second_moments: tuple[float, float]
    torsion_constant: float
    shear_factors: tuple[float, float]
    outline: FloatArray | None
    boundaries: tuple[Boundary, ...]
    product: float = 0.0
    shear_coupling: float = 0.0
    shear_centre: tuple[float, float] = (0.0, 0.0)
    warping_constant: float | None = None


def rectangle_torsion(a: float, b: float) -> float:
    """Return Saint-Venant's torsion constant of a solid rectangle with sides `a` and `b`.

    With a >= b: `J = a b^3/3 [1 - 192 b/(pi^5 a) sum over odd n of tanh(n pi a/(2 b))/n^5]`
    (Timoshenko, Goodier, Theory of Elasticity, 3rd ed. 1970, section 109). The part of the series
    that does not decay exponentially is summed in closed form, so that the result is exact to
    rounding; the unit square gives 0.140577, a thin strip a b^3/3 (1 - 0.63 b/a).
    """
    long, short = max(a, b), min(a, b)
    ratio = long / short
    decaying = sum(
        2.0 / (n**5 * (exp(n * pi * ratio) + 1.0))
        for n in range(1, 16, 2)
        if n * pi * ratio < 700.0
    )
    series = 31.0 / 32.0 * _ZETA_5 - decaying
    return long * short**3 / 3.0 * (1.0 - 192.0 / (pi**5 * ratio) * series)


def rectangle_shape(width: float, height: float) -> Shape:
    """Return the constants of a solid rectangle, `width` along e2 and `height` along e3.

    The shear factor is 5/6, the energy factor of the parabolic shear stress (Timoshenko; also
    Cowper's `10 (1 + nu)/(12 + 11 nu)` for nu = 0).
    """
    y, z = width / 2.0, height / 2.0
    torsion = rectangle_torsion(width, height)
    return Shape(
        area=width * height,
        second_moments=(width * height**3 / 12.0, height * width**3 / 12.0),
        torsion_constant=torsion,
        shear_factors=(5.0 / 6.0, 5.0 / 6.0),
        outline=np.array([[-y, -z], [y, -z], [y, z], [-y, z]]),
        boundaries=(rectangle_boundary(width, height, torsion),),
    )


def _box_shear_factor(depth: float, breadth: float) -> float:
    """Return the energy shear factor of a thin box for a force along the sides of `depth`.

    Both lengths are of the wall's middle line. The shear flow of a box of uniform wall thickness
    gives, with n = breadth/depth,
    `k = 10 (1 + 3 n)^2 / [(1 + n) (12 + 60 n + 90 n^2 + 30 n^3)]`,
    the thin-walled box of Cowper (1966, doi:10.1115/1.3625046) for nu = 0.
    """
    n = breadth / depth
    return 10.0 * (1 + 3 * n) ** 2 / ((1 + n) * (12 + 60 * n + 90 * n**2 + 30 * n**3))


def hollow_rectangle_shape(width: float, height: float, wall: float) -> Shape:
    """Return the constants of a rectangular box with walls of uniform thickness.

    Area and second moments are exact sums of four rectangles: differences of the outer and the
    inner one would lose the digits of thin walls. Torsion constant: Bredt's formula for the closed
    middle line plus the walls' own share, `J = 4 A_m^2 t/p + p t^3/3`, with A_m and p area and
    perimeter of the middle line (the formula of EN 10210-2, annex A, for sharp corners). It holds
    for thin walls: against a numerical solution of Saint-Venant's problem for a square box it is
    low by 2 %, 4 % and 6 % at t = 0.05, 0.1 and 0.2 of the side. Shear factors: thin walls as well,
    see `_box_shear_factor`.
    """
    inner_width, inner_height = width - 2.0 * wall, height - 2.0 * wall
    middle_width, middle_height = width - wall, height - wall
    perimeter = 2.0 * (middle_width + middle_height)
    enclosed = middle_width * middle_height
    torsion = 4.0 * enclosed**2 * wall / perimeter + perimeter * wall**3 / 3.0
    return Shape(
        area=perimeter * wall,
        second_moments=(
            _two_walls(width, wall, middle_height) + wall * inner_height**3 / 6.0,
            _two_walls(height, wall, middle_width) + wall * inner_width**3 / 6.0,
        ),
        torsion_constant=torsion,
        shear_factors=(
            _box_shear_factor(middle_width, middle_height),
            _box_shear_factor(middle_height, middle_width),
        ),
        outline=rectangle_shape(width, height).outline,
        boundaries=box_boundaries(width, height, wall, torsion),
    )


def _two_walls(length: float, wall: float, apart: float) -> float:
    """Second moment of two parallel walls, m^4, about the line in the middle between them."""
    return length * wall * (wall**2 / 6.0 + apart**2 / 2.0)


def tube_shape(inner_diameter: float, outer_diameter: float, poisson_ratio: float) -> Shape:
    """Return the constants of a circular tube, or of a solid circle for a zero inner diameter.

    The torsion constant is the polar moment (exact). The shear factor is Cowper's (1966,
    doi:10.1115/1.3625046) with m = inner/outer diameter:
    `k = 6 (1+nu) (1+m^2)^2 / [(7+6 nu) (1+m^2)^2 + (20+12 nu) m^2]`;
    it becomes `6 (1+nu)/(7+6 nu)` for the solid circle and `2 (1+nu)/(4+3 nu)` for a thin tube.
    """
    m2 = (inner_diameter / outer_diameter) ** 2
    square = (1.0 + m2) ** 2
    nu = poisson_ratio
    factor = 6 * (1 + nu) * square / ((7 + 6 * nu) * square + (20 + 12 * nu) * m2)
    # not the difference of powers, which loses the digits of thin walls
    squares = (outer_diameter - inner_diameter) * (outer_diameter + inner_diameter)
    second = pi * squares * (outer_diameter**2 + inner_diameter**2) / 64.0
    diameters = (outer_diameter, inner_diameter) if inner_diameter > 0.0 else (outer_diameter,)
    boundaries = tuple(round_boundary(0.5 * d, 2.0 * second) for d in diameters)
    return Shape(
        area=pi * squares / 4.0,
        second_moments=(second, second),
        torsion_constant=2.0 * second,
        shear_factors=(factor, factor),
        outline=boundaries[0].points,
        boundaries=boundaries,
    )
