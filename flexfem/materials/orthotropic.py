# SPDX-License-Identifier: LGPL-3.0-or-later
"""Orthotropic linear elastic material."""

from typing import Any

import numpy as np

from flexfem import _checks
from flexfem._fields import checked, declared, number, vector
from flexfem._types import FloatArray

__all__ = ["OrthotropicMaterial"]

# Smallest eigenvalue of the compliance, its diagonal scaled to one, that counts as positive
_DEFINITE = 1e-9


def _moduli(owner: str, what: str, value: Any) -> None:
    """Check three positive numbers."""
    moduli = _checks.vector(owner, what, value)
    if (moduli <= 0.0).any():
        raise ValueError(f"{owner}: {what} must be positive, got {moduli.tolist()}")


@declared(eq=True)
class OrthotropicMaterial:
    """Orthotropic linear elastic material, axis 1 along the fibres.

    Attributes:
        youngs_moduli: (E1, E2, E3), pascals, positive.
        shear_moduli: (G12, G13, G23), pascals, positive.
        poisson_ratios: (nu12, nu13, nu23); nu12 is the contraction along 2 under tension along 1.
        density: Mass per volume, kg/m^3, not negative.

    Raises:
        TypeError: A value is not a number.
        ValueError: A value is not finite or outside its range, or the material is not positive
            definite.
    """

    youngs_moduli: tuple[float, float, float] = checked(_moduli, as_given=True)
    shear_moduli: tuple[float, float, float] = checked(_moduli, as_given=True)
    poisson_ratios: tuple[float, float, float] = vector(as_given=True)
    density: float = number(nonnegative=True, as_given=True)

    def __post_init__(self) -> None:
        """Check that the material is positive definite."""
        block = self.compliance[:3, :3]
        scale = np.sqrt(np.diagonal(block))
        if np.linalg.eigvalsh(block / np.outer(scale, scale))[0] < _DEFINITE:
            raise ValueError(
                "OrthotropicMaterial: poisson_ratios must leave the stiffness positive definite, "
                f"got {list(self.poisson_ratios)} with youngs_moduli {list(self.youngs_moduli)}"
            )

    @property
    def compliance(self) -> FloatArray:
        """Strains (11, 22, 33, 23, 13, 12; shears doubled) of unit stresses, shape (6, 6), 1/Pa."""
        e1, e2, e3 = self.youngs_moduli
        g12, g13, g23 = self.shear_moduli
        nu12, nu13, nu23 = self.poisson_ratios
        result = np.diag([1 / e1, 1 / e2, 1 / e3, 1 / g23, 1 / g13, 1 / g12])
        result[0, 1] = result[1, 0] = -nu12 / e1
        result[0, 2] = result[2, 0] = -nu13 / e1
        result[1, 2] = result[2, 1] = -nu23 / e2
        return result
