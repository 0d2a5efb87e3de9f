# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes of lines with named groups, for beams."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import Self

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._memory import LINE_NODE, check_run
from flexfem._types import FloatArray, IntArray
from flexfem.mesh.geometry.frames import (
    CORNER_ANGLE,
    frames_of_lines,
    node_tangents,
    section_frames,
)
from flexfem.mesh.geometry.topology import edge_keys, group_order, orient
from flexfem.mesh.nurbs.curve import NurbsCurve

__all__ = [
    "CORNER_ANGLE",
    "LineMesh",
    "frames_of_lines",
    "group_order",
    "node_tangents",
    "read_mesh",
    "section_frames",
]

# Shortest cell relative to the size of the mesh
_ZERO_LENGTH = 1e-12


@dataclass(frozen=True, eq=False, init=False)
class LineMesh:
    """Nodes, two-node cells and named groups of both.

    Cells of one unbranched line are stored head to tail, all in the direction of the line's cell
    with the lowest number.

    Attributes:
        points: Node positions, shape (n, 3), metres.
        cells: Node indices, shape (m, 2).
        line_groups: Cell indices, ascending, by group name.
        point_groups: Node index by group name.
    """

    points: FloatArray
    cells: IntArray
    line_groups: Mapping[str, IntArray]
    point_groups: Mapping[str, int]
    _orders: dict[str, IntArray | None] = field(repr=False)
    _curves: dict[tuple[str, int], NurbsCurve] = field(repr=False)

    def __init__(
        self,
        points: npt.ArrayLike,
        cells: npt.ArrayLike,
        line_groups: Mapping[str, npt.ArrayLike],
        point_groups: Mapping[str, int] | None = None,
    ) -> None:
        """Create a mesh.

        Raises:
            TypeError: An argument does not consist of numbers of the right kind.
            ValueError: A wrong shape, NaN, an index out of range, a cell of zero length or given
                twice, a node without cell, or an empty group.
        """
        xyz = _checks.array("LineMesh", "points", points, (-1, 3))
        pairs = _checks.indices("LineMesh", "cells", cells, len(xyz), 2)
        check_run(f"LineMesh: a step with {len(pairs)} elements", len(pairs), LINE_NODE)
        if len(pairs) == 0:
            raise ValueError("LineMesh: cells must hold at least one cell, got none")
        groups = {
            _checks.text("LineMesh", "name of a line group", name): _group(name, rows, len(pairs))
            for name, rows in line_groups.items()
        }
        nodes = {
            _checks.text("LineMesh", "name of a point group", name): int(
                _checks.indices("LineMesh", f'point group "{name}"', [node], len(xyz), 1)[0]
            )
            for name, node in (point_groups or {}).items()
        }
        _check_cells(xyz, pairs, groups)
        _checks.assign(
            self,
            points=xyz,
            cells=_checks.freeze(orient(pairs), np.int64),
            line_groups=MappingProxyType(groups),
            point_groups=MappingProxyType(nodes),
            _orders={},
            _curves={},
        )

    @classmethod
    def straight(cls, lines: Mapping[str, npt.ArrayLike], elements: int = 1) -> Self:
        """Create a mesh of straight lines, each a group of its name with nodes of its own.

        Args:
            lines: Start and end of each, shape (2, 3), metres.
            elements: Cells of equal length per line.

        Raises:
            TypeError: A name or an argument is of the wrong kind.
            ValueError: No line, a wrong shape, NaN, a line of zero length, or no element.
        """
        _checks.instance("LineMesh", "elements", elements, int)
        if elements < 1:
            raise ValueError(f"LineMesh: elements must be at least 1, got {elements}")
        if not lines:
            raise ValueError("LineMesh: lines must hold at least one line, got none")
        count = float(elements) * len(lines)
        check_run(f"LineMesh: a step with {elements} elements a line", count, LINE_NODE)
        ends = np.array(
            [_checks.array("LineMesh", f'line "{name}"', x, (2, 3)) for name, x in lines.items()]
        )
        points = np.linspace(ends[:, 0], ends[:, 1], elements + 1, axis=1).reshape(-1, 3)
        first = np.arange(len(ends))[:, None] * (elements + 1) + np.arange(elements)
        cells = np.stack([first, first + 1], axis=-1).reshape(-1, 2)
        numbers = np.arange(len(cells)).reshape(len(ends), elements)
        mesh = cls(points, cells, dict(zip(lines, numbers, strict=True)))
        nodes = np.arange(len(points)).reshape(len(ends), elements + 1)
        mesh._orders.update(zip(lines, nodes, strict=True))  # to find each takes as long as a beam
        return mesh

    @classmethod
    def join(cls, meshes: Sequence["LineMesh"]) -> Self:
        """Create one mesh from several, whose nodes stay apart also where they coincide.

        Raises:
            TypeError: Something is no LineMesh.
            ValueError: No mesh, or a name that two groups of lines or points have.
        """
        if len(meshes) == 0:
            raise ValueError("LineMesh.join: meshes must hold at least one mesh, got none")
        for mesh in meshes:
            _checks.instance("LineMesh.join", "each mesh", mesh, LineMesh)
        for kind in ("line_groups", "point_groups"):
            counts = Counter(name for mesh in meshes for name in getattr(mesh, kind))
            if counts and (most := counts.most_common(1)[0])[1] > 1:
                raise ValueError(f'LineMesh.join: {kind}: the name "{most[0]}" is used twice')
        node = np.cumsum([0] + [len(mesh.points) for mesh in meshes]).tolist()
        row = np.cumsum([0] + [len(mesh.cells) for mesh in meshes]).tolist()
        numbered = list(zip(meshes, node[:-1], row[:-1], strict=True))
        return cls(
            np.concatenate([mesh.points for mesh in meshes]),
            np.concatenate([mesh.cells + n for mesh, n, _ in numbered]),
            {name: rows + r for mesh, _, r in numbered for name, rows in mesh.line_groups.items()},
            {name: one + n for mesh, n, _ in numbered for name, one in mesh.point_groups.items()},
        )

    @classmethod
    def from_gmsh_model(cls) -> Self:
        """Create a mesh from the named physical groups of the current gmsh model.

        Raises:
            ValueError: No lines, no named group of lines, elements of higher order, or a
                physical point that holds several nodes.
        """
        from flexfem.mesh.imported.gmsh_model import line_data

        return cls(*line_data())

    def group_cells(self, name: str) -> IntArray:
        """Return the cells of a line group as node indices, shape (k, 2).

        Raises:
            ValueError: There is no such group of lines.
        """
        if name not in self.line_groups:
            kind = "a point, not a line" if name in self.point_groups else "not in the mesh"
            known = ", ".join(self.line_groups)
            raise ValueError(
                f'LineMesh: group "{name}" is {kind}; its lines are {_checks.show(known, 200)}'
            )
        return self.cells[self.line_groups[name]]

    def named_nodes(self, owner: str, name: str) -> IntArray:
        """Return the nodes, ascending, of a group of lines, or the one of a point.

        Raises:
            ValueError: There is neither; the message begins with the owner.
        """
        if name in self.point_groups:
            return np.array([self.point_groups[name]], dtype=np.int64)
        if name not in self.line_groups:
            known = _checks.show(", ".join([*self.line_groups, *self.point_groups]), 200)
            raise ValueError(f"{owner}: no line or point {_checks.show(name)}; there are {known}")
        return np.unique(self.cells[self.line_groups[name]])

    def moved(self, points: npt.ArrayLike) -> Self:
        """Return the mesh with its nodes at other places, shape (n, 3), metres.

        Raises:
            TypeError: They are no numbers.
            ValueError: Another shape, or a cell of zero length.
        """
        places = _checks.array("LineMesh.moved", "points", points, self.points.shape)
        return type(self)(places, self.cells, self.line_groups, self.point_groups)

    def order(self, name: str) -> IntArray | None:
        """Return the node order along a line group, None when it branches or falls apart.

        Raises:
            ValueError: There is no such group of lines.
        """
        if name not in self._orders:
            self._orders[name] = group_order(self.group_cells(name))
        return self._orders[name]

    def curve(self, name: str, degree: int) -> NurbsCurve:
        """Return the curve through the nodes of a line group, with one element per cell.

        Models of one mesh, as those of which derivatives are taken, share it.

        Raises:
            ValueError: There is no such group of lines, it branches or falls apart, or has no such
                curve.
        """
        if (name, degree) not in self._curves:
            nodes = self.order(name)
            if nodes is None:
                raise ValueError(
                    f'group "{name}" branches or falls apart, formulation "nurbs" needs one line'
                )
            self._curves[name, degree] = NurbsCurve.through(self.points[nodes], degree=degree)
        return self._curves[name, degree]

    def __str__(self) -> str:
        """Return the numbers of nodes, cells and groups."""
        return (
            f"LineMesh: {len(self.points)} nodes, {len(self.cells)} cells, "
            f"{len(self.line_groups)} line groups, {len(self.point_groups)} point groups"
        )


def read_mesh(
    path: str | PathLike[str],
    *,
    scale: float = 1.0,
    merge: float | None = None,
    lines: Sequence[str] | None = None,
    points: Sequence[str] | None = None,
    separate: bool = False,
) -> LineMesh:
    """Read the lines of a mesh file: gmsh, Abaqus, Nastran or VTK.

    Element sets are line groups. All of the file without any set is one group called after the
    file. Node sets of one node are point groups.

    Args:
        path: Ends in .msh (formats 2.2, 4.0 and 4.1; physical groups are sets), .inp (Abaqus),
            .bdf, .dat or .nas (Nastran: property_N, material_N, set_N), .vtu or .vtk (data of
            whole numbers: NAME_VALUE). Nothing in it is executed.
        scale: Metres in a unit of length of the file, 1e-3 for millimetres.
        merge: Make nodes that are at most so far apart one, metres; None leaves them apart.
        lines: Element sets to take; None for all.
        points: Node sets to take; None for those of one node. A set of several is NAME_1, NAME_2
            and so on, in the order of the file.
        separate: Give each group nodes of its own, as beams of a model need them. Those that it
            shared with other groups are points called GROUP_seam_1 and so on, for joints (see
            :func:`weld`). Another point there is on the first of these groups.

    Returns:
        The mesh.

    Raises:
        TypeError: An argument is of the wrong kind.
        ValueError: The file is missing or unreadable, has no lines or no such set, or groups
            that are to be separate share lines.
    """
    from flexfem.mesh.imported.lines import line_data
    from flexfem.mesh.imported.read import read_mesh_file

    file = read_mesh_file(Path(path), scale, merge)
    _checks.instance(file.owner, "separate", separate, bool)
    data = line_data(file, lines, points, separate)
    try:
        return LineMesh(*data)
    except ValueError as error:
        raise ValueError(f"{file.owner}: {error}") from None


def _group(name: str, rows: object, limit: int) -> IntArray:
    """Return the checked, ascending cell indices of a line group."""
    what = f'line group "{name}"'
    indices = np.unique(_checks.indices("LineMesh", what, rows, limit, 1))
    if len(indices) == 0:
        raise ValueError(f"LineMesh: {what} must hold at least one cell, got none")
    return _checks.freeze(indices, np.int64)


def _check_cells(points: FloatArray, cells: IntArray, groups: Mapping[str, IntArray]) -> None:
    """Raise for cells of zero length, cells given twice and nodes without cell."""
    lengths = np.linalg.norm(points[cells[:, 1]] - points[cells[:, 0]], axis=1)
    size = float(np.ptp(points, axis=0).max())
    if (short := lengths <= _ZERO_LENGTH * size).any():
        _report_cell("has zero length", int(np.argmax(short)), cells, groups)
    keys = edge_keys(cells, len(points))
    _, first, counts = np.unique(keys, return_index=True, return_counts=True)
    if (counts > 1).any():
        _report_cell("occurs twice", int(first[np.argmax(counts > 1)]), cells, groups)
    lonely = np.bincount(cells.ravel(), minlength=len(points)) == 0
    if lonely.any():
        raise ValueError(f"LineMesh: node {int(np.argmax(lonely))} belongs to no cell")


def _report_cell(problem: str, cell: int, cells: IntArray, groups: Mapping[str, IntArray]) -> None:
    names = [name for name, rows in groups.items() if cell in rows]
    place = f' of group "{names[0]}"' if names else ""
    raise ValueError(
        f"LineMesh: cell {cell}{place} between nodes {cells[cell, 0]} and {cells[cell, 1]} "
        f"{problem}"
    )
