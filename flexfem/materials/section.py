# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stiffness and inertia of beam sections.

Axes: e1 along the beam, e2 and e3 in the section; points of the section have the coordinates
y along e2 and z along e3, measured from the reference axis (the line of nodes).

Strain order: extension gamma1, shears gamma2, gamma3, twist kappa1, bendings kappa2, kappa3.
The stiffness of a section that is symmetric about its reference axis is
`D = diag(E A, k2 G A, k3 G A, G J_t, E I22, E I33)`, where I22 = integral of z^2 resists bending
about e2 and I33 = integral of y^2 bending about e3; where the integral I23 of y z does not vanish,
the last two rows couple by -E I23.

Velocity order: (V, Omega), translation first. The inertia per length is
`[[m I, -S], [S, J]]`, m = rho A, S = skew(m c) with c = (0, y_c, z_c) the mass centre, and the
rotary inertia about the reference axis
`J = rho diag(I22 + I33, I22, I33) + m (c.c I - c c^T)`.
Index names differ in the literature: where I_2 is the integral of y^2, the second and third
entry of J read (I_3, I_2).
"""

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import Array, Given, checked, declared, instance, settled
from flexfem._types import FloatArray
from flexfem.materials import constants
from flexfem.materials.material import Material
from flexfem.materials.matrices import check_definite, check_inertia_form
from flexfem.materials.section_law import BeamLaw
from flexfem.materials.section_matrices import about_shear_centre, inertia_of, stiffness_of
from flexfem.materials.section_profiles import ProfileSections, length_of
from flexfem.materials.section_wall import SectionWall

#: Vertices that an outline needs to pass for a circle, and by how much their radii may differ.
_ROUND = (12, 1e-6)


def _inertia(owner: str, what: str, value: Any) -> FloatArray:
    """Return a checked inertia per length."""
    inertia = _checks.array(owner, what, value, (6, 6))
    check_definite(owner, what, inertia, semidefinite=True)
    check_inertia_form(owner, inertia)
    return inertia


def _outline(owner: str, what: str, value: Any) -> FloatArray:
    """Return checked vertices."""
    outline = _checks.array(owner, what, value, (-1, 2))
    if len(outline) < 3:
        raise ValueError(f"{owner}: {what} must have at least three vertices, got {len(outline)}")
    return outline


@declared
class Section(ProfileSections):
    """Section of a beam: stiffness or law, inertia, and an outline for pictures.

    Attributes:
        stiffness: Maps strains (gamma, kappa) to forces and moments, shape (6, 6); N, N m, N m^2.
            None where a law takes its place.
        inertia: Maps velocities (V, Omega) in section axes to momentum per length, shape (6, 6);
            kg/m, kg, kg m.
        outline: Vertices (y, z) of the outer boundary, the last one joined to the first, shape
            (k, 2), metres; None when unknown.
        law: The section's own law; None for the linear one of the stiffness.
        walls: Boundaries as pictures show them: the outer one, and the inner one of hollow shapes;
            with the known stresses there. If left out, that of the outline alone; empty without an
            outline.
        shape: Area, second moments, torsion constant, shear centre and the like; None where only
            matrices are known.

    The other constructors are for common shapes.

    Raises:
        TypeError: An argument does not consist of numbers, or the law is no BeamLaw.
        ValueError: The stiffness is not symmetric and positive definite, the inertia not symmetric
            and positive semidefinite or not of the form `[[m I, -S], [S, J]]`, an argument has the
            wrong shape or is not finite, or both a stiffness and a law are given.
    """

    stiffness: Given[npt.ArrayLike | None, FloatArray | None]
    inertia: Array = checked(_inertia)
    outline: Given[npt.ArrayLike | None, FloatArray | None] = checked(_outline, default=None)
    _: KW_ONLY
    law: BeamLaw | None = instance(BeamLaw, default=None)
    walls: Given[Sequence[SectionWall], tuple[SectionWall, ...]] = settled(default=())
    shape: constants.Shape | None = None

    def __post_init__(self) -> None:
        """Check the stiffness, or that a law takes its place."""
        stiffness, walls = self.stiffness, tuple(self.walls)
        if self.law is None:
            stiffness = _checks.array("Section", "stiffness", stiffness, (6, 6))
            check_definite("Section", "stiffness", stiffness, semidefinite=False)
        elif stiffness is not None:
            raise ValueError(f"Section: give a stiffness or the {self.law.owner}, not both")
        if self.outline is not None:
            walls = walls or (SectionWall(self.outline),)
        _checks.assign(self, stiffness=stiffness, walls=walls)

    @classmethod
    def general(
        cls,
        stiffness: npt.ArrayLike | None = None,
        inertia: npt.ArrayLike = (),
        outline: npt.ArrayLike | None = None,
        *,
        law: BeamLaw | None = None,
    ) -> Self:
        """Create a section from given matrices.

        Args:
            stiffness: 6 x 6 matrix, or its diagonal (EA, GA2, GA3, GJ, EI22, EI33); None with a
                law.
            inertia: 6 x 6 matrix, or its diagonal (m, m, m, J1, J2, J3) per length.
            outline: Vertices (y, z) of the outer boundary, shape (k, 2), metres.
            law: The section's own law, instead of the stiffness.

        Raises:
            TypeError: An argument does not consist of numbers, or the law is no BeamLaw.
            ValueError: As for the class itself.
        """
        if stiffness is not None:
            stiffness = _diagonal(stiffness)
        return cls(stiffness, _diagonal(inertia), outline, law=law)

    def with_law(self, law: BeamLaw) -> Self:
        """Create a section with the same inertia and outline, and a law of its own.

        Raises:
            TypeError: The law is no BeamLaw.
        """
        _checks.instance("Section", "law", law, BeamLaw)
        walls = [SectionWall(wall.points) for wall in self.walls]  # the stresses are the law's
        return type(self)(None, self.inertia, self.outline, law=law, walls=walls, shape=self.shape)

    @classmethod
    def rectangle(
        cls,
        width: float,
        height: float,
        material: Material,
        *,
        mass_centre: npt.ArrayLike = (0.0, 0.0),
        shear_centre: npt.ArrayLike = (0.0, 0.0),
        shear_factor: npt.ArrayLike | None = None,
    ) -> Self:
        """Create a solid rectangle.

        Args:
            width: Side along e2, metres.
            height: Side along e3, metres.
            material: Elastic constants and density.
            mass_centre: (y, z) of the mass centre, metres.
            shear_centre: (y, z) of the shear centre, metres.
            shear_factor: One number or the pair (k2, k3); None for 5/6.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: A length is not positive, or an argument not finite.
        """
        shape = constants.rectangle_shape(length_of("width", width), length_of("height", height))
        return cls._of(shape, material, mass_centre, shear_centre, shear_factor)

    @classmethod
    def hollow_rectangle(
        cls,
        width: float,
        height: float,
        wall: float,
        material: Material,
        *,
        mass_centre: npt.ArrayLike = (0.0, 0.0),
        shear_centre: npt.ArrayLike = (0.0, 0.0),
        shear_factor: npt.ArrayLike | None = None,
    ) -> Self:
        """Create a rectangular box with walls of uniform, small thickness.

        Args:
            width: Outer side along e2, metres.
            height: Outer side along e3, metres.
            wall: Wall thickness, metres, less than half of the shorter side.
            material: Elastic constants and density.
            mass_centre: (y, z) of the mass centre, metres.
            shear_centre: (y, z) of the shear centre, metres.
            shear_factor: One number or the pair (k2, k3); None for those of a thin box.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: A length is not positive, the walls fill the box, or an argument is not
                finite.
        """
        width, height = length_of("width", width), length_of("height", height)
        if 2.0 * length_of("wall", wall) >= min(width, height):
            raise ValueError(
                f"Section: wall must be less than half of the shorter side "
                f"{min(width, height):g}, got {wall}"
            )
        shape = constants.hollow_rectangle_shape(width, height, wall)
        return cls._of(shape, material, mass_centre, shear_centre, shear_factor)

    @classmethod
    def circle(
        cls,
        diameter: float,
        material: Material,
        *,
        mass_centre: npt.ArrayLike = (0.0, 0.0),
        shear_centre: npt.ArrayLike = (0.0, 0.0),
        shear_factor: npt.ArrayLike | None = None,
    ) -> Self:
        """Create a solid circle.

        Args:
            diameter: Diameter, metres.
            material: Elastic constants and density.
            mass_centre: (y, z) of the mass centre, metres.
            shear_centre: (y, z) of the shear centre, metres.
            shear_factor: One number or the pair (k2, k3); None for Cowper's
                6 (1 + nu)/(7 + 6 nu), which is 0.886 for nu = 0.3.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: The diameter is not positive, or an argument not finite.
        """
        _checks.instance("Section", "material", material, Material)
        shape = constants.tube_shape(0.0, length_of("diameter", diameter), material.poisson_ratio)
        return cls._of(shape, material, mass_centre, shear_centre, shear_factor)

    @classmethod
    def tube(
        cls,
        inner_diameter: float,
        outer_diameter: float,
        material: Material,
        *,
        mass_centre: npt.ArrayLike = (0.0, 0.0),
        shear_centre: npt.ArrayLike = (0.0, 0.0),
        shear_factor: npt.ArrayLike | None = None,
    ) -> Self:
        """Create a circular tube of any wall thickness.

        Args:
            inner_diameter: Inner diameter, metres.
            outer_diameter: Outer diameter, metres, greater than the inner one.
            material: Elastic constants and density.
            mass_centre: (y, z) of the mass centre, metres.
            shear_centre: (y, z) of the shear centre, metres.
            shear_factor: One number or the pair (k2, k3); None for Cowper's hollow circle.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: A diameter is not positive, the inner one is not smaller than the outer
                one, or an argument is not finite.
        """
        _checks.instance("Section", "material", material, Material)
        outer = length_of("outer_diameter", outer_diameter)
        if length_of("inner_diameter", inner_diameter) >= outer:
            raise ValueError(
                f"Section: inner_diameter must be less than the outer diameter {outer:g}, "
                f"got {inner_diameter}"
            )
        shape = constants.tube_shape(inner_diameter, outer, material.poisson_ratio)
        return cls._of(shape, material, mass_centre, shear_centre, shear_factor)

    @classmethod
    def of_constants(
        cls,
        area: float,
        i22: float,
        i33: float,
        torsion_constant: float,
        material: Material,
        *,
        mass_centre: npt.ArrayLike = (0.0, 0.0),
        shear_centre: npt.ArrayLike = (0.0, 0.0),
        shear_factor: npt.ArrayLike,
    ) -> Self:
        """Create a section of any shape from its geometric constants, as tables of profiles list.

        Axes e2 and e3 are the principal ones through the centroid. Such a section has no outline.

        Args:
            area: Area, m^2.
            i22: Integral of z^2 over the area, resists bending about e2, m^4.
            i33: Integral of y^2, resists bending about e3, m^4.
            torsion_constant: Factor of G in the torsional stiffness, m^4.
            material: Elastic constants and density.
            mass_centre: (y, z) of the mass centre, metres.
            shear_centre: (y, z) of the shear centre, metres.
            shear_factor: One number or the pair (k2, k3).

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: A constant is not positive, or an argument not finite.
        """
        shape = constants.Shape(
            area=_positive("area", area),
            second_moments=(_positive("i22", i22), _positive("i33", i33)),
            torsion_constant=_positive("torsion_constant", torsion_constant),
            shear_factors=(1.0, 1.0),
            outline=None,
            boundaries=(),
        )
        return cls._of(shape, material, mass_centre, shear_centre, shear_factor)

    @classmethod
    def _of(
        cls,
        shape: constants.Shape,
        material: Material,
        mass_centre: npt.ArrayLike,
        shear_centre: npt.ArrayLike | None,
        shear_factor: npt.ArrayLike | None,
    ) -> Self:
        """Create the section of a given shape and material."""
        _checks.instance("Section", "material", material, Material)
        factors = _shear_factors(shear_factor, shape.shear_factors)
        centre = _checks.array("Section", "mass_centre", mass_centre, (2,))
        coupling = shape.shear_coupling if shear_factor is None else 0.0
        elastic = stiffness_of(shape, material, factors, coupling)
        own = shape.shear_centre if shear_centre is None else shear_centre
        pole = _checks.array("Section", "shear_centre", own, (2,))
        return cls(
            about_shear_centre(elastic, pole),
            inertia_of(shape, material.density, centre),
            shape.outline,
            walls=[
                SectionWall.linear(boundary, shape.area, shape.second_moments, pole, shape.product)
                for boundary in shape.boundaries
            ],
            shape=shape,
        )

    @property
    def round_radius(self) -> float | None:
        """Radius of a circular outline around the axis, metres; None for all others."""
        if self.outline is None or len(self.outline) < _ROUND[0]:
            return None
        sizes = np.hypot(*self.outline.T)
        largest = float(sizes.max())
        return largest if sizes.min() > (1.0 - _ROUND[1]) * largest else None

    @property
    def mass_per_length(self) -> float:
        """Mass per length, kg/m."""
        return float(self.inertia[0, 0])

    @property
    def mass_centre(self) -> FloatArray:
        """Mass centre (y, z) relative to the reference axis, shape (2,), metres."""
        mass = self.mass_per_length
        # S = inertia[3:, :3] = skew(m c): S[2, 0] = -m y, S[1, 0] = m z
        moment = np.array([-self.inertia[5, 0], self.inertia[4, 0]])
        return moment / mass if mass > 0.0 else moment


def _positive(what: str, value: float) -> float:
    return _checks.number("Section", what, value, positive=True)


def _diagonal(matrix: npt.ArrayLike) -> npt.ArrayLike:
    """Return the matrix of a diagonal given as six numbers, anything else unchanged."""
    try:
        values = np.asarray(matrix)
    except ValueError:  # ragged: the class itself reports it
        return matrix
    return np.diag(values) if values.shape == (6,) else matrix


def _shear_factors(
    given: npt.ArrayLike | None, default: tuple[float, float]
) -> tuple[float, float]:
    """Return (k2, k3) from an override by one number or a pair."""
    if given is None:
        return default
    shape = () if np.ndim(given) == 0 else (2,)
    values = _checks.array("Section", "shear_factor", given, shape)
    if (values <= 0.0).any():
        raise ValueError(f"Section: shear_factor must be positive, got {_checks.show(given)}")
    k2, k3 = np.broadcast_to(values, (2,))
    return float(k2), float(k3)
