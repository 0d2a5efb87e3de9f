# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies of shells with the sections of the package."""

from typing import Any

import basix.ufl
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, mesh

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.forms.linear_shell import facet_axes, membrane_work, shell_strains, stress_tensor
from flexfem.materials.shell_section import ShellSection
from flexfem.reduction.fem.beam import rigid_motion
from flexfem.reduction.fem.body.linear_body import LinearBody, MassField

__all__ = ["shell_body"]

#: Drilling stiffness: against a rotation about the normal that differs from the facet's, relative
#: to that in shear.
_DRILLING = 1e-3
#: Asymmetry of an isotropic section that is round-off.
_ROUND_OFF = 1e-9


def shell_body(
    domain: mesh.Mesh,
    section: ShellSection,
    *,
    orientation: npt.ArrayLike | None = None,
    name: str = "shell",
) -> LinearBody:
    """Shells of flat facets with shear across their thickness and rotary inertia.

    Quadratic displacements with rotations that are continuous in the middle of edges do not lock
    in thin shells. Interfaces are groups of edges: single points have no rotations.

    Args:
        domain: mesh of triangles in space, body axes, m; folds and branches included. Normals
            follow from the order of the corners.
        section: linear section of all facets, its reference surface the facets.
        orientation: (3,) whose part in a facet is the section's e1; None for sections that are
            the same in all directions.
        name: for messages.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: the mesh is not of triangles in space, the section has a law of its own, no
            mass, or directions without an orientation.
    """
    owner = f'shell_body "{name}"'
    _checks.instance(owner, "mesh", domain, mesh.Mesh)
    _checks.instance(owner, "section", section, ShellSection)
    if section.law is not None:
        raise ValueError(f"{owner}: the section must be linear, not have a law of its own")
    _checks.number(owner, "mass", section.mass, positive=True)
    if domain.topology.cell_type != mesh.CellType.triangle or domain.geometry.dim != 3:
        raise ValueError(f"{owner}: the mesh must be of triangles in three dimensions")
    towards = None
    if orientation is not None:
        direction = _checks.vector(owner, "orientation", orientation, nonzero=True)
        towards = fem.Constant(domain, np.array(direction))
    elif not _isotropic(section):
        raise ValueError(f"{owner}: the section has directions, and needs an orientation")
    cell = domain.basix_cell()
    space = fem.functionspace(
        domain,
        basix.ufl.mixed_element([
            basix.ufl.element("Lagrange", cell, 2, shape=(3,)),
            basix.ufl.element("CR", cell, 1, shape=(3,)),
        ]),
    )  # fmt: skip
    axes = facet_axes(domain, towards)
    stiffness = fem.Constant(domain, np.array(section.stiffness))
    sheared = fem.Constant(domain, np.array(section.shear))
    drilling = fem.Constant(domain, np.array(_DRILLING * section.stiffness[2, 2]))
    thickness = fem.Constant(domain, np.array(section.thickness))
    height = fem.Constant(domain, np.array(section.thickness / 12.0**0.5))
    x, dx = ufl.SpatialCoordinate(domain), ufl.dx(domain)

    def strains(w: Any) -> Any:
        u, theta = ufl.split(w)
        return shell_strains(u, theta, axes)

    def elastic(w: Any, v: Any) -> Any:
        (plane, shear, turn), (plane_v, shear_v, turn_v) = strains(w), strains(v)
        return (
            ufl.inner(ufl.dot(stiffness, plane), plane_v)
            + ufl.inner(ufl.dot(sheared, shear), shear_v)
            + drilling * turn * turn_v
        ) * dx

    def prestress(w0: Any, w: Any, v: Any) -> Any:
        force = ufl.dot(stiffness, strains(w0)[0])
        return membrane_work(force, ufl.split(w)[0], ufl.split(v)[0], axes) * dx

    def stress(w: Any) -> Any:
        r = ufl.dot(stiffness, strains(w)[0])
        outer = ufl.as_vector([r[i] / thickness + 6.0 * r[3 + i] / thickness**2 for i in range(3)])
        return stress_tensor(outer, axes)

    def sheet(side: float) -> MassField:
        def moved(w: Any) -> Any:
            u, theta = ufl.split(w)
            return u + side * height * ufl.cross(theta, axes[2])

        # two sheets at this height have the rotary inertia of the thickness
        return MassField(0.5 * section.mass, x + side * height * axes[2], moved)

    return LinearBody(
        space,
        elastic,
        [sheet(-1.0), sheet(1.0)],
        rigid=lambda shift, turn: rigid_motion(space, shift, turn),
        displacement=lambda w: ufl.split(w)[0],
        rotation=lambda w: ufl.split(w)[1],
        prestress=prestress,
        stress=stress,
        name=name,
    )


def _isotropic(section: ShellSection) -> bool:
    """Return True if the section is the same in all directions of the surface."""
    turn = np.deg2rad(30.0)
    c, s = np.cos(turn), np.sin(turn)
    change = np.array(
        [[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]]
    )
    whole = np.kron(np.eye(2), change)
    plane = np.array([[c, s], [-s, c]])
    return _same(whole.T @ section.stiffness @ whole, section.stiffness) and _same(
        plane.T @ section.shear @ plane, section.shear
    )


def _same(first: FloatArray, second: FloatArray) -> bool:
    size = np.sqrt(np.outer(np.diagonal(second), np.diagonal(second)))
    return bool((np.abs(first - second) <= _ROUND_OFF * size).all())
