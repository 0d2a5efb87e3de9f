# SPDX-License-Identifier: LGPL-3.0-or-later
"""Materials of the parts of a section, and their elastic matrices in section axes.

Stresses and strains are ordered (11, 22, 33, 23, 13, 12), shear strains doubled; axis 1 is that
of the beam, 2 and 3 are e2 and e3 of the section.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import checked, declared, instance, number
from flexfem._types import FloatArray
from flexfem.materials.material import Material
from flexfem.materials.orthotropic import OrthotropicMaterial

__all__ = ["VOIGT", "OrientedMaterial", "elastic_matrices", "elastic_matrix"]

#: Pairs of axes in the order of stresses.
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


def _angle(owner: str, what: str, value: Any) -> None:
    """Check a number; functions are checked where they are called."""
    if not callable(value):
        _checks.number(owner, what, value)


@declared(eq=True)
class OrientedMaterial:
    """Orthotropic material and its axes in a section.

    The plane of the layer contains the beam's axis e1 and the direction
    `t = cos(plane_angle) e2 + sin(plane_angle) e3`; the fibres run along
    `cos(fibre_angle) e1 + sin(fibre_angle) t`, and axis 3 of the material is the layer's normal
    `e1 x t`.

    Attributes:
        material: Constants in the axes of the fibres.
        fibre_angle: From e1 within the layer, radians.
        plane_angle: From e2 about e1, radians; or a function that maps points (y, z) of shape
            (k, 2), the centres of cells, to angles of shape (k,), as along a curved wall.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: An angle is not finite.
    """

    material: OrthotropicMaterial = instance(OrthotropicMaterial)
    fibre_angle: float = number(default=0.0, as_given=True)
    plane_angle: float | Callable[[FloatArray], npt.ArrayLike] = checked(
        _angle, default=0.0, as_given=True
    )

    @property
    def density(self) -> float:
        """Mass per volume, kg/m^3."""
        return self.material.density


type SectionMaterial = Material | OrthotropicMaterial | OrientedMaterial


def elastic_matrix(material: Material | OrthotropicMaterial) -> FloatArray:
    """Return the stresses of unit strains in the material's axes, shape (6, 6), pascals."""
    if isinstance(material, OrthotropicMaterial):
        return np.linalg.inv(material.compliance)
    g, nu = material.shear_modulus, material.poisson_ratio
    result = np.diag([2.0 * g] * 3 + [g] * 3)
    result[:3, :3] += 2.0 * g * nu / (1.0 - 2.0 * nu)
    return result


def elastic_matrices(material: SectionMaterial, centres: FloatArray) -> FloatArray:
    """Return the elastic matrices of cells in section axes, shape (k, 6, 6), pascals.

    Args:
        material: Of all these cells.
        centres: Of the cells, (y, z), shape (k, 2), metres.

    Raises:
        ValueError: A function of the plane's angle returns something else than k finite numbers.
    """
    if not isinstance(material, OrientedMaterial):
        return np.broadcast_to(elastic_matrix(material), (len(centres), 6, 6))
    given = material.plane_angle
    raw = given(centres) if callable(given) else np.full(len(centres), given)
    plane = _checks.array("OrientedMaterial", "plane_angle", raw, (len(centres),))
    axes = _axes(material.fibre_angle, plane)
    index = np.empty((3, 3), dtype=int)
    for k, (i, j) in enumerate(VOIGT):
        index[i, j] = index[j, i] = k
    tensor = elastic_matrix(material.material)[index[:, :, None, None], index]
    turned = np.einsum("kia,kjb,kpc,kqd,abcd->kijpq", axes, axes, axes, axes, tensor, optimize=True)
    rows, columns = np.transpose(VOIGT)
    result: FloatArray = turned[:, rows[:, None], columns[:, None], rows, columns]
    return result


def _axes(fibre: float, plane: FloatArray) -> FloatArray:
    """Return the material's axes as columns in section axes, shape (k, 3, 3)."""
    c, s, zero = np.cos(plane), np.sin(plane), np.zeros_like(plane)
    e1 = np.stack([zero + 1.0, zero, zero], axis=1)
    t = np.stack([zero, c, s], axis=1)
    along = np.cos(fibre) * e1 + np.sin(fibre) * t
    across = np.cos(fibre) * t - np.sin(fibre) * e1
    return np.stack([along, across, np.stack([zero, -s, c], axis=1)], axis=2)
