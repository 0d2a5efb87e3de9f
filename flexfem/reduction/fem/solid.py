# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies of solid elements, and of plane ones."""

from typing import Any

import numpy as np
import ufl
from dolfinx import fem, mesh

from flexfem import _checks
from flexfem.forms.elasticity import (
    in_space,
    plane_stress,
    prestress_work,
    solid_stress,
    strain,
)
from flexfem.materials.material import Material
from flexfem.reduction.fem.body.linear_body import LinearBody, MassField

__all__ = ["plane_body", "solid_body"]

_DEGREES = (1, 2, 3)
_CELLS = (
    mesh.CellType.triangle,
    mesh.CellType.quadrilateral,
    mesh.CellType.tetrahedron,
    mesh.CellType.hexahedron,
)


def solid_body(
    domain: mesh.Mesh, material: Material, degree: int = 2, *, name: str = "solid"
) -> LinearBody:
    """An isotropic solid of tetrahedra or hexahedra.

    Args:
        domain: mesh in body axes, m; of any shape and on any number of ranks.
        material: elastic constants and density.
        degree: of the displacements; linear ones are much too stiff in bending.
        name: for messages.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: the mesh is not of solid cells, the degree not 1 to 3, the material without
            mass or incompressible.
    """
    owner = f'solid_body "{name}"'
    _check(owner, domain, material, degree, 3)
    if material.poisson_ratio == 0.5:
        raise ValueError(f"{owner}: poisson_ratio must be less than 0.5 for solid elements")
    e, nu = _constants(domain, material)
    space = fem.functionspace(domain, ("Lagrange", degree, (3,)))

    def stress(u: Any) -> Any:
        return solid_stress(u, e, nu)

    return LinearBody(
        space,
        lambda u, v: ufl.inner(stress(u), strain(v)) * ufl.dx(domain),
        [MassField(material.density, ufl.SpatialCoordinate(domain), in_space)],
        prestress=lambda u0, u, v: prestress_work(stress(u0), u, v) * ufl.dx(domain),
        stress=stress,
        name=name,
    )


def plane_body(
    domain: mesh.Mesh,
    thickness: float,
    material: Material,
    degree: int = 2,
    *,
    name: str = "plane",
) -> LinearBody:
    """A plate that moves and deforms in its plane, which is that of the body's x and y axes.

    Its inertia is that of the whole thickness, z = 0 in the middle.

    Args:
        domain: mesh of triangles or quadrilaterals at z = 0, in two or three dimensions, m.
        thickness: m.
        material: elastic constants and density.
        degree: of the displacements.
        name: for messages.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: the mesh is not of plane cells at z = 0, a number is out of its range.
    """
    owner = f'plane_body "{name}"'
    _check(owner, domain, material, degree, 2)
    width = _checks.number(owner, "thickness", thickness, positive=True)
    points = domain.geometry.x
    away = abs(points[:, 2]).max(initial=0.0)
    if (away := max(domain.comm.allgather(float(away)))) > 1e-9 * width:
        raise ValueError(f"{owner}: the mesh must lie at z = 0, got a point at a distance {away:g}")
    e, nu = _constants(domain, material)
    space = fem.functionspace(domain, ("Lagrange", degree, (2,)))
    t = fem.Constant(domain, np.array(width))
    x = in_space(ufl.SpatialCoordinate(domain))
    # two sheets at this height have the second moment t^3/12 of the thickness
    height = ufl.as_vector([0.0, 0.0, t / 12.0**0.5])

    def force(u: Any) -> Any:
        return t * plane_stress(u, e, nu)

    def stress(u: Any) -> Any:
        s = plane_stress(u, e, nu)
        return ufl.as_matrix([[s[0, 0], s[0, 1], 0.0], [s[1, 0], s[1, 1], 0.0], [0.0, 0.0, 0.0]])

    return LinearBody(
        space,
        lambda u, v: ufl.inner(force(u), strain(v)) * ufl.dx(domain),
        [
            MassField(0.5 * material.density * width, x + side * height, in_space)
            for side in (-1, 1)
        ],
        prestress=lambda u0, u, v: prestress_work(force(u0), u, v) * ufl.dx(domain),
        stress=stress,
        name=name,
    )


def _constants(domain: mesh.Mesh, material: Material) -> tuple[Any, Any]:
    """As data of the compiled forms: other materials need not compile them again."""
    return (
        fem.Constant(domain, material.youngs_modulus),
        fem.Constant(domain, material.poisson_ratio),
    )


def _check(owner: str, domain: mesh.Mesh, material: Material, degree: int, dimension: int) -> None:
    _checks.instance(owner, "mesh", domain, mesh.Mesh)
    _checks.instance(owner, "material", material, Material)
    _checks.number(owner, "density", material.density, positive=True)
    if degree not in _DEGREES:
        raise ValueError(f"{owner}: degree must be one of {_DEGREES}, got {_checks.show(degree)}")
    if domain.topology.dim != dimension:
        raise ValueError(
            f"{owner}: cells must have {dimension} dimensions, got {domain.topology.dim}"
        )
    kind = domain.topology.cell_type
    if kind not in _CELLS:
        raise ValueError(f"{owner}: cannot use cells of the kind {kind.name}")
