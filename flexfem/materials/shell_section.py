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
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import Array, ArrayOrNone, checked, declared, instance, number
from flexfem._types import FloatArray
from flexfem.materials.material import Material
from flexfem.materials.matrices import check_definite
from flexfem.materials.section_law import ShellLaw

__all__ = ["Ply", "ShellSection"]

#: Part of the shear stiffness that the parabola of stresses over a homogeneous thickness leaves
#: (Reissner 1945).
_SHEAR_FACTOR = 5.0 / 6.0


def _moduli(owner: str, what: str, value: Any) -> None:
    """Check two positive numbers."""
    for modulus in _checks.array(owner, what, value, (2,)).tolist():
        _checks.number(owner, "modulus", modulus, positive=True)


def _matrix(owner: str, what: str, value: Any) -> FloatArray:
    """Return a checked stiffness."""
    matrix = _checks.array(owner, what, value, (2, 2) if what == "shear" else (6, 6))
    check_definite(owner, what, matrix, semidefinite=False)
    return matrix


@declared(eq=True)
class Ply:
    """Layer of a laminate: orthotropic, its fibres in the plane of the shell.

    Attributes:
        thickness: m.
        angle: from e1 to the fibres, about e3, rad.
        moduli: Young's moduli along and across the fibres, Pa.
        shear_modulus: in the plane, Pa.
        poisson_ratio: contraction across the fibres under tension along them.
        density: kg/m^3.

    Raises:
        TypeError: A value is not a number.
        ValueError: A value is not finite or outside its range.
    """

    thickness: float = number(positive=True, as_given=True)
    angle: float = number(as_given=True)
    moduli: tuple[float, float] = checked(_moduli, as_given=True)
    shear_modulus: float = number(positive=True, as_given=True)
    poisson_ratio: float
    density: float = number(nonnegative=True, as_given=True)

    def __post_init__(self) -> None:
        """Check the ratio against the moduli."""
        _check_ratio("Ply", self.poisson_ratio, *self.moduli)

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


@declared
class ShellSection:
    """Section of a shell.

    Attributes:
        stiffness: Maps strains to forces and moments per length, shape (6, 6); N/m, N, N m.
        mass: Mass per area, kg/m^2.
        thickness: m, of pictures, of contact and of rotary inertia.
        shear: Maps shear strains across the thickness to forces per length, shape (2, 2), N/m. None
            for 5/6 of the stiffness of the membrane in shear along both axes, which is right for a
            homogeneous isotropic plate.
        law: The section's own law, which takes the place of the stiffness; None for the linear one.
            The stiffness is that for small strains then, of which free edges and the automatic
            stiffness of contact are made.

    The other constructors are for common laws.

    Raises:
        TypeError: An argument does not consist of numbers.
        ValueError: A stiffness is not symmetric and positive definite, the mass negative, the
            thickness not positive, or an argument has the wrong shape or is not finite.
    """

    stiffness: Array = checked(_matrix)
    mass: float = number(nonnegative=True)
    thickness: float = number(positive=True)
    shear: ArrayOrNone = checked(_matrix, default=None)
    law: ShellLaw | None = instance(ShellLaw, default=None)

    def __post_init__(self) -> None:
        """Choose a shear stiffness where none is given."""
        if self.shear is None:
            shear = _SHEAR_FACTOR * self.stiffness[2, 2] * np.eye(2)
            _checks.assign(self, shear=_checks.freeze(shear))

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
