# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL of small deformations of shear-deformable beams in space, made of straight cells.

Unknowns are the displacement u of the axis and the rotation theta of the section, both in body
axes. With t the tangent and R = [e1 e2 e3] the section's axes, strains in these are
``gamma = R^T (u' + t x theta)`` and ``kappa = R^T theta'``, the linear part of those of the
geometrically exact beam; their quadratic part in a rotation vector theta,
``-theta x u' + theta x (theta x t)/2`` and ``-theta x theta'/2``, gives the geometric stiffness
(Simo and Vu-Quoc 1986, linearised about the straight state).
"""

from typing import Any

import ufl

__all__ = ["beam_axes", "beam_strain", "second_order_work"]

Expr = Any


def beam_axes(domain: Any, orientation: Expr | None) -> Expr:
    """Axes (3, 3) of the section in columns, constant along a cell.

    e1 points from the cell's first vertex to the second, e2 lies in the plane of e1 and the
    orientation; without one it is horizontal, along ez x e1, or along ey on vertical cells.
    """
    J = ufl.Jacobian(domain)
    t = J[:, 0] / ufl.sqrt(ufl.dot(J[:, 0], J[:, 0]))
    if orientation is None:
        vertical = ufl.gt(abs(t[2]), 1.0 - 1e-8)
        across = ufl.as_vector([-t[1], t[0], 0.0])
        y = ufl.as_vector([0.0, 1.0, 0.0])
        orientation = ufl.as_vector([ufl.conditional(vertical, y[i], across[i]) for i in range(3)])
    e3 = ufl.cross(t, orientation)
    e3 = e3 / ufl.sqrt(ufl.dot(e3, e3))
    e2 = ufl.cross(e3, t)
    return ufl.as_matrix([[t[i], e2[i], e3[i]] for i in range(3)])


def _along(field: Expr, axes: Expr) -> Expr:
    """Derivative along the axis."""
    return ufl.dot(ufl.grad(field), axes[:, 0])


def beam_strain(u: Expr, theta: Expr, axes: Expr) -> Expr:
    """Strains (gamma, kappa), six numbers in section axes."""
    t = axes[:, 0]
    gamma = ufl.dot(axes.T, _along(u, axes) + ufl.cross(t, theta))
    kappa = ufl.dot(axes.T, _along(theta, axes))
    return ufl.as_vector([*(gamma[i] for i in range(3)), *(kappa[i] for i in range(3))])


def second_order_work(
    resultants: Expr, first: tuple[Expr, Expr], second: tuple[Expr, Expr], axes: Expr
) -> Expr:
    """Work of forces and moments (n, m), section axes, on the bilinear strain of two motions."""
    t = axes[:, 0]
    n = ufl.dot(axes, ufl.as_vector([resultants[i] for i in range(3)]))
    m = ufl.dot(axes, ufl.as_vector([resultants[i] for i in range(3, 6)]))
    work = 0.0
    for (u, theta), (_, other) in ((first, second), (second, first)):
        gamma = -ufl.cross(other, _along(u, axes)) + 0.5 * ufl.cross(theta, ufl.cross(other, t))
        kappa = -0.5 * ufl.cross(other, _along(theta, axes))
        work = work + ufl.dot(n, gamma) + ufl.dot(m, kappa)
    return work
