# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stiffness and mass of shell sections.

Axes: e1 and e2 in the reference surface, e3 the normal; z along e3 from the reference surface,
which the nodes lie on.

Strain order: membrane eps11, eps22, 2 eps12, then curvatures kappa11, kappa22, 2 kappa12; the
strain at z is eps + z kappa. The stiffness `[[A, B], [B^T, D]]` maps them to forces n11, n22, n12
and moments m11, m22, m12 per length. Thin shells have no other strains; those with a director also
shear across their thickness, gamma1 and gamma2, which the shear stiffness maps to q1 and q2.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.materials.material import Material
from flexfem.materials.matrices import check_definite
from flexfem.materials.section_law import ShellLaw

__all__ = ["Ply", "ShellSection"]

#: Part of the shear stiffness that the parabola of stresses over a homogeneous thickness leaves
#: (Reissner 1945).
_SHEAR_FACTOR = 5.0 / 6.0


@dataclass(frozen=True)
class Ply:
    """Layer of a laminate: orthotropic, its fibres in the plane of the shell.

    Attributes:
        thickness: m.
        angle: from e1 to the fibres, about e3, rad.
        moduli: Young's moduli along and across the fibres, Pa.
        shear_modulus: in the plane, Pa.
        poisson_ratio: contraction across the fibres under tension along them.
        density: kg/m^3.
    """

    thickness: float
    angle: float
    moduli: tuple[float, float]
    shear_modulus: float
    poisson_ratio: float
    density: float

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            TypeError: A value is not a number.
            ValueError: A value is not finite or outside its range.
        """
        _checks.number("Ply", "thickness", self.thickness, positive=True)
        _checks.number("Ply", "angle", self.angle)
        moduli = _checks.array("Ply", "moduli", self.moduli, (2,))
        for value in moduli:
            _checks.number("Ply", "modulus", float(value), positive=True)
        _checks.number("Ply", "shear_modulus", self.shear_modulus, positive=True)
        _checks.number("Ply", "density", self.density, nonnegative=True)
        _check_ratio("Ply", self.poisson_ratio, *moduli.tolist())

    @property
    def stiffness(self) -> FloatArray:
        """(3, 3) plane-stress stiffness along e1 and e2, Pa."""
        own = _orthotropic(*self.moduli, self.shear_modulus, self.poisson_ratio)
        c, s = np.cos(self.angle), np.sin(self.angle)
        # strains along the fibres from those along e1 and e2
        turn = np.array([
            [c * c, s * s, c * s],
            [s * s, c * c, -c * s],
            [-2.0 * c * s, 2.0 * c * s, c * c - s * s],
        ])  # fmt: skip
        stiffness: FloatArray = turn.T @ own @ turn
        return stiffness


@dataclass(frozen=True, eq=False, init=False)
class ShellSection:
    """Section of a shell.

    Attributes:
        stiffness: Maps strains to forces and moments per length, shape (6, 6); N/m, N, N m.
        mass: Mass per area, kg/m^2.
        thickness: m, of pictures, of contact and of rotary inertia.
        shear: Maps shear strains across the thickness to forces per length, shape (2, 2), N/m.
        law: The section's own law, which takes the place of the stiffness; None for the linear one.
    """

    stiffness: FloatArray
    mass: float
    thickness: float
    shear: FloatArray
    law: ShellLaw | None

    def __init__(
        self,
        stiffness: npt.ArrayLike,
        mass: float,
        thickness: float,
        shear: npt.ArrayLike | None = None,
        law: ShellLaw | None = None,
    ) -> None:
        """Create a section from its matrix; the other constructors are for common laws.

        Args:
            stiffness: as the attribute.
            mass: as the attribute.
            thickness: as the attribute.
            shear: as the attribute; None for 5/6 of the stiffness of the membrane in shear along
                both axes, which is right for a homogeneous isotropic plate.
            law: as the attribute; the stiffness is that for small strains then, of which free edges
                and the automatic stiffness of contact are made.

        Raises:
            TypeError: An argument does not consist of numbers.
            ValueError: A stiffness is not symmetric and positive definite, the mass negative,
                the thickness not positive, or an argument has the wrong shape or is not finite.
        """
        if law is not None:
            _checks.instance("ShellSection", "law", law, ShellLaw)
        matrix = _checks.array("ShellSection", "stiffness", stiffness, (6, 6))
        check_definite("ShellSection", "stiffness", matrix, semidefinite=False)
        given = _SHEAR_FACTOR * matrix[2, 2] * np.eye(2) if shear is None else shear
        across = _checks.array("ShellSection", "shear", given, (2, 2))
        check_definite("ShellSection", "shear", across, semidefinite=False)
        _checks.assign(
            self,
            stiffness=matrix,
            shear=across,
            law=law,
            mass=_checks.number("ShellSection", "mass", mass, nonnegative=True),
            thickness=_checks.number("ShellSection", "thickness", thickness, positive=True),
        )

    def with_law(self, law: ShellLaw) -> Self:
        """Create the same section with a law of its own.

        Raises:
            TypeError: The law is no ShellLaw.
        """
        return type(self)(self.stiffness, self.mass, self.thickness, self.shear, law)

    @classmethod
    def isotropic(cls, thickness: float, material: Material) -> Self:
        """Create a homogeneous plate; the reference surface is its middle surface.

        Its shear stiffness is 5/6 G h.

        Args:
            thickness: m.
            material: elastic constants and density; Poisson's ratio below one half.

        Raises:
            TypeError: An argument is of the wrong kind.
            ValueError: The thickness is not positive.
        """
        h = _checks.number("ShellSection", "thickness", thickness, positive=True)
        _checks.instance("ShellSection", "material", material, Material)
        E = material.youngs_modulus
        plane = _orthotropic(E, E, material.shear_modulus, material.poisson_ratio)
        return cls(_joined(h * plane, h**3 / 12.0 * plane), h * material.density, h)

    @classmethod
    def orthotropic(
        cls,
        membrane: npt.ArrayLike,
        bending: npt.ArrayLike,
        poisson_ratio: float,
        mass: float,
        thickness: float,
        shear: npt.ArrayLike | None = None,
    ) -> Self:
        """Create a section from rigidities along e1 and e2, of a fabric for example.

        Args:
            membrane: force per width and strain, along e1 and e2, then in shear, N/m.
            bending: moment per width and curvature, about lines along e2 and e1, then moment m12
                for 2 kappa12, N m.
            poisson_ratio: contraction along e2 under tension along e1, also of bending.
            mass: per area, kg/m^2.
            thickness: m.
            shear: as for the class itself.

        Raises:
            TypeError: An argument does not consist of numbers.
            ValueError: As for the class itself.
        """
        blocks = []
        for name, values in (("membrane", membrane), ("bending", bending)):
            first, second, sheared = _checks.array("ShellSection", name, values, (3,)).tolist()
            for value in (first, second, sheared):
                _checks.number("ShellSection", f"{name} rigidity", value, positive=True)
            _check_ratio("ShellSection", poisson_ratio, first, second)
            blocks.append(_orthotropic(first, second, sheared, poisson_ratio))
        return cls(_joined(*blocks), mass, thickness, shear)

    @classmethod
    def laminate(
        cls, plies: Sequence[Ply], offset: float = 0.0, shear: npt.ArrayLike | None = None
    ) -> Self:
        """Create a laminate by classical lamination theory.

        Args:
            plies: from the lowest to the highest, along e3.
            offset: of the middle of the laminate from the reference surface, along e3, m.
            shear: as for the class itself; None for 5/6 of the sum of the plies' shear moduli times
                their thicknesses, as if they sheared across the thickness as in the plane.

        Raises:
            TypeError: A ply is none, or the offset is no number.
            ValueError: There is no ply.
        """
        shift = _checks.number("ShellSection", "offset", offset)
        if len(plies) == 0:
            raise ValueError("ShellSection: plies must hold at least one ply, got none")
        for ply in plies:
            _checks.instance("ShellSection", "ply", ply, Ply)
        if shear is None:
            sheared = sum(ply.shear_modulus * ply.thickness for ply in plies)
            shear = _SHEAR_FACTOR * sheared * np.eye(2)
        heights = np.array([ply.thickness for ply in plies])
        total = float(heights.sum())
        top = np.cumsum(heights) - 0.5 * total + shift
        low = top - heights
        A, B, D = (
            sum((b**n - a**n) / n * p.stiffness for a, b, p in zip(low, top, plies, strict=True))
            for n in (1, 2, 3)
        )
        mass = sum(ply.thickness * ply.density for ply in plies)
        return cls(_joined(np.asarray(A), np.asarray(D), np.asarray(B)), mass, total, shear)


def _check_ratio(owner: str, ratio: float, first: float, second: float) -> None:
    """Check that a Poisson's ratio leaves the energy of all strains positive."""
    limit = (first / second) ** 0.5
    if not abs(_checks.number(owner, "poisson_ratio", ratio)) < limit:
        raise ValueError(
            f"{owner}: poisson_ratio must be below the root of the moduli's ratio, {limit:g}, in "
            f"size, got {ratio}"
        )


def _orthotropic(first: float, second: float, shear: float, ratio: float) -> FloatArray:
    """Plane-stress stiffness of two moduli, a shear modulus and a Poisson's ratio."""
    slope = 1.0 / (1.0 - ratio * ratio * second / first)
    return np.array([
        [slope * first, slope * ratio * second, 0.0],
        [slope * ratio * second, slope * second, 0.0],
        [0.0, 0.0, shear],
    ])  # fmt: skip


def _joined(A: FloatArray, D: FloatArray, B: FloatArray | None = None) -> FloatArray:
    """Stiffness of membrane, bending and coupling."""
    coupling = np.zeros((3, 3)) if B is None else B
    return np.block([[A, coupling], [coupling.T, D]])
