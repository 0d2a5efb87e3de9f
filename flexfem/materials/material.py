# SPDX-License-Identifier: LGPL-3.0-or-later
"""Isotropic linear elastic material."""

from flexfem import _checks
from flexfem._fields import checked, declared, number


def _ratio(owner: str, what: str, value: float) -> None:
    """Check a Poisson's ratio."""
    ratio = _checks.number(owner, what, value)
    if not -1.0 < ratio <= 0.5:
        raise ValueError(f"{owner}: {what} must be in (-1, 0.5], got {ratio}")


@declared(eq=True)
class Material:
    """Isotropic linear elastic material.

    Attributes:
        youngs_modulus: Young's modulus E, pascals, positive.
        poisson_ratio: Poisson's ratio nu, in (-1, 0.5].
        density: Mass per volume, kg/m^3, not negative.

    Raises:
        TypeError: A value is not a number.
        ValueError: A value is not finite or outside its range.
    """

    youngs_modulus: float = number(positive=True, as_given=True)
    poisson_ratio: float = checked(_ratio, as_given=True)
    density: float = number(nonnegative=True, as_given=True)

    @property
    def shear_modulus(self) -> float:
        """Shear modulus G = E / (2 (1 + nu)), pascals."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poisson_ratio))
