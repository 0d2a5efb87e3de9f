# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL form of the rotation-free shell, at one triangle.

With ``f_a`` the derivatives of the position along the axes e1, e2 of the start, the strains of a
frame whose first axis stays on the first of two material lines (side alignment; Shi, Liu, Hong,
Acta Mech. Sinica 34 (2018), without their assumption of constant area) are

    eps_11 = |f_1| - 1,  eps_22 = |f_1 x f_2| / |f_1| - 1,  gamma_12 = f_1 . f_2 / |f_1|,

(for smoothed derivatives less their values at the start instead of 1, 1, 0), and with the curvature
vectors ``k = (k_11, k_22, 2 k_12)`` of the patch and the unit normal n

    kappa = n . k - kappa_0,

``kappa_0`` being the value at the start. The energy per area of the start is
``(eps^T D_m eps + 2 eps^T D_c kappa + kappa^T D_b kappa) / 2``; its derivatives are exact. Rigid
rotations rotate f, k and n in the same way and leave the strains unchanged.

The form of a point takes the fifteen numbers ``(f_1, f_2, k_11, k_22, 2 k_12)`` and is independent
of patches; the nodal forces are in ``flexfem.families.shell_rotation_free.triangles``. The
functions of strains and energy take any expressions, hence also those of a mesh.
"""

from dataclasses import dataclass
from functools import cache

import ufl

from flexfem.forms.beam_law import constant_field, interval_mesh, symmetric, written
from flexfem.forms.lie import Expr

__all__ = ["POINT", "ShellForms", "shell_energy", "shell_forms", "shell_strains"]

#: Number of the unknowns at a point.
POINT = 15


@dataclass(frozen=True)
class ShellForms:
    """Forms of the linear section law and the order in which they expect their data.

    Both have rank 1 and write their quantities, row by row, per area of the start.

    Attributes:
        residual: force (15,), work-conjugate to the unknowns.
        tangent: force (15,) and its derivative by the unknowns (15, 15).
        coefficients: by name, in the order in which a triangle's data is packed: ``unknowns``
            (15,); ``start``, 1, 1, 0 and kappa_0 (6,); ``stiffness``, the upper triangle of the 6x6
            matrix ``[D_m D_c; D_c^T D_b]``, row by row (21,).
    """

    residual: ufl.Form
    tangent: ufl.Form
    coefficients: dict[str, ufl.Coefficient]


def shell_strains(f1: Expr, f2: Expr, curvature: Expr, start: Expr) -> Expr:
    """Strains (6,): eps_11, eps_22, gamma_12, kappa_11, kappa_22, 2 kappa_12.

    Args:
        f1: derivative of the position along e1, (3,).
        f2: the same along e2.
        curvature: curvature vectors, row by row, 1/m, (3, 3).
        start: values without strain: 1, 1, 0 and kappa_0, 1/m, (6,).
    """
    length, across = ufl.sqrt(ufl.dot(f1, f1)), ufl.cross(f1, f2)
    ratio = ufl.sqrt(ufl.dot(across, across))
    bending = curvature * (across / ratio)
    membrane = [length, ratio / length, ufl.dot(f1, f2) / length]
    return ufl.as_vector([*membrane, bending[0], bending[1], bending[2]]) - start


def shell_energy(strain: Expr, stiffness: Expr) -> Expr:
    """Energy per area, J/m^2.

    Args:
        strain: strains (6,).
        stiffness: matrix (6, 6) of N/m, N and N m.
    """
    return ufl.dot(strain, stiffness * strain) / 2


@cache
def shell_forms() -> ShellForms:
    """Build the forms of the linear law."""
    mesh = interval_mesh()
    fields = {
        "unknowns": constant_field(mesh, POINT),
        "start": constant_field(mesh, 6),
        "stiffness": constant_field(mesh, 21),
    }
    unknowns = ufl.variable(fields["unknowns"])
    rows = [ufl.as_vector([unknowns[first + i] for i in range(3)]) for first in range(0, POINT, 3)]
    curvature = ufl.as_matrix([[row[i] for i in range(3)] for row in rows[2:]])
    strain = shell_strains(rows[0], rows[1], curvature, fields["start"])
    force = ufl.diff(shell_energy(strain, symmetric(fields["stiffness"])), unknowns)
    matrix = ufl.diff(force, unknowns)
    entries = [force[i] for i in range(POINT)]
    places = [(i, j) for i in range(POINT) for j in range(POINT)]
    return ShellForms(
        residual=written(mesh, entries),
        tangent=written(mesh, entries + [matrix[i, j] for i, j in places]),
        coefficients=fields,
    )
