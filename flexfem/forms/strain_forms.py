# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL forms of strains, of which forces and tangents of any section law are made.

With strains ``e(u)`` of some numbers u of an element, and stresses s = s(e), the virtual work
``s . de`` has the force and the tangent

    f = B^T s,    K = B^T (ds/de) B + d(B^T s)/du at fixed s,    B = de/du .

B and the last matrix are derivatives that UFL takes of the strains. The law may be linear, one of
the user in UFL, or stresses that are given.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Self

import ufl

from flexfem.forms.beam_law import constant_field, interval_mesh, written
from flexfem.forms.director_shell import curvature_products, shear_products, stretch_products
from flexfem.forms.lie import Expr
from flexfem.forms.shell import POINT, shell_strains

__all__ = ["StrainForms", "director_strains", "rotation_free_strains"]


@dataclass(frozen=True)
class StrainForms:
    """Forms of k strains of n unknowns, which write their quantities row by row.

    Attributes:
        strain: strains (k,) and their derivatives (k, n).
        geometric: second derivative (n, n) of ``s . e``.
        unknowns: coefficient u (n,).
        stress: coefficient s (k,), which ``strain`` does without.
    """

    strain: ufl.Form
    geometric: ufl.Form
    unknowns: ufl.Coefficient
    stress: ufl.Coefficient

    @classmethod
    def of(cls, strains: Callable[[Expr], Sequence[Expr]], count: int) -> Self:
        """Forms of strains that are a function of ``count`` unknowns (n,)."""
        mesh = interval_mesh()
        unknowns = constant_field(mesh, count)
        u = ufl.variable(unknowns)
        found = list(strains(u))
        stress = constant_field(mesh, len(found))
        rates = [ufl.diff(strain, u) for strain in found]
        virtual = sum(stress[i] * strain for i, strain in enumerate(found))
        matrix = ufl.diff(ufl.diff(virtual, u), u)
        places = [(i, j) for i in range(count) for j in range(count)]
        return cls(
            written(mesh, found + [rate[j] for rate in rates for j in range(count)]),
            written(mesh, [matrix[i, j] for i, j in places]),
            unknowns,
            stress,
        )


@cache
def rotation_free_strains() -> StrainForms:
    """Forms of the strains of ``forms.shell``, nothing being subtracted, by its 15 unknowns."""

    def strains(u: Expr) -> list[Expr]:
        rows = [ufl.as_vector([u[3 * s + a] for a in range(3)]) for s in range(POINT // 3)]
        curvature = ufl.as_matrix([[row[a] for a in range(3)] for row in rows[2:]])
        found = shell_strains(rows[0], rows[1], curvature, ufl.as_vector([0.0] * 6))
        return [found[i] for i in range(6)]

    return StrainForms.of(strains, POINT)


@cache
def director_strains() -> StrainForms:
    """Forms of the products of ``forms.director_shell`` at a point by its 15 unknowns.

    These are ``g_1``, ``g_2``, ``d``, ``d,1`` and ``d,2``; the products those of the membrane (3),
    the curvature (3) and the shear (2), nothing being subtracted.
    """

    def strains(u: Expr) -> list[Expr]:
        g1, g2, d, d1, d2 = (ufl.as_vector([u[3 * s + a] for a in range(3)]) for s in range(5))
        return [
            *stretch_products(g1, g2), *curvature_products(g1, g2, d1, d2),
            *shear_products(g1, g2, d),
        ]  # fmt: skip

    return StrainForms.of(strains, 15)
