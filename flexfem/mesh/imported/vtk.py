# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points, cells and whole-numbered data of VTK files.

Read here and not with meshio, which trusts the sizes and indices in a file: some bytes ask for any
memory, and an index of -1 is the last point.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.mesh.imported.mesh_file import KINDS, MeshFile

__all__ = ["VtkGrid", "mesh_file"]

# Arrays that programs write for their own use
_OWN = ("vtk", "Global", "ObjectId", "PedigreeIds")

_KINDS = {
    3: "line", 5: "triangle", 9: "quad", 10: "tetra", 12: "hexahedron", 13: "wedge", 14: "pyramid",
    21: "line3", 22: "triangle6", 23: "quad8", 24: "tetra10", 25: "hexahedron20", 26: "wedge15",
    27: "pyramid13", 28: "quad9", 29: "hexahedron27",
}  # fmt: skip
_OTHERS = {
    1: "vertex", 2: "poly_vertex", 4: "poly_line", 6: "triangle_strip", 7: "polygon", 8: "pixel",
    11: "voxel", 42: "polyhedron",
}  # fmt: skip
# The normal of a wedge's first triangle points outwards in VTK, inwards in all other programs
_ORDER = {"wedge": [0, 2, 1, 3, 5, 4]}


@dataclass
class VtkGrid:
    """Unstructured grid of a VTK file or of a piece of it.

    Attributes:
        points: (n, 3).
        offsets: (m,) where the nodes of each cell end in `connectivity`.
        connectivity: Rows of the nodes of all cells.
        types: (m,) types of the cells.
        point_data: Whole numbers of the points by name.
        cell_data: Whole numbers of the cells by name.
    """

    points: FloatArray
    offsets: IntArray
    connectivity: IntArray
    types: IntArray
    point_data: Mapping[str, IntArray] = field(default_factory=dict)
    cell_data: Mapping[str, IntArray] = field(default_factory=dict)


def mesh_file(path: Path, grid: VtkGrid) -> MeshFile:
    """Return points, cells and sets of a file.

    Cells of the value 2 in the data "material" are the element set material_2, and points with
    the value 3 in the data "support" the node set support_3; points with 0 are in no set.

    Raises:
        ValueError: A cell has no such points, or data are not for all points or cells.
    """
    starts = _starts(path, grid)
    cells: dict[str, IntArray] = {}
    unused: dict[str, int] = {}
    rows = [np.empty(0, dtype=np.int64)]
    for kind in dict.fromkeys(grid.types.tolist()):
        mine = np.flatnonzero(grid.types == kind)
        if kind not in _KINDS:
            name = _OTHERS.get(kind, f"VTK type {kind}")
            unused[name] = unused.get(name, 0) + len(mine)
            continue
        name, width = _KINDS[kind], KINDS[_KINDS[kind]].nodes
        if (wrong := grid.offsets[mine] - starts[mine] != width).any():
            cell = mine[np.argmax(wrong)]
            _fail(path, f"cell {cell} of type {kind} has {grid.offsets[cell] - starts[cell]} nodes")
        nodes = grid.connectivity[starts[mine, np.newaxis] + np.arange(width)]
        cells[name] = nodes[:, _ORDER[name]] if name in _ORDER else nodes
        rows.append(mine)
    order = np.concatenate(rows)
    element_sets: dict[str, IntArray] = {}
    node_sets: dict[str, IntArray] = {}
    for name, values in grid.cell_data.items():
        _check_data(path, "cells", name, values, len(grid.types))
        element_sets |= _sets(name, values[order], zero=True)
    for name, values in grid.point_data.items():
        _check_data(path, "points", name, values, len(grid.points))
        node_sets |= _sets(name, values, zero=False)
    return MeshFile(path, grid.points, cells, element_sets, node_sets, unused=unused)


def _starts(path: Path, grid: VtkGrid) -> IntArray:
    """Return where the nodes of each cell begin, all within the list."""
    if len(grid.offsets) != len(grid.types):
        _fail(path, f"{len(grid.offsets)} cells and {len(grid.types)} types of cells")
    starts = np.concatenate([np.zeros(1, dtype=np.int64), grid.offsets[:-1]])[: len(grid.offsets)]
    if len(starts) and ((starts > grid.offsets).any() or grid.offsets[0] < 0):
        _fail(path, "the offsets of the cells do not ascend")
    if len(starts) and grid.offsets[-1] > len(grid.connectivity):
        _fail(path, f"the cells have {len(grid.connectivity)} nodes, not {grid.offsets[-1]}")
    count = len(grid.points)
    if (lost := (grid.connectivity < 0) | (grid.connectivity >= count)).any():
        _fail(path, f"a cell has node {grid.connectivity[lost][0]} of 0 to {count - 1}")
    return starts


def _check_data(path: Path, what: str, name: str, values: IntArray, count: int) -> None:
    if len(values) != count:
        _fail(path, f'data "{name}" have {len(values)} values for {count} {what}')


def _fail(path: Path, reason: str) -> None:
    raise ValueError(f'mesh file "{path}" cannot be read: {reason}')


def _sets(name: str, values: IntArray, *, zero: bool) -> dict[str, IntArray]:
    """Return the rows of each value of whole-numbered data."""
    if name.startswith(_OWN) or len(values) == 0:
        return {}
    order = np.argsort(values, kind="stable")
    found, starts = np.unique(values[order], return_index=True)
    return {
        f"{name}_{value}": rows
        for value, rows in zip(found.tolist(), np.split(order, starts[1:]), strict=True)
        if zero or value != 0
    }
