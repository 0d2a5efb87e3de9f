# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies of finite elements whose strain energy the user writes in UFL."""

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY
from functools import cached_property
from math import factorial
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import (
    ZERO,
    Array,
    Given,
    checked,
    declared,
    function,
    instance,
    number,
    settled,
    vector,
)
from flexfem._types import FloatArray
from flexfem.mesh.element_mesh import ElementMesh
from flexfem.mesh.surface_mesh import SurfaceMesh
from flexfem.model.bodies.mesh_body import MeshBody, checked_fixed, one_or_each

__all__ = ["UFLBody"]

#: Smallest area coordinate of the points of rules for simplices of degree two, by corners.
_NEAR = {2: 0.5 - 0.5 / np.sqrt(3.0), 3: 1.0 / 6.0, 4: (5.0 - np.sqrt(5.0)) / 20.0}

#: Energy per unit of size at the start of the positions x, places at the start X and parameters.
Energy = Callable[[Any, Any, Any], Any]


def _degree(owner: str, what: str, value: int) -> int:
    """Return a checked degree of quadrature."""
    _checks.instance(owner, what, value, int)
    _checks.number(owner, what, value, nonnegative=True)
    return value


@declared
class UFLBody(MeshBody):
    """Body of finite elements with a strain energy in UFL, for example bars, membranes, solids.

    The unknowns are the positions of the nodes. A node has no axes: forces act there, joints hold
    its position; joints that need axes take those of a triangle, of the face of a solid or of many
    nodes, see :class:`NodeSetMarker`.

    Attributes:
        name: Unique name in the model.
        mesh: Nodes and cells.
        energy: Function of positions x (a UFL coefficient with values in space), of the places X
            at the start, and of the parameters p (``p.E`` for that named "E"), which returns the
            strain energy per length (J/m), area (J/m^2) or volume (J/m^3) at the start. It must
            vanish at the start and under rotation. ``grad(x)`` is the deformation gradient,
            (3, 3); on bars and membranes that along the cell, without a part across it.
        density: Mass per length (kg/m), area (kg/m^2) or volume (kg/m^3) at the start.
        parameters: Numbers of the energy by name; each one number, or one for each cell, (m,).
        thickness: Distance between both sides of a membrane that touches others, m; None for
            bodies without contact.
        quadrature: Degree of polynomials that are integrated exactly; None for
            twice that of the shape functions.
        fixed: Directions in which sets of nodes are fixed, some of "xyz", by the set's name.
        velocity: Initial velocity of the point of the (extended) body at the inertial origin,
            inertial axes, shape (3,), m/s.
        angular_velocity: Initial angular velocity, inertial axes, shape (3,), rad/s; a point at x
            starts with `velocity + angular_velocity x x`.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: A density that is not positive, a parameter that is not finite or not one for
            each cell, or a set that the mesh does not have.
    """

    family = "flexfem.families.ufl_body.family:UFLBodyFamily"

    name: str
    mesh: ElementMesh = instance(ElementMesh)
    energy: Energy = function("x, X and p")
    _: KW_ONLY
    density: float = number(positive=True)
    parameters: Given[Mapping[str, npt.ArrayLike], Mapping[str, FloatArray]] = settled(
        default=MappingProxyType({})
    )
    thickness: float | None = number(default=None, positive=True)
    quadrature: int | None = checked(_degree, default=None)
    fixed: Mapping[str, str] = settled(default=MappingProxyType({}))
    velocity: Array = vector(default=ZERO)
    angular_velocity: Array = vector(default=ZERO)

    def __post_init__(self) -> None:
        """Check the values that belong to sets and cells of the mesh."""
        owner, mesh = _checks.named(self, self.name), self.mesh
        _checks.assign(
            self,
            parameters=MappingProxyType(
                {key: _values(owner, key, value, mesh) for key, value in self.parameters.items()}
            ),
            fixed=checked_fixed(owner, self.fixed, mesh),
        )

    @property
    def touches(self) -> bool:  # type: ignore[override]
        """True if it is a membrane of linear triangles whose thickness is given."""
        return self.thickness is not None and self.surface is not None

    @property
    def details(self) -> str:
        """See :attr:`Body.details`."""
        return f"{self.elements} cells, {self.mesh.cell} of degree {self.mesh.degree}"

    @cached_property
    def surface(self) -> SurfaceMesh | None:
        """Linear triangles as a surface, whose one body has the name of this; None without any."""
        mesh = self.mesh
        if (mesh.cell, mesh.degree) != ("triangle", 1):
            return None
        return SurfaceMesh(mesh.points, mesh.cells, {self.name: np.arange(len(mesh.cells))})

    @property
    def masses(self) -> tuple[FloatArray, FloatArray]:
        """Points (q, 3) in the body at the start, m, and masses (q,), kg, with its inertia.

        Moments are exact to second order, between the corners of the cells.
        """
        corners = self.mesh.points[self.mesh.corners]
        count = corners.shape[1]
        near = _NEAR[count]
        shape = np.full((count, count), near) + (1.0 - count * near) * np.eye(count)
        sides = corners[:, 1:] - corners[:, :1]
        metric = np.einsum("mia,mja->mij", sides, sides)
        size = np.sqrt(np.linalg.det(metric)) / factorial(count - 1)
        points = np.einsum("qi,mia->mqa", shape, corners).reshape(-1, 3)
        return points, np.repeat(self.density * size / count, count)


def _values(owner: str, name: str, value: npt.ArrayLike, mesh: ElementMesh) -> FloatArray:
    """Return the values (m,) of a parameter in the cells."""
    _checks.text(owner, "name of a parameter", name)
    return one_or_each(owner, f'parameters["{name}"]', value, len(mesh.cells))
