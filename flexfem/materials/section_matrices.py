# SPDX-License-Identifier: LGPL-3.0-or-later
"""Matrices of a beam section from the constants of its shape.

Axes, orders and signs are those of ``flexfem.materials.section``.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.materials.constants import Shape
from flexfem.materials.material import Material

__all__ = [
    "about_centres",
    "about_shear_centre",
    "inertia_about_axis",
    "inertia_of",
    "stiffness_of",
]


def stiffness_of(
    shape: Shape, material: Material, factors: tuple[float, float], coupling: float = 0.0
) -> FloatArray:
    """Return the stiffness of a section whose centres all lie on the reference axis.

    The factors are those of shear (k2, k3), the coupling is k23.
    """
    e, g = material.youngs_modulus, material.shear_modulus
    i22, i33 = shape.second_moments
    k2, k3 = factors
    area = shape.area
    result = np.diag(
        [e * area, k2 * g * area, k3 * g * area, g * shape.torsion_constant, e * i22, e * i33]
    )
    result[1, 2] = result[2, 1] = coupling * g * area
    result[4, 5] = result[5, 4] = -e * shape.product
    return result


def about_shear_centre(stiffness: FloatArray, centre: FloatArray) -> FloatArray:
    """Let shear forces act through, and twist rotate about, the shear centre (y, z).

    The shear strains there are `gamma2 - z kappa1` and `gamma3 + y kappa1` (the strain of the
    point c is gamma + kappa x c; extension stays that of the reference axis). With A the matrix
    of this map, `D' = A^T D A`.
    """
    y, z = centre
    a = np.eye(6)
    a[1, 3] = -z
    a[2, 3] = y
    result: FloatArray = a.T @ stiffness @ a
    return result


def about_centres(stiffness: FloatArray, tension: FloatArray, shear: FloatArray) -> FloatArray:
    """Let normal forces act through the tension centre (y, z), shear through the shear centre.

    The extension of the tension centre is `gamma1 + z kappa2 - y kappa3`, the shear strains are
    those of :func:`about_shear_centre`.
    """
    y, z = tension
    a = np.eye(6)
    a[0, 4] = z
    a[0, 5] = -y
    return about_shear_centre(a.T @ stiffness @ a, shear)


def inertia_of(shape: Shape, density: float, centre: FloatArray) -> FloatArray:
    """Return the inertia per length about the reference axis, mass centre at (y, z)."""
    i22, i33 = shape.second_moments
    rotary = density * np.diag([i22 + i33, i22, i33])
    rotary[1, 2] = rotary[2, 1] = -density * shape.product
    return inertia_about_axis(density * shape.area, centre, rotary)


def inertia_about_axis(mass: float, centre: FloatArray, rotary: FloatArray) -> FloatArray:
    """Return the inertia per length about the reference axis from that about the mass centre.

    Args:
        mass: Per length, kg/m.
        centre: Mass centre (y, z), m.
        rotary: Rotary inertia (3, 3) about it, kg m.
    """
    y, z = centre
    skew = mass * np.array([[0.0, -z, y], [z, 0.0, 0.0], [-y, 0.0, 0.0]])
    # m (c.c I - c c^T) is skew(c)^T skew(c) times m
    steiner = skew.T @ skew / mass if mass > 0.0 else np.zeros((3, 3))
    return np.block([[mass * np.eye(3), -skew], [skew, rotary + steiner]])
