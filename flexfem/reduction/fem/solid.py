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
from flexfem.reduction.fem.body.strain_energy import law_energy

__all__ = ["plane_body", "solid_body"]

_DEGREES = (1, 2, 3)
_CELLS = (
    mesh.CellType.triangle,
    mesh.CellType.quadrilateral,
    mesh.CellType.tetrahedron,
    mesh.CellType.hexahedron,
)


def solid_body(
    domain: mesh.Mesh,
    material: Any,
    degree: int = 2,
    *,
    density: float | None = None,
    name: str = "solid",
) -> LinearBody:
    """A solid of tetrahedra or hexahedra, isotropic or with a law of its strain energy.

    Args:
        domain: mesh in body axes, m; of any shape and on any number of ranks.
        material: elastic constants and density (``Material``); or a law of ``flexfem.laws``, the
            same in the whole body, smooth and without stress at rest: then ``reduce_body`` has
            ``derivatives``, and the body is as linear as at rest without them.
        degree: of the displacements; linear ones are much too stiff in bending.
        density: of a law, kg/m^3.
        name: for messages.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: the mesh is not of solid cells, the degree not 1 to 3, the material without
            mass or incompressible; a law with internal variables, viscosity, stress at rest or
            kinks, or whose numbers differ in place or time.
    """
    owner = f'solid_body "{name}"'
    if not isinstance(material, Material) and hasattr(material, "energy"):
        return _law_body(owner, domain, material, degree, density, name)
    if density is not None:
        raise ValueError(f"{owner}: density is that of the material already")
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


def _law_body(
    owner: str, domain: mesh.Mesh, law: Any, degree: int, density: Any, name: str
) -> LinearBody:
    """Return a body with the energy of a law, and the linear forms that belong to it."""
    _check_mesh(owner, domain, degree, 3)
    rho = _checks.number(owner, "density", density, positive=True)
    simple = domain.topology.cell_type == mesh.CellType.tetrahedron
    quadrature = 2 * degree - (2 if simple and domain.geometry.cmaps[0].degree == 1 else 0)
    energy = law_energy(owner, law, quadrature)
    moduli = fem.Constant(domain, energy.derivatives[0].reshape(3, 3, 3, 3))
    measure = ufl.dx(domain, metadata={"quadrature_degree": quadrature})
    space = fem.functionspace(domain, ("Lagrange", degree, (3,)))
    i, j, k, m = ufl.indices(4)

    def stress(u: Any) -> Any:
        return ufl.as_tensor(moduli[i, j, k, m] * ufl.grad(u)[k, m], (i, j))

    return LinearBody(
        space,
        lambda u, v: ufl.inner(stress(u), ufl.grad(v)) * measure,
        [MassField(rho, ufl.SpatialCoordinate(domain), in_space)],
        prestress=lambda u0, u, v: prestress_work(stress(u0), u, v) * measure,
        stress=stress,
        energy=energy,
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
    _checks.instance(owner, "material", material, Material)
    _checks.number(owner, "density", material.density, positive=True)
    _check_mesh(owner, domain, degree, dimension)


def _check_mesh(owner: str, domain: mesh.Mesh, degree: int, dimension: int) -> None:
    _checks.instance(owner, "mesh", domain, mesh.Mesh)
    if degree not in _DEGREES:
        raise ValueError(f"{owner}: degree must be one of {_DEGREES}, got {_checks.show(degree)}")
    if domain.topology.dim != dimension:
        raise ValueError(
            f"{owner}: cells must have {dimension} dimensions, got {domain.topology.dim}"
        )
    kind = domain.topology.cell_type
    if kind not in _CELLS:
        raise ValueError(f"{owner}: cannot use cells of the kind {kind.name}")
