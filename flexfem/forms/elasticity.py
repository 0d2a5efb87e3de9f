# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL of small elastic deformations of solids and of plates in their plane.

Displacements have as many components as the body has dimensions; a plane body lies in the plane of
the first two axes, whatever the dimension of the space around it.
"""

from typing import Any

import ufl

__all__ = [
    "gradient",
    "in_space",
    "plane_stress",
    "prestress_work",
    "small_rotation",
    "solid_stress",
    "strain",
]

Expr = Any


def in_space(vector: Expr) -> Expr:
    """A vector of one to three components as one of three."""
    count = vector.ufl_shape[0]
    return ufl.as_vector([vector[i] if i < count else 0.0 * vector[0] for i in range(3)])


def gradient(u: Expr) -> Expr:
    """Square displacement gradient: derivatives along as many axes as u has components."""
    full = ufl.grad(u)
    count = u.ufl_shape[0]
    if full.ufl_shape == (count, count):
        return full
    return ufl.as_matrix([[full[i, j] for j in range(count)] for i in range(count)])


def small_rotation(u: Expr) -> Expr:
    """Small rotation vector of three, half the curl."""
    g = gradient(u)
    turn = 0.5 * (g[1, 0] - g[0, 1])
    if len(u) == 2:
        return ufl.as_vector([0.0 * turn, 0.0 * turn, turn])
    return ufl.as_vector([0.5 * (g[2, 1] - g[1, 2]), 0.5 * (g[0, 2] - g[2, 0]), turn])


def strain(u: Expr) -> Expr:
    """Small strain, the symmetric part of the gradient."""
    return ufl.sym(gradient(u))


def solid_stress(u: Expr, youngs_modulus: Expr, poisson_ratio: Expr) -> Expr:
    """Stress (3, 3) of an isotropic solid."""
    e, nu = youngs_modulus, poisson_ratio
    eps = strain(u)
    lame = e * nu / ((1 + nu) * (1 - 2 * nu))
    return lame * ufl.tr(eps) * ufl.Identity(3) + e / (1 + nu) * eps


def plane_stress(u: Expr, youngs_modulus: Expr, poisson_ratio: Expr) -> Expr:
    """Stress (2, 2) of an isotropic plate in its plane, none across its thickness."""
    e, nu = youngs_modulus, poisson_ratio
    eps = strain(u)
    return e / (1 - nu**2) * (nu * ufl.tr(eps) * ufl.Identity(2) + (1 - nu) * eps)


def prestress_work(stress: Expr, u: Expr, v: Expr) -> Expr:
    """Work of a stress on the strain of second order: ``stress : grad(u)^T grad(v)``."""
    return ufl.inner(stress, ufl.dot(gradient(u).T, gradient(v)))
