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
from flexfem._types import FloatArray, IntArray
from flexfem.core.marker import Marker, SurfaceMarker
from flexfem.core.pose import Pose
from flexfem.mesh.element_mesh import ElementMesh
from flexfem.mesh.surface_mesh import SurfaceMesh
from flexfem.model.bodies.base import Body

__all__ = ["NodeSetMarker", "UFLBody"]

#: Smallest area coordinate of the points of rules for simplices of degree two, by corners.
_NEAR = {2: 0.5 - 0.5 / np.sqrt(3.0), 3: 1.0 / 6.0, 4: (5.0 - np.sqrt(5.0)) / 20.0}

#: Energy per unit of size at the start of the positions x, places at the start X and parameters.
Energy = Callable[[Any, Any, Any], Any]


class NodeSetMarker(SurfaceMarker):
    """Mean place of some nodes of an :class:`UFLBody`, for joints; inertial axes at the start.

    Where a joint needs axes, three nodes or more that are not on one line define them: they rotate
    with the affine map that is fitted to all of the nodes by least squares. A force and a moment
    there are statically equivalent forces at the nodes, which stay free to move apart, as of an
    interpolation element (RBE3). Corners of one triangle, or of one face of a solid, take its axes.

    Attributes:
        nodes: The nodes.
        weights: Their parts in the position, equal ones.
    """

    def __init__(self, body: str, nodes: npt.ArrayLike) -> None:
        """Create the marker.

        Raises:
            TypeError: The nodes are no numbers.
        """
        Marker.__init__(self, body)
        places = _checks.indices(f'NodeSetMarker on "{body}"', "nodes", nodes, 2**62, 1)
        own = np.unique(places).tolist()
        _checks.assign(self, nodes=tuple(own), weights=(1.0 / len(own),) * len(own))


def _degree(owner: str, what: str, value: int) -> int:
    """Return a checked degree of quadrature."""
    _checks.instance(owner, what, value, int)
    _checks.number(owner, what, value, nonnegative=True)
    return value


@declared
class UFLBody(Body):
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
        for place, axes in self.fixed.items():
            mesh.chosen(f"{owner}: fixed", place)
            if not isinstance(axes, str) or not axes or not set(axes) <= set("xyz"):
                raise ValueError(
                    f'{owner}: fixed["{place}"] must be some of "xyz", got {_checks.show(axes)}'
                )
        _checks.assign(
            self,
            parameters=MappingProxyType(
                {key: _values(owner, key, value, mesh) for key, value in self.parameters.items()}
            ),
            fixed=MappingProxyType(dict(self.fixed)),
        )

    def marker(self, name: str) -> NodeSetMarker:
        """Return the mean place of a set of nodes as a marker for joints.

        Raises:
            ValueError: The mesh has no such set.
        """
        return NodeSetMarker(self.name, self.mesh.chosen(f'Marker on "{self.name}"', name))

    def node(self, marker: Marker) -> int:
        """Return the node of a marker.

        Raises:
            ValueError: It names no single node and is near none, or has an offset.
        """
        owner = f'Marker on "{self.name}"'
        if marker.offset.any():
            raise ValueError(f"{owner}: a node has no axes for offsets, got {marker.offset}")
        nodes = self.mesh.chosen(owner, marker.point)
        if len(nodes) > 1:
            raise ValueError(
                f'{owner}: "{marker.point}" has {len(nodes)} nodes; their mean place, for joints, '
                f'is UFLBody.marker("{marker.point}")'
            )
        return int(nodes[0])

    @property
    def touches(self) -> bool:  # type: ignore[override]
        """True if it is a membrane of linear triangles whose thickness is given."""
        return self.thickness is not None and self.surface is not None

    @property
    def points(self) -> FloatArray:
        """See :attr:`Body.points`."""
        return self.mesh.points

    @property
    def elements(self) -> int:
        """See :attr:`Body.elements`."""
        return len(self.mesh.cells)

    @property
    def holds(self) -> int:
        """See :attr:`Body.holds`."""
        return int(self.held.sum())

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

    def moved(self, motion: Pose) -> "UFLBody":
        """Return the body moved rigidly with its initial velocities.

        Raises:
            ValueError: Nodes are fixed along axes that would not be inertial.
        """
        turn = motion.rotation
        if self.fixed and not np.array_equal(turn, np.eye(3)):
            raise ValueError(f'UFLBody "{self.name}": fixed nodes cannot be rotated')
        mesh, spin = self.mesh, turn @ self.angular_velocity
        points = motion.apply(mesh.points)
        return UFLBody(
            self.name,
            ElementMesh(points, mesh.cells, mesh.cell, degree=mesh.degree, nodes=mesh.nodes),
            self.energy,
            density=self.density,
            parameters=self.parameters,
            thickness=self.thickness,
            quadrature=self.quadrature,
            fixed=self.fixed,
            velocity=turn @ self.velocity - np.cross(spin, motion.position),
            angular_velocity=spin,
        )

    @property
    def held(self) -> npt.NDArray[np.bool_]:
        """(n, 3) directions in which nodes are fixed."""
        held = np.zeros((len(self.mesh.points), 3), dtype=np.bool_)
        for name, axes in self.fixed.items():
            held[np.ix_(self.mesh.nodes[name], ["xyz".index(axis) for axis in axes])] = True
        return held

    @property
    def node_velocities(self) -> FloatArray:
        """(n, 3) inertial velocities of the nodes at the start, m/s."""
        speed: FloatArray = self.velocity + np.cross(self.angular_velocity, self.mesh.points)
        return np.where(self.held, 0.0, speed)


def _values(owner: str, name: str, value: npt.ArrayLike, mesh: ElementMesh) -> FloatArray:
    """Return the values (m,) of a parameter in the cells."""
    _checks.text(owner, "name of a parameter", name)
    given = np.asarray(value)
    what = f'parameters["{name}"]'
    if given.ndim == 0:
        return _checks.freeze(
            np.full(len(mesh.cells), _checks.number(owner, what, value)), np.float64
        )
    return _checks.array(owner, what, value, (len(mesh.cells),))


def cells_of(nodes: IntArray, mesh: ElementMesh) -> IntArray:
    """Return the cells that have all of some nodes among their corners, ascending."""
    member = np.isin(mesh.corners, nodes)
    return np.flatnonzero(member.sum(axis=1) == len(nodes))
