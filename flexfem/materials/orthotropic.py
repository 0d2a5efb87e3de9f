# SPDX-License-Identifier: LGPL-3.0-or-later
"""Orthotropic linear elastic material."""

from dataclasses import dataclass

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray

__all__ = ["OrthotropicMaterial"]

# Smallest eigenvalue of the compliance, its diagonal scaled to one, that counts as positive
_DEFINITE = 1e-9


@dataclass(frozen=True)
class OrthotropicMaterial:
    """Orthotropic linear elastic material, axis 1 along the fibres.

    Attributes:
        youngs_moduli: (E1, E2, E3), pascals, positive.
        shear_moduli: (G12, G13, G23), pascals, positive.
        poisson_ratios: (nu12, nu13, nu23); nu12 is the contraction along 2 under tension along 1.
        density: Mass per volume, kg/m^3, not negative.
    """

    youngs_moduli: tuple[float, float, float]
    shear_moduli: tuple[float, float, float]
    poisson_ratios: tuple[float, float, float]
    density: float

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            TypeError: A value is not a number.
            ValueError: A value is not finite or outside its range, or the material is not
                positive definite.
        """
        owner = "OrthotropicMaterial"
        _checks.number(owner, "density", self.density, nonnegative=True)
        for what in ("youngs_moduli", "shear_moduli", "poisson_ratios"):
            values = _checks.array(owner, what, getattr(self, what), (3,))
            if what != "poisson_ratios" and (values <= 0.0).any():
                raise ValueError(
                    f"OrthotropicMaterial: {what} must be positive, got {values.tolist()}"
                )
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
