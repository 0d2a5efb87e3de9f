# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes of elements of one shape and degree, for bodies with an energy in UFL."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Self

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.mesh.line_mesh import LineMesh
from flexfem.mesh.surface_mesh import SurfaceMesh

__all__ = ["CELLS", "ElementMesh"]

#: Nodes of a cell by its shape and degree; corners come first, as in Basix.
CELLS = {
    ("interval", 1): 2, ("interval", 2): 3, ("triangle", 1): 3, ("triangle", 2): 6,
    ("tetrahedron", 1): 4, ("tetrahedron", 2): 10,
}  # fmt: skip


@dataclass(frozen=True, eq=False, init=False)
class ElementMesh:
    """Nodes and Lagrange cells in space, with named sets of nodes.

    Attributes:
        points: Node positions, shape (n, 3), metres.
        cells: Node indices, shape (m, k), in the order of Basix: corners, then the midpoints of the
            edges opposite to the corners; of a tetrahedron of edges 2-3, 1-3, 1-2, 0-3, 0-2, 0-1.
        cell: "interval", "triangle" or "tetrahedron".
        degree: Degree of the shape functions, 1 or 2; positions at the start have the same ones.
        nodes: Node indices, ascending, by the name of the set.
    """

    points: FloatArray
    cells: IntArray
    cell: str
    degree: int
    nodes: Mapping[str, IntArray]

    def __init__(
        self,
        points: npt.ArrayLike,
        cells: npt.ArrayLike,
        cell: str,
        *,
        degree: int = 1,
        nodes: Mapping[str, npt.ArrayLike] = MappingProxyType({}),
    ) -> None:
        """Create a mesh.

        Raises:
            TypeError: An argument does not consist of numbers of the right kind.
            ValueError: An unknown cell or degree, a wrong shape, NaN, an index out of range, a
                node without cell, a cell that is given a node twice, or an empty set.
        """
        owner = "ElementMesh"
        if (cell, degree) not in CELLS:
            known = ", ".join(f'"{name}" of degree {order}' for name, order in CELLS)
            raise ValueError(
                f"{owner}: cell must be one of {known}, got {_checks.show(cell)} of degree "
                f"{_checks.show(degree)}"
            )
        xyz = _checks.array(owner, "points", points, (-1, 3))
        rows = _checks.indices(owner, "cells", cells, len(xyz), CELLS[cell, degree])
        if len(rows) == 0:
            raise ValueError(f"{owner}: cells must hold at least one cell, got none")
        ordered = np.sort(rows, axis=1)
        twice = (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)
        if twice.any():
            at = int(np.argmax(twice))
            raise ValueError(f"{owner}: cell {at} has a node twice, {_checks.show(rows[at])}")
        unused = np.setdiff1d(np.arange(len(xyz)), rows)
        if len(unused):
            raise ValueError(f"{owner}: node {unused[0]} belongs to no cell")
        sets = {}
        for name, chosen in nodes.items():
            _checks.text(owner, "name of a set of nodes", name)
            found = np.unique(_checks.indices(owner, f'nodes["{name}"]', chosen, len(xyz), 1))
            if not len(found):
                raise ValueError(f'{owner}: nodes["{name}"] is empty')
            sets[name] = _checks.freeze(found, np.int64)
        _checks.assign(
            self, points=xyz, cells=_checks.freeze(rows, np.int64), cell=cell, degree=degree,
            nodes=MappingProxyType(sets),
        )  # fmt: skip

    @classmethod
    def from_lines(cls, mesh: LineMesh) -> Self:
        """Return the cells of a mesh of lines, with its points and groups as sets of nodes."""
        groups: dict[str, npt.ArrayLike] = {
            name: np.unique(mesh.cells[rows]) for name, rows in mesh.line_groups.items()
        }
        points: dict[str, npt.ArrayLike] = {
            name: [node] for name, node in mesh.point_groups.items()
        }
        return cls(mesh.points, mesh.cells, "interval", nodes=groups | points)

    @classmethod
    def from_surface(cls, mesh: SurfaceMesh) -> Self:
        """Return the triangles of a surface mesh, with its nodes and lines as sets of nodes."""
        lines: dict[str, npt.ArrayLike] = {
            name: np.unique(pairs) for name, pairs in mesh.lines.items()
        }
        points: dict[str, npt.ArrayLike] = {name: [node] for name, node in mesh.nodes.items()}
        return cls(mesh.points, mesh.triangles, "triangle", nodes=lines | points)

    @property
    def dimension(self) -> int:
        """1, 2 or 3: whether cells are lines, surfaces or solids."""
        return {"interval": 1, "triangle": 2, "tetrahedron": 3}[self.cell]

    @property
    def corners(self) -> IntArray:
        """Corners (m, d + 1) of the cells."""
        return self.cells[:, : self.dimension + 1]

    def chosen(self, owner: str, point: object) -> IntArray:
        """Return the nodes of a named set, or the one nearest to a position.

        Args:
            owner: Prefix of messages.
            point: Name of a set, or position (x, y, z) in metres, which must be as near to a node
                as the nodes of its cells are.

        Raises:
            ValueError: There is no such set, or no node near.
        """
        if isinstance(point, str) and point in self.nodes:
            return self.nodes[point]
        if not isinstance(point, tuple):
            known = _checks.show(", ".join(self.nodes) or "none", 200)
            raise ValueError(
                f"{owner}: point must name a set of nodes or be a position (x, y, z), got "
                f"{_checks.show(point)}; the sets are {known}"
            )
        gaps = np.linalg.norm(self.points - np.array(point), axis=1)
        node = int(np.argmin(gaps))
        around = self.points[self.cells[(self.cells == node).any(axis=1)]]
        reach = float(np.linalg.norm(around - self.points[node], axis=2).max())
        if gaps[node] > reach:
            raise ValueError(
                f"{owner}: the nearest node to {_checks.show(list(point))} is {gaps[node]:.4g} m "
                f"away, more than its own neighbours are, {reach:.4g} m"
            )
        return np.array([node], dtype=np.int64)
