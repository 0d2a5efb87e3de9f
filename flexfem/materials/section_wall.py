# SPDX-License-Identifier: LGPL-3.0-or-later
"""Boundaries of beam sections for pictures, and the stresses there.

Axes and signs as in ``flexfem.materials.section``: y along e2, z along e3, resultants
(N, Q2, Q3, T, M2, M3). Where a section is linear and elastic, the axial stress is

    sigma = N/A + M2 (I33 z - I23 y)/D + M3 (I23 z - I22 y)/D, D = I22 I33 - I23^2,

and on the surface, which is free, shear stress acts along the boundary only. Given here is that of
Saint-Venant's torsion and, for profiles, of the shear forces Q2 and Q3. In compact sections the
latter is left out: it is smaller than the stress of bending by the slenderness of the beam. So are
stresses of restrained warping.
"""

from dataclasses import dataclass
from math import pi

import numpy as np

from flexfem._types import FloatArray

__all__ = ["Boundary", "SectionWall", "box_boundaries", "rectangle_boundary", "round_boundary"]

#: Corners of the polygon that represents a circle.
_CORNERS = 24
#: Terms of the series of Saint-Venant's torsion; they fall with the square of their number at the
#: edges, where the stress vanishes, and exponentially elsewhere.
_TERMS = 400


@dataclass(frozen=True, eq=False)
class Boundary:
    """A closed boundary of a shape and the shear stress of torsion along it.

    Attributes:
        points: (k, 2) its vertices (y, z) in anticlockwise order, m.
        torsion: (k,) shear stress in this sense per torque, 1/m^3.
        shear: (k, 2) the same per force along e2 and e3 through the shear centre, 1/m^2; None where
            it is left out.
    """

    points: FloatArray
    torsion: FloatArray
    shear: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class SectionWall:
    """A closed boundary of a section, as the surface of a beam shows it.

    Attributes:
        points: (k, 2) its vertices (y, z) in anticlockwise order, m.
        stress: (k, 2, 6) maps the stress resultants to the axial stress and the shear stress in
            this sense, 1/m^2 and 1/m^3; None where they are not known.
    """

    points: FloatArray
    stress: FloatArray | None = None

    @classmethod
    def linear(
        cls, boundary: Boundary, area: float, second_moments: tuple[float, float],
        shear_centre: FloatArray, product: float = 0.0,
    ) -> "SectionWall":  # fmt: skip
        """The boundary of a linear elastic section with its centroid on the reference axis.

        Args:
            boundary: of its shape.
            area: m^2.
            second_moments: (I22, I33), m^4.
            shear_centre: (y, z) of the point about which torques twist, m.
            product: I23, m^4.
        """
        y, z = boundary.points.T
        stress = np.zeros((len(y), 2, 6))
        stress[:, 0, 0] = 1.0 / area
        (i22, i33), i23 = second_moments, product
        root = i22 * i33 - i23**2
        stress[:, 0, 4], stress[:, 0, 5] = (i33 * z - i23 * y) / root, (i23 * z - i22 * y) / root
        # T is the torque about the reference axis: that about the shear centre twists
        about = np.array([0.0, shear_centre[1], -shear_centre[0], 1.0, 0.0, 0.0])
        stress[:, 1] = boundary.torsion[:, np.newaxis] * about
        if boundary.shear is not None:
            stress[:, 1, 1:3] += boundary.shear
        return cls(boundary.points, stress)


def round_boundary(radius: float, polar_moment: float) -> Boundary:
    """A circle in a circular section: the shear stress is T r/I_p, exactly."""
    angle = np.linspace(0.0, 2.0 * pi, _CORNERS, endpoint=False)
    points = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return Boundary(points, np.full(_CORNERS, radius / polar_moment))


def rectangle_boundary(width: float, height: float, torsion_constant: float) -> Boundary:
    """Corners and midpoints of the sides of a solid rectangle.

    The shear stress on the sides of length b, which are 2 a apart, is at the distance s from their
    midpoints, with the twist T/(G J), `2 a T/J [1 - 8/pi^2 sum over odd n of cosh(n pi s/(2
    a))/(n^2 cosh(n pi b/(4 a)))]` (Timoshenko, Goodier, Theory of Elasticity, 3rd ed. 1970, section
    109). It is greatest in the midpoints of the longer sides; the corners have none.
    """
    y, z = 0.5 * width, 0.5 * height
    points = np.array(
        [[-y, -z], [0.0, -z], [y, -z], [y, 0.0], [y, z], [0.0, z], [-y, z], [-y, 0.0]]
    )
    upright, level = (_middle_stress(*sides) for sides in ((y, height), (z, width)))
    torsion = np.array([0.0, level, 0.0, upright, 0.0, level, 0.0, upright]) / torsion_constant
    return Boundary(points, torsion)


def _middle_stress(a: float, length: float) -> float:
    """Shear stress in the middle of sides 2 a apart, times J/T."""
    n = np.arange(1.0, 2.0 * _TERMS, 2.0)
    x = n * pi * length / (4.0 * a)
    inverse_cosh = 2.0 * np.exp(-x) / (1.0 + np.exp(-2.0 * x))
    return float(2.0 * a * (1.0 - 8.0 / pi**2 * np.sum(inverse_cosh / n**2)))


def box_boundaries(
    width: float, height: float, wall: float, torsion_constant: float
) -> tuple[Boundary, Boundary]:
    """Outer and inner boundary of a rectangular box with thin walls of one thickness.

    Bredt's shear flow gives `2 A_m T/(p J)` in the middle of the walls, A_m and p area and
    perimeter of the middle line; the walls' own torsion adds `wall T/J` outside and takes it away
    inside, as the torsion constant has it. Stresses close to the corners are not resolved.
    """
    middle = (width - wall, height - wall)
    flow = middle[0] * middle[1] / (middle[0] + middle[1])  # 2 A_m/p
    found = []
    for inset, own in ((0.0, wall), (wall, -wall)):
        shape = rectangle_boundary(width - 2.0 * inset, height - 2.0 * inset, 1.0)
        found.append(Boundary(shape.points, np.full(8, (flow + own) / torsion_constant)))
    return found[0], found[1]
