# SPDX-License-Identifier: LGPL-3.0-or-later
"""What bodies share whose unknowns are the positions of the nodes of a mesh of cells."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import BoolArray, FloatArray
from flexfem.core.marker import Marker, SurfaceMarker
from flexfem.core.pose import Pose
from flexfem.mesh.element_mesh import ElementMesh
from flexfem.model.bodies.base import Body

__all__ = ["MeshBody", "NodeSetMarker", "checked_fixed", "one_or_each"]


class NodeSetMarker(SurfaceMarker):
    """Mean place of some nodes of an :class:`UFLBody` or :class:`CableNet`, for joints.

    Where a joint needs axes, three nodes or more that are not on one line define them: they rotate
    with the affine map that is fitted to all of the nodes by least squares. A force and a moment
    there are statically equivalent forces at the nodes, which stay free to move apart, as of an
    interpolation element (RBE3). Corners of one triangle, or of one face of a solid, take its axes.
    At the start the axes are inertial.

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


class MeshBody(Body):
    """Body with a mesh, some of whose nodes may be fixed.

    Attributes:
        mesh: Nodes and cells.
        fixed: Directions in which sets of nodes are fixed, some of "xyz", by the set's name.
    """

    mesh: ElementMesh
    fixed: Mapping[str, str]

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
                f'is {type(self).__name__}.marker("{marker.point}")'
            )
        return int(nodes[0])

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
    def held(self) -> BoolArray:
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

    def moved(self, motion: Pose) -> Self:
        """Return the body moved rigidly with its initial velocities.

        Raises:
            ValueError: Nodes are fixed along axes that would not be inertial.
        """
        turn, mesh = motion.rotation, self.mesh
        if self.fixed and not np.array_equal(turn, np.eye(3)):
            raise ValueError(f"{_checks.named(self, self.name)}: fixed nodes cannot be rotated")
        spin = turn @ self.angular_velocity
        changes: dict[str, Any] = {
            "mesh": ElementMesh(
                motion.apply(mesh.points), mesh.cells, mesh.cell, degree=mesh.degree,
                nodes=mesh.nodes,
            ),
            "velocity": turn @ self.velocity - np.cross(spin, motion.position),
            "angular_velocity": spin,
        }  # fmt: skip
        return replace(self, **changes)  # type: ignore[type-var]  # derived classes are declared


def checked_fixed(owner: str, fixed: Mapping[str, str], mesh: ElementMesh) -> Mapping[str, str]:
    """Return the checked directions in which sets of nodes are fixed.

    Raises:
        ValueError: A set that the mesh does not have, or other axes than some of "xyz".
    """
    for place, axes in fixed.items():
        mesh.chosen(f"{owner}: fixed", place)
        if not isinstance(axes, str) or not axes or not set(axes) <= set("xyz"):
            raise ValueError(
                f'{owner}: fixed["{place}"] must be some of "xyz", got {_checks.show(axes)}'
            )
    return MappingProxyType(dict(fixed))


def one_or_each(owner: str, what: str, value: npt.ArrayLike, count: int) -> FloatArray:
    """Return the values (count,) of cells or nodes, given by one number or one for each.

    Raises:
        TypeError: They are no numbers.
        ValueError: They are not finite, or neither one nor so many.
    """
    if np.ndim(value) == 0:
        return _checks.freeze(np.full(count, _checks.number(owner, what, value)), np.float64)
    return _checks.array(owner, what, value, (count,))
