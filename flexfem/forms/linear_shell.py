# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL of small deformations of shells of flat facets that shear across their thickness.

Unknowns are the displacement u of the middle surface and the rotation theta, both in body axes.
With the facet's axes e1, e2 and normal n, the director changes by ``phi = theta x n``, and

    eps_ab = sym(e_a . u,_b),  kappa_ab = sym(e_a . phi,_b),  gamma_a = n . u,_a + e_a . phi

(Reissner 1945, Mindlin 1951). The rotation of a facet about its normal,
``(e2 . u,_1 - e1 . u,_2)/2``, is tied to theta by a weak spring.
"""

from typing import Any

import ufl

__all__ = ["facet_axes", "membrane_work", "shell_strains", "stress_tensor"]

Expr = Any


def facet_axes(domain: Any, orientation: Expr | None) -> tuple[Expr, Expr, Expr]:
    """Axes e1, e2, n of the facets; e1 is the orientation's part in the facet, or along an edge."""
    J = ufl.Jacobian(domain)
    n = ufl.cross(J[:, 0], J[:, 1])
    n = n / ufl.sqrt(ufl.dot(n, n))
    along = J[:, 0] if orientation is None else orientation - ufl.dot(orientation, n) * n
    e1 = along / ufl.sqrt(ufl.dot(along, along))
    return e1, ufl.cross(n, e1), n


def _derivatives(field: Expr, axes: tuple[Expr, Expr, Expr]) -> tuple[Expr, Expr]:
    """Derivatives along e1 and e2."""
    gradient = ufl.grad(field)
    return ufl.dot(gradient, axes[0]), ufl.dot(gradient, axes[1])


def _plane(first: Expr, second: Expr, axes: tuple[Expr, Expr, Expr]) -> tuple[Expr, Expr, Expr]:
    """Components 11, 22 and 12 + 21 of two derivatives."""
    e1, e2, _ = axes
    return (
        ufl.dot(e1, first),
        ufl.dot(e2, second),
        ufl.dot(e1, second) + ufl.dot(e2, first),
    )


def shell_strains(u: Expr, theta: Expr, axes: tuple[Expr, Expr, Expr]) -> tuple[Expr, Expr, Expr]:
    """Membrane strains and curvatures (6), shear strains (2), and the rotation about the normal."""
    e1, e2, n = axes
    u_1, u_2 = _derivatives(u, axes)
    theta_1, theta_2 = _derivatives(theta, axes)
    phi = ufl.cross(theta, n)
    plane = _plane(u_1, u_2, axes)
    bent = _plane(ufl.cross(theta_1, n), ufl.cross(theta_2, n), axes)
    shear = ufl.as_vector([ufl.dot(n, u_1) + ufl.dot(e1, phi), ufl.dot(n, u_2) + ufl.dot(e2, phi)])
    drill = 0.5 * (ufl.dot(e2, u_1) - ufl.dot(e1, u_2)) - ufl.dot(theta, n)
    return ufl.as_vector([*plane, *bent]), shear, drill


def membrane_work(force: Expr, u: Expr, v: Expr, axes: tuple[Expr, Expr, Expr]) -> Expr:
    """Work of membrane forces (n11, n22, n12) on the strain of second order of two motions."""
    u_1, u_2 = _derivatives(u, axes)
    v_1, v_2 = _derivatives(v, axes)
    return (
        force[0] * ufl.dot(u_1, v_1)
        + force[1] * ufl.dot(u_2, v_2)
        + force[2] * (ufl.dot(u_1, v_2) + ufl.dot(u_2, v_1))
    )


def stress_tensor(components: Expr, axes: tuple[Expr, Expr, Expr]) -> Expr:
    """Tensor (3, 3) in body axes of the components 11, 22, 12 in the facet."""
    e1, e2, _ = axes
    s11, s22, s12 = (components[i] for i in range(3))
    return (
        s11 * ufl.outer(e1, e1)
        + s22 * ufl.outer(e2, e2)
        + s12 * (ufl.outer(e1, e2) + ufl.outer(e2, e1))
    )
