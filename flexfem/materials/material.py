# SPDX-License-Identifier: LGPL-3.0-or-later
"""Isotropic linear elastic material."""

from dataclasses import dataclass

from flexfem import _checks


@dataclass(frozen=True)
class Material:
    """Isotropic linear elastic material.

    Attributes:
        youngs_modulus: Young's modulus E, pascals, positive.
        poisson_ratio: Poisson's ratio nu, in (-1, 0.5].
        density: Mass per volume, kg/m^3, not negative.
    """

    youngs_modulus: float
    poisson_ratio: float
    density: float

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            TypeError: A value is not a number.
            ValueError: A value is not finite or outside its range.
        """
        _checks.number("Material", "youngs_modulus", self.youngs_modulus, positive=True)
        _checks.number("Material", "density", self.density, nonnegative=True)
        ratio = _checks.number("Material", "poisson_ratio", self.poisson_ratio)
        if not -1.0 < ratio <= 0.5:
            raise ValueError(f"Material: poisson_ratio must be in (-1, 0.5], got {ratio}")

    @property
    def shear_modulus(self) -> float:
        """Shear modulus G = E / (2 (1 + nu)), pascals."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poisson_ratio))
