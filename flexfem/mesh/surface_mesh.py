# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes of triangles with named bodies, lines and nodes, for shells."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import Self

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._memory import check_room
from flexfem._types import FloatArray, IntArray
from flexfem.mesh.geometry.topology import edge_keys, group_order
from flexfem.mesh.triangles import (
    checks as surface_checks,
)
from flexfem.mesh.triangles import (
    grid as surface_grid,
)
from flexfem.mesh.triangles import (
    topology as surface_topology,
)
from flexfem.mesh.triangles.topology import SurfaceTopology

__all__ = ["SurfaceMesh", "read_surface_mesh"]

# Bytes of a node with its triangles while a mesh is made of it, about
_NODE = 1000


@dataclass(frozen=True, eq=False, init=False)
class SurfaceMesh:
    """Nodes, triangles in named bodies, and named lines and nodes on them.

    Every triangle belongs to exactly one body. A body may consist of several parts that no edge
    joins. In each part all triangles are flipped to the side of its first one, so that the nodes
    run counterclockwise seen from the side of the unit normal. Bodies may share nodes, also the
    edges of many may lie in one place: they are not neighbours there, and share positions only.

    Attributes:
        points: Node positions, shape (n, 3), metres.
        triangles: Node indices, shape (m, 3).
        bodies: Triangles, ascending, by the body's name.
        body: Number of each triangle's body in their order, shape (m,).
        lines: Node pairs along edges, shape (k, 2), by the line's name.
        nodes: Node index by name.
        topology: Edges and neighbours.
        midpoints: Where the middles of the curved edges opposite to the nodes of each triangle
            are, shape (m, 3, 3), metres, NaN where that is not known; None when none is known.
    """

    points: FloatArray
    triangles: IntArray
    bodies: Mapping[str, IntArray]
    body: IntArray
    lines: Mapping[str, IntArray]
    nodes: Mapping[str, int]
    topology: SurfaceTopology
    midpoints: FloatArray | None

    def __init__(
        self,
        points: npt.ArrayLike,
        triangles: npt.ArrayLike,
        bodies: Mapping[str, npt.ArrayLike],
        lines: Mapping[str, npt.ArrayLike] | None = None,
        nodes: Mapping[str, int] | None = None,
        midpoints: FloatArray | None = None,
    ) -> None:
        """Create a mesh.

        Args:
            points: Node positions, shape (n, 3), metres.
            triangles: Node indices, shape (m, 3); those oriented against the first of their part of
                a body are flipped, (a, b, c) into (a, c, b).
            bodies: Triangles of each body.
            lines: Node pairs of named lines, shape (k, 2), each an edge of a triangle.
            nodes: Named nodes.
            midpoints: As the attribute, of the triangles as given.

        Raises:
            TypeError: An argument does not consist of numbers of the right kind.
            ValueError: A wrong shape, NaN, an index out of range, a triangle without area, given
                twice, or in no or two bodies, a node without triangle, an edge with more than two
                triangles of one body, a body with one side only, an empty body or line, or a line
                that does not follow edges.
        """
        xyz = _checks.array("SurfaceMesh", "points", points, (-1, 3))
        rows = _checks.indices("SurfaceMesh", "triangles", triangles, len(xyz), 3)
        if len(rows) == 0:
            raise ValueError("SurfaceMesh: triangles must hold at least one triangle, got none")
        surface_checks.check_triangles(xyz, rows)
        groups = dict(
            surface_checks.body_rows(name, found, len(rows)) for name, found in bodies.items()
        )
        body = surface_checks.body_numbers(groups, len(rows))
        given = rows
        rows, sides = surface_checks.oriented(xyz, rows, body, list(groups))
        topology = surface_topology.surface_topology(rows, sides)
        keys = np.sort(edge_keys(topology.edges, len(xyz)))
        pairs = dict(
            surface_checks.line_pairs(name, found, keys, len(xyz))
            for name, found in (lines or {}).items()
        )
        _checks.assign(
            self,
            points=xyz,
            triangles=_checks.freeze(rows, np.int64),
            bodies=MappingProxyType(groups),
            body=_checks.freeze(body, np.int64),
            lines=MappingProxyType({k: _checks.freeze(v, np.int64) for k, v in pairs.items()}),
            nodes=MappingProxyType(_named_nodes(nodes or {}, len(xyz))),
            topology=topology,
            midpoints=surface_grid.turned_midpoints(midpoints, (rows != given).any(axis=1)),
        )

    @classmethod
    def grid(
        cls,
        name: str,
        u: npt.ArrayLike,
        v: npt.ArrayLike,
        surface: Callable[[FloatArray], npt.ArrayLike] | None = None,
        *,
        closed: bool = False,
        diagonal: str = "right",
    ) -> Self:
        """Create one body from a grid in two parameters, each rectangle cut along a diagonal.

        Node i + len(u) j has the parameters u[i], v[j]; the normals point to x_u cross x_v. The
        lines of the four sides are called name_bottom and name_top (first and last v, along u),
        name_left and name_right (first and last u, along v), the corners name_bottom_left,
        name_bottom_right, name_top_left and name_top_right.

        Args:
            name: Of the body.
            u: Ascending parameter values.
            v: Ascending parameter values.
            surface: Positions, shape (n, 3), metres, for parameters of shape (n, 2); the plane
                (u, v, 0) when None.
            closed: Whether a last column of rectangles joins the last u to the first, as around a
                cylinder; then there is no left and right, and there are no corners.
            diagonal: "right" from bottom left to top right, "left" from bottom right to top left;
                "right_left" and "left_right" alternate between both, beginning with the first (as
                in DOLFINx; a pattern without preferred direction, known as union jack).

        Raises:
            TypeError: An argument is of the wrong kind.
            ValueError: Parameters that do not ascend, an unknown diagonal, alternating ones around
                an odd number of columns, or positions that make no mesh.
        """
        owner = f'SurfaceMesh.grid "{_checks.text("SurfaceMesh.grid", "name", name)}"'
        first, second = _ascending(owner, "u", u, 3 if closed else 2), _ascending(owner, "v", v, 2)
        columns, rows = len(first), len(second)
        check_room(f"{owner}: {columns} x {rows} nodes", float(_NODE) * columns * rows)
        _check_diagonal(owner, diagonal, columns if closed else 0)
        parameters = np.column_stack([np.tile(first, rows), np.repeat(second, columns)])
        points: object = np.column_stack([parameters, np.zeros(len(parameters))])
        if surface is not None:
            if not callable(surface):
                raise TypeError(f"{owner}: surface must be a function, got {surface!r}")
            points = surface(parameters)
        positions = _checks.array(owner, "surface(u, v)", points, (len(parameters), 3))
        triangles = surface_grid.grid_triangles(columns, rows, closed=closed, diagonal=diagonal)
        lines = surface_grid.grid_lines(columns, rows, closed=closed)
        corners = {} if closed else surface_grid.grid_corners(columns, rows)
        return cls(
            positions,
            triangles,
            {name: np.arange(len(triangles))},
            {f"{name}_{side}": pairs for side, pairs in lines.items()},
            {f"{name}_{corner}": node for corner, node in corners.items()},
            None
            if surface is None
            else surface_grid.grid_midpoints(surface, parameters, triangles, columns),
        )

    @classmethod
    def rectangle(
        cls,
        name: str,
        size: tuple[float, float],
        cells: tuple[int, int],
        *,
        diagonal: str = "right",
    ) -> Self:
        """Create a flat rectangle in the plane z = 0 with one corner at the origin.

        Its normals point to +z; lines and corners are named as in `grid`.

        Args:
            name: Of the body.
            size: Lengths along x and y, metres.
            cells: Rectangles along x and y, each cut into two triangles.
            diagonal: As in `grid`.

        Raises:
            TypeError: An argument is of the wrong kind.
            ValueError: A length that is not positive, no cells, or an unknown diagonal.
        """
        owner = f'SurfaceMesh.rectangle "{_checks.text("SurfaceMesh.rectangle", "name", name)}"'
        lengths = _checks.array(owner, "size", size, (2,))
        counts = _checks.indices(owner, "cells", cells, np.iinfo(np.int32).max, 1)
        if (lengths <= 0.0).any():
            raise ValueError(f"{owner}: size must be positive, got {_checks.show(size)}")
        if counts.shape != (2,) or (counts < 1).any():
            raise ValueError(
                f"{owner}: cells must be two positive whole numbers, got {_checks.show(cells)}"
            )
        u, v = (np.linspace(0.0, lengths[k], counts[k] + 1) for k in range(2))
        return cls.grid(name, u, v, diagonal=diagonal)

    @classmethod
    def from_gmsh_model(cls) -> Self:
        """Create a mesh from the named physical groups of the current gmsh model.

        Surfaces are bodies. Curves and points are taken where they lie on these; the others, of
        beams for example, are left out.

        Raises:
            ValueError: No named group of surfaces, quadrilaterals, elements of higher order, a
                curve that lies on the surfaces only in part, or a physical point that holds
                several nodes.
        """
        from flexfem.mesh.imported.gmsh_model import surface_data

        return cls(*surface_data())

    @classmethod
    def join(cls, meshes: Sequence["SurfaceMesh"]) -> Self:
        """Create one mesh from several, whose nodes stay apart also where they coincide.

        Raises:
            TypeError: Something is no SurfaceMesh.
            ValueError: No mesh, or a name that two bodies, lines or nodes have.
        """
        if len(meshes) == 0:
            raise ValueError("SurfaceMesh.join: meshes must hold at least one mesh, got none")
        for mesh in meshes:
            _checks.instance("SurfaceMesh.join", "each mesh", mesh, SurfaceMesh)
        for kind in ("bodies", "lines", "nodes"):
            counts = Counter(name for mesh in meshes for name in getattr(mesh, kind))
            if counts and (most := counts.most_common(1)[0])[1] > 1:
                raise ValueError(f'SurfaceMesh.join: {kind}: the name "{most[0]}" is used twice')
        node = np.cumsum([0] + [len(mesh.points) for mesh in meshes]).tolist()
        row = np.cumsum([0] + [len(mesh.triangles) for mesh in meshes]).tolist()
        numbered = list(zip(meshes, node[:-1], row[:-1], strict=True))
        return cls(
            np.concatenate([mesh.points for mesh in meshes]),
            np.concatenate([mesh.triangles + n for mesh, n, _ in numbered]),
            {name: rows + r for mesh, _, r in numbered for name, rows in mesh.bodies.items()},
            {name: pairs + n for mesh, n, _ in numbered for name, pairs in mesh.lines.items()},
            {name: one + n for mesh, n, _ in numbered for name, one in mesh.nodes.items()},
            surface_grid.joined_midpoints(
                [(mesh.midpoints, len(mesh.triangles)) for mesh in meshes]
            ),
        )

    @cached_property
    def areas(self) -> FloatArray:
        """Areas of the triangles, shape (m,), square metres."""
        vectors = surface_topology.vector_areas(self.points, self.triangles)
        return _checks.freeze(np.linalg.norm(vectors, axis=1))

    @cached_property
    def normals(self) -> FloatArray:
        """Unit normals of the triangles, shape (m, 3)."""
        vectors = surface_topology.vector_areas(self.points, self.triangles)
        return _checks.freeze(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))

    @cached_property
    def node_triangles(self) -> tuple[IntArray, IntArray]:
        """Triangles at each node: offsets, shape (n + 1,), and triangles, shape (3 m,)."""
        return surface_topology.node_triangles(self.triangles, len(self.points))

    @cached_property
    def parts(self) -> IntArray:
        """Number of each triangle's part, the parts of bodies that edges join, shape (m,)."""
        return surface_topology.connected_parts(self.topology.neighbours)

    def body_rows(self, name: str) -> IntArray:
        """Return the triangles of a body, ascending.

        Raises:
            ValueError: There is no such body.
        """
        return self.bodies[_known("body", name, self.bodies)]

    def body_nodes(self, name: str) -> IntArray:
        """Return the nodes of a body, ascending.

        Raises:
            ValueError: There is no such body.
        """
        return np.unique(self.triangles[self.body_rows(name)])

    def named_nodes(self, owner: str, name: str) -> IntArray:
        """Return the nodes, ascending, of a body or a line, or the one of a name.

        Raises:
            ValueError: There is none of them; the message begins with the owner.
        """
        if name in self.bodies:
            return self.body_nodes(name)
        if name in self.lines:
            return np.unique(self.lines[name])
        if name not in self.nodes:
            known = _checks.show(", ".join([*self.bodies, *self.lines, *self.nodes]), 200)
            raise ValueError(
                f"{owner}: no body, line or node {_checks.show(name)}; there are {known}"
            )
        return np.array([self.nodes[name]], dtype=np.int64)

    def moved(self, points: npt.ArrayLike) -> Self:
        """Return the mesh with its nodes at other places, shape (n, 3), metres.

        Middles of curved edges move by the mean of both ends.

        Raises:
            TypeError: They are no numbers.
            ValueError: Another shape, or a triangle without area.
        """
        places = _checks.array("SurfaceMesh.moved", "points", points, self.points.shape)
        midpoints = self.midpoints
        if midpoints is not None:
            by = (places - self.points)[self.triangles]
            midpoints = midpoints + 0.5 * (by.sum(axis=1, keepdims=True) - by)
        return type(self)(places, self.triangles, self.bodies, self.lines, self.nodes, midpoints)

    def boundary_lines(self, name: str) -> list[IntArray]:
        """Return the node rows along the boundary of a body, which lies on their left.

        A closed row repeats its first node. Rows end at nodes where two boundaries touch.

        Raises:
            ValueError: There is no such body.
        """
        return surface_topology.boundary_lines(self.topology, self.body_rows(name))

    def line_nodes(self, name: str) -> IntArray:
        """Return the nodes along a named line in order, from the start of its first pair.

        A closed line repeats its first node.

        Raises:
            ValueError: There is no such line, or it branches or falls apart.
        """
        order = group_order(self.lines[_known("line", name, self.lines)])
        if order is None:
            raise ValueError(f'SurfaceMesh: line "{name}" branches or falls apart')
        return order

    def closest_node(self, position: npt.ArrayLike, body: str | None = None) -> int:
        """Return the node closest to a position, the lowest one of several.

        Args:
            position: Shape (3,), metres.
            body: Body to search, all when None.

        Raises:
            TypeError: The position does not consist of numbers.
            ValueError: There is no such body, or the position is no finite vector.
        """
        target = _checks.vector("SurfaceMesh.closest_node", "position", position)
        nodes = np.arange(len(self.points)) if body is None else self.body_nodes(body)
        distance = ((self.points[nodes] - target) ** 2).sum(axis=1)
        return int(nodes[np.argmin(distance)])

    def __str__(self) -> str:
        """Return the numbers of nodes, triangles and names."""
        return (
            f"SurfaceMesh: {len(self.points)} nodes, {len(self.triangles)} triangles, "
            f"{len(self.bodies)} bodies, {len(self.lines)} lines, {len(self.nodes)} named nodes"
        )


def read_surface_mesh(
    path: str | PathLike[str],
    *,
    scale: float = 1.0,
    merge: float | None = None,
    bodies: Sequence[str] | None = None,
    lines: Sequence[str] | None = None,
    nodes: Sequence[str] | None = None,
) -> SurfaceMesh:
    """Read the triangles and quadrilaterals of a mesh file: gmsh, Abaqus, Nastran, VTK, STL, OBJ.

    Element sets are bodies, which must not overlap; all of the file without any set is one body
    called after the file. Quadrilaterals are cut along the shorter diagonal. Sets of lines, edges
    or nodes that follow edges of the triangles are lines, node sets of one node are nodes.

    STL (ASCII and binary) and OBJ (v and f) files have no sets. Their points in the same place
    are one, and triangles that have two corners in one place are left out.

    Args:
        path: As for :func:`read_mesh`, or ends in .stl or .obj.
        scale: Metres in a unit of length of the file, 1e-3 for millimetres.
        merge: Make nodes that are at most so far apart one, metres; None leaves them apart.
        bodies: Element sets to take; None for all.
        lines: Sets to take as lines; None for all that make some.
        nodes: Node sets to take; None for those of one node. A set of several is NAME_1, NAME_2
            and so on, in the order of the file.

    Returns:
        The mesh.

    Raises:
        TypeError: An argument is of the wrong kind.
        ValueError: The file is missing or unreadable, has no triangles or no such set, or bodies
            overlap.
    """
    from flexfem.mesh.imported.read import read_mesh_file
    from flexfem.mesh.imported.surface import surface_data

    file = read_mesh_file(Path(path), scale, merge)
    data = surface_data(file, bodies, lines, nodes)
    try:
        return SurfaceMesh(*data)
    except ValueError as error:
        raise ValueError(f"{file.owner}: {error}") from None


def _check_diagonal(owner: str, diagonal: object, around: int) -> None:
    """Check the name of diagonals, and that they alternate around a closed grid's columns."""
    known = surface_grid.DIAGONALS
    if not isinstance(diagonal, str) or diagonal not in known:
        raise ValueError(
            f"{owner}: diagonal must be one of {', '.join(known)}, got {_checks.show(diagonal)}"
        )
    first, second = known[diagonal]
    if first != second and around % 2:
        raise ValueError(
            f'{owner}: diagonal "{diagonal}" does not close around {around} columns, an odd number'
        )


def _ascending(owner: str, what: str, values: npt.ArrayLike, least: int) -> FloatArray:
    """Return checked parameter values of a grid."""
    result = _checks.array(owner, what, values, (-1,))
    if len(result) < least or (np.diff(result) <= 0.0).any():
        raise ValueError(
            f"{owner}: {what} must hold at least {least} ascending numbers, got "
            f"{_checks.show(values)}"
        )
    return result


def _named_nodes(nodes: Mapping[str, int], limit: int) -> dict[str, int]:
    """Return checked named nodes."""
    return {
        _checks.text("SurfaceMesh", "name of a node", name): int(
            _checks.indices("SurfaceMesh", f'node "{name}"', [node], limit, 1)[0]
        )
        for name, node in nodes.items()
    }


def _known(kind: str, name: str, things: Mapping[str, IntArray]) -> str:
    """Return a name that the mesh has."""
    if name not in things:
        known = ", ".join(things) or "none"
        raise ValueError(
            f'SurfaceMesh: {kind} "{name}" is not in the mesh, which has {_checks.show(known, 200)}'
        )
    return name
